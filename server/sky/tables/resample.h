/* Resampling from a source layout to the cube map: a sparse matrix of the solid angles in which source and cube texels
 * overlap, computed once per layout, size and rotation and applied to every frame. A constant sky
 * stays constant, and each source texel's energy is conserved, both to 1e-5. Directions that a layout does not cover (a
 * fisheye's lower hemisphere) get the mean of the covered ones [LPG13, 3]. An image of many more texels than the cube
 * map can use is first reduced to blocks of factor x factor texels, weighted by solid angle, so that the table stays
 * below about 100 MB. Thread: one at a time, except resampler_band. */
#pragma once

#include "base/err.h"
#include "image/codec/image.h"
#include "sky/tables/cube.h"
#include "sky/tables/layout.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- Tables ---- */

/* The sparse matrix of resample.h: the source texels and weights of each cube texel. It takes some tenths of a second
 * and about 16 MB to compute, depends only on its key, and never changes afterwards, so that any number of threads and
 * environments can share it. Tables are reference-counted.
 *
 * A `struct resample_tables` is the list of tables in use, with its own lock, through which environments share them.
 * Its creator owns it and destroys it after the last environment that uses it. Thread: any. */

struct resample_key {
    enum layout layout; /* any but LAYOUT_AUTO */
    uint32_t width, height;
    uint32_t n;      /* texels per edge of a cube face */
    double rotation; /* radians about +Y, right-handed: moves what the source shows at +Z towards +X */
};

bool resample_key_equal(const struct resample_key *a, const struct resample_key *b); /* field by field */

/* The cube map is processed in tiles of 8 x 8 texels (padded at its edge); tile (band, place) of a face covers rows 8
 * band .. and columns 8 place ... A tile consists of octets: eight texels with similar numbers of terms, summed in
 * parallel with little padding. What a tile reads is close together in the source. */
#define TILE 8
#define OCTETS 8 /* octets in a tile */

#define LINE_BYTES 64 /* a cache line */

struct octet {
    uint32_t first;       /* index of the first step; the octet's steps end at the next octet's first */
    uint32_t base : 31;   /* the tile's lowest source block; `near` is relative to it */
    uint32_t careful : 1; /* a lane has many terms, or one of them is the last block of the source */
    uint8_t texel[8];     /* in the tile, 8 row + column, per lane */
};

struct resample_table {
    struct resample_key key;
    uint32_t users;              /* {lock of tables} reference count */
    struct resample_table *next; /* {lock of tables} */

    /* The source in blocks, row by row: columns x rows. With factor 1, blocks are texels. */
    uint32_t factor, columns, rows;

    /* The texel in lane l of an octet is the sum over its steps k of weight[k][l] * block[base + near[k][l]] (or
     * block[base + far[k][l]]) plus unseen[octet][l] times the mean. Weights and unseen sum to 1. Blocks ascend within
     * a lane; padding has weight 0. */
    uint32_t across;      /* tiles per edge of a face */
    struct octet *octets; /* [6][across][across][8] + 1: face, band, place */
    float *weight;        /* [steps][8] */
    uint16_t *near;       /* [steps][8]; NULL if a tile's blocks are too far apart; then `far` is used */
    uint32_t *far;
    uint32_t *line_first; /* [tiles + 1]; NULL if `far` is used */
    uint16_t *line;       /* cache lines of the source that a tile reads, relative to its base; for prefetching */
    float *unseen;        /* [octets][8]; NULL if the layout covers everything */
    float *block_sum;     /* [blocks]: weights of the mean; NULL if unseen is */
    float *share;         /* solid angles of source texels, for the reduction; NULL if factor is 1 */
};

/* NULL when out of memory. */
struct resample_tables *resample_tables_create(void);
void resample_tables_destroy(struct resample_tables *s); /* no table may be in use; NULL is allowed */

/* Acquires the table of a key, computing it if necessary; concurrent requests for the same table wait. Release it with
 * resample_table_release and the same `tables`, which may be NULL for an unshared table. The size must fit the layout
 * (layout_fits). ERR_UNSUPPORTED: it does not. ERR_NOMEM. Uses all OpenMP threads; the table does not depend on their
 * number. */
MUST_CHECK enum err resample_table_take(struct resample_tables *s, const struct resample_key *key,
                                        struct resample_table **out);
void resample_table_release(struct resample_tables *s, struct resample_table *t); /* t may be NULL */

struct resampler { /* per-frame state */
    const struct resample_table *table;
    struct resample_tables *tables; /* where the table came from; may be NULL */
    struct resample_table *taken;   /* the same table, to be released */
    float *reduced;                 /* [blocks][3]; NULL when the table's factor is 1 */
    const float *source;            /* the loaded frame: the caller's texels, or `reduced` */
    float mean[3];                  /* mean of the covered directions; 0 if the layout covers everything */
};

/* Takes the table from `tables`, which must outlive the resampler, or creates its own if NULL. On ERR_OK the caller
 * owns *out. ERR_UNSUPPORTED: the size does not fit the layout. ERR_NOMEM. */
MUST_CHECK enum err resampler_create(struct resample_tables *tables, const struct resample_key *key,
                                     struct resampler **out);
void resampler_destroy(struct resampler *r); /* NULL is allowed */

/* Loads a frame's texels, float[height][width][3], which must stay valid while bands are computed. Uses all OpenMP
 * threads. */
void resampler_load(struct resampler *r, const float *rgb);

/* Texels per row of a band: padded, and not a power of two, so that a column does not map to a single cache set. */
#define RESAMPLE_PITCH(n) (((n) + 7) / 8 * 8 + 4)

/* Computes band b of face f, b < (n + 7) / 8: rows 8 b .. 8 b + 7 of the cube map of the loaded frame, times gain, to
 * texels[8][RESAMPLE_PITCH(n)][4]. The fourth float and the padding are undefined. Thread: any. */
void resampler_band(const struct resampler *r, float gain, uint32_t face, uint32_t b, float *texels);

/* ---- Construction of tables ---- */

/* Construction of the table of resample.h: dividing the source into blocks, and two ways to find overlaps. Private to
 * this room. Thread: any, on separate objects. */

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
