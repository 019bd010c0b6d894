#include "light/frame/relighter.h"

#include "light/estimators/baselines/path.h"
#include "light/resolve/resolve.h"

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

static enum err add_up(const struct prepared_scene *set, const struct environment *e, const struct relight_desc *desc,
                       float *rgb, struct relight_stats *stats)
{
    const struct relight_whole *whole = desc->whole;

    if (!whole)
        return err_say(desc->direct.why, ERR_UNSUPPORTED, "--method components needs --parts, from the start");
    stats->bias = whole->bias;
    return whole->run(whole->self, set, e, rgb, desc->direct.why);
}

enum err reference_run(const struct prepared_scene *set, const struct environment *e, const struct relight_desc *desc,
                       float *rgb, struct relight_stats *stats)
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

    if (desc->direct.method == METHOD_COMPONENTS)
        return add_up(set, e, desc, rgb, stats);
    if (ground && backplate_bare(e, bare))
        return ERR_NOMEM;
    environment_complete(e);
    struct path_stats counted = { 0 };

    const enum err result = render(desc->direct.method, &world, &path, rgb, &counted);
    stats->reference_rays = counted.rays;
    stats->bias = counted.bias;
    return result;
}
