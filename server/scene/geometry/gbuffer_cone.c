/* Ray differentials: first derivatives of a camera ray's origin and direction with respect to one pixel in x and y,
 * carried through mirrors and glass [Igehy 1999]. */
#include "scene/geometry/gbuffer_build.h"
#include "scene/geometry/mesh_read.h"

#include <math.h>
#include <string.h>

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

/* A triangle as the differentials need it. */
struct corner_edges {
    struct vec3 e1, e2, area; /* from the first corner; their cross product */
    float area2;              /* its square; 0: the triangle is too small for floats */
};

static struct corner_edges edges_of(const struct mesh *m, uint32_t triangle)
{
    struct corner_edges t;
    struct vec3 p[3];

    mesh_corners_rounded(m, triangle, p);
    t.e1 = vec3_sub(p[1], p[0]);
    t.e2 = vec3_sub(p[2], p[0]);
    t.area = vec3_cross(t.e1, t.e2);
    t.area2 = vec3_dot(t.area, t.area);
    return t;
}

/* The change of the barycentric coordinates u and v for a step in the triangle's plane, as ratios of areas [Igehy 1999,
 * Eq. 13]. */
static void barycentric_change(const struct corner_edges *t, struct vec3 step, float *du, float *dv)
{
    *du = vec3_dot(vec3_cross(step, t->e2), t->area) / t->area2;
    *dv = vec3_dot(vec3_cross(t->e1, step), t->area) / t->area2;
}

static void step_uvs(const struct mesh *m, const float *uvs, const struct hit *h, const struct corner_edges *edges,
                     const struct footprint *at, float uv_step[2][2])
{
    const uint32_t *t = m->indices + 3 * (size_t)h->triangle;
    float du, dv;

    memset(uv_step, 0, 2 * sizeof(uv_step[0]));
    for (int k = 0; k < 2 && uvs && edges->area2 > 0.0f; k++) {
        barycentric_change(edges, at->step[k], &du, &dv);
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
    const struct corner_edges edges = edges_of(m, h->triangle);

    step_uvs(m, m->uvs, h, &edges, at, uv_step);
    step_uvs(m, m->more_uvs, h, &edges, at, uv_step + 2);
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

/* The change of the interpolated normal for a step in the triangle's plane [Igehy 1999, Eq. 14-15]. */
void cone_bend(const struct scene *scene, const struct hit *h, struct footprint *at)
{
    const struct mesh *m = &scene->meshes[h->mesh];
    const uint32_t *t = m->indices + 3 * (size_t)h->triangle;
    float du, dv;

    at->turn[0] = at->turn[1] = vec3_make(0.0f, 0.0f, 0.0f);
    if (!m->normals)
        return;
    const struct vec3 n0 = mesh_normal(m, t[0]);
    const struct vec3 n1 = vec3_sub(mesh_normal(m, t[1]), n0), n2 = vec3_sub(mesh_normal(m, t[2]), n0);
    const struct vec3 raw = vec3_add(n0, vec3_add(vec3_scale(n1, h->u), vec3_scale(n2, h->v)));
    const float along = vec3_dot(raw, at->shading); /* its length, with the sign of the side */
    const struct corner_edges edges = edges_of(m, h->triangle);
    if (fabsf(along) < 1e-3f || !(edges.area2 > 0.0f))
        return;
    for (int k = 0; k < 2; k++) {
        barycentric_change(&edges, at->step[k], &du, &dv);
        const struct vec3 change = vec3_scale(vec3_add(vec3_scale(n1, du), vec3_scale(n2, dv)), 1.0f / along);
        at->turn[k] = limit(vec3_sub(change, vec3_scale(at->shading, vec3_dot(change, at->shading))), TURN_MAX);
    }
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
