#include "year/points.h"

#include "base/luminance.h"
#include "base/vec.h"
#include "scene/geometry/coverage.h"
#include "scene/geometry/scatter_hit.h"
#include "sky/daylight/sun.h"

#include <math.h>

#define NEAR 1e-4f    /* m: a sensor on a surface does not meet it */
#define LAYERS_MAX 32 /* panes and partly transparent surfaces of a ray */

/* Directions of equal shares of the disc. */
static void fill_directions(const double sun[3], struct ray16 *ray)
{
    const struct vec3 w = vec3_make((float)sun[0], (float)sun[1], (float)sun[2]);
    double r;

    for (int k = 0; k < PACKET; k++) {
        const struct vec3 d = vec3_normalize(vec3_add(w, spiral_place(w, SUN_RADIUS, k, PACKET, &r)));
        ray->dir_x[k] = d.x;
        ray->dir_y[k] = d.y;
        ray->dir_z[k] = d.z;
    }
}

/* Whether rays pass surfaces at random: through thin glass and fractional coverage. */
static bool has_thin_glass(const struct scene *s)
{
    for (size_t k = 0; k < s->material_count; k++)
        if (s->materials[k].thin || s->materials[k].alpha_mode == ALPHA_BLEND)
            return true;
    return false;
}

/* The share of the sun's luminance that gets to a point along one direction, through all panes in between. */
static double passed_along(const struct scene *scene, const struct rays *rays, struct vec3 from, struct vec3 dir)
{
    const float sharp[2][2] = { { 0.0f } };
    double left[3] = { 1.0, 1.0, 1.0 };
    float near = NEAR, passed[3];
    struct hit h;
    bool varies;

    for (int k = 0; k < LAYERS_MAX && rays_see(rays, from, dir, near, 0.0f, &h, &varies); k++) {
        struct scatter at;
        rays_surface(rays, &h, vec3_scale(dir, -1.0f), &at.surface);
        scatter_on(scene, &h, NULL, &at);
        (void)coverage_seen(scene, &h, &at, dir, sharp, passed);
        for (int c = 0; c < 3; c++)
            left[c] *= passed[c];
        if (!(left[0] + left[1] + left[2] > 1e-4))
            return 0.0;
        near = nextafterf(h.t, INFINITY);
    }
    return luminance_of(LUMINANCE_REC709, left);
}

/* The mean over the disc. Only where some ray meets the sun are all of them weighted by the panes on their way. */
static double seen_through(const struct scene *scene, const struct rays *rays, const struct ray16 *directions,
                           const struct sensor *s, double open)
{
    double sum = 0.0;

    for (int k = 0; k < PACKET; k++) {
        const struct vec3 d = vec3_make(directions->dir_x[k], directions->dir_y[k], directions->dir_z[k]);
        sum += passed_along(scene, rays, s->position, d);
        if (!(open > 0.0) && !(sum > 0.0) && k >= 1) /* two rays: a dark pane may have let none of sixteen pass */
            return 0.0;
    }
    return sum / PACKET;
}

static double seen(const struct rays *rays, const struct ray16 *directions, const struct sensor *s)
{
    struct ray16 ray = *directions;
    int32_t valid[PACKET];
    int open = 0;

    for (int k = 0; k < PACKET; k++) {
        ray.org_x[k] = s->position.x;
        ray.org_y[k] = s->position.y;
        ray.org_z[k] = s->position.z;
        ray.tnear[k] = NEAR;
        ray.tfar[k] = INFINITY;
        ray.mask[k] = UINT32_MAX;
        ray.id[k] = ray.flags[k] = 0;
        ray.time[k] = 0.0f;
        valid[k] = -1;
    }
    rays_occluded16(rays, RAYS_TOGETHER, valid, &ray);
    for (int k = 0; k < PACKET; k++)
        open += ray.tfar[k] > 0.0f;
    return (double)open / PACKET;
}

void sunlight_lux(const struct scene *scene, const struct rays *rays, const struct sensor *sensors, size_t count,
                  const double sun[3], double normal_lux, float *lux)
{
    const bool thin_glass = has_thin_glass(scene);
    struct ray16 directions;

    fill_directions(sun, &directions);
#pragma omp parallel for schedule(dynamic, 16)
    for (size_t i = 0; i < count; i++) {
        const struct vec3 n = sensors[i].normal;
        const double cosine = n.x * sun[0] + n.y * sun[1] + n.z * sun[2];
        lux[i] = 0.0f;
        if (!(normal_lux > 0.0 && sun[1] > 0.0 && cosine > 0.0))
            continue;
        double share = seen(rays, &directions, &sensors[i]);
        if (thin_glass)
            share = seen_through(scene, rays, &directions, &sensors[i], share);
        lux[i] = (float)(normal_lux * cosine * share);
    }
}
