/* server/source/source.h */
/* Where frames come from: a file, a directory, a printf or glob pattern, a watched folder, or the built-in sky.
 * `sky.%04d.exr` (one %d, %i or %u with an optional width, in the file's name; every other character, '%' included, is
 * literal) walks the numbers that exist between first and last, ascending; a directory takes its *.exr and *.hdr of any
 * case, a glob what it matches, both in byte order, counted from 0; one file is one frame with the number 0, whatever
 * digits its name has (dawn_1k.hdr is no frame 1). A name that exists is that file, whatever characters it has.
 * A spec with `{face}` in it, after which nothing may vary, means six files a frame, the faces of a cube: px, nx,
 * py, ny, pz and nz, or posx, negx and so on, in its place (`pier/{face}.hdr`, `sky.%04d.{face}.exr`).
 * `watch:DIR` gives the frames of DIR in byte order, then those that are closed after writing or moved in, as they
 * come, counted from 0 in that order; hidden names (".x.exr") are left alone, so that a writer may use and then rename
 * them. What is there at the start counts as whole. `sky:key=value,...` (see sky.h) computes frames and never ends by
 * itself. No sockets and no decoding here: `push:` belongs to relightd. One thread per source. */
#ifndef SOURCE_SOURCE_H
#define SOURCE_SOURCE_H

#include "err.h"
#include "frame.h"

#include <stdbool.h>
#include <stdint.h>

struct sky_desc;
struct source;

struct source_desc {
    const char *spec; /* S of the command line */
    bool has_range;   /* only frames with first <= number <= last */
    uint64_t first, last;
    bool loop; /* begin again after the last frame; the numbers repeat */
};

/* On ERR_OK the caller owns *out; else *out is NULL and *why names the spec and the fault.
 * ERR_IO: nothing there, or not readable. ERR_USAGE: the spec or the range makes no sense. ERR_NOMEM. */
MUST_CHECK enum err source_open(const struct source_desc *desc, struct source **out, struct reason *why);
void source_close(struct source *s); /* NULL is allowed */

/* The next frame into *f, whose memory is reused. ERR_END after the last one: *f is left as it was, so that a caller
 * may go on with the frame that stands. ERR_IO, ERR_RANGE (a file above 1 GiB),
 * ERR_NOMEM: this frame could not be read (*why says which), but the source goes on with the one after it at the next
 * call; f->kind is FRAME_NONE then. Capture time: for `watch:` the file's last modification;
 * for a sky the moment of its computation; 0, unknown, for all other files, which may have lain there for years.
 * `watch:` blocks at most 200 ms and then answers ERR_OK with f->kind FRAME_NONE, so that the caller can stop. */
MUST_CHECK enum err source_next(struct source *s, struct frame *f, struct reason *why);

/* The first frame alone, of a source that is not needed any longer. ERR_IO also where there is none. */
MUST_CHECK enum err source_first(const struct source_desc *desc, struct frame *f, struct reason *why);

/* How many frames one pass has; 0 when that is unknown or without end. */
uint64_t source_count(const struct source *s);

/* ---- Going to another place of it. A watched folder has none: there these do nothing and say so. ---- */

enum source_kind {
    SOURCE_FILES, /* one file, a folder, a pattern */
    SOURCE_WATCH,
    SOURCE_SKY,
};

enum source_kind source_kind(const struct source *s);

/* Place of the frame that was given last, from 0, before the first one 0: among the files, or of a sky's frames in its
 * range. */
uint64_t source_position(const struct source *s);

/* The next frame is the one at that place. False, and nothing is changed, where the source has none such. */
bool source_seek(struct source *s, uint64_t position);

/* The next frame is so many places after the one that was given last, or before it: round the end where the source
 * loops, else no further than its ends. */
bool source_step(struct source *s, int64_t by);

/* Solar time, 0 to 24, of the frame that was given last; false where the source is no computed sky. */
bool source_hour(const struct source *s, double *out);

/* The next frame, and those after it in their steps, has this solar time of the day of the one that was given last: as
 * though `time=` of the sky had been another. Numbers go on as they would. */
bool source_set_hour(struct source *s, double hour);

/* The sky as its hour now stands; NULL where the source is none. Lives as long as s. */
const struct sky_desc *source_sky(const struct source *s);

#endif
