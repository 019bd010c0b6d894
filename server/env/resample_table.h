/* server/env/resample_table.h */
/* The sparse table of resample.h: which source texels a cube texel is made of, and in which shares. It takes a good
 * part of a second and some 16 MB to make, depends on nothing but its key, and never changes afterwards: any number of
 * threads and environments read one. Each user holds a reference; it is freed with the last of them.
 *
 * A `struct resample_tables` is what several environments find each other's tables in: a list of those that are in use,
 * with a lock of its own. Whoever creates it owns it and destroys it after the last environment that was given it. */
#ifndef ENV_RESAMPLE_TABLE_H
#define ENV_RESAMPLE_TABLE_H

#include "err.h"
#include "image.h"

#include <stdbool.h>
#include <stdint.h>

struct resample_key {
    enum layout layout; /* any but LAYOUT_AUTO */
    uint32_t width, height;
    uint32_t n;      /* texels along an edge of the cube's faces */
    double rotation; /* radians about +Y, right-handed: takes what the source shows at +Z towards +X */
};

bool resample_key_equal(const struct resample_key *a, const struct resample_key *b);

/* The cube map goes by tiles of 8 x 8 texels (what reaches past its edge is empty), tile (band, place) of a face being
 * rows 8 band .. and columns 8 place .., and a tile by eights: eight texels of about as many terms, so that eight sums
 * grow side by side and hardly one waits for the others. What a tile reads lies close together in the source. */
#define TILE 8
#define EIGHTS 8 /* in a tile */

#define LINE_BYTES 64

struct eight {
    uint32_t first;       /* step; it has those up to the next eight's first */
    uint32_t base : 31;   /* source block that `near` is counted from, the tile's lowest */
    uint32_t careful : 1; /* a lane has many terms, or one of them is the very last block of the source */
    uint8_t texel[8];     /* in the tile, 8 row + column, by lane */
};

struct resample_table {
    struct resample_key key;
    uint32_t users;              /* {lock of tables}: references */
    struct resample_table *next; /* {lock of tables} */

    /* Blocks of the source, row by row: columns x rows of them. With factor 1 they are its texels. */
    uint32_t factor, columns, rows;

    /* The texel in lane l of an eight is the sum over its steps k of weight[k][l] * block[base + near[k][l]] (or
     * block[base + far[k][l]]), plus unseen[eight][l] times the mean; its weights and unseen add up to 1. Blocks ascend
     * within a lane; behind the last one its weights are 0. */
    uint32_t across;      /* tiles along an edge of a face */
    struct eight *eights; /* [6][across][across][8] + 1: face, band, place */
    float *weight;        /* [steps][8] */
    uint16_t *near;       /* [steps][8]; NULL where a tile's blocks are too far apart, then: */
    uint32_t *far;
    uint32_t *line_first; /* [tiles + 1]; NULL with `far` */
    uint16_t *line;       /* cache lines that a tile reads of the source, from its base's on: to be fetched ahead */
    float *unseen;        /* [eights][8]; NULL where the layout shows everything */
    float *block_sum;     /* [blocks]: their shares of all that is seen; NULL with unseen */
    float *share;         /* solid angles of source texels, for the reduction; NULL when factor is 1 */
};

/* NULL when out of memory. */
struct resample_tables *resample_tables_create(void);
void resample_tables_destroy(struct resample_tables *s); /* no table may be in use; NULL allowed */

uint32_t resample_tables_in_use(struct resample_tables *s); /* how many; any thread */

/* A reference to the table of a key, made now if nobody has it: whoever else asks for one meanwhile waits. Give it back
 * with resample_table_release and the same tables; those may be NULL: then it is the caller's alone. The shape must fit
 * the layout (layout_fits). ERR_UNSUPPORTED when it does not, ERR_NOMEM. Any thread. Uses all OpenMP threads; the table
 * is the same at any number of them. */
MUST_CHECK enum err resample_table_take(struct resample_tables *s, const struct resample_key *key,
                                        struct resample_table **out);
void resample_table_release(struct resample_tables *s, struct resample_table *t); /* t NULL is allowed */

#endif
