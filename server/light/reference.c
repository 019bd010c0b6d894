#include "light/reference.h"

#include "estimators/baselines/mlt.h"
#include "estimators/baselines/photons.h"
#include "estimators/baselines/vpl.h"
#include "light/backplate.h"

#include <assert.h>

static enum err render(enum method m, const struct path_world *world, const struct path_desc *desc, float *rgb,
                       struct path_stats *stats)
{
    switch (m) {
    case METHOD_MLT: return mlt_render(world, desc, rgb, stats);
    case METHOD_PHOTONS: return photons_render(world, desc, rgb, stats);
    case METHOD_VPL: return vpl_render(world, desc, rgb, stats);
    default: assert(m == METHOD_PATH); return path_render(world, desc, rgb, stats);
    }
}

enum err reference_run(const struct set *set, const struct environment *e, const struct relight_desc *desc, float *rgb,
                       struct relight_stats *stats)
{
    double bare[3];
    const bool ground = set->scene->ground.radius > 0.0f;
    const struct path_world world = { set->scene, set->rays, &set->view, e, ground ? bare : NULL };
    const struct path_desc path = {
        .classes = desc->classes ? desc->classes : PATH_BACKGROUND | PATH_DIRECT,
        .samples = desc->direct.samples,
        .seed = desc->direct.seed,
        .pass = desc->direct.pass,
        .cancel = desc->direct.cancel,
    };

    if (ground && backplate_bare(e, bare))
        return ERR_NOMEM;
    environment_complete(e);
    struct path_stats counted = { 0 };

    const enum err result = render(desc->direct.method, &world, &path, rgb, &counted);
    stats->reference_rays = counted.rays;
    stats->bias = counted.bias;
    return result;
}
