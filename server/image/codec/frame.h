/* One environment frame on its way from a source to env: either the bytes of a file, not yet decoded, or the texels of
 * a computed sky. The frame owns its buffers and is reused; frame_reserve_* keep the larger buffer until it has been
 * far too large for several frames (base/mem.h). Thread: one at a time. */
#pragma once

#include "base/err.h"
#include "base/mem.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define FRAME_NUMBER_MAX ((UINT64_C(1) << 53) - 1)    /* of any frame (PROTOCOL.md 1.5) */
#define FRAME_CAPTURE_MAX_US ((INT64_C(1) << 53) - 1) /* of a capture time, which may be as far below 0 */

enum frame_kind {
    FRAME_NONE,
    FRAME_FILE,   /* bytes of an EXR or Radiance file */
    FRAME_TEXELS, /* linear Rec.709 radiance, float[height][width][3], lat-long with +Y at the top if `layout` is "" */
};

struct frame {
    enum frame_kind kind;
    uint64_t number;    /* the source's frame number: from a file name, or counted from 0 */
    int64_t capture_us; /* capture time, microseconds since 1970-01-01 UTC; 0: unknown (see source.h) */
    double units;       /* of the texels per W sr^-1 m^-2; 0: unknown, so that they are relative to each other alone */
    char name[256];     /* for messages: a file's path or a description of the sky */
    double turn;        /* degrees about +Y, in addition to the rotation of what takes it */
    bool placed;        /* made here: `layout` is what the texels have, whatever layout is asked for */
    float gain[3];      /* by which a captured sky's channels were multiplied to steady them (sky/between); 0: none */
    bool sun_restored;  /* its clipped sun was given its energy back */
    char layout[16];    /* a layout's name, as layout_parse reads it; "": the file's own, and lat-long for texels */

    uint8_t *bytes; /* FRAME_FILE */
    size_t size;
    size_t bytes_capacity;
    size_t faces[6]; /* sizes of six files stored one after another in `bytes`: the faces px, nx, py, ny, pz and nz of a
                        cube map; all 0: a single file */

    float *rgb; /* FRAME_TEXELS */
    uint32_t width, height;
    size_t rgb_capacity; /* floats */

    struct recent recent_bytes, recent_rgb; /* recent sizes, bytes */
};

/* Reserve `size` bytes or width x height texels and set kind and size; the contents are undefined and without units.
 * ERR_NOMEM: the kind becomes FRAME_NONE. */
MUST_CHECK enum err frame_reserve_bytes(struct frame *f, size_t size);
/* See frame_reserve_bytes. */
MUST_CHECK enum err frame_reserve_texels(struct frame *f, uint32_t width, uint32_t height);

void frame_finish(struct frame *f); /* frees the buffers; zeroed memory and NULL are allowed */
