/* Small caches of indirect light, for tests. */
#pragma once

#include "light/cache_direct/transports.h"
#include "light/cache_indirect/indirect.h"
#include "light/cache_indirect/internal.h"
#include "light/estimators/courts.h"
#include "light/estimators/points.h"

/* A cheap direct cache, of which only the packets that it takes count here. */
static inline struct transport *direct_of(const struct lit *x)
{
    struct transport *t;
    const struct transport_desc desc = { .per_cell = 1, .lobe_samples = 1 };

    t = transport_of(x->gbuffer, x->rays, &desc);
    return t;
}

static inline struct indirect_desc desc_of(const struct lit *x, const struct transport *t, uint64_t seed)
{
    return (struct indirect_desc){ .scene = x->scene,
                                   .rays = x->rays,
                                   .gbuffer = x->gbuffer,
                                   .direct = t,
                                   .eye = x->scene->cameras[0].position,
                                   .records = 1500,
                                   .seed = seed };
}

static inline struct indirect_cache *indirect_of(const struct lit *x, const struct transport *t, uint64_t seed)
{
    const struct indirect_desc desc = desc_of(x, t, seed);
    struct indirect_cache *b;
    struct reason why;

    assert_int_equal(indirect_create(&desc, best_kernels(), &b, &why), ERR_OK);
    assert_non_null(b);
    return b;
}

static inline void shade_indirect(struct indirect_cache *b, struct lit *x, const struct environment *e)
{
    clear(x);
    add_indirect_alone(indirect_of_frame(b), x->gbuffer, e, x->lo);
}
