/* The cache of direct light (precomputed radiance transport). While camera, geometry and materials stay the same, the
 * radiance of a shade point is linear in the environment map:
 *     Lo(p) = sum over cells c of T(p, c) L(c),      T(p, c) = integral over c of f(o, w) max(0, n.w) V(p, w) dw,
 * where L(c) is the map's mean radiance over cell c of 6 x 16 x 16. T is traced once and stored without colours, one
 * row for each part of the BRDF (light/cache_direct/internal.h); a frame multiplies the rows by the point's colours.
 *
 * A mean over 5.6 degrees would blur the shadows of the sun. So sky/tables/sky_split.h splits the map: T transports the
 * lower part, and the cache remembers which directions to the sun each point sees, asking for them as suns come there
 * (sun.c). Lobes narrower than a cell have directions of their own with stored visibility,
 * and look up the map texel by texel.
 *
 * The result is biased: a cell has one radiance, T is a quadrature and is compressed within a tolerance, and the
 * sun is a sum over directions. docs/internals/transport-cache.md has figures.
 *
 * One struct transport per thread of control. transport_create and transport_shade run on all OpenMP threads and give
 * the same bits at any number of them. LAPACK compresses; its rounding may differ between types of processors. */
#pragma once

#include "base/digest.h"
#include "base/err.h"
#include "light/cache/cache_file.h"
#include "light/estimators/kernels.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "sky/tables/environment.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

/* A lobe is narrow if it falls to half its peak within a cell's 5.6 degrees: above this Phong exponent, or below this
 * alpha (lobe_is_narrow). cos^150 falls to a half at 5.5 degrees; microfacets fall to a half at 1.29 alpha, measured on
 * the half vector, which turns half as fast. */
#define TRANSPORT_EXPONENT 150.0f
#define TRANSPORT_ALPHA 0.075f

struct transport;
struct transport_indirect;
struct precedence;
struct progress;
struct cache_share;

struct transport_desc {
    uint32_t per_cell;     /* directions along a cell's edge, 1..8: 2 means 4 per cell; 0: 2 */
    uint32_t lobe_samples; /* additional directions for a glossy point's lobe, at most 4096; 0: 64 */
    /* Compression tolerance: Frobenius norm of the error of a block of 64 points, relative to the norm of its
     * transport, colours included. 0: 0.015 for matte and 0.01 for glossy blocks; below 0: no compression. */
    float tolerance, tolerance_glossy;
    uint64_t max_bytes; /* limit of the stored size (light/cache/memory.h); building takes some 2 MB more per thread */
    uint64_t seed;
    bool no_visibility;              /* V = 1 */
    struct progress *progress;       /* NULL, or stepped transport_steps times in all */
    const atomic_bool *cancel;       /* NULL, or a flag that ends the building (base/cancel.h) */
    const struct precedence *urgent; /* the building gives way to this work (base/precedence.h); NULL: there is none */
    const struct cache_share
        *share; /* other processes that build the same cache (light/cache/cache_share.h); NULL: none */
};

struct transport_stats {
    uint64_t bytes; /* of the cache */
    uint64_t dense; /* bytes of all entries as half floats, uncompressed */
    uint64_t rays;  /* traced during building */
    uint32_t packets;
    uint32_t narrow;              /* packets with lobes narrower than a cell */
    uint32_t blocks, pieces, raw; /* a piece is one row of a block; raw: uncompressed pieces */
    uint32_t halves;              /* pieces compressed to half floats, because bytes were too coarse */
    double rank;                  /* mean rank of compressed pieces */
};

/* How a part of a frame treats blocks with narrow lobes, which look up the map texel by texel. */
enum transport_narrow {
    TRANSPORT_NARROW_OWN,  /* shades those in the part */
    TRANSPORT_NARROW_NONE, /* leaves their lanes of lo unchanged and needs no texels for them */
    TRANSPORT_NARROW_ALL,  /* shades all, in the part or not */
};

struct transport_frame {
    const atomic_bool *cancel; /* NULL, or a flag that ends the frame early */
    bool unsplit;              /* no sun: cells only, linear in the map up to rounding */
    /* Indirect light of the same cache (indirect_of_frame), added before colours multiply; NULL: none. */
    const struct transport_indirect *indirect;
    /* A part of the frame: the blocks that begin with packets first .. end - 1; other places in lo are unchanged. end
     * 0: all of it, of which what has not changed may be taken over from the last such frame, with the same bits. */
    uint32_t first, end;
    enum transport_narrow narrow;
    bool sky_taken; /* the sky is set already, by transport_take_sky or transport_unpack_sky */
};

/* What a frame computed for a packet, beside what it took over from the last one. */
enum transport_work {
    TRANSPORT_WORK_CELLS = 1, /* its light from cells and gazes */
    TRANSPORT_WORK_SUN = 2,   /* its light from the sun */
};

struct transport_frame_stats {
    uint64_t rays;       /* traced towards the sun */
    uint32_t sun;        /* texels of the sun */
    uint32_t penumbra;   /* packets in penumbrae, which got more rays */
    uint32_t lit, shone; /* packets whose light from cells and gazes, and from the sun, was computed */
    double share;        /* of the map's energy that is bright, 0..1 */
};

/* Number of progress steps that building takes. */
uint64_t transport_steps(const struct gbuffer *g);

/* Traces and compresses. g, rays and kernels are borrowed and must outlive *out, which the caller frees with
 * transport_destroy. rays: NULL means that everything is visible. ERR_RANGE: max_bytes is too small; *why states a
 * sufficient limit. ERR_NOMEM. *out is NULL on an error and when cancelled; cancellation returns ERR_OK. */
MUST_CHECK enum err transport_create(const struct gbuffer *g, const struct rays *rays, const struct kernels *kernels,
                                     const struct transport_desc *desc, struct transport **out, struct reason *why);
void transport_destroy(struct transport *t); /* NULL is allowed */

/* Moves the pieces into one contiguous array, in the order in which frames read them. Call it on the frame's thread,
 * between frames. Does nothing while a background build runs, when the pieces are contiguous already, or when out of
 * memory. */
void transport_gather(struct transport *t);

/* Frees the blocks that this process does not need: those that begin with packets outside s->first .. s->end - 1.
 * Process 0 keeps all blocks with narrow lobes if transport_narrow_is_few. Loading and building with desc->share have
 * done so already in other processes than 0. Not while a frame is lit; again when a process needs less. */
void transport_keep(struct transport *t, const struct cache_share *s);

/* Whether transport_keep keeps the block that contains a packet. s NULL: true. */
bool transport_keeps(const struct transport *t, const struct cache_share *s, uint32_t packet);

/* Whether one of `count` processes can light all packets with narrow lobes within less than a part's time. */
bool transport_narrow_is_few(const struct transport *t, uint32_t count);

/* Lights the shade points under the map e. A whole frame of a cache that is built takes over from the last such frame
 * what depends on nothing that has changed; the bits are those of one computed whole. lo: float[packet_count][3][16],
 * radiance, linear Rec.709; every lane is written, padding with 0. While a background build runs, lo must hold the
 * light of the packets in transport_unbuilt on entry. *stats is filled. ERR_NOMEM. */
MUST_CHECK enum err transport_shade(struct transport *t, const struct environment *e,
                                    const struct transport_frame *frame, float *lo,
                                    struct transport_frame_stats *stats);

/* Asks ahead which parts of the sun blocks turn, turn + turns, ... see at `count` places of it, w, as frames will, and
 * keeps the answers; a place's turns follow each other. If its memory is full it forgets what nobody has asked for
 * since frame `since` (transport_frames). ERR_RANGE: all of it is in use; ERR_UNSUPPORTED: no frame has had a narrow
 * sun yet; ERR_NOMEM. Thread: any one, also while another shades; the cache must be settled. */
MUST_CHECK enum err transport_look_at(struct transport *t, const double (*w)[3], uint32_t count, uint32_t turn,
                                      uint32_t turns, uint64_t since);
uint64_t transport_frames(const struct transport *t); /* shaded so far; the frames' thread */
/* Towards the last frame's sun; NULL: none, or none narrow yet. The frames' thread. */
const float *transport_sun_axis(const struct transport *t);

/* What the last frame computed, uint8_t[packet_count]: bits of enum transport_work. Valid until the next one. */
const uint8_t *transport_work(const struct transport *t);

/* The first packet of the block that contains a packet: a part of a frame may begin there. packet_count maps to
 * itself. */
uint32_t transport_cut(const struct transport *t, uint32_t packet);

/* The bytes of the cache that lighting a packet needs, on average over its block; in process 0 those that
 * transport_keep has freed, too. */
double transport_packet_bytes(const struct transport *t, uint32_t packet);

/* Distributes a frame over several processes with the same cache. The first process takes the sky of e and packs the
 * data that the others need. The others unpack it and light their parts with sky_taken under an environment of the same
 * size that contains only the texels of the sun, so it does not serve narrow lobes. transport_take_sky: ERR_NOMEM.
 * transport_unpack_sky: ERR_FORMAT if the bytes are not those of such a sky; ERR_NOMEM. */
MUST_CHECK enum err transport_take_sky(struct transport *t, const struct environment *e,
                                       const struct transport_frame *frame);
size_t transport_sky_bytes(const struct transport *t, const struct transport_indirect *indirect);
void transport_pack_sky(const struct transport *t, const struct environment *e,
                        const struct transport_indirect *indirect, uint8_t *out);
MUST_CHECK enum err transport_unpack_sky(struct transport *t, const uint8_t *bytes, size_t size,
                                         const struct transport_indirect *indirect, struct environment *e);

/* Valid as long as t. */
const struct transport_stats *transport_stats(const struct transport *t);

/* True once all blocks are built. */
bool transport_is_settled(const struct transport *t);

/* Packets with lobes narrower than a cell, ascending. Valid as long as t. */
const struct packet_list *transport_narrow(const struct transport *t);

/* Packets whose block is missing in a cache that is being built (light/cache_direct/live.h); otherwise
 * empty. Valid until the next transport_live_advance. */
const struct packet_list *transport_unbuilt(const struct transport *t);

/* ---- The file ---- */

/* Stores the cache of direct light in a file (light/cache/cache_file.h), which a later run loads instead of computing
 * it. A loaded cache has the same bits as the saved one. Thread: one per reader and writer. */

/* The digest of everything that determines the transport: shade points, geometry, and desc except max_bytes, progress
 * and cancel. */
struct digest transport_key(const struct gbuffer *g, const struct scene *scene, const struct transport_desc *desc);

/* Adds the sections of t to w, which borrows them: t must outlive w. cache_writer_store reports a lack of memory. */
void transport_save(const struct transport *t, const struct digest *key, struct cache_writer *w);

/* Loads the result of transport_create. The caller frees *out with transport_destroy; on an error it is NULL. The
 * caller may compute the cache after ERR_FORMAT (damaged sections), ERR_UNSUPPORTED (another key), ERR_END (no such
 * sections) and ERR_IO. ERR_RANGE: max_bytes is too small. ERR_NOMEM. */
MUST_CHECK enum err transport_load(struct cache_reader *r, const struct digest *key, const struct gbuffer *g,
                                   const struct rays *rays, const struct kernels *kernels,
                                   const struct transport_desc *desc, struct transport **out, struct reason *why);

/* What points see of suns, for a file. A frame has been shaded before. Thread: any one, also while another shades. */
struct transport_sun_copy {
    uint8_t *bytes;
    size_t size;
};

/* How much is known: places of some 0.4 square degrees. */
uint32_t transport_sun_tiles(struct transport *t);

/* A copy of it as it is now; the caller frees its bytes with mem_free. ERR_NOMEM; ERR_END: nothing is known. */
MUST_CHECK enum err transport_copy_sun(struct transport *t, struct transport_sun_copy *out);

/* Adds a section to w, which borrows the copy. */
void transport_save_sun(const struct transport_sun_copy *c, const struct digest *key, struct cache_writer *w);

/* Adds what such a section knows to what frames have asked for. Errors: those of transport_load. */
MUST_CHECK enum err transport_load_sun(struct transport *t, struct cache_reader *r, const struct digest *key,
                                       struct reason *why);
