/* server/chart/truth_file.h */
/* A reference on disk: the sum of the parts that are done, stored whole after each of them (base/file_store.h), so that
 * work goes on after an interruption where it was. The file is this machine's own, in its byte order: magic, sizes,
 * key, parts, checksum, then double[height][width][3]. One thread at a time per file. */
#ifndef CHART_TRUTH_FILE_H
#define CHART_TRUTH_FILE_H

#include "base/digest.h"
#include "base/err.h"

#include <stdint.h>

struct truth_sum {
    double *rgb; /* [height][width][3]: sum over the parts */
    uint32_t width, height;
    uint32_t parts; /* done */
};

/* Reads into sum->rgb, which the caller made for width x height. ERR_END: there is no such file, which is where all
 * begins. ERR_FORMAT: cut short, damaged, or of something else; *why says which. ERR_IO. Except on ERR_OK the sum is
 * all zero. */
MUST_CHECK enum err truth_file_load(const char *path, const struct digest *key, struct truth_sum *sum,
                                    struct reason *why);

MUST_CHECK enum err truth_file_store(const char *path, const struct digest *key, const struct truth_sum *sum,
                                     struct reason *why);

#endif
