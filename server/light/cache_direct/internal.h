/* Private to the cache of direct light (transport.h) and to the cache of indirect light, which shares its blocks.
 * Contains data structures and the loops that are compiled once per CPU level. Thread: one per object, unless stated
 * otherwise.
 *
 * A row is a part of BRDF times cosine, without the colour that multiplies it (lobe_rows). A block is up to four
 * consecutive packets of one kind. A piece is one row of a block. */
#pragma once

#include "light/cache/cache_file.h"
#include "light/cache_direct/transport.h"
#include "sky/tables/sky_split.h"

#include <pthread.h>

#define TRANSPORT_ROWS 3    /* those listed above */
#define TRANSPORT_PACKETS 4 /* of a block, the sharing of V: 64 points */
#define TRANSPORT_POINTS (TRANSPORT_PACKETS * PACKET)
#define TRANSPORT_TOGETHER 4 /* rows of V that are stored side by side */
#define TRANSPORT_UNIT 4     /* directions of a unit (transport_directions) */
#define TRANSPORT_GAZES 32   /* stored directions of a narrow lobe */
#define SUN_SAMPLES 32       /* that the sun counts as, beside the gazes of narrow lobes */
#define SUN_EDGE 4           /* directions along a tile's edge (sun.c) */
#define SUN_TILE (SUN_EDGE * SUN_EDGE)

/* A block's row as traced, before compression: [cell][point]. */
struct transport_matrix {
    _Alignas(64) float at[SKY_CELLS][TRANSPORT_POINTS];
};

/* How V is stored. */
enum transport_form {
    TRANSPORT_HALVES, /* half floats */
    TRANSPORT_RAW,    /* half floats of T itself; there is no U */
    TRANSPORT_BYTES,  /* -127 to 127, with a gain per row */
};

/* A compressed row: T = U V. Its bytes are the gains of V's rows (form bytes only), V, and U. V is stored in groups of
 * TRANSPORT_TOGETHER rows (the last group may have fewer), each group chunk by chunk. U is half floats, packet by
 * packet: [points / 16][rank][16]. Raw: T instead of V, one row per point. Chunks of cells that are zero for all points
 * are omitted. */
struct transport_piece {
    struct transport_shape { /* files store it in its memory layout */
        uint32_t rank;       /* rows of V; 0: all entries are zero, and there are no bytes */
        float scale;         /* a power of two that V's halves are divided by, so that the largest is about 2^14 */
        uint8_t form;        /* enum transport_form */
        uint8_t chunk_count;
        uint8_t chunks[SKY_CHUNKS]; /* ascending */
        uint8_t zero[2];
    } shape;
    uint8_t *bytes; /* aligned to 64 */
};

/* A direction that a packet's narrow lobes sample by their own densities, and its visibility. */
struct transport_gaze {
    uint32_t to[PACKET]; /* packed (packed.h) */
    /* Half floats: */
    uint16_t by_specular[PACKET];  /* row 1 / density; 0 where the sky is occluded */
    uint16_t by_one[PACKET];       /* row 2 / density, likewise */
    uint16_t root_density[PACKET]; /* its square: sr^-1, sum over all TRANSPORT_GAZES; densities exceed half floats */
};

/* Visibility of the cells from a block, over all points and directions above their horizon: bits of the cells that are
 * partly or fully visible, and of the cells that are partly or fully occluded. */
struct transport_sight {
    uint64_t seen[SKY_CELLS / 64], hidden[SKY_CELLS / 64];
};

struct transport_block {
    uint32_t first, packets;       /* of the G-buffer */
    uint32_t kind;                 /* enum lobe_kind */
    uint32_t rows;                 /* rows with pieces; blocks with narrow lobes have only the matte row */
    bool narrow;                   /* has lobes narrower than a cell, and therefore gazes */
    bool built;                    /* at least coarsely; valid only while a cache is being built */
    uint32_t freed;                /* bytes that transport_keep has freed */
    struct transport_gaze *gazes;  /* [packets][TRANSPORT_GAZES]; NULL until built */
    struct transport_sight *sight; /* NULL until built */
    struct transport_piece pieces[TRANSPORT_ROWS];
};

/* The directions that all points trace, group by group in the order of sky_cell. A group is one cell, or 2 x 2 cells
 * that share their directions: each gets a quarter of the result. */
struct transport_directions {
    uint32_t group;     /* cells: 1 or 4 */
    uint32_t per_group; /* directions */
    float *x, *y, *z;   /* [SKY_CELLS / group * per_group]: unit */
    float *weight;      /* 1 / density, sr; sums to the group's solid angle */
    /* A unit is a square with TRANSPORT_UNIT directions: a cell or a chunk. If its first direction and those of the
     * eight units around it agree for all lanes of a packet, the other directions need not be traced. */
    uint32_t units;        /* 0: groups have other numbers of directions, and all are traced */
    uint16_t (*around)[8]; /* [units] */
};

struct transport_world {     /* input of tracing; borrowed */
    const struct rays *rays; /* NULL: everything is visible */
    const struct transport_directions *directions;
    const float (*lobe_numbers)[2]; /* [lobe_samples]: points of the unit square */
    uint32_t lobe_samples;
    const float (*gaze_numbers)[2]; /* [TRANSPORT_GAZES]: the same for gazes */
};

/* The unit at a row and column of a face with `edge` units along its edge. They may be one step beyond the face: then
 * it is the neighbouring face's, or at a corner, where there is none, the nearest one. */
uint16_t transport_unit_at(uint32_t face, int i, int j, int edge);

/* Where the lanes of a packet look. */
struct sun_look {
    _Alignas(64) float ray[3][PACKET];
    uint32_t place[PACKET]; /* of the cells of its pixel, the one that it looks from (lanes_start) */
};

struct sun_corner;

/* Directions to the sun: a square part of a grid on a face of the sky. */
struct sun_tile {
    float axis[3], sine;                         /* a cone that contains it: unit; of its radius */
    float x[SUN_TILE], y[SUN_TILE], z[SUN_TILE]; /* unit: centres of the grid's squares, row by row */
    struct sun_look looks[SUN_TILE];             /* within the squares */
    uint64_t cells[SKY_CELLS / 64];              /* bits of the cells that contain part of it */
};

/* Light of a frame's sun in a tile. */
struct sun_part {
    uint32_t key, tile;            /* of its tile; its place in the index */
    struct sun_corner *corners[4]; /* of the tile */
    uint32_t asked;                /* bits of the directions with light */
    float colour[3];               /* of luminance 1 */
    float flux[3];                 /* integral of luminance times direction */
    float weight[SUN_TILE];        /* integral of luminance over the square */
    float density[SUN_TILE];       /* sr^-1, of SUN_SAMPLES samples by luminance: for the balance heuristic */
};

struct sun_parts {
    uint32_t count;
    size_t capacity;
    struct sun_part *at;
};

struct transport_sun {
    struct sun_parts parts; /* none: no sun */
    struct sun_parts ahead; /* directions that it may come to next: only keys, tiles and the directions asked for */
    struct sun_parts later; /* of transport_look_at: likewise */
    /* A cone that contains the whole sun: unit. Too wide a cone: -2 and 2, which all directions meet. */
    float axis[3], cosine, sine;
    float colour[3], flux[3]; /* of the whole sun, as of a part */
    /* Of the last frame that had a narrow sun, as a sky with one bright place has: */
    uint32_t edge; /* texels along an edge of the sky's faces */
    float radius;  /* from the axis to the farthest texel's middle, radians */
};

/* A frame's sky for narrow lobes, which look it up texel by texel. */
struct transport_look {
    const struct environment *environment;
    float level; /* of sky_split */
    const struct transport_sun *sun;
    double per_energy; /* SUN_SAMPLES n^2 / 4 / energy of the sun; 0: no sun */
};

/* Floats before V: the gains, in whole cache lines. */
static inline uint32_t transport_gains(const struct transport_shape *s)
{
    return s->form == TRANSPORT_BYTES ? (s->rank + PACKET - 1) / PACKET * PACKET : 0;
}

/* Bytes before U. */
static inline size_t transport_head(const struct transport_shape *s)
{
    return transport_gains(s) * sizeof(float) +
           (size_t)s->rank * s->chunk_count * SKY_CHUNK * (s->form == TRANSPORT_BYTES ? 1 : sizeof(uint16_t));
}

/* Visibility of the sun from a packet: bits of the lanes that see some of it, and of the lanes for which some
 * of it is occluded.
 */
struct transport_view {
    uint32_t lit, dark;
};

struct sun_kernels {
    /* Looks from some lanes of a packet along some of up to 32 rays: their bits of bits[ray] become 1 if they see the
     * sky, above their horizons; *view adds them up. Returns the number of rays. rays: NULL if everything is visible.
     */
    uint64_t (*trace)(const struct rays *rays, const struct sun_look *looks, const struct shade_packet *p,
                      uint32_t directions, uint32_t lanes, uint16_t *bits, struct transport_view *view);
    /* Adds the light of all of the sun to lo[3][16], as from one direction, for the lanes that see it. False, and
     * nothing is added, if a horizon may cut it. */
    bool (*whole)(const struct transport_sun *s, const struct shade_packet *p, uint32_t lanes, float *lo);
    /* Adds the light of a part of the sun to lo[3][16]. bits: as traced; NULL: `lanes` see all of it above their
     * horizons. narrow: the packet has gazes too, and the lobes count with their balance heuristic share. */
    void (*light)(const struct sun_part *s, const struct sun_tile *t, const struct shade_packet *p, bool narrow,
                  uint32_t lanes, const uint16_t *bits, float *lo);
};

/* Indirect light of a block's rows, before multiplication by colours. Negative entries, which compression may cause,
 * count as 0. */
struct transport_rows {
    uint32_t count; /* rows; 0: none */
    _Alignas(64) float at[TRANSPORT_ROWS][3][TRANSPORT_POINTS];
};

/* How indirect light joins a frame of transport_shade. bounce/ fills it in, since transport/ may not include bounce/.
 * The functions are called in this order, each step after the previous one has ended. Thread: any, unless noted. */
typedef bool transport_wants(const void *context, uint32_t packet);

struct transport_indirect {
    void *self;
    /* Reads part 0 .. take_parts - 1 of the map, whose pyramid is complete. */
    void (*take)(void *self, const struct environment *e, uint32_t part);
    uint32_t take_parts;
    void (*taken)(void *self); /* one thread */
    float *sky;                /* [sky_count]: the result of `take`, which may come from another process instead */
    uint32_t sky_count;
    /* Computes part 0 .. parts - 1 of the data that blocks share, if `wants` accepts the first packet of one of these
     * blocks. wants NULL: accept all. */
    void (*prepare)(void *self, uint32_t part, transport_wants *wants, const void *context);
    uint32_t parts;
    /* Writes the rows of the block that begins with packet `first`. */
    void (*rows)(const void *self, uint32_t first, struct transport_rows *out);
};

/* The points of a block of four packets take turns: of four directions each traces one, and what it sees of the others
 * is what the plane says that is fitted to its neighbours. */
struct transport_neighbours {
    uint64_t alone; /* bits of the points that have too few neighbours, and trace all directions */
    /* [turn][lane][point]: of what the turn's points see, the weights in what a point sees; and of those that are above
     * their horizons, if some are not. */
    _Alignas(64) float plane[TRANSPORT_PACKETS][PACKET][TRANSPORT_POINTS];
    float near[TRANSPORT_PACKETS][PACKET][TRANSPORT_POINTS];
    float others[TRANSPORT_POINTS][PACKET]; /* the weights of its own turn's points without itself */
};

/* The point of a block that is lane l of a turn's packet: one of four lanes of each packet, and of four neighbours. */
static inline uint32_t transport_turn_point(uint32_t turn, uint32_t l)
{
    return (l + l / 4 + turn) % TRANSPORT_PACKETS * PACKET + l;
}

/* Packets: TRANSPORT_PACKETS. Thread: any. */
void transport_find_neighbours(const struct shade_packet *packets, struct transport_neighbours *out);

/* Turns the weights w[list[0 .. count - 1]] of points into those that evaluate at `to` the plane fitted to the points'
 * values, so that a gradient causes no error if all of them are on one side, as at a block's border [Cleveland 1979].
 * They sum to 1. Thread: any. */
void transport_fit_plane(const float *const at[3], const uint16_t *list, uint32_t count, const float to[3], float *w);

struct transport_kernels {
    /* Traces the transport of a block's 1 to 4 packets to out[rows], writing every entry of their columns, and adds to
     * *sight. neighbours: NULL if all points trace all directions. Returns the number of rays. */
    uint64_t (*trace)(const struct transport_world *w, const struct shade_packet *packets, uint32_t count,
                      uint32_t rows, const struct transport_neighbours *neighbours, struct transport_matrix *out,
                      struct transport_sight *sight);
    /* Writes the block's light from the sky's lower part to lo[packets][3][16]: (rows times the sky, plus `more` unless
     * NULL) times colours. */
    void (*cells)(const struct transport_block *b, const struct shade_packet *packets, const struct sky_split *sky,
                  const struct transport_rows *more, float *lo);
    /* out[c][point] = sum over cells of T L. points: a multiple of 16. */
    void (*expand)(const struct transport_piece *q, const struct sky_split *sky, uint32_t points,
                   float out[3][TRANSPORT_POINTS]);
    /* Traces a packet's gazes to out[TRANSPORT_GAZES]. Returns the number of rays. */
    uint64_t (*aim)(const struct transport_world *w, const struct shade_packet *p, struct transport_gaze *out);
    /* Adds to lo[3][16] the light of a packet's gazes; the balance heuristic combines them with the sun's
     * samples. */
    void (*gaze)(const struct transport_look *look, const struct shade_packet *p, const struct transport_gaze *gazes,
                 float *lo);
    const struct sun_kernels *sun;
    /* Half floats to floats. n: a multiple of 16; out: aligned to 64 bytes. */
    void (*widen)(const uint16_t *in, float *out, uint32_t n);
};

/* The loops for the CPU level of k. Never NULL; any thread. */
const struct transport_kernels *transport_kernels_of(const struct kernels *k);

struct transport_last;

struct transport {
    const struct gbuffer *gbuffer;
    const struct rays *rays; /* NULL: everything is visible */
    const struct transport_kernels *kernels;
    struct transport_block *blocks;
    uint32_t block_count;
    struct transport_stats stats;
    uint8_t *bytes; /* of all pieces after transport_gather; NULL: each piece owns its bytes */
    uint32_t *narrow_index;
    struct packet_list narrow;
    uint32_t *unbuilt_index; /* [packet_count] while the cache is being built; NULL: all blocks are */
    struct packet_list unbuilt;

    struct transport_last *last; /* of whole frames, once all blocks are built; NULL: none yet */
    uint8_t *work;               /* [packet_count]: of the last frame */

    struct sky_split sky; /* of the last frame */
    struct transport_sun sun;
    struct sun_index *index;
    uint64_t index_bytes; /* beyond which it forgets tiles that no frame asks for any more */
    /* Of sun and index, between a frame and transport_look_at, which lets a frame that awaits its turn go first. */
    pthread_mutex_t lock;
    pthread_cond_t shaded;
    atomic_bool awaits;
};

/* Channel c of the colour that multiplies a row at lane l. */
static inline float transport_row_colour(const struct shade_packet *p, uint32_t row, int c, uint32_t l)
{
    return row == 0 ? p->diffuse[c][l] : row == 1 ? p->specular[c][l] : 1.0f;
}

/* The mean of the three. */
static inline float transport_mean_colour(const struct shade_packet *p, uint32_t row, uint32_t l)
{
    return (transport_row_colour(p, row, 0, l) + transport_row_colour(p, row, 1, l) +
            transport_row_colour(p, row, 2, l)) /
           3.0f;
}

/* desc with its defaults filled in. */
struct transport_desc transport_resolve(const struct transport_desc *desc);

/* Creates a cache with the layout of its blocks, but without pieces. Reads only no_visibility and max_bytes of desc.
 * Free with transport_destroy. NULL when out of memory. */
struct transport *transport_begin(const struct gbuffer *g, const struct rays *rays, const struct kernels *kernels,
                                  const struct transport_desc *desc);

/* Adds a finished block to the statistics; call transport_close_stats after the last one. */
void transport_count_block(struct transport *t, const struct transport_block *b);
void transport_close_stats(struct transport *t);

/* The block that contains a packet. */
const struct transport_block *transport_block_of(const struct transport *t, uint32_t packet);

/* Adds blocks first, first + step, ... and the rays of building them to a section of w, which borrows *rays. Reads such
 * a section into a cache without these blocks, and adds its rays; s not NULL: only blocks that transport_keeps. Errors:
 * those of transport_load. */
void transport_save_blocks(const struct transport *t, uint32_t first, uint32_t step, const uint64_t *rays,
                           const struct digest *key, struct cache_writer *w);
MUST_CHECK enum err transport_load_blocks(struct cache_reader *r, const struct digest *key, uint32_t first,
                                          uint32_t step, const struct cache_share *s, struct transport *t,
                                          struct reason *why);

/* Moves the pieces into a new array, t->bytes, from the old one or from memory of their own; not when out of memory. */
void transport_gather_again(struct transport *t);

/* Counts anew, only the blocks that this process has. */
void transport_count_kept(struct transport *t, const struct cache_share *s);

/* Passes the blocks that each process has built to the others, which keep what they need; desc->share is not NULL.
 * Collective. ERR_RANGE: more than max_bytes; ERR_NOMEM; ERR_FORMAT: damaged on the way. */
MUST_CHECK enum err transport_exchange(struct transport *t, const struct transport_desc *desc, struct reason *why);

/* Returns ERR_RANGE with a reason that estimates the bytes of all blocks from those of the first `blocks`. */
MUST_CHECK enum err transport_say_too_large(const struct transport *t, uint64_t bytes, uint32_t blocks,
                                            uint64_t max_bytes, struct reason *why);

struct transport_live;

/* Hands a finished block over to the frame's thread, with its pieces unless it fails. Thread: any of the build.
 * ERR_NOMEM. */
MUST_CHECK enum err transport_live_publish(struct transport_live *live, uint32_t index, const struct transport_block *b,
                                           bool fine);

/* Bytes of the cache with the newest version of each block; between two batches independent of the number of
 * threads. */
uint64_t transport_live_bytes(struct transport_live *live);

/* Builds all blocks. desc: from transport_resolve. to: publishes finished blocks there; NULL: nowhere. Coarse blocks
 * are only published; fine ones also stay in t, where the pieces of published blocks are borrowed. *all: the build was
 * not cancelled. Errors: those of transport_create. */
MUST_CHECK enum err transport_build(struct transport *t, const struct transport_desc *desc, bool coarse,
                                    uint32_t threads, struct transport_live *to, bool *all, struct reason *why);

/* The norm that compression preserves: sum over points of scale^2 (sum over cells of T^2 + sum over chunks of (sum over
 * their cells of T)^2): the expected square under skies whose cells vary individually as much as with their chunk. */
double transport_weigh(const struct transport_matrix *m, uint32_t points, const float *scale);

/* The memory that compression needs; one per thread. NULL when out of memory. */
struct transport_workspace;
struct transport_workspace *transport_workspace_create(void);
void transport_workspace_destroy(struct transport_workspace *w); /* NULL is allowed */

/* scale[row][point]: the weight of an error at a point, the row's colour, relative to the point's light under an even
 * sky, or to 0.03 of the block's mean for darker points. 1 at most, and at least a thousandth of it, so that no half
 * float overflows; all 1 in the dark. matrices: one per row. */
void transport_scales(const struct gbuffer *g, const struct transport_block *block,
                      const struct transport_matrix *matrices, float scale[TRANSPORT_ROWS][TRANSPORT_POINTS]);

/* Compresses the matrix, whose contents are destroyed, to *out. points: 16 per packet. scale[points]: weight of a
 * point's error, above 0. allowed: the error, in units of transport_weigh; below 0: no compression. ERR_NOMEM. */
MUST_CHECK enum err transport_compress(struct transport_workspace *w, struct transport_matrix *m, uint32_t points,
                                       const float *scale, double allowed, struct transport_piece *out);

/* Divides the sun of t->sky into parts, whose tiles the index then has. ERR_NOMEM. */
MUST_CHECK enum err transport_sun_take(struct transport *t, const struct environment *e);

/* Adds the block's light from the sun to lo[packets][3][16] and the number of rays to *rays. Returns the number
 * of packets in penumbrae. Thread: any, one per block. */
uint32_t transport_sun_add(struct transport *t, uint32_t block, float *lo, uint64_t *rays);

/* Forgets what a block, which has changed, sees of the sun. */
void transport_sun_forget(struct transport *t, uint32_t block);
void transport_sun_finish(struct transport *t); /* frees sun and index */

/* Bytes of a piece, of the gazes of a block, and of a block with all pieces and gazes. */
uint64_t transport_piece_bytes(const struct transport_piece *q, uint32_t points);
uint64_t transport_gaze_bytes(const struct transport_block *b);
uint64_t transport_block_bytes(const struct transport_block *b);

/* Whether stored numbers (`bytes` from transport_piece_bytes) are valid: V's bytes may have any value, halves must be
 * finite, and gains 0 or more and below a million. */
bool transport_is_sound(const struct transport_piece *q, size_t bytes);
void transport_block_finish(struct transport_block *b); /* frees its pieces and gazes */

/* Turns off the linear algebra library's own threads. Call it once before several threads call transport_compress. */
void transport_compress_begin(void);

/* Draws side x side jittered directions in each group; edge: 1 or 2, cells along a group's edge. ERR_NOMEM. */
MUST_CHECK enum err transport_directions_init(struct transport_directions *d, uint32_t side, uint32_t edge,
                                              uint64_t seed);
void transport_directions_finish(struct transport_directions *d); /* zeroed memory is allowed */

/* ---- last.c ---- */

/* Reuses the parts of the last frame that have not changed (last.c). Private to transport/. One frame at a time. */

/* Compares the sky of t, split and drawn, and the coefficients of indirect light with the last frame's, and keeps them.
 * True: the frame lights its blocks by way of transport_last_lit and _shone, whose parts without transport_last_work
 * are there, and then calls transport_last_end. False: it lights them whole, because little is the same, or for lack of
 * memory. Thread: the frame's. */
bool transport_last_begin(struct transport *t, const struct transport_indirect *indirect);
void transport_last_end(struct transport *t, bool complete); /* complete: all blocks were lit */
void transport_last_destroy(struct transport_last *l);       /* NULL is allowed */

#define TRANSPORT_LAST_PASSING                                                                                         \
    0x100u /* its cells' light is not kept: compute it elsewhere than in transport_last_lit */

/* Which parts of a block's light this frame must compute: bits of enum transport_work, and TRANSPORT_LAST_PASSING. Call
 * it once per block and frame. Thread: any. */
unsigned transport_last_work(const struct transport *t, uint32_t block);

/* The parts, from a packet on: [][3][PACKET]; valid until transport_destroy. Thread: any, one per block. */
float *transport_last_lit(const struct transport *t, uint32_t packet);
float *transport_last_shone(const struct transport *t, uint32_t packet);

/* Call transport_last_look when a block's transport_last_shone has been computed; transport_last_is_dark: it is all 0.
 * Thread: any, one per block. */
void transport_last_look(const struct transport *t, uint32_t block);
bool transport_last_is_dark(const struct transport *t, uint32_t block);
