/* Names of numbered files: "image.%04d.exr". A pattern has at most one %d or %0Nd and no other '%'. Thread: any. */
#pragma once

#include "base/err.h"

#include <stddef.h>
#include <stdint.h>

struct file_pattern {
    const char *text; /* borrowed */
    size_t at;        /* offset of the conversion */
    size_t length;    /* of the conversion; 0: none, so every file has the same name */
    unsigned digits;  /* minimum number of digits, zero-padded */
};

/* Parses a pattern; *out borrows `text`. `flag`, such as "--out", begins the message. ERR_USAGE: not a valid pattern.
 */
MUST_CHECK enum err file_pattern_parse(const char *text, const char *flag, struct file_pattern *out,
                                       struct reason *why);

/* Writes the name of file `number` into name[size]. ERR_USAGE: the name does not fit. */
MUST_CHECK enum err file_pattern_name(const struct file_pattern *p, uint64_t number, char *name, size_t size,
                                      struct reason *why);
