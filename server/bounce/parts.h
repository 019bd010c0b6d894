/* Inside the cache of interreflection (bounce.h). Light that goes on from a place is kept as a row over the basis, K
 * numbers for each colour: what the place has of the sky's K coefficients. Rows of `sources` are those of the records
 * and, behind them, those of the cells themselves, which a path that leaves the scene ends in. */
#ifndef BOUNCE_PARTS_H
#define BOUNCE_PARTS_H

#include "bounce/bounce.h"
#include "brdf/lobe.h"
#include "base/progress.h"
#include "base/rng.h"
#include "scene/scatter.h"
#include "transport/parts.h"

#define BOUNCE_BASIS_MAX 128 /* K, a multiple of 16 */

#define BOUNCE_BASIS_RAYS 512u
#define BOUNCE_SPOTS 8u /* of a record; two make a packet */

/* ---- Records ---- */

struct bounce_spot { /* a place where a path has met a rough surface */
    struct vec3 at;  /* off the surface */
    struct vec3 geometric, shading;
    float length;   /* m: of the ray that met it */
    uint64_t order; /* a random number of its own: which of many a record takes does not depend on threads */
    uint64_t key;   /* of its voxel */
    uint32_t kind;  /* enum lobe_kind */
};

struct bounce_spots {
    struct bounce_spot *at;
    uint32_t count;
    size_t capacity;
    bool failed; /* out of memory */
};

struct bounce_records {
    struct vec3 eye;
    float angle; /* a voxel's size over its distance from the eye, before it is rounded to a power of two */
    uint32_t count;
    struct bounce_spot *spots; /* [count + 1][BOUNCE_SPOTS], repeated where a voxel has fewer */
    uint32_t *table;           /* [mask + 1]: record + 1 by key, 0 where there is none */
    uint32_t mask;
};

#define BOUNCE_NO_RECORD UINT32_MAX
/* The record for a spot's place, from x in [0, 1)^2. */
uint32_t bounce_find(const struct bounce_records *r, const struct bounce_spot *s, const double x[2]);

/* Makes records of the spots, with voxels so large that there are at most `most`; r->eye and the first r->angle are
 * set. Spots are sorted. ERR_NOMEM. */
MUST_CHECK enum err bounce_records_init(struct bounce_records *r, struct bounce_spots *spots, uint32_t most);
void bounce_records_finish(struct bounce_records *r); /* zeroed memory is allowed */

/* ---- Paths ---- */

struct bounce_end {  /* where a path has found light */
    uint32_t source; /* record, or count of records + cell */
    float weight[3];
};

struct bounce_ends {
    struct bounce_end *at;
    uint32_t count;
    size_t capacity;
    bool failed;
    uint64_t rays;
};

struct bounce_world { /* borrowed */
    const struct scene *scene;
    const struct rays *rays;
    const struct bounce_records *records;
    struct bounce_spots *found; /* not NULL: matte surfaces are written down here, and nothing ends */
};

/* Follows a ray from a rough surface: light that arrives by way of other rough surfaces, as ends. Returns the distance
 * to what is met first, INFINITY where nothing is. */
float bounce_walk(const struct bounce_world *w, struct vec3 origin, struct vec3 dir, struct rng *rng,
                  struct bounce_ends *ends);

/* A ray from a spot by its matte part. False: it would go below the surface. */
bool bounce_leave(const struct bounce_spot *s, const double x[2], struct vec3 *dir, float *weight);

/* ---- The basis ---- */

struct bounce_basis {
    uint32_t count; /* K */
    float *rows;    /* [K][SKY_CELLS], orthonormal */
    double rest;
};

/* Of m: [rows][SKY_CELLS]. ERR_NOMEM. */
MUST_CHECK enum err bounce_basis_init(struct bounce_basis *b, const float *m, uint32_t rows);
void bounce_basis_finish(struct bounce_basis *b);

/* ---- The sky ---- */

#define BOUNCE_WIDE (SKY_EDGE + 2) /* a face with a border of its neighbours' cells */
#define BOUNCE_SKY_FACE_PARTS 4u   /* of a face, summed apart */
#define BOUNCE_SKY_PARTS (CUBE_FACES * BOUNCE_SKY_FACE_PARTS)

struct bounce_tent_sums {
    float at[BOUNCE_WIDE][BOUNCE_WIDE][4]; /* red, green, blue, solid angle */
};

struct bounce_tents {
    struct bounce_tent_sums parts[CUBE_FACES][BOUNCE_SKY_FACE_PARTS];
};

/* Means of the whole sky over the tents: each of BOUNCE_SKY_PARTS by itself, on any thread, of an environment whose
 * pyramid is complete; then out[3][SKY_CELLS] of them all. */
void bounce_sky_part(const struct environment *e, uint32_t part, struct bounce_tents *t);
void bounce_sky_deal(const struct bounce_tents *t, float out[3][SKY_CELLS]);

/* A cell by its tent's weight at w, from x in [0, 1). */
uint32_t bounce_cell(struct vec3 w, double x);

/* ---- Blocks ---- */

#define BOUNCE_RANK_MAX 256u /* of a block */
#define BOUNCE_GROUP 16u     /* blocks that have their V in common */

/* A row of a group's blocks: T = U W V, in bytes of -127 to 127. V [rank][3][basis] comes first, then for each block a
 * gain for each of its ranks, by which their products are multiplied (floats, not aligned), W [its
 * rank][bounce_columns(rank)] and U [its rank][points]. What comes behind V goes elsewhere once all is there
 * (bounce_lay_out). */
struct bounce_piece {
    int8_t *bytes; /* NULL: all is zero */
    uint32_t rank;
    uint32_t basis; /* coefficients that count, a multiple of 16 */
};

struct bounce_block {
    uint32_t first, packets, rows;
    uint32_t group;
    uint8_t rank[TRANSPORT_ROWS]; /* below BOUNCE_RANK_MAX */
};

/* Of a block, by its first packet. */
struct bounce_place {
    uint32_t at;            /* in bounce.stream, / 8 */
    uint16_t rows, packets; /* 0: there is none */
};

/* What stands before a block's bytes for each of its rows. */
struct bounce_row {
    uint32_t z; /* its group's: a place in bounce.z */
    uint16_t rank, columns;
};

struct bounce_group {
    uint32_t first, count; /* blocks */
    uint32_t rows;
    struct bounce_piece pieces[TRANSPORT_ROWS];
    float *z[TRANSPORT_ROWS]; /* [3][bounce_columns(rank)]: V times the frame's sky */
};

/* Columns of W: the rest of the last sixteen are 0. */
static inline uint32_t bounce_columns(uint32_t rank)
{
    return (rank + PACKET - 1) / PACKET * PACKET;
}

static inline size_t bounce_block_bytes(uint32_t rank, uint32_t columns, uint32_t points)
{
    return rank * (sizeof(float) + columns + points);
}

/* Of a row's piece. blocks: the group's. */
static inline size_t bounce_piece_bytes(const struct bounce_group *g, const struct bounce_block *blocks, uint32_t row)
{
    const struct bounce_piece *q = &g->pieces[row];
    size_t count = (size_t)q->rank * 3 * q->basis;

    for (uint32_t k = 0; k < g->count; k++)
        count += bounce_block_bytes(blocks[k].rank[row], bounce_columns(q->rank), blocks[k].packets * PACKET);
    return count;
}

struct bounce_kernels {
    /* The sky's coefficients: y[3][K] = Q L; L: [3][SKY_CELLS]. */
    void (*take)(const struct bounce_basis *q, float (*sky)[SKY_CELLS], float *y);
    /* to[c][k] += weight[c] * from[c][k]; k < basis, a multiple of 16. */
    void (*add)(float *to, const float *from, const float weight[3], uint32_t basis);
    /* z[c][rank] = V y; y [3][basis]; z is 0 behind that, up to bounce_columns(rank). */
    void (*project)(const struct bounce_piece *q, const float *y, uint32_t basis, float *z);
    /* out[c][point] = U gain W z of a block, whose gains are the first of `bytes`; points: a multiple of 16. */
    void (*expand)(const int8_t *bytes, uint32_t rank, const float *z, uint32_t columns, uint32_t points,
                   float out[3][TRANSPORT_POINTS]);
};

/* The loops for the CPU level of k. Never NULL; any thread. */
const struct bounce_kernels *bounce_kernels_of(const struct kernels *k);

struct bounce {
    const struct gbuffer *gbuffer;
    const struct kernels *kernels;
    struct bounce_basis basis;
    struct bounce_block *blocks;
    uint32_t block_count;
    struct bounce_group *groups;
    uint32_t group_count;
    struct bounce_place *places;   /* [packet_count] */
    uint8_t *stream;               /* of each block its rows' heads, and behind these their bytes */
    float *z;                      /* of all groups */
    float y[3 * BOUNCE_BASIS_MAX]; /* the frame's sky in the basis: [3][basis.count] */
    struct bounce_tents *tents;    /* of the frame's sky */
    struct transport_indirect indirect;
    uint32_t *left_index;
    struct packet_list left;
    struct bounce_stats stats;
};

/* ---- Building ---- */

struct bounce_build {
    struct bounce *b;
    const struct bounce_desc *desc;
    struct bounce_records records;
    struct transport_directions directions;
    uint16_t *light;         /* [records + 1][SKY_CELLS], half floats: what arrives at a record from a cell at once */
    float *sources;          /* [records + SKY_CELLS][3][K] */
    float *even;             /* [K]: coefficients of a sky of 1 */
    double (*numbers[2])[2]; /* of a gather: by the matte part, by the lobe */
    void (*widen)(const uint16_t *in, float *out, uint32_t n);
    uint32_t gather, most; /* rays of a point; records */
    uint64_t rays;
};

/* The steps of building in their order, each a file's own. All may be called with a build that is cancelled, and then
 * leave early. ERR_NOMEM. */
MUST_CHECK enum err bounce_find_records(struct bounce_build *b);
MUST_CHECK enum err bounce_light_records(struct bounce_build *b); /* light */
MUST_CHECK enum err bounce_make_basis(struct bounce_build *b);
MUST_CHECK enum err bounce_solve(struct bounce_build *b); /* sources */
MUST_CHECK enum err bounce_gather_blocks(struct bounce_build *b);

/* A cache with the blocks of the direct transport, and nothing of what is in them. NULL when out of memory. */
struct bounce *bounce_begin(const struct bounce_desc *d, const struct kernels *kernels);

/* Once all is there: where frames find it, bytes and mean ranks. ERR_NOMEM. */
MUST_CHECK enum err bounce_close(struct bounce *b);

/* Moves the blocks' bytes out of the pieces, which keep V alone, to where frames read them; room for z. ERR_NOMEM. */
MUST_CHECK enum err bounce_lay_out(struct bounce *b);

/* Fills b->indirect: the last step. */
void bounce_set_indirect(struct bounce *b);

/* A row's bytes of a block, once all that is done. */
const int8_t *bounce_block_row(const struct bounce *b, const struct bounce_block *block, uint32_t row);

/* ERR_RANGE. */
MUST_CHECK enum err bounce_say_too_large(uint64_t max_bytes, struct reason *why);

/* Orders the blocks by groups. ERR_NOMEM. */
MUST_CHECK enum err bounce_group(struct bounce *b, const struct bounce_desc *d);

#endif
