#include "reference.h"

#include "baselines/mlt.h"

#include <assert.h>

enum err reference_run(const struct set *set, const struct environment *e, const struct relight_desc *desc, float *rgb,
                       uint64_t *rays)
{
    const struct path_world world = { set->scene, set->rays, &set->view, e };
    const struct path_desc path = {
        .classes = desc->classes ? desc->classes : PATH_BACKGROUND | PATH_DIRECT,
        .samples = desc->direct.samples,
        .seed = desc->direct.seed,
        .pass = desc->direct.pass,
        .cancel = desc->direct.cancel,
    };
    struct path_stats stats = { 0 };

    assert(method_is_reference(desc->direct.method));
    const enum err result = desc->direct.method == METHOD_MLT ? mlt_render(&world, &path, rgb, &stats)
                                                              : path_render(&world, &path, rgb, &stats);
    *rays = stats.rays;
    return result;
}
