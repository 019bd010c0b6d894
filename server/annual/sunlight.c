#include "annual/sunlight.h"

#include "base/vec.h"
#include "daylight/sun.h"

#include <math.h>

#define NEAR 1e-4f /* m: a sensor on a surface does not meet it */

/* Directions of equal shares of the disc: Vogel's spiral. */
static void fill_directions(const double sun[3], struct ray16 *ray)
{
    const struct vec3 w = vec3_make((float)sun[0], (float)sun[1], (float)sun[2]);
    const struct vec3 side = fabsf(w.y) < 0.9f ? vec3_make(0.0f, 1.0f, 0.0f) : vec3_make(1.0f, 0.0f, 0.0f);
    const struct vec3 u = vec3_normalize(vec3_cross(side, w)), v = vec3_cross(w, u);

    for (int k = 0; k < PACKET; k++) {
        const double r = SUN_RADIUS * sqrt((k + 0.5) / PACKET), turn = 2.399963229728653 * k;
        const struct vec3 d = vec3_normalize(
            vec3_add(w, vec3_add(vec3_scale(u, (float)(r * cos(turn))), vec3_scale(v, (float)(r * sin(turn))))));
        ray->dir_x[k] = d.x;
        ray->dir_y[k] = d.y;
        ray->dir_z[k] = d.z;
    }
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

void sunlight_lux(const struct rays *rays, const struct sensor *sensors, size_t count, const double sun[3],
                  double normal_lux, float *lux)
{
    struct ray16 directions;

    fill_directions(sun, &directions);
#pragma omp parallel for schedule(dynamic, 16)
    for (size_t i = 0; i < count; i++) {
        const struct vec3 n = sensors[i].normal;
        const double cosine = n.x * sun[0] + n.y * sun[1] + n.z * sun[2];
        const bool lit = normal_lux > 0.0 && sun[1] > 0.0 && cosine > 0.0;
        lux[i] = lit ? (float)(normal_lux * cosine * seen(rays, &directions, &sensors[i])) : 0.0f;
    }
}
