/* server/codec/exr_policy.h */
/* Restricts which EXR files are accepted from the network. The decoders of the other compressions are large, old and
 * have had vulnerabilities; although decoding is sandboxed (decoder/decoder.h), a remote client must not be able to
 * reach them. The check parses the header without the library it protects: every step is checked against `size`,
 * nothing is allocated, and EXR_POLICY_ATTRIBUTES bounds its time. Thread: any. */
#ifndef CODEC_EXR_POLICY_H
#define CODEC_EXR_POLICY_H

#include "base/err.h"

#include <stddef.h>
#include <stdint.h>

#define EXR_POLICY_ATTRIBUTES 1024 /* maximum number of attributes in a header */

/* ERR_OK: a single-part scan-line file with no, RLE, ZIPS or ZIP compression. ERR_UNSUPPORTED: another kind of EXR
 * file, which *why names. ERR_FORMAT: not an EXR file, or its header is damaged or truncated. Does not look past the
 * header. `name` begins the message. */
MUST_CHECK enum err exr_policy_check(const uint8_t *bytes, size_t size, const char *name, struct reason *why);

#endif
