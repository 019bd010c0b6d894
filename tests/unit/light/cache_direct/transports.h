/* A cache of light transport, or the failure of the test with the reason. */
#pragma once

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
