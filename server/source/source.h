/* server/source/source.h */
/* Where frames come from: a file, a directory, a printf or glob pattern, a watched folder, or the built-in sky.
 * `sky.%04d.exr` walks the numbers that exist between first and last, ascending; a directory or glob walks names in
 * byte order and counts from 0; one file is one frame with the number in its name's last run of digits, or 0;
 * `watch:DIR` waits for files that appear whole; `sky:key=value,...` computes frames and never ends by itself.
 * No sockets and no decoding here. One thread per source. */
#ifndef SOURCE_SOURCE_H
#define SOURCE_SOURCE_H

#include "err.h"
#include "frame.h"

#include <stdbool.h>

struct source;

struct source_desc {
    const char *spec; /* S of the command line */
    bool has_range;   /* only frames with first <= number <= last */
    uint64_t first, last;
    bool loop; /* begin again after the last frame; the numbers repeat */
};

/* On ERR_OK the caller owns *out; else *out is NULL and *why names the spec and the fault.
 * ERR_IO: nothing there, or not readable. ERR_USAGE: the spec makes no sense. */
MUST_CHECK enum err source_open(const struct source_desc *desc, struct source **out, struct reason *why);
void source_close(struct source *s); /* NULL is allowed */

/* The next frame into *f, whose memory is reused. ERR_END after the last one. ERR_IO, ERR_RANGE: this frame could not
 * be read (*why says which file), but the source goes on with the one after it at the next call.
 * `watch:` blocks at most 200 ms and then answers ERR_OK with f->kind FRAME_NONE, so that the caller can stop. */
MUST_CHECK enum err source_next(struct source *s, struct frame *f, struct reason *why);

/* How many frames one pass has; 0 when that is unknown or without end. */
uint64_t source_count(const struct source *s);

#endif
