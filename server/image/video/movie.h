/* Video files: frames of one size at a constant rate, encoded as H.264 by libx264 or AV1 by SVT-AV1. A file appears
 * whole or not at all (base/file_store.h). Thread: one per movie; the encoder starts threads of its own. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stdint.h>

/* Whether this build writes video files. Thread: any. */
bool movie_available(void);

struct movie_desc {
    const char *path;       /* borrowed until movie_create returns, as is the next one */
    const char *container;  /* "mp4" or "mkv" with H.264, "webm" with AV1 */
    uint32_t width, height; /* an odd side is padded by repeating its last pixel */
    double rate;            /* frames per second */
    int quality;            /* 1..100 */
    bool pq;                /* 10 bits, BT.2020, PQ, with the metadata of mux.h; else 8 bits, BT.709; limited range */
};

struct movie;

/* ERR_UNSUPPORTED: not in this build, or the encoder refuses the size. ERR_IO: the file. ERR_NOMEM. On ERR_OK the
 * caller owns *out. */
MUST_CHECK enum err movie_create(const struct movie_desc *desc, struct movie **out, struct reason *why);

/* The next frame: uint16_t[height][width][3], 65535 a signal of 1 in the colours of the desc. ERR_IO, ERR_NOMEM: no
 * file will appear; only movie_destroy may follow. */
MUST_CHECK enum err movie_add(struct movie *m, const uint16_t *rgb, struct reason *why);

/* Encodes what is pending and puts the file in its place; without a frame there is no file. Only movie_destroy may
 * follow. Errors of movie_add. */
MUST_CHECK enum err movie_finish(struct movie *m, struct reason *why);

/* Leaves no file unless movie_finish succeeded. NULL is allowed. */
void movie_destroy(struct movie *m);
