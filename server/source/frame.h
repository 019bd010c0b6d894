/* server/source/frame.h */
/* One environment frame on its way from a source to env: either the bytes of a file, not yet decoded, or the texels
 * of a sky that was computed. The frame owns what it points to and is reused: frame_reserve_* keep the larger block,
 * until it has been far too large for some frames (recent.h). */
#ifndef SOURCE_FRAME_H
#define SOURCE_FRAME_H

#include "err.h"
#include "recent.h"

#include <stddef.h>
#include <stdint.h>

enum frame_kind {
    FRAME_NONE,
    FRAME_FILE,   /* bytes of an EXR or Radiance file */
    FRAME_TEXELS, /* linear Rec.709 radiance, float[height][width][3], lat-long with +Y at the top where `layout` is ""
                   */
};

struct frame {
    enum frame_kind kind;
    uint64_t number;    /* the source's own number: a pattern's, or counted from 0 */
    int64_t capture_us; /* when the light was captured, wall clock; 0: unknown (source.h says of which) */
    char name[256];     /* for messages: the file's path, or what the sky is */
    char layout[16];    /* a name that env's layout_parse reads; "": as the file says, and lat-long for texels */

    uint8_t *bytes; /* FRAME_FILE */
    size_t size;
    size_t bytes_capacity;
    size_t faces[6]; /* bytes of each of six files that stand one after another in `bytes`: the faces px, nx, py, ny, pz
                      * and nz of a cube; all 0: one file */

    float *rgb; /* FRAME_TEXELS */
    uint32_t width, height;
    size_t rgb_capacity; /* floats */

    struct recent recent_bytes, recent_rgb; /* what was reserved, in bytes */
};

/* Make room for `size` bytes or width x height texels and set kind and sizes; the contents are undefined. ERR_NOMEM
 * leaves FRAME_NONE. */
MUST_CHECK enum err frame_reserve_bytes(struct frame *f, size_t size);
MUST_CHECK enum err frame_reserve_texels(struct frame *f, uint32_t width, uint32_t height);

void frame_finish(struct frame *f); /* frees; zeroed memory and NULL are allowed */

#endif
