#include "relightd/daemon/shade.h"

#include "light/frame/frame_plan.h"

#include <math.h>

#define LOBE 3.5          /* a BRDF sample costs as much as so many light samples, which neighbours trace together */
#define EACH 8.0          /* an eye path or a particle as much as so many samples (plan_make) */
#define SAMPLES_LEAST 4   /* below, what is done once per point outweighs the samples */
#define STORED_A_PIXEL 64 /* as relight_desc.stored_paths 0 */

/* What a sample of the method costs, in light samples. */
static double weight(enum method method)
{
    const struct method_recipe *r = method_recipe(method);

    return (double)r->light_part + LOBE * (double)r->brdf_part;
}

static bool has_direct(const struct relight_desc *light)
{
    return light->classes & PATH_DIRECT || light->classes == 0;
}

void cost_learn(struct cost *c, uint64_t points, const struct relight_desc *light, const struct relight_stats *stats)
{
    const uint32_t samples = light->direct.samples;

    /* A black sky traces nothing, and a cache's frames are no measure of samples. */
    if (has_direct(light) && light->direct.method != METHOD_CACHED && stats->direct.rays > 0 && points > 0 &&
        (samples >= SAMPLES_LEAST || c->sample_s == 0.0))
        c->sample_s =
            smooth(c->sample_s, 1e-3 * stats->shade_ms / ((double)points * samples * weight(light->direct.method)));
    if (stats->eye.paths > 0)
        c->path_s = smooth(c->path_s, 1e-3 * stats->eye_ms / (double)stats->eye.paths);
    if (stats->light.particles > 0)
        c->particle_s = smooth(c->particle_s, 1e-3 * stats->light_ms / (double)stats->light.particles);
    c->fixed_s = smooth(c->fixed_s, 1e-3 * stats->resolve_ms);
}

/* The estimate under a sky of this peakedness, by which the plan chooses the estimator of caustics. */
static double estimate(const struct cost *c, const struct plan_facts *facts, const struct relight_desc *light,
                       double peakedness)
{
    const double path_s = c->path_s > 0.0 ? c->path_s : EACH * c->sample_s;
    const double particle_s = c->particle_s > 0.0 ? c->particle_s : EACH * c->sample_s;
    struct plan_facts f = *facts;
    struct plan plan;

    f.peakedness = peakedness;
    plan_make(&f, light, light->direct.method == METHOD_CACHED, &plan);
    double particles = (double)plan.particles;
    if (plan.caustics == PLAN_STORED) /* traced once, before the first image */
        particles += light->stored_paths ? (double)light->stored_paths : STORED_A_PIXEL * (double)f.pixels;
    const double samples = has_direct(light) ? light->direct.samples * weight(light->direct.method) : 0.0;
    return c->fixed_s + (double)f.points * (samples * c->sample_s + plan.eye_paths * path_s) + particles * particle_s;
}

double cost_estimate(const struct cost *c, const struct plan_facts *facts, const struct relight_desc *light)
{
    if (!(c->sample_s > 0.0))
        return 0.0;
    return fmax(estimate(c, facts, light, 1.0), estimate(c, facts, light, 1e6));
}
