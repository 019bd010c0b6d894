/* Direct light by a cache of light transport: with camera, geometry and materials fixed, the radiance of a shade point
 * is linear in the sky,
 *     Lo(p) = sum over cells c of T(p, c) L(c),      T(p, c) = integral over c of f(o, w) max(0, n.w) V(p, w) dw,
 * L(c) being the mean of the sky over the cell. The sphere has 6 x 16 x 16 cells. T is traced once and kept without
 * colours: a row for each part of the BRDF (transport_parts.h), which a point's colours multiply as a frame is made.
 *
 * What is brighter than sky_table.h's level is no cell's business, since a mean over 5.6 degrees would blur its
 * shadows: the sky is split at the level, the lower part goes through T, the upper is traced in every frame, with few
 * rays where neighbours agree on what they see of it and up to eight times as many where not.
 *
 * Biased: a cell has one radiance, T is a quadrature and compressed within a tolerance, and penumbrae that the few rays
 * have missed are lost. docs/transport-cache.md has figures. Lobes narrower than a cell have directions of their own
 * instead, whose visibility is kept: the sky is looked up there texel by texel.
 *
 * One struct transport per thread of control; both functions run on all OpenMP threads and do not depend on their
 * number. The compression is LAPACK's, whose rounding may differ from one type of processor to another. */
#ifndef SHADE_TRANSPORT_H
#define SHADE_TRANSPORT_H

#include "environment.h"
#include "err.h"
#include "gbuffer.h"
#include "kernels.h"
#include "rays.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

/* Lobes that fall to a half within less than a cell's 5.6 degrees: cos^150 does at 5.5 degrees from its middle, D of
 * ggx, about a half vector that turns half as fast, at 1.29 alpha. */
#define TRANSPORT_EXPONENT 150.0f
#define TRANSPORT_ALPHA 0.075f

struct transport;
struct transport_guest;
struct progress;

struct transport_desc {
    uint32_t per_cell;     /* directions per cell and side: 2 are 4 a cell; 0: 2; at most 8 */
    uint32_t lobe_samples; /* of a glossy point's lobe besides; 0: 64; at most 4096 */
    /* Of compression: the Frobenius norm of what a block of 64 points leaves out, relative to that of its transport,
     * colours included. 0: 0.02 of matte blocks and 0.01 of glossy ones; below 0: nothing is compressed. */
    float tolerance, tolerance_glossy;
    uint64_t max_bytes; /* of all that stays; 0: 1 GiB. While it is made, some 2 MB a thread come to it. */
    uint64_t seed;
    bool no_visibility;        /* V = 1 */
    struct progress *progress; /* may be NULL; stepped by transport_steps in all */
    const atomic_bool *cancel; /* once true, building ends; may be NULL */
};

struct transport_stats {
    uint64_t bytes; /* that it holds */
    uint64_t dense; /* that all entries would take as half floats */
    uint64_t rays;  /* traced for it */
    uint32_t packets;
    uint32_t narrow;              /* of these with lobes narrower than a cell */
    uint32_t blocks, pieces, raw; /* a piece is one row of a block; raw: not compressed, */
    uint32_t halves;              /* and compressed to half floats, where bytes would not do */
    double rank;                  /* mean of those that are */
};

/* What is computed of a frame. */
enum transport_what {
    TRANSPORT_ALL,
    TRANSPORT_SOME,  /* blocks that see cells that have changed */
    TRANSPORT_GAIN,  /* nothing: the last frame is multiplied by a power of two */
    TRANSPORT_EQUAL, /* nothing */
};

struct transport_frame {
    uint32_t samples;    /* N >= 1: a 64th of it to an eighth are rays to the bright part, as neighbours agree on it */
    uint64_t seed, pass; /* by which the bright part is sampled: others make another frame of it */
    const atomic_bool *cancel; /* may be NULL */
    bool keep;    /* where lo is that of the last call, it is as that has left it: what has not changed since is not
                   * computed again. The bits are the same. */
    bool unsplit; /* nothing is bright: the cells alone, which are linear in the sky to rounding */
    const struct transport_guest *guest; /* what comes to the blocks' light (bounce_guest), or NULL; not while
                                          * transport_is_settled says false */
};

struct transport_frame_stats {
    uint64_t rays;     /* traced to the bright part */
    uint32_t bright;   /* texels of it */
    uint32_t penumbra; /* packets that got more rays */
    double share;      /* of the sky's energy that is in it */
    enum transport_what what;
    uint32_t kept; /* blocks that were not computed */
};

/* "all", "cells", "gain" or "equal" */
const char *transport_what_name(enum transport_what what);

uint64_t transport_steps(const struct gbuffer *g);

/* g, rays and kernels must outlive it. ERR_RANGE: max_bytes does not suffice; *why says what would. ERR_NOMEM. On an
 * error, or when cancelled (which is none), *out is NULL. */
MUST_CHECK enum err transport_create(const struct gbuffer *g, const struct rays *rays, const struct kernels *kernels,
                                     const struct transport_desc *desc, struct transport **out, struct reason *why);
void transport_destroy(struct transport *t); /* NULL is allowed */

/* Brings what frames read together in memory, in the order in which they read it; before a frame, on its thread. Does
 * nothing while the cache is being built in the background, when that is done already, or when memory is out. */
void transport_gather(struct transport *t);

/* lo: float[packet_count][3][16]; every lane of the packets that are taken is written, padding with 0. While it is
 * being built, the light of those that are not there yet (transport_unbuilt) must stand in lo before. ERR_NOMEM. */
MUST_CHECK enum err transport_shade(struct transport *t, const struct environment *e,
                                    const struct transport_frame *frame, float *lo,
                                    struct transport_frame_stats *stats);

const struct transport_stats *transport_stats(const struct transport *t);

/* All blocks are there, and nothing is left of what stood in for them. */
bool transport_is_settled(const struct transport *t);

/* Packets whose block is not there yet, or only in part: of a cache that is being built (transport_live.h). */
const struct packet_list *transport_unbuilt(const struct transport *t);

#endif
