/* A cache of light transport, or the failure of the test with the reason. */
#pragma once

#include "light/cache_direct/live.h"
#include "light/cache_direct/transport.h"
#include "light/estimators/points.h"

/* The caller gives it to transport_destroy. */
static inline struct transport *transport_of(const struct gbuffer *g, const struct rays *rays,
                                             const struct transport_desc *desc)
{
    struct reason why = { "" };
    struct transport *t = NULL;

    if (transport_create(g, rays, best_kernels(), desc, &t, &why))
        fail_msg("%s", why.text);
    assert_non_null(t);
    return t;
}

/* Adds indirect light to lo, as over a cache of direct light that has no blocks yet. */
static inline void add_indirect_alone(const struct transport_indirect *indirect, const struct gbuffer *g,
                                      const struct environment *e, float *lo)
{
    const struct transport_frame frame = { .indirect = indirect };
    struct transport_frame_stats stats;
    struct transport_live *live;
    struct reason why;

    assert_int_equal(transport_live_create(g, NULL, best_kernels(), &(struct transport_desc){ .seed = 0 }, &live, &why),
                     ERR_OK);
    assert_int_equal(transport_shade(transport_live_cache(live), e, &frame, lo, &stats), ERR_OK);
    transport_live_destroy(live);
}
