/* server/env/resample_build.h */
/* How the table of resample.h is made: the source cut into blocks, and two ways to find what overlaps what. Inside the
 * room only. */
#ifndef ENV_RESAMPLE_BUILD_H
#define ENV_RESAMPLE_BUILD_H

#include "cube.h"
#include "err.h"
#include "image.h"
#include "layout.h"
#include "resample_table.h"

#include <stddef.h>
#include <stdint.h>

/* Overlaps smaller than this share of both texels are left out. */
#define OVERLAP_LEAST 1e-7

#define RESAMPLE_MANY 64 /* terms that are still added in float */

/* A picture as cells (the faces of a cube; else one) of blocks of factor x factor texels; the last block of a cell may
 * be smaller. */
struct blocks {
    enum layout layout;
    uint32_t width, height, factor;
    uint32_t cell[2];     /* width and height of a cell, in texels */
    uint32_t per_cell[2]; /* blocks in it */
    uint32_t columns, rows;
};

void blocks_init(struct blocks *b, enum layout layout, uint32_t width, uint32_t height, uint32_t factor);

/* Where along coordinate k block `index` begins and ends, in texels. */
uint32_t blocks_start(const struct blocks *b, int k, uint32_t index);
uint32_t blocks_end(const struct blocks *b, int k, uint32_t index);

/* The corners of a block, in texels. */
void blocks_bounds(const struct blocks *b, uint32_t column, uint32_t row, double low[2], double high[2]);

/* One overlap, and a list of them that grows. */
struct overlap {
    uint32_t texel; /* of the cube map */
    uint32_t block;
    double solid_angle; /* sr */
};

struct overlaps {
    struct overlap *items;
    size_t count, capacity;
    enum err e; /* what stopped it */
};

MUST_CHECK enum err overlaps_add(struct overlaps *o, uint32_t texel, uint32_t block, double solid_angle);

/* What the cube map's side of the table needs: n, the rotation, and the solid angles [n][n] of a face's texels. */
struct cube_side {
    uint32_t n;
    double rotation;
    const double *solid_angle;
};

/* Lat-long, in closed form: the overlaps of row `row` of 6n of the cube map. edge_cos[rows + 1]: heights of the borders
 * between the blocks' rows, from the north pole, descending. */
void resample_latlong_row(const struct blocks *b, const struct cube_side *c, const double *edge_cos, uint32_t row,
                          struct overlaps *out);

/* The others: the overlaps of row `row` of the blocks, which is cut by the cube map's grid as polygons on its faces. */
void resample_polygon_row(const struct blocks *b, const struct cube_side *c, uint32_t row, struct overlaps *out);

/* The table of a key, without its sharing. ERR_UNSUPPORTED, ERR_NOMEM. */
MUST_CHECK enum err resample_table_create(const struct resample_key *key, struct resample_table **out);
void resample_table_destroy(struct resample_table *t); /* NULL is allowed */

/* t->share. ERR_NOMEM. */
MUST_CHECK enum err resample_make_share(struct resample_table *t, const struct blocks *b);

/* Row y of the blocks of a picture: each the mean of its texels, weighted by solid angle. What is masked weighs
 * nothing. */
void resample_reduce_row(const struct resample_table *t, const struct blocks *b, const float *rgb, uint32_t y,
                         float *out);

#endif
