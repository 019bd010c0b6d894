#include "light/plan/plan.h"

#include <stddef.h>

const char *plan_estimator_name(enum plan_estimator e)
{
    static const char *const names[] = { "auto", "none", "light tracer", "eye paths", "stored light paths", "cache" };
    return names[e];
}

const struct setting_choice caustics_choices[] = {
    { "auto", PLAN_AUTO, "chosen for scene and environment", 0 },
    { "none", PLAN_NONE, "left out", 0 },
    { "light", PLAN_LIGHT, "light tracer", 0 },
    { "eye", PLAN_EYE, "eye paths", 0 },
    { "stored", PLAN_STORED, "stored light paths, relit in each frame; used by --method cached", 0 },
    { NULL, 0, NULL, 0 },
};

const struct setting_choice indirect_choices[] = {
    { "auto", PLAN_AUTO, "chosen for scene and environment", 0 },
    { "none", PLAN_NONE, "left out", 0 },
    { "light", PLAN_LIGHT, "light tracer", 0 },
    { "eye", PLAN_EYE, "eye paths", 0 },
    { NULL, 0, NULL, 0 },
};
