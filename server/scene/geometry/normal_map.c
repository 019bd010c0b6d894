#include "scene/geometry/scatter_hit.h"

#include "scene/geometry/mesh_read.h"
#include "scene/surface/scatter.h"

#include <math.h>

#define COS_LEAST 0.02f /* of the angle between the result and the geometric normal */

/* The tangent at a hit, in the plane of n, and the side of the bitangent. False: there is none. */
static bool tangent_at(const struct mesh *m, const struct hit *h, struct vec3 n, struct vec3 *tangent, float *side)
{
    const uint32_t *t = m->indices + 3 * (size_t)h->triangle;
    const float weight[3] = { 1.0f - h->u - h->v, h->u, h->v };
    struct vec3 sum = { 0.0f, 0.0f, 0.0f };
    float sides = 0.0f;

    for (int k = 0; k < 3; k++) {
        float v[4];
        mesh_tangent(m, t[k], v);
        sum = vec3_add(sum, vec3_scale(vec3_make(v[0], v[1], v[2]), weight[k]));
        sides += weight[k] * v[3];
    }
    const struct vec3 flat = vec3_sub(sum, vec3_scale(n, vec3_dot(sum, n)));
    const float length = vec3_length(flat);
    if (!(length > 1e-3f))
        return false;
    *tangent = vec3_scale(flat, 1.0f / length);
    *side = sides < 0.0f ? -1.0f : 1.0f;
    return true;
}

void normal_map_turn(const struct scene *scene, const struct hit *h, const float (*uv_step)[2], struct surface *at)
{
    const struct mesh *mesh = &scene->meshes[h->mesh];
    const struct material *m = &scene->materials[mesh->material];
    const float towards = at->outside ? 1.0f : -1.0f;
    const struct vec3 n = vec3_scale(at->shading, towards); /* the frame is that of the outside */
    struct vec3 t;
    float side;

    if (!mesh->tangents || !tangent_at(mesh, h, n, &t, &side))
        return;
    const struct vec3 v = map_read(scene->textures, m, MAP_NORMAL, at, uv_step);
    const float x = (2.0f * v.x - 1.0f) * m->normal_scale, y = (2.0f * v.y - 1.0f) * m->normal_scale * side;
    const float z = 2.0f * v.z - 1.0f;
    struct vec3 turned = vec3_add(vec3_add(vec3_scale(t, x), vec3_scale(vec3_cross(n, t), y)), vec3_scale(n, z));
    const float length = vec3_length(turned);
    if (!(length > 1e-3f))
        return;
    turned = vec3_scale(turned, towards / length);
    const float along = vec3_dot(turned, at->geometric);
    if (along < COS_LEAST)
        turned = vec3_normalize(vec3_add(turned, vec3_scale(at->geometric, COS_LEAST - along)));
    at->shading = turned;
}
