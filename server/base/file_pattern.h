/* server/base/file_pattern.h */
/* Names of numbered files: "picture.%04d.exr". At most one %d or %0Nd; no other '%', since the name would not be what
 * was meant. Any thread. */
#ifndef BASE_FILE_PATTERN_H
#define BASE_FILE_PATTERN_H

#include "err.h"

#include <stddef.h>
#include <stdint.h>

struct file_pattern {
    const char *text; /* borrowed */
    size_t at;        /* where the number goes */
    size_t length;    /* of what stands for it; 0: there is none, and all files have the same name */
    unsigned digits;  /* at least so many, with zeros in front */
};

/* `flag`, as "--out", begins the reason. ERR_USAGE. */
MUST_CHECK enum err file_pattern_parse(const char *text, const char *flag, struct file_pattern *out,
                                       struct reason *why);

/* ERR_USAGE when the name does not fit. */
MUST_CHECK enum err file_pattern_name(const struct file_pattern *p, uint64_t number, char *name, size_t size,
                                      struct reason *why);

#endif
