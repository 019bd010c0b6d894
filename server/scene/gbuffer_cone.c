/* Ray differentials: first derivatives of a camera ray's origin and direction with respect to one pixel in x and y,
 * carried through mirrors and glass [Igehy 1999]. */
#include "scene/gbuffer_build.h"
#include "scene/mesh_read.h"

#include <math.h>

#define COS_MIN 0.02f     /* cosines are clamped here: the footprint would grow without bound */
#define TURN_MAX 1.0f     /* change of the normal within a footprint */
#define DIR_MAX (float)PI /* change of the direction */

static struct vec3 limit(struct vec3 v, float most)
{
    const float length = vec3_length(v);

    if (length <= most)
        return v;
    return length < INFINITY ? vec3_scale(v, most / length) : vec3_make(most, 0.0f, 0.0f); /* NaN also ends up here */
}

void cone_begin(struct cone *c, struct vec3 dir, float angle)
{
    const struct vec3 axis = fabsf(dir.y) < 0.7f ? vec3_make(0.0f, 1.0f, 0.0f) : vec3_make(1.0f, 0.0f, 0.0f);
    const struct vec3 across = vec3_normalize(vec3_cross(axis, dir));

    c->origin[0] = c->origin[1] = vec3_make(0.0f, 0.0f, 0.0f);
    c->dir[0] = vec3_scale(across, angle);
    c->dir[1] = vec3_scale(vec3_cross(dir, across), angle);
}

/* A square of edge `width` has the same variance, along an axis and averaged over all, as the parallelogram of the two
 * steps: width^2 / 12 = (|d0|^2 + |d1|^2) / 24. */
float cone_width(const struct cone *c)
{
    return sqrtf(0.5f * (vec3_dot(c->dir[0], c->dir[0]) + vec3_dot(c->dir[1], c->dir[1])));
}

/* The change of the barycentric coordinates u and v for a step in the triangle's plane, as ratios of areas [Igehy 1999,
 * Eq. 13]. False: the triangle is too small for floats. */
static bool barycentric_change(const struct mesh *m, const struct hit *h, struct vec3 step, float *du, float *dv)
{
    struct vec3 p[3];

    mesh_corners_rounded(m, h->triangle, p);
    const struct vec3 e1 = vec3_sub(p[1], p[0]), e2 = vec3_sub(p[2], p[0]);
    const struct vec3 area = vec3_cross(e1, e2);
    const float area2 = vec3_dot(area, area);

    if (!(area2 > 0.0f))
        return false;
    *du = vec3_dot(vec3_cross(step, e2), area) / area2;
    *dv = vec3_dot(vec3_cross(e1, step), area) / area2;
    return true;
}

/* The change of the interpolated normal for a step in the triangle's plane [Igehy 1999, Eq. 14-15]. */
static struct vec3 normal_change(const struct mesh *m, const struct hit *h, struct vec3 shading, struct vec3 step)
{
    const uint32_t *t = m->indices + 3 * (size_t)h->triangle;
    const struct vec3 none = vec3_make(0.0f, 0.0f, 0.0f);
    float du, dv;

    if (!m->normals)
        return none;
    const struct vec3 n0 = mesh_normal(m, t[0]);
    const struct vec3 n1 = vec3_sub(mesh_normal(m, t[1]), n0), n2 = vec3_sub(mesh_normal(m, t[2]), n0);
    const struct vec3 raw = vec3_add(n0, vec3_add(vec3_scale(n1, h->u), vec3_scale(n2, h->v)));
    const float along = vec3_dot(raw, shading); /* its length, with the sign of the side */
    if (fabsf(along) < 1e-3f || !barycentric_change(m, h, step, &du, &dv))
        return none;
    const struct vec3 change = vec3_scale(vec3_add(vec3_scale(n1, du), vec3_scale(n2, dv)), 1.0f / along);
    return limit(vec3_sub(change, vec3_scale(shading, vec3_dot(change, shading))), TURN_MAX);
}

static void step_uvs(const struct mesh *m, const float *uvs, const struct hit *h, const struct footprint *at,
                     float uv_step[2][2])
{
    const uint32_t *t = m->indices + 3 * (size_t)h->triangle;
    float du, dv;

    for (int k = 0; k < 2; k++) {
        uv_step[k][0] = uv_step[k][1] = 0.0f;
        if (!uvs || !barycentric_change(m, h, at->step[k], &du, &dv))
            continue;
        for (int i = 0; i < 2; i++) {
            const float first = uvs[2 * (size_t)t[0] + (size_t)i];
            uv_step[k][i] =
                du * (uvs[2 * (size_t)t[1] + (size_t)i] - first) + dv * (uvs[2 * (size_t)t[2] + (size_t)i] - first);
        }
    }
}

void cone_uv(const struct scene *scene, const struct hit *h, const struct footprint *at, float uv_step[4][2])
{
    const struct mesh *m = &scene->meshes[h->mesh];

    step_uvs(m, m->uvs, h, at, uv_step);
    step_uvs(m, m->more_uvs, h, at, uv_step + 2);
}

/* The derivative of a normalised vector: the part perpendicular to it. */
static struct vec3 crosswise(struct vec3 d, struct vec3 dir)
{
    return vec3_sub(d, vec3_scale(dir, vec3_dot(d, dir)));
}

void cone_meet(const struct cone *c, const struct hit *h, const struct surface *s, struct vec3 dir,
               struct footprint *out)
{
    const float cosine = vec3_dot(dir, s->geometric);
    const float against = fabsf(cosine) > COS_MIN ? cosine : copysignf(COS_MIN, cosine);

    /* The points where the neighbours meet the triangle's plane [Igehy 1999, Eq. 10-12]. */
    for (int k = 0; k < 2; k++) {
        const struct vec3 moved = vec3_add(c->origin[k], vec3_scale(c->dir[k], h->t));
        out->step[k] = vec3_sub(moved, vec3_scale(dir, vec3_dot(moved, s->geometric) / against));
    }
    out->shading = s->shading;
}

void cone_bend(const struct scene *scene, const struct hit *h, struct footprint *at)
{
    for (int k = 0; k < 2; k++)
        at->turn[k] = normal_change(&scene->meshes[h->mesh], h, at->shading, at->step[k]);
}

void cone_turn(const struct cone *c, const struct footprint *at, const struct scatter *s, struct vec3 dir,
               const struct delta_ray *back, const struct delta_ray *to, struct cone *out)
{
    /* The reflection shows which normal was used. If it was the geometric one, the triangle is flat. */
    const struct vec3 half = vec3_normalize(vec3_sub(back->dir, dir));
    const bool smooth = vec3_dot(half, s->surface.shading) > 0.99999f;
    const struct vec3 n = smooth ? s->surface.shading : s->surface.geometric;
    const float cosine = fmaxf(COS_MIN, -vec3_dot(dir, n));
    const float eta = s->surface.outside ? s->ior : 1.0f / s->ior;

    for (int k = 0; k < 2; k++) {
        const struct vec3 dn = smooth ? at->turn[k] : vec3_make(0.0f, 0.0f, 0.0f), d = c->dir[k];
        const float dc = -(vec3_dot(d, n) + vec3_dot(dir, dn)); /* change of the cosine */
        struct vec3 change;
        if (!to->crosses) { /* dir + 2 c n [Igehy 1999, Eq. 16] */
            change = vec3_add(d, vec3_add(vec3_scale(dn, 2.0f * cosine), vec3_scale(n, 2.0f * dc)));
        } else { /* dir / eta + (c / eta - c') n, c' = sqrt(1 - (1 - c^2) / eta^2) [Igehy 1999, Eq. 17-19] */
            const float behind = fmaxf(COS_MIN, -vec3_dot(to->dir, n));
            const float dm = dc * (1.0f / eta - cosine / (eta * eta * behind));
            change =
                vec3_add(vec3_scale(d, 1.0f / eta), vec3_add(vec3_scale(dn, cosine / eta - behind), vec3_scale(n, dm)));
        }
        out->dir[k] = limit(crosswise(change, to->dir), DIR_MAX);
        out->origin[k] = at->step[k];
    }
}
