/* Inside the cache of light transport (transport.h): its memory, and the loops that are built once per CPU level.
 *
 * A row is the part of the BRDF times cosine that one colour multiplies, so that transport is kept without colours and
 * textures (lobes.h has the BRDFs; F0 stands for the specular colour):
 *     lambert  row 0: cos / pi, by diffuse
 *     phong    row 0: cos / pi, by diffuse;   row 1: its lobe, by specular
 *     ggx      row 0: (1 - F(n.w)) (1 - F(n.o)) cos / pi of F0 = 0, by (1 - F0)^2 diffuse;
 *              row 1: D V (1 - s), by F0;   row 2: D V s, by 1;   s = (1 - o.h)^5, F = F0 (1 - s) + s
 * A block is up to four packets of one kind that follow each other, a piece one row of a block. */
#ifndef TRANSPORT_PARTS_H
#define TRANSPORT_PARTS_H

#include "transport/transport.h"
#include "env/sky_split.h"

#define TRANSPORT_ROWS 3
#define TRANSPORT_PACKETS 4
#define TRANSPORT_POINTS (TRANSPORT_PACKETS * PACKET)
#define TRANSPORT_TOGETHER 4
#define TRANSPORT_VARIANTS 256
#define TRANSPORT_UNIT 4   /* directions */
#define TRANSPORT_GAZES 32 /* directions in which a narrow lobe looks */
#define TRANSPORT_FADE 8   /* frames within which a block takes over */
#define TRANSPORT_MORE 4   /* strata of the bright part to each ray that is traced at first; a power of two */

/* A block's row as it is traced: [cell][point]. */
struct transport_matrix {
    _Alignas(64) float at[SKY_CELLS][TRANSPORT_POINTS];
};

/* How V is kept. */
enum transport_form {
    TRANSPORT_HALVES, /* half floats */
    TRANSPORT_RAW,    /* likewise, but it is T itself, and there is no U */
    TRANSPORT_BYTES,  /* -127 to 127, each row with a gain of its own */
};

/* The row compressed: T = U V. V comes first, TRANSPORT_TOGETHER of its rows side by side (the last ones fewer) and
 * within them chunk by chunk, of bytes behind the gains of its rows (transport_gains); U follows packet by packet,
 * [points / 16][rank][16], half floats. Raw: T itself, its points being V's rows. Cells that are zero for all points
 * are left out in chunks. */
struct transport_piece {
    struct transport_shape { /* files hold it as it is in memory */
        uint32_t rank;       /* rows of V; 0: all is zero, and there are no bytes */
        float scale;         /* a power of two, by which V's halves are divided: their largest is about 2^14 */
        uint8_t form;        /* enum transport_form */
        uint8_t chunk_count;
        uint8_t chunks[SKY_CHUNKS]; /* ascending */
        uint8_t zero[2];
    } shape;
    uint8_t *bytes; /* aligned to 64 */
};

/* Where a packet's narrow lobes look, by their own densities; what stands still about it. */
struct transport_gaze {
    float x[PACKET], y[PACKET], z[PACKET]; /* unit */
    float by_specular[PACKET];             /* row 1 over density and number; 0 where the sky is not seen */
    float by_one[PACKET];                  /* row 2 likewise */
    float density[PACKET];                 /* of all TRANSPORT_GAZES together, per sr */
};

/* What a block's points have seen of each cell, by all of their directions, over those that face it: cells of which
 * something was seen, and cells of which something was hidden. */
struct transport_sight {
    uint64_t seen[SKY_CELLS / 64], hidden[SKY_CELLS / 64];
};

struct transport_block {
    uint32_t first, packets;      /* of the G-buffer */
    uint32_t kind;                /* of their lobes: enum lobe_kind */
    uint32_t rows;                /* that have pieces: of narrow lobes the matte one alone */
    bool narrow;                  /* lobes narrower than a cell: */
    struct transport_gaze *gazes; /* [packets][TRANSPORT_GAZES]; NULL until it is built */
    struct transport_piece pieces[TRANSPORT_ROWS];
    struct transport_sight sight;
};

/* The directions of all points, group by group in the order of their cells' places. A group is one cell, or 2 x 2 that
 * have their directions in common: a quarter of what is seen by those goes to each. */
struct transport_directions {
    uint32_t group;     /* cells: 1 or 4 */
    uint32_t per_group; /* directions */
    float *x, *y, *z;   /* [SKY_CELLS / group * per_group]: unit */
    float *weight;      /* 1 / density, sr; sums to the group's solid angle */
    /* A unit is a square with TRANSPORT_UNIT directions, a cell or a chunk; where its first direction and those of the
     * units about it agree for all lanes of a packet, the others need not be traced. */
    uint32_t units;        /* 0: squares have other numbers of directions, and all are traced */
    uint16_t (*around)[8]; /* [units] */
};

struct transport_world {     /* what tracing needs; borrowed */
    const struct rays *rays; /* NULL: everything is visible */
    const struct transport_directions *directions;
    const float (*lobe_numbers)[2]; /* [lobe_samples]: points of the unit square */
    uint32_t lobe_samples;
    const float (*gaze_numbers)[2]; /* [TRANSPORT_GAZES]: likewise */
};

/* Samples of a frame's bright part: [strata][TRANSPORT_VARIANTS], each stratum an equal share of its energy. */
struct transport_bright {
    uint32_t strata; /* 0: there is none; else TRANSPORT_MORE times `few` */
    uint32_t few;
    float *x, *y, *z, *r, *g, *b; /* direction, radiance over density */
    float *density;               /* of all `few` together, per sr */
    uint64_t seed;
    uint64_t cells[SKY_CELLS / 64]; /* in which it lies */
};

/* A frame's sky as narrow lobes look at it, texel by texel. */
struct transport_look {
    const struct environment *environment;
    float level;
    double per_energy; /* few n^2 / 4 over the bright part's energy; 0: there is none */
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

/* What a packet has seen of the bright part: a bit for each lane that faces it. */
struct transport_view {
    uint32_t lit, dark;
};

/* Of the strata's groups of TRANSPORT_MORE that follow each other groups[0] .. groups[1] - 1, and of each the
 * turns[0]-th
 * .. turns[1] - 1-st that a point takes of it. Where that begins goes by the point's variant, so that over many points
 * all strata are taken alike. */
struct transport_round {
    uint32_t groups[2], turns[2];
};

struct bright_kernels {
    /* Adds to sum[3][16] the light of a round of samples before division by their number, to *view what was seen;
     * returns rays traced. rays: NULL where all of it is visible. narrow: the lobes have gazes as well, and only their
     * share counts here. variant: of each lane, below TRANSPORT_VARIANTS. */
    uint64_t (*light)(const struct rays *rays, const struct transport_bright *b, const struct shade_packet *p,
                      bool narrow, const uint32_t variant[PACKET], const struct transport_round *round,
                      float sum[3][PACKET], struct transport_view *view);
    /* One ray to the bright part from each of 16 of a block's points, as many of each packet; returns rays traced. */
    uint64_t (*probe)(const struct rays *rays, const struct transport_bright *b, const struct shade_packet *packets,
                      uint32_t count, const uint32_t variant[PACKET], struct transport_view *view);
};

/* Indirect light of a block's rows, before colours multiply it. Entries below 0, which compression may leave, count as
 * 0. */
struct transport_rows {
    uint32_t count; /* 0: none */
    _Alignas(64) float at[TRANSPORT_ROWS][3][TRANSPORT_POINTS];
};

/* How indirect light joins a frame of transport_shade: bounce/ fills this in, since transport/ may not include it. The
 * calls come in this order, each step after the one before has ended; those with a part run on any thread. */
struct transport_indirect {
    void *self;
    /* Reads part 0 .. take_parts - 1 of the map, whose pyramid is complete. */
    void (*take)(void *self, const struct environment *e, uint32_t part);
    uint32_t take_parts;
    void (*taken)(void *self); /* on one thread */
    /* Computes part 0 .. parts - 1 of what blocks share. */
    void (*prepare)(void *self, uint32_t part);
    uint32_t parts;
    /* Writes the rows of the block that begins with packet `first`. */
    void (*rows)(const void *self, uint32_t first, struct transport_rows *out);
};

struct transport_kernels {
    /* The packet's transport into columns first .. first + 15 of the matrices, as many as the block has rows; adds
     * to *sight; returns rays traced. Every entry of the columns is written. */
    uint64_t (*trace)(const struct transport_world *w, const struct shade_packet *p, uint32_t rows,
                      struct transport_matrix *out, uint32_t first, struct transport_sight *sight);
    /* The lower part of the block's light into lo [packets][3][16]: rows times the sky and, unless `more` is NULL, what
     * comes to them, coloured. */
    void (*cells)(const struct transport_block *b, const struct shade_packet *packets, const struct sky_split *sky,
                  const struct transport_rows *more, float *lo);
    /* out[c][point] = sum over the cells of T L. points: a multiple of 16. */
    void (*expand)(const struct transport_piece *q, const struct sky_split *sky, uint32_t points,
                   float out[3][TRANSPORT_POINTS]);
    /* Where the packet's narrow lobes look and what they see there; returns rays traced. */
    uint64_t (*aim)(const struct transport_world *w, const struct shade_packet *p, struct transport_gaze *out);
    /* Adds to lo [3][16] what they see under this sky, the bright part with its share of the balance heuristic. */
    void (*gaze)(const struct transport_look *look, const struct shade_packet *p, const struct transport_gaze *gazes,
                 float *lo);
    const struct bright_kernels *bright;
    /* Half floats to floats; n is a multiple of 16, out aligned to 64 bytes. */
    void (*widen)(const uint16_t *in, float *out, uint32_t n);
};

/* The loops for the CPU level of k. Never NULL; any thread. */
const struct transport_kernels *transport_kernels_of(const struct kernels *k);

/* Of a block while the cache is being built (transport/live.h): what it has been until now, on which it is laid over.
 */
struct transport_fade {
    struct transport_block old; /* without pieces: what stands in lo, from elsewhere */
    uint8_t weight;             /* of the block itself, in parts of TRANSPORT_FADE; 0: there is none yet */
    bool from_cells;            /* old has pieces */
};

struct transport {
    const struct gbuffer *gbuffer;
    const struct rays *rays; /* NULL: everything is visible */
    const struct transport_kernels *kernels;
    struct transport_block *blocks;
    uint32_t block_count;
    struct transport_stats stats;
    struct transport_fade *fades; /* [block_count]; NULL: all blocks are there */
    uint8_t *bytes;               /* of all pieces, once they stand together; else NULL, and each has its own */
    uint32_t *narrow_index;
    struct packet_list narrow;
    uint32_t *unbuilt_index;
    struct packet_list unbuilt;

    struct sky_split sky; /* of the last frame */
    struct transport_bright bright;
    float *bright_values;     /* six arrays, one after the other */
    uint32_t bright_capacity; /* samples in each */
};

/* Colours of a row, as above. */
static inline float transport_row_colour(const struct shade_packet *p, uint32_t row, int c, uint32_t l)
{
    const float f0 = p->specular[c][l];

    if (row == 0)
        return p->kind == LOBE_GGX ? (1.0f - f0) * (1.0f - f0) * p->diffuse[c][l] : p->diffuse[c][l];
    return row == 1 ? f0 : 1.0f;
}

/* desc with its defaults filled in. */
struct transport_desc transport_resolve(const struct transport_desc *desc);

/* A cache whose blocks have no pieces yet: they, and what all that takes. NULL when out of
 * memory. */
struct transport *transport_begin(const struct gbuffer *g, const struct rays *rays, const struct kernels *kernels,
                                  const struct transport_desc *desc);

/* Adds a finished block to the statistics; once all are, transport_close_stats. */
void transport_count_block(struct transport *t, const struct transport_block *b);
void transport_close_stats(struct transport *t);

/* ERR_RANGE, with what all blocks would take, by the bytes of the first `blocks`. */
MUST_CHECK enum err transport_say_too_large(const struct transport *t, uint64_t bytes, uint32_t blocks,
                                            uint64_t max_bytes, struct reason *why);

/* Where blocks go as they are finished: from several threads at once. */
struct transport_publisher {
    void *self;
    /* Takes the block's pieces over, unless it fails. */
    enum err (*publish)(void *self, uint32_t index, const struct transport_block *b, bool fine);
    /* Bytes of the newest version of each block, with what there is beside blocks; the same at any number of threads
     * between two batches. */
    uint64_t (*bytes)(void *self);
};

/* Builds all blocks, of a desc without defaults. Coarse ones are only published; others stand in t as well, where their
 * pieces are only looked at when `to` has them. to: may be NULL. *all: it was not cancelled. Errors: as of
 * transport_create. */
MUST_CHECK enum err transport_build(struct transport *t, const struct transport_desc *desc, bool coarse,
                                    uint32_t threads, const struct transport_publisher *to, bool *all,
                                    struct reason *why);

/* What compression counts of a matrix: sum over points of scale^2 (sum over cells T^2 + sum over chunks (sum over their
 * cells T)^2), the expected square under skies of which a cell is as uncertain by itself as with its chunk. */
double transport_weigh(const struct transport_matrix *m, uint32_t points, const float *scale);

/* Fills *out from the matrix, points = 16 packets; it is destroyed. scale [points]: what a point's error counts, above
 * 0. allowed: what may be left out, in transport_weigh's terms; below 0: nothing is compressed. ERR_NOMEM. */
struct transport_workspace;
struct transport_workspace *transport_workspace_create(void);
void transport_workspace_destroy(struct transport_workspace *w);
MUST_CHECK enum err transport_compress(struct transport_workspace *w, struct transport_matrix *m, uint32_t points,
                                       const float *scale, double allowed, struct transport_piece *out);

/* The frame's samples of the bright part, once its sky is taken. ERR_NOMEM. */
MUST_CHECK enum err transport_bright_draw(struct transport *t, const struct environment *e,
                                          const struct transport_frame *f);

/* Adds the block's light from there to lo [packets][3][16], and to *rays those that were traced; returns how many
 * packets do not agree on whether they see it. */
uint32_t transport_bright_add(const struct transport *t, const struct transport_block *b, float *lo, uint64_t *rays);

/* Bytes that a piece, the gazes of a block, or a block with all of its pieces hold. */
uint64_t transport_piece_bytes(const struct transport_piece *q, uint32_t points);
uint64_t transport_gaze_bytes(const struct transport_block *b);
uint64_t transport_block_bytes(const struct transport_block *b);
void transport_block_finish(struct transport_block *b); /* frees its pieces */

/* Once, before transport_compress is called from several threads: the library's own threads are not wanted. */
void transport_compress_begin(void);

/* side x side in each group, whose edge is 1 or 2 cells. ERR_NOMEM. */
MUST_CHECK enum err transport_directions_init(struct transport_directions *d, uint32_t side, uint32_t edge,
                                              uint64_t seed);
void transport_directions_finish(struct transport_directions *d);

#endif
