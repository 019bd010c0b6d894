/* The cache of indirect light. While camera, geometry and materials stay the same, the light that reaches a shade point
 * by way of other surfaces is linear in the environment map. The cache covers the paths of PATH_INDIRECT_LIT
 * (light/estimators/paths.h), E D (S* D)+ L, sun included; frames trace no rays.
 *
 * Records lie on the surfaces, one for each voxel and range of normals. A record stores the light that it receives from
 * the map, per cell, by rays from four places, and the light from other records. Shade points gather from records. All
 * light is expressed in one basis over the cells, the eigenvectors of the light gathered at a few thousand points.
 * Records and points store 3 x K coefficients (K <= 128); those of points are compressed, with one set of rows for 16
 * neighbouring blocks of 64 points.
 *
 * Cells overlap in this cache: each is a tent function over its neighbours' centres, so that a moving sun crosses
 * gradually from one to the next. The result is biased by means over cells, a truncated basis, records that are
 * constant over their voxel, and static gather noise that is smoothed over a group of blocks.
 * docs/internals/transport-cache.md has figures.
 *
 * One struct indirect_cache per thread of control. indirect_create runs on all OpenMP threads and gives the same bits
 * at any number of them. */
#pragma once

#include "base/digest.h"
#include "base/err.h"
#include "base/vec.h"
#include "light/cache/cache_file.h"
#include "light/cache_direct/transport.h"
#include "light/estimators/kernels.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"
#include "sky/tables/environment.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct indirect_cache;
struct precedence;
struct progress;
struct cache_share;

struct indirect_desc {
    const struct scene *scene;
    const struct rays *rays;
    const struct gbuffer *gbuffer;
    const struct transport *direct; /* supplies the blocks, except those with narrow lobes; read during building only */
    struct vec3 eye;                /* the camera's position, m: records are larger at a distance */
    uint32_t gather;                /* rays for a shade point's matte part, and the same number for a lobe; 0: 64 */
    uint32_t records;               /* limit; 0: half the number of points, within 4000..24000 */
    uint64_t max_bytes; /* limit of the stored size (light/cache/memory.h); building takes some 100 MB more */
    uint64_t seed;
    bool quick; /* a rough cache in a tenth of the time, for frames until the full one is complete; gather, records:
                   0 */
    struct progress *progress;       /* NULL, or stepped indirect_steps times in all */
    const atomic_bool *cancel;       /* NULL, or a flag that ends the building (base/cancel.h) */
    const struct precedence *urgent; /* the building gives way to this work (base/precedence.h); NULL: there is none */
    const struct cache_share
        *share; /* other processes that build the same cache (light/cache/cache_share.h); NULL: none */
};

struct indirect_stats {
    uint64_t bytes; /* of the cache */
    uint64_t rays;  /* traced during building */
    uint32_t records;
    uint32_t basis;    /* K */
    double basis_rest; /* share of the input that the basis omits, by Frobenius norms */
    uint32_t bounces;  /* iterations of light exchange between records */
    uint32_t pieces;   /* rows of all blocks */
    double rank;       /* mean rank of the pieces */
    double shared;     /* mean rank of the rows shared by a group */
};

/* Number of progress steps that building takes. */
uint64_t indirect_steps(const struct gbuffer *g);

/* Builds the cache; a quick one only if it suffices: without an error *out is NULL for rooms. desc->gbuffer and kernels
 * are borrowed and must outlive *out, which the caller frees with indirect_destroy. ERR_RANGE: max_bytes is too small.
 * ERR_NOMEM. *out is NULL on an error and when cancelled; cancellation returns ERR_OK. */
MUST_CHECK enum err indirect_create(const struct indirect_desc *desc, const struct kernels *kernels,
                                    struct indirect_cache **out, struct reason *why);
void indirect_destroy(struct indirect_cache *b); /* NULL is allowed */

/* Frees what only blocks use that transport_keep has freed in `direct`. ERR_NOMEM. */
MUST_CHECK enum err indirect_keep(struct indirect_cache *b, const struct transport *direct,
                                  const struct cache_share *s);

/* The value for transport_frame.indirect with the transport that b was built with; valid as long as b. */
const struct transport_indirect *indirect_of_frame(const struct indirect_cache *b);

/* Valid as long as b. */
const struct indirect_stats *indirect_stats(const struct indirect_cache *b);

/* Packets that the cache omits, ascending: their lobes are so narrow that the records would be visible as reflections.
 * Valid as long as b. */
const struct packet_list *indirect_left(const struct indirect_cache *b);

/* ---- The file ---- */

/* Stores the cache of indirect light in a file (light/cache/cache_file.h), next to the cache of direct light. A loaded
 * cache has the same bits as the saved one. Thread: one per reader and writer. */

/* The digest of everything that determines the cache: `direct`, the key of transport_key, the materials, and desc
 * except max_bytes, progress and cancel. */
struct digest indirect_key(const struct digest *direct, const struct indirect_desc *desc);

/* Adds the sections of b to w, which borrows them: b must outlive w. */
void indirect_save(const struct indirect_cache *b, const struct digest *key, struct cache_writer *w);

/* Loads the result of indirect_create. The caller frees *out with indirect_destroy. Errors are those of transport_load.
 */
MUST_CHECK enum err indirect_load(struct cache_reader *r, const struct digest *key, const struct indirect_desc *desc,
                                  const struct kernels *kernels, struct indirect_cache **out, struct reason *why);
