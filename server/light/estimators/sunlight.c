#include "light/estimators/sunlight.h"

#include "base/denormals.h"
#include "base/luminance.h"
#include "base/rng.h"
#include "scene/geometry/coverage.h"
#include "scene/geometry/lane_rays.h"
#include "scene/geometry/scatter_hit.h"
#include "sky/daylight/sun.h"

#include <math.h>
#include <string.h>

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

/* What all points have in common. */
struct disc {
    struct ray16 directions;
    double sun[3];
    bool thin_glass;
};

static struct disc disc_of(const struct scene *scene, const double sun[3])
{
    struct disc d = { .sun = { sun[0], sun[1], sun[2] }, .thin_glass = has_thin_glass(scene) };

    fill_directions(sun, &d.directions);
    return d;
}

static double share_of(const struct scene *scene, const struct rays *rays, const struct disc *d,
                       const struct sensor *at)
{
    const struct vec3 n = at->normal;

    if (!(d->sun[1] > 0.0 && n.x * d->sun[0] + n.y * d->sun[1] + n.z * d->sun[2] > 0.0))
        return 0.0;
    const double share = seen(rays, &d->directions, at);
    return d->thin_glass ? seen_through(scene, rays, &d->directions, at, share) : share;
}

double sunlight_share(const struct scene *scene, const struct rays *rays, const struct sensor *at, const double sun[3])
{
    const struct disc d = disc_of(scene, sun);
    return share_of(scene, rays, &d, at);
}

void sunlight_lux(const struct scene *scene, const struct rays *rays, const struct sensor *sensors, size_t count,
                  const double sun[3], double normal_lux, float *lux)
{
    const struct disc d = disc_of(scene, sun);

#pragma omp parallel for schedule(dynamic, 16)
    for (size_t i = 0; i < count; i++) {
        const struct vec3 n = sensors[i].normal;
        const double cosine = n.x * sun[0] + n.y * sun[1] + n.z * sun[2];
        lux[i] = normal_lux > 0.0 && cosine > 0.0
                     ? (float)(normal_lux * cosine * share_of(scene, rays, &d, &sensors[i]))
                     : 0.0f;
    }
}

/* ---- Hours ---- */

#define PLACES 256 /* of the disc */

/* Towards a place of the disc, at a moment of the step. */
static void aim(const struct sun_step *s, uint64_t number, struct lanes d[3])
{
    struct rng random = { number };
    double r;

    LANES(l)
    {
        const float at = (float)rng_next(&random);
        const int place = (int)(PLACES * rng_next(&random));
        const struct vec3 w = vec3_normalize(vec3_make(s->from[0] + at * (s->to[0] - s->from[0]),
                                                       s->from[1] + at * (s->to[1] - s->from[1]),
                                                       s->from[2] + at * (s->to[2] - s->from[2])));
        const struct vec3 to = vec3_add(w, spiral_place(w, SUN_RADIUS, place, PLACES, &r));
        d[0].v[l] = to.x;
        d[1].v[l] = to.y;
        d[2].v[l] = to.z;
    }
}

/* The lanes of a packet that see the sky along d. */
static void see(const struct rays *rays, const struct shade_packet *p, const struct lane_pixels *pixels,
                uint32_t number, const struct lanes d[3], struct ray16 *ray, int32_t valid[PACKET])
{
    uint32_t place[PACKET];
    int32_t any = 0;

    LANES(l)
    {
        const float shading = p->ns_x[l] * d[0].v[l] + p->ns_y[l] * d[1].v[l] + p->ns_z[l] * d[2].v[l];
        const float geometric = p->ng_x[l] * d[0].v[l] + p->ng_y[l] * d[1].v[l] + p->ng_z[l] * d[2].v[l];
        valid[l] = shading > 0.0f && geometric > 0.0f && d[1].v[l] > 0.0f ? p->valid[l] : 0;
        any |= valid[l];
        place[l] = lanes_place(number + (uint32_t)l);
    }
    lanes_aim(d, ray);
    lanes_start(p, pixels, place, ray);
    if (any)
        rays_occluded16(rays, RAYS_TOGETHER, valid, ray);
    LANES(l) valid[l] = ray->tfar[l] > 0.0f ? valid[l] : 0;
}

void sunlight_hours(const struct gbuffer *g, const struct rays *rays, const struct sun_step *steps, size_t count,
                    struct progress *line, float *hours)
{
#pragma omp parallel for schedule(dynamic, 16)
    for (uint32_t k = 0; k < g->packet_count; k++) {
        const struct shade_packet *p = &g->packets[k];
        float *sum = hours + (size_t)k * PACKET;
        _Alignas(64) int32_t valid[PACKET];
        const unsigned before = denormals_flush();
        struct lane_pixels pixels;
        struct lanes d[3];
        struct ray16 ray;
        lobes_rays(p, &ray);
        lanes_pixels(p, &pixels);
        memset(sum, 0, PACKET * sizeof(*sum));
        for (size_t i = 0; i < count; i++) {
            aim(&steps[i], rng_mix(k, i), d);
            see(rays, p, &pixels, (uint32_t)i, d, &ray, valid);
            LANES(l) sum[l] += valid[l] ? steps[i].hours : 0.0f;
        }
        denormals_restore(before);
        progress_step(line, 1);
    }
}
