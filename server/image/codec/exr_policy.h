/* Reads EXR headers without OpenEXRCore, attribute by attribute, and restricts which EXR files are accepted from the
 * network. The library's decoders of the other compressions are large, old and have had vulnerabilities; although
 * decoding is sandboxed (import/decoder/decoder.h), a remote client must not be able to reach them. Every step is
 * checked against `size`, nothing is allocated, and EXR_POLICY_ATTRIBUTES bounds the time. Thread: any. */
#pragma once

#include "base/err.h"

#include <stddef.h>
#include <stdint.h>

#define EXR_POLICY_ATTRIBUTES 1024 /* maximum number of attributes in a header */

#define EXR_COMPRESSIONS 10                                       /* that OpenEXR defines */
extern const char *const exr_compression_names[EXR_COMPRESSIONS]; /* by the format's numbers */

/* A header that is being read. */
struct exr_header {
    const uint8_t *bytes; /* the whole file */
    size_t size, at;      /* at: the next attribute */
    const char *name;     /* of the file, for messages */
    struct reason *why;
};

/* [OpenEXR File Layout]: a name, a type, a length and a value, all little-endian. They point into the file. */
struct exr_entry {
    const char *name, *type; /* terminated */
    const uint8_t *value;
    size_t size;
};

/* Reads the next attribute; the caller checks for the end of the list. ERR_FORMAT: damaged or truncated. */
MUST_CHECK enum err exr_header_next(struct exr_header *h, struct exr_entry *a);

/* ERR_OK: a single-part scan-line file with no, RLE, ZIPS or ZIP compression. ERR_UNSUPPORTED: another kind of EXR
 * file, which *why names. ERR_FORMAT: not an EXR file, or its header is damaged or truncated. Does not look past the
 * header. `name` begins the message. */
MUST_CHECK enum err exr_policy_check(const uint8_t *bytes, size_t size, const char *name, struct reason *why);
