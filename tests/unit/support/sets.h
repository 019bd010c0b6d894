/* A set, or the failure of the test with the reason. */
#pragma once

#include "light/frame/relight.h"
#include "support/unit.h"

/* The caller gives it to set_destroy. */
static inline struct prepared_scene *set_of(const struct prepared_scene_desc *desc)
{
    struct reason why = { "" };
    struct prepared_scene *set = NULL;

    if (set_create(desc, &set, &why))
        fail_msg("%s", why.text);
    return set;
}
