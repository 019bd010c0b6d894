/* A G-buffer, or the failure of the test with the reason. */
#pragma once

#include "scene/geometry/gbuffer.h"
#include "support/unit.h"

/* The caller gives it to gbuffer_destroy. */
static inline struct gbuffer *gbuffer_of(const struct scene *s, const struct rays *r, const struct gbuffer_desc *desc)
{
    struct reason why = { "" };
    struct gbuffer *g = NULL;

    if (gbuffer_create(s, r, desc, &g, &why))
        fail_msg("%s", why.text);
    return g;
}
