/* Private to the cache of indirect light (bounce.h). The light that leaves a place is stored as a row: K numbers per
 * colour, whose product with the K coefficients of the sky is the radiance. `sources` holds the rows of the records,
 * followed by the rows of the cells, for paths that leave the scene. Thread: one per object, unless stated
 * otherwise. */
#pragma once

#include "base/progress.h"
#include "base/rng.h"
#include "light/cache/cache_file.h"
#include "light/cache/cache_share.h"
#include "light/cache_direct/internal.h"
#include "light/cache_indirect/indirect.h"
#include "scene/surface/lobe.h"
#include "scene/surface/scatter.h"

#define INDIRECT_BASIS_MAX 128 /* K, a multiple of 16 */

#define INDIRECT_SPOTS 8u /* per record: half a packet */
#define INDIRECT_SIDE 4u  /* squared: a cell's directions towards the light of records */

/* ---- Records ---- */

struct indirect_spot { /* a hit on a rough surface */
    struct vec3 at;    /* m, offset from the surface */
    struct vec3 geometric, shading;
    float length;   /* m: of the ray that hit it */
    uint64_t order; /* random: decides which spots a record keeps, so that the choice is independent of the number of
                       threads */
    uint64_t key;   /* of the voxel that contains it */
    uint32_t kind;  /* enum lobe_kind */
};

struct indirect_spots {
    struct indirect_spot *at;
    uint32_t count;
    size_t capacity;
    bool failed; /* out of memory */
};

struct indirect_records {
    struct vec3 eye;
    float angle; /* size of a voxel / distance from the eye, before rounding to a power of two */
    uint32_t count;
    struct indirect_spot *spots; /* [count + 1][INDIRECT_SPOTS]; a voxel with fewer spots repeats them */
    uint32_t *table;             /* [mask + 1]: hash table by key of record + 1; 0: empty */
    uint32_t mask;
};

#define INDIRECT_NO_RECORD UINT32_MAX
/* The record at a spot, chosen among neighbouring ones by x in [0, 1)^2; INDIRECT_NO_RECORD: none. Thread: any. */
uint32_t indirect_find(const struct indirect_records *r, const struct indirect_spot *s, const double x[2]);

/* Groups the spots, which it sorts, by voxel into at most `most` records: enlarges r->angle as needed. r->eye and
 * r->angle must be set. ERR_NOMEM. */
MUST_CHECK enum err indirect_records_init(struct indirect_records *r, struct indirect_spots *spots, uint32_t most);
void indirect_records_finish(struct indirect_records *r); /* frees the memory; zeroed memory is allowed */

/* ---- Paths ---- */

struct indirect_end { /* the end of a path at a source of light */
    uint32_t source;  /* index of a record, or number of records + cell */
    float weight[3];
};

struct indirect_ends {
    struct indirect_end *at;
    uint32_t count;
    size_t capacity;
    bool failed;
    uint64_t rays;
};

struct indirect_world { /* borrowed */
    const struct scene *scene;
    const struct rays *rays;
    const struct indirect_records *records;
    struct indirect_spots *found; /* not NULL: records hits on matte surfaces here and returns no ends */
};

/* Traces a path from a rough surface and adds its ends: the light that arrives via other rough surfaces. Returns the
 * distance of the first hit, INFINITY if there is none. Thread: any, with its own rng and ends. */
float indirect_walk(const struct indirect_world *w, struct vec3 origin, struct vec3 dir, struct rng *rng,
                    struct indirect_ends *ends);

/* Samples a direction from a spot's matte part by x in [0, 1)^2. False: it points below the surface. Thread: any. */
bool indirect_leave(const struct indirect_spot *s, const double x[2], struct vec3 *dir, float *weight);

/* ---- The basis ---- */

struct indirect_basis {
    uint32_t count; /* K */
    float *rows;    /* [K][SKY_CELLS], orthonormal */
    double rest;    /* share of the input's norm that the basis omits */
};

/* Computes the best basis for m[rows][SKY_CELLS] with at most `most` rows, a multiple of 16 up to INDIRECT_BASIS_MAX.
 * ERR_NOMEM. */
MUST_CHECK enum err indirect_basis_init(struct indirect_basis *b, const float *m, uint32_t rows, uint32_t most);
void indirect_basis_finish(struct indirect_basis *b); /* zeroed memory is allowed */

/* ---- The sky ---- */

#define INDIRECT_WIDE (SKY_EDGE + 2) /* cells along a face's edge, plus one of each neighbour */
#define INDIRECT_SKY_FACE_PARTS 4u   /* parts of a face, summed separately */
#define INDIRECT_SKY_PARTS (CUBE_FACES * INDIRECT_SKY_FACE_PARTS)

struct indirect_tent_sums {
    float at[INDIRECT_WIDE][INDIRECT_WIDE][4]; /* red, green, blue, solid angle */
};

struct indirect_tents {
    struct indirect_tent_sums parts[CUBE_FACES][INDIRECT_SKY_FACE_PARTS];
};

/* Computes the sky's mean radiance over each cell's tent in two steps. The first step sums each of INDIRECT_SKY_PARTS
 * parts, on any thread, of an environment whose pyramid is complete. The second computes the means, W sr^-1 m^-2, of
 * all cells. */
void indirect_sky_part(const struct environment *e, uint32_t part, struct indirect_tents *t);
void indirect_sky_deal(const struct indirect_tents *t, float out[3][SKY_CELLS]); /* second step */

/* Chooses a cell in proportion to its tent's weight at w, by x in [0, 1). Thread: any. */
uint32_t indirect_cell(struct vec3 w, double x);

/* ---- Blocks ---- */

#define INDIRECT_RANK_MAX 256u /* of a block */
#define INDIRECT_GROUP 16u     /* blocks that share one V */

/* One row of a group's blocks: T = U W V, in bytes of -127 to 127. V[rank][3][basis] is followed, for each block, by a
 * gain per rank (float, unaligned) that multiplies the product, W[block's rank][indirect_columns(rank)] and U[block's
 * rank][points]. indirect_lay_out moves everything but V elsewhere. */
struct indirect_piece {
    int8_t *bytes; /* NULL: all zero */
    uint32_t rank;
    uint32_t basis; /* coefficients in use, a multiple of 16 */
};

struct indirect_block {
    uint32_t first, packets, rows;
    uint32_t group;
    uint8_t rank[TRANSPORT_ROWS]; /* below INDIRECT_RANK_MAX */
};

/* Where a block's bytes are. */
struct indirect_place {
    uint32_t at;            /* offset in bounce.stream, divided by 8 */
    uint16_t rows, packets; /* 0: no block begins with this packet */
};

/* A block's bytes begin with one of these per row. */
struct indirect_row {
    uint32_t z; /* of its group: offset in bounce.z */
    uint16_t rank, columns;
};

struct indirect_group {
    uint32_t first, count; /* blocks */
    uint32_t rows;
    struct indirect_piece pieces[TRANSPORT_ROWS];
    float *z[TRANSPORT_ROWS]; /* [3][indirect_columns(rank)]: V times the frame's sky; in bounce.z */
};

/* Columns of W: the rank, rounded up to a multiple of 16; the rest is 0. */
static inline uint32_t indirect_columns(uint32_t rank)
{
    return (rank + PACKET - 1) / PACKET * PACKET;
}

static inline size_t indirect_block_bytes(uint32_t rank, uint32_t columns, uint32_t points)
{
    return rank * (sizeof(float) + columns + points);
}

/* Bytes of a row's piece before indirect_lay_out. blocks: the group's. */
static inline size_t indirect_piece_bytes(const struct indirect_group *g, const struct indirect_block *blocks,
                                          uint32_t row)
{
    const struct indirect_piece *q = &g->pieces[row];
    size_t count = (size_t)q->rank * 3 * q->basis;

    for (uint32_t k = 0; k < g->count; k++)
        count += indirect_block_bytes(blocks[k].rank[row], indirect_columns(q->rank), blocks[k].packets * PACKET);
    return count;
}

struct indirect_kernels {
    /* The sky's coefficients: y[3][K] = Q L, where L is sky[3][SKY_CELLS]. */
    void (*take)(const struct indirect_basis *q, float (*sky)[SKY_CELLS], float *y);
    /* to[c][k] += weight[c] * from[c][k]; k < basis, a multiple of 16. */
    void (*add)(float *to, const float *from, const float weight[3], uint32_t basis);
    /* z[3][indirect_columns(rank)] = V y, padded with 0; y: [3][basis]. */
    void (*project)(const struct indirect_piece *q, const float *y, uint32_t basis, float *z);
    /* out[c][point] = U gain W z of a block; `bytes` begins with its gains. points: a multiple of 16. */
    void (*expand)(const int8_t *bytes, uint32_t rank, const float *z, uint32_t columns, uint32_t points,
                   float out[3][TRANSPORT_POINTS]);
};

/* The loops for the CPU level of k. Never NULL; any thread. */
const struct indirect_kernels *indirect_kernels_of(const struct kernels *k);

struct indirect_cache {
    const struct gbuffer *gbuffer;
    const struct kernels *kernels;
    struct indirect_basis basis;
    struct indirect_block *blocks;
    uint32_t block_count;
    struct indirect_group *groups;
    uint32_t group_count;
    struct indirect_place *places; /* [packet_count]: of the block that begins with this packet */
    uint8_t *stream;               /* per block: a indirect_row per row, then the rows' bytes */
    size_t stream_size;
    float *z;                        /* of all groups */
    float y[3 * INDIRECT_BASIS_MAX]; /* the frame's sky in the basis: [3][basis.count] */
    struct indirect_tents *tents;    /* of the frame's sky */
    struct transport_indirect indirect;
    uint32_t *left_index;
    struct packet_list left;
    struct indirect_stats stats;
};

/* ---- Building ---- */

struct indirect_effort {                              /* of a build: the full one, or a quick one */
    uint32_t gather;                                  /* rays per point */
    uint32_t records;                                 /* maximum number; 0: by the number of points */
    uint32_t basis_points, basis_records, basis_rays; /* points and records whose light, by this many rays each,
                                                         determines the basis, */
    uint32_t basis;                                   /* and the maximum number of its rows */
    uint32_t reach;    /* smoothing: blocks on either side within the group; INDIRECT_GROUP: the whole group */
    uint32_t cells;    /* that a packet of a record's rays looks through at once: 4 or 16 */
    uint32_t exchange; /* rays from each spot of a record to other records */
};

struct indirect_build {
    struct indirect_cache *b;
    const struct indirect_desc *desc;
    const struct indirect_effort *effort;
    struct indirect_records records;
    struct transport_directions directions;
    uint16_t *light;         /* [records + 1][SKY_CELLS], half floats: direct light of a record from a cell */
    float *sources;          /* [records + SKY_CELLS][3][K] */
    float *even;             /* [K]: coefficients of a sky of radiance 1 */
    double (*numbers[2])[2]; /* random numbers of a gather's rays: for the matte part, for the lobe */
    void (*widen)(const uint16_t *in, float *out, uint32_t n);
    uint32_t gather, most;   /* rays per point; maximum number of records */
    double open;             /* mean direct light of matte shading points under a sky of radiance 1, 0..1 */
    bool enclosed;           /* a quick cache would be useless: building ends */
    uint64_t rays, own_rays; /* of all processes' records and groups; of this one's */
};

/* Which of the directions of cells, 16 each, lane l of a record's packet looks in, through one of four cells from
 * `cell` on: in each half of the packet a record's spots take turns between two cells, and the four that look through a
 * cell do so through its four quarters. turn: random. *which: the cell, 0 to 3. */
uint32_t indirect_direction(uint32_t cell, uint64_t turn, uint32_t l, uint32_t *which);

/* The steps of building, in this order. Each uses all OpenMP threads and returns early, with ERR_OK, when cancelled.
 * ERR_NOMEM; indirect_gather_blocks also ERR_RANGE: more than max_bytes. */
MUST_CHECK enum err indirect_find_records(struct indirect_build *b);
MUST_CHECK enum err indirect_light_records(struct indirect_build *b); /* sets light */
MUST_CHECK enum err indirect_make_basis(struct indirect_build *b);
MUST_CHECK enum err indirect_solve(struct indirect_build *b); /* sets sources */
MUST_CHECK enum err indirect_gather_blocks(struct indirect_build *b);

/* A cache with the blocks of the cache of direct light, still empty. The caller frees it with indirect_destroy. NULL
 * when out of memory. */
struct indirect_cache *indirect_begin(const struct indirect_desc *d, const struct kernels *kernels);

/* Completes a cache whose pieces are all built or loaded: statistics, then indirect_lay_out. ERR_NOMEM. */
MUST_CHECK enum err indirect_close(struct indirect_cache *b);

/* Moves the blocks' bytes from the pieces, which keep V only, to b->stream, in the order in which frames read them;
 * allocates z; fills b->indirect. ERR_NOMEM. */
MUST_CHECK enum err indirect_lay_out(struct indirect_cache *b);

/* Fills b->indirect. */
void indirect_set_indirect(struct indirect_cache *b);

/* A block's bytes of a row, after indirect_lay_out; valid as long as b. */
const int8_t *indirect_block_row(const struct indirect_cache *b, const struct indirect_block *block, uint32_t row);

/* Returns ERR_RANGE with a reason that names the limit. */
MUST_CHECK enum err indirect_say_too_large(uint64_t max_bytes, struct reason *why);

/* Passes the light of the records that each process has lit to the others. Collective. ERR_NOMEM; ERR_FORMAT. */
MUST_CHECK enum err indirect_exchange_light(struct indirect_build *b);

/* Passes the groups that each process has gathered to the others, which keep what they need; desc->share is not NULL.
 * Collective. Errors: those of transport_exchange. */
MUST_CHECK enum err indirect_exchange(struct indirect_build *b, struct reason *why);

/* Whether a block of the group needs it. s NULL: true. Frees a group's pieces before indirect_lay_out. */
bool indirect_keeps(const struct indirect_cache *b, const struct transport *direct, const struct cache_share *s,
                    const struct indirect_group *g);
void indirect_drop_group(struct indirect_cache *b, struct indirect_group *g);

/* Adds a group to a section of w, and reads it; bytes: those of groups before, counts this one's. */
void indirect_save_group(const struct indirect_cache *b, const struct indirect_group *g, struct cache_writer *w);
MUST_CHECK enum err indirect_load_group(struct cache_reader *r, struct indirect_cache *b, struct indirect_group *g,
                                        uint64_t *bytes, uint64_t max_bytes, struct reason *why);

/* Sorts the blocks into groups of similar ones. ERR_NOMEM. */
MUST_CHECK enum err indirect_group(struct indirect_cache *b, const struct indirect_desc *d);

/* ---- compress.c ---- */

/* Compresses a group of blocks to T = U W V with a common V. Private to the cache of indirect light. Thread: one per
 * workspace. */

struct indirect_workspace;

struct indirect_workspace *indirect_workspace_create(uint32_t k); /* k: size of the basis; NULL when out of memory */
void indirect_workspace_destroy(struct indirect_workspace *w);    /* NULL is allowed */

/* Compresses one group: call begin, then for each row all of its blocks in order, followed by that row's end. blocks:
 * the group's. t: float[points][3 k], destroyed. scale: float[points], above 0, the weight of a point's error. least:
 * squared error that a rank must remove for each point, weighted. ERR_NOMEM. */
void indirect_compress_begin(struct indirect_workspace *w);
void indirect_compress_block(struct indirect_workspace *w, uint32_t slot, uint32_t row, uint32_t points, float *t,
                             const float *scale, double least);
MUST_CHECK enum err indirect_compress_end(struct indirect_workspace *w, struct indirect_group *g,
                                          struct indirect_block *blocks, uint32_t row, double least);

/* ---- smooth.c ---- */

/* Smooths the noise of the gather over a group of blocks. Private to the cache of indirect light. Thread: one per
 * smoother.
 */

#define INDIRECT_GROUP_POINTS (INDIRECT_GROUP * TRANSPORT_POINTS)

struct indirect_smoother { /* a group's points, 64 per block */
    float at[3][INDIRECT_GROUP_POINTS], normal[3][INDIRECT_GROUP_POINTS];
    float near[INDIRECT_GROUP_POINTS]; /* harmonic mean distance to surrounding surfaces, m, above 0 */
    bool used[INDIRECT_GROUP_POINTS];
    float weights[TRANSPORT_POINTS][INDIRECT_GROUP_POINTS];
};

struct indirect_smoother *indirect_smoother_create(void);    /* NULL when out of memory */
void indirect_smoother_destroy(struct indirect_smoother *s); /* NULL is allowed */

/* from, to: float[64 blocks][wide], no overlap; unused points are ignored. Each block is averaged with `reach` blocks
 * on either side. */
void indirect_smooth(struct indirect_smoother *s, uint32_t blocks, uint32_t reach, uint32_t wide, const float *from,
                     float *to);

/* The sum of the weights, 0..1, of all points that are averaged with point p, its own 1 and those of a quarter of them;
 * blocks and reach as in indirect_smooth. */
float indirect_alike(const struct indirect_smoother *s, uint32_t blocks, uint32_t reach, uint32_t p);
