#include "lamps/emitters.h"

#include "base/mem.h"
#include "scene/coverage.h"
#include "scene/mesh_read.h"
#include "scene/scatter.h"

#include <math.h>

/* A shadow ray ends this share before a lamp: float directions may err by 1e-7 of the distance, a few times that where
 * they graze the lamp. */
#define SHADOW_END 0.99999f

#define LOOKUPS_MAX 32      /* texture lookups along the edge of a triangle, at most; and */
#define TEXELS_A_LOOKUP 2.0 /* texels between two of them */
#define CONE_LEAST 1e-3     /* difference of a spot's cosines below which its edge is no longer resolved, as in glTF */

struct group { /* an emissive mesh */
    uint32_t mesh;
    uint64_t first; /* of its triangles in the table */
};

struct emitters {
    const struct scene *scene;
    const struct rays *rays;
    struct group *groups;
    size_t group_count;
    uint32_t *group_of; /* [mesh_count]: index of its group, or NO_GROUP */
    double *sums;       /* [triangle_count + 1]: running sums of area x luminance, divided by the whole */
    uint64_t triangle_count;
};

#define NO_GROUP UINT32_MAX

static bool emits(const struct scene *s, uint32_t mesh)
{
    const struct vec3 e = s->materials[s->meshes[mesh].material].emission;
    return e.x > 0.0f || e.y > 0.0f || e.z > 0.0f;
}

static double luminance(struct vec3 v)
{
    return rgb_luminance(v.x, v.y, v.z);
}

/* Twice the area. */
static double double_area(const struct mesh *m, uint32_t triangle)
{
    double p[3][3], a[3], b[3], sum = 0.0;

    mesh_corners(m, triangle, p);
    for (int k = 0; k < 3; k++) {
        a[k] = p[1][k] - p[0][k];
        b[k] = p[2][k] - p[0][k];
    }
    for (int k = 0; k < 3; k++) {
        const double c = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
        sum += c * c;
    }
    return sqrt(sum);
}

/* How many lookups an edge of the triangle needs, by the length of the longest in its texture. */
static uint32_t lookups(const struct texture *t, const struct mesh *m, const uint32_t *corner)
{
    double longest = 0.0;

    for (int k = 0; k < 3; k++) {
        const float *a = m->uvs + 2 * (size_t)corner[k], *b = m->uvs + 2 * (size_t)corner[(k + 1) % 3];
        longest = fmax(longest, hypot((a[0] - b[0]) * (double)t->width, (a[1] - b[1]) * (double)t->height));
    }
    return (uint32_t)fmin(fmax(1.0, ceil(longest / TEXELS_A_LOOKUP)), LOOKUPS_MAX); /* 1 for NaN, too */
}

/* The mean luminance that the triangle emits. An estimate suffices: it only says how often the triangle is sampled. */
static double mean_emission(const struct scene *s, const struct mesh *m, uint32_t triangle)
{
    const struct material *material = &s->materials[m->material];
    const uint32_t *corner = m->indices + 3 * (size_t)triangle;

    if (material->emission_texture == MATERIAL_NO_TEXTURE || !m->uvs)
        return luminance(scene_emission(s, m->material, (const float[]){ 0.0f, 0.0f }, NULL));
    const uint32_t n = lookups(&s->textures[material->emission_texture], m, corner);
    double sum = 0.0;
    /* The centres of the n^2 small triangles that lines parallel to the sides make: upright ones, and between them
     * those that stand on a tip. */
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = 0; j < 2 * (n - i) - 1; j++) {
            const double third = j % 2 ? 2.0 / 3.0 : 1.0 / 3.0, u = (i + third) / n, v = (j / 2 + third) / n;
            float uv[2];
            for (int k = 0; k < 2; k++)
                uv[k] = (float)((1.0 - u - v) * m->uvs[2 * (size_t)corner[0] + (size_t)k] +
                                u * m->uvs[2 * (size_t)corner[1] + (size_t)k] +
                                v * m->uvs[2 * (size_t)corner[2] + (size_t)k]);
            sum += luminance(scene_emission(s, m->material, uv, NULL));
        }
    return sum / ((double)n * n);
}

/* Running sums of the triangles' power. Without power the table is that of no triangles. */
static void fill_sums(struct emitters *e)
{
    double sum = 0.0;

    for (size_t g = 0; g < e->group_count; g++) {
        const struct mesh *m = &e->scene->meshes[e->groups[g].mesh];
        double *out = e->sums + e->groups[g].first + 1;
#pragma omp parallel for schedule(dynamic, 256)
        for (uint32_t t = 0; t < m->triangle_count; t++)
            out[t] = double_area(m, t) * mean_emission(e->scene, m, t);
    }
    for (uint64_t i = 1; i <= e->triangle_count; i++)
        e->sums[i] = sum += e->sums[i];
    for (uint64_t i = 1; i <= e->triangle_count && sum > 0.0; i++)
        e->sums[i] /= sum;
    if (!(sum > 0.0))
        e->triangle_count = 0;
}

static void find_groups(struct emitters *e)
{
    for (uint32_t i = 0; i < e->scene->mesh_count; i++) {
        e->group_of[i] = NO_GROUP;
        if (!emits(e->scene, i))
            continue;
        e->group_of[i] = (uint32_t)e->group_count;
        e->groups[e->group_count++] = (struct group){ i, e->triangle_count };
        e->triangle_count += e->scene->meshes[i].triangle_count;
    }
}

struct emitters *emitters_create(const struct scene *scene, const struct rays *rays)
{
    struct emitters *e = mem_alloc(1, sizeof(*e));

    if (!e)
        return NULL;
    e->scene = scene;
    e->rays = rays;
    e->groups = mem_alloc(scene->mesh_count ? scene->mesh_count : 1, sizeof(*e->groups));
    e->group_of = mem_alloc(scene->mesh_count ? scene->mesh_count : 1, sizeof(*e->group_of));
    if (e->groups && e->group_of) {
        find_groups(e);
        e->sums = mem_alloc(e->triangle_count + 1, sizeof(*e->sums));
    }
    if (!e->sums) {
        emitters_destroy(e);
        return NULL;
    }
    fill_sums(e);
    return e;
}

void emitters_destroy(struct emitters *e)
{
    if (!e)
        return;
    mem_free(e->groups);
    mem_free(e->group_of);
    mem_free(e->sums);
    mem_free(e);
}

uint64_t emitters_triangles(const struct emitters *e)
{
    return e->triangle_count;
}

uint64_t emitters_lights(const struct emitters *e)
{
    return e->scene->light_count;
}

/* ---- Triangles ---- */

/* The triangle whose part of [0, 1) holds x. */
static uint64_t find_triangle(const struct emitters *e, double x)
{
    uint64_t low = 0, high = e->triangle_count;

    while (high - low > 1) {
        const uint64_t middle = low + (high - low) / 2;
        if (e->sums[middle] <= x)
            low = middle;
        else
            high = middle;
    }
    return low;
}

static const struct group *group_with(const struct emitters *e, uint64_t triangle)
{
    size_t low = 0, high = e->group_count;

    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (e->groups[middle].first <= triangle)
            low = middle;
        else
            high = middle;
    }
    return &e->groups[low];
}

/* m^-2, on its whole surface. */
static double area_density(const struct emitters *e, uint64_t index, const struct mesh *m, uint32_t triangle)
{
    return (e->sums[index + 1] - e->sums[index]) / (0.5 * double_area(m, triangle));
}

/* Whether the lamp has surface where a shadow ray ends. The ray itself ends before it, so that nothing else asks. */
static bool is_covered(const struct emitters *e, const struct hit *at, struct vec3 from, struct vec3 to)
{
    const struct material *m = &e->scene->materials[e->scene->meshes[at->mesh].material];
    struct mask mask;

    if (m->alpha_mode == ALPHA_OPAQUE && !m->thin)
        return true;
    mask_init(&mask, e->scene, at->mesh);
    return mask_covers(&mask, at->triangle, at->u, at->v, (const float[]){ from.x, from.y, from.z },
                       (const float[]){ to.x, to.y, to.z });
}

bool emitters_sample(const struct emitters *e, struct vec3 from, const double x[3], struct arrival *out)
{
    if (e->triangle_count == 0)
        return false;
    const uint64_t index = find_triangle(e, x[0]);
    const struct group *g = group_with(e, index);
    const struct mesh *m = &e->scene->meshes[g->mesh];
    const double root = sqrt(x[1]);
    const struct hit at = { .mesh = g->mesh,
                            .triangle = (uint32_t)(index - g->first),
                            .u = (float)(root * (1.0 - x[2])),
                            .v = (float)(root * x[2]) };
    struct vec3 p[3];
    struct surface s;

    mesh_corners_rounded(m, at.triangle, p);
    /* Any point of the triangle tells the side that `from` is on. */
    rays_surface(e->rays, &at, vec3_sub(from, p[0]), &s);
    out->to = vec3_sub(surface_start(&s, 1.0f), from);
    const double distance = vec3_length(out->to);
    out->dir = vec3_scale(out->to, (float)(1.0 / distance));
    const double cosine = -vec3_dot_double(s.geometric, out->dir);
    const struct vec3 emission = scene_emission(e->scene, m->material, s.uv, NULL);
    if (!(distance > 0.0 && cosine > 0.0 && luminance(emission) > 0.0) || !is_covered(e, &at, from, out->to))
        return false;
    out->tfar = SHADOW_END;
    out->density = area_density(e, index, m, at.triangle) * distance * distance / cosine;
    out->rgb[0] = emission.x;
    out->rgb[1] = emission.y;
    out->rgb[2] = emission.z;
    return true;
}

double emitters_density(const struct emitters *e, const struct hit *h, struct vec3 geometric, struct vec3 dir)
{
    const uint32_t group = e->group_of[h->mesh];
    const double cosine = fabs(vec3_dot_double(geometric, dir));

    if (group == NO_GROUP || e->triangle_count == 0 || !(cosine > 0.0))
        return 0.0;
    return area_density(e, e->groups[group].first + h->triangle, &e->scene->meshes[h->mesh], h->triangle) *
           (double)h->t * h->t / cosine;
}

/* ---- Punctual lights ---- */

static double cone(const struct punctual_light *l, struct vec3 dir)
{
    const double scale = 1.0 / fmax(CONE_LEAST, (double)l->inner_cos - l->outer_cos);
    const double in = (-vec3_dot_double(l->direction, dir) - l->outer_cos) * scale, share = fmin(1.0, fmax(0.0, in));

    return share * share;
}

void light_arrive(const struct punctual_light *l, struct vec3 from, struct vec3 *dir, double *distance, double rgb[3])
{
    const struct vec3 to = vec3_sub(l->position, from);
    double scale = 1.0;

    if (l->kind == LIGHT_DIRECTIONAL) {
        *dir = vec3_scale(l->direction, -1.0f);
        *distance = INFINITY;
    } else {
        *distance = sqrt(vec3_dot_double(to, to));
        *dir = vec3_scale(to, (float)(1.0 / *distance));
        scale = *distance > 0.0 ? 1.0 / (*distance * *distance) : 0.0;
        if (l->kind == LIGHT_SPOT)
            scale *= cone(l, *dir);
    }
    rgb[0] = l->intensity.x * scale;
    rgb[1] = l->intensity.y * scale;
    rgb[2] = l->intensity.z * scale;
}

static double share_of(const struct emitters *e, size_t light, struct vec3 from)
{
    double rgb[3], distance;
    struct vec3 dir;

    light_arrive(&e->scene->lights[light], from, &dir, &distance, rgb);
    return rgb[0] + rgb[1] + rgb[2];
}

bool emitters_pick_light(const struct emitters *e, struct vec3 from, double x, struct arrival *out)
{
    const size_t count = e->scene->light_count;
    double sum = 0.0, below = 0.0, distance;
    size_t i = 0;

    for (size_t k = 0; k < count; k++)
        sum += share_of(e, k, from);
    if (!(sum > 0.0 && sum < INFINITY))
        return false;
    double share = share_of(e, 0, from);
    while (i + 1 < count && below + share <= x * sum) {
        below += share;
        share = share_of(e, ++i, from);
    }
    if (!(share > 0.0)) /* rounding at the end of the list */
        return false;
    light_arrive(&e->scene->lights[i], from, &out->dir, &distance, out->rgb);
    const bool far = isinf(distance);
    out->to = far ? out->dir : vec3_sub(e->scene->lights[i].position, from);
    out->tfar = far ? INFINITY : SHADOW_END;
    out->density = 0.0;
    for (int c = 0; c < 3; c++)
        out->rgb[c] *= sum / share;
    return true;
}
