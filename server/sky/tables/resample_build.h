/* Construction of the table of resample.h: dividing the source into blocks, and two ways to find overlaps. Private to
 * this room. Thread: any, on separate objects. */
#pragma once

#include "base/err.h"
#include "image/codec/image.h"
#include "sky/tables/cube.h"
#include "sky/tables/layout.h"
#include "sky/tables/resample.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Overlaps smaller than this share of both texels are dropped. */
#define OVERLAP_MIN 1e-7

#define RESAMPLE_MANY 64 /* more terms than this are summed in double */

/* An image as cells (the faces of a cube; else one) of blocks of factor x factor texels; the last block of a cell may
 * be smaller. */
struct blocks {
    enum layout layout;
    uint32_t width, height, factor;
    uint32_t cell[2];     /* size of a cell, texels */
    uint32_t per_cell[2]; /* blocks per cell */
    uint32_t columns, rows;
};

void blocks_init(struct blocks *b, enum layout layout, uint32_t width, uint32_t height, uint32_t factor); /* fills *b */

/* Start and end of block `index` along coordinate k, in texels. */
uint32_t blocks_start(const struct blocks *b, int k, uint32_t index);
uint32_t blocks_end(const struct blocks *b, int k, uint32_t index); /* exclusive */

/* The corners of a block, in texels. */
void blocks_bounds(const struct blocks *b, uint32_t column, uint32_t row, double low[2], double high[2]);

/* An overlap, and a growing list of them, whose items are not zeroed. */
struct overlap {
    uint32_t texel; /* of the cube map */
    uint32_t block;
    double solid_angle; /* sr */
};

struct overlaps {
    struct overlap *items;
    size_t count, capacity;
    enum err e; /* the first error */
};

MUST_CHECK enum err overlaps_add(struct overlaps *o, uint32_t texel, uint32_t block,
                                 double solid_angle); /* ERR_NOMEM */

/* The cube map: n, rotation, and the solid angles [n][n] of a face's texels. */
struct cube_side {
    uint32_t n;
    double rotation;
    const double *solid_angle;
};

/* Borders between rows of blocks, [rows + 1] from the north pole: heights of the unit sphere, and sqrt(1 - height^2),
 * never 0. */
struct row_edges {
    double *height, *sine;
};

#define RESAMPLE_LATLONG_PARTS 5 /* four side faces, and both polar ones */

/* Whether a quarter turn about y maps a lat-long source and a cube map of n x n texels per face onto themselves. Then
 * the first side face and the first quarter of the polar faces, rows and columns below n / 2, stand for all others. */
bool resample_is_fourfold(const struct blocks *b, uint32_t n);

/* Lat-long, in closed form: adds the overlaps of one of RESAMPLE_LATLONG_PARTS * n parts of the cube map: slices of the
 * four side faces, then rows of both polar faces. With fourfold symmetry, only of the texels that stand for others. */
void resample_latlong_part(const struct blocks *b, const struct cube_side *c, const struct row_edges *edges,
                           uint32_t part, struct overlaps *out);

/* Other layouts: adds the overlaps of row `row` of the blocks, clipped as polygons against the cube map's grid. */
void resample_polygon_row(const struct blocks *b, const struct cube_side *c, uint32_t row, struct overlaps *out);

/* All overlaps, sorted by cube texel and then by block: those of texel t are items[first[t]] to [first[t + 1]]. */
struct resample_sorted {
    uint32_t *first; /* [6 n n + 1] */
    struct overlap *items;
};

/* Fills *s from all lists, which it frees on the way, and adds what symmetry has left out. The caller frees both
 * arrays, also after an error: a list's own, or ERR_NOMEM. */
MUST_CHECK enum err resample_gather(const struct blocks *b, uint32_t n, struct overlaps *lists, uint32_t count,
                                    struct resample_sorted *s);

/* Computes the table of a key, unshared. The caller owns *out. ERR_UNSUPPORTED, ERR_NOMEM. */
MUST_CHECK enum err resample_table_create(const struct resample_key *key, struct resample_table **out);
void resample_table_destroy(struct resample_table *t); /* NULL is allowed */

/* Computes t->share. ERR_NOMEM. */
MUST_CHECK enum err resample_make_share(struct resample_table *t, const struct blocks *b);

/* Row y of an image's blocks: each the mean of its texels, weighted by solid angle; masked texels have weight 0. rgb:
 * the image, float[height][width][3]; out: float[columns][3]. */
void resample_reduce_row(const struct resample_table *t, const struct blocks *b, const float *rgb, uint32_t y,
                         float *out);
