#include "scene/lamps/lamps.h"

#include "base/mem.h"
#include "scene/geometry/coverage.h"
#include "scene/geometry/mesh_read.h"
#include "scene/surface/scatter.h"

#include <math.h>

/* A shadow ray ends this share of its length before a lamp: float directions may err by 1e-7 of the distance, and by a
 * few times that at grazing angles. */
#define SHADOW_END 0.99999f

#define LOOKUPS_MAX 32      /* texture lookups along the edge of a triangle, at most; and */
#define TEXELS_A_LOOKUP 2.0 /* texels between two of them */
#define CONE_LEAST 1e-3     /* difference of a spot's cosines below which its edge is no longer resolved, as in glTF */

struct group { /* an emissive mesh */
    uint32_t mesh;
    uint32_t block;
    uint64_t first; /* of its triangles, counted over all groups */
};

/* Groups of triangles with one table: consecutive meshes in world space, or one placed mesh, whose instances share the
 * table, since the distribution of power within an instance need not be exact. */
struct block {
    uint64_t first, count; /* triangles, counted over all groups */
    uint64_t table;        /* in sums: count + 1 running sums, from 0 to 1 */
    double power;          /* area x luminance */
    double below, share;   /* the part of [0, 1) that picks it */
};

struct emitters {
    const struct scene *scene;
    const struct rays *rays;
    struct group *groups;
    struct block *blocks;
    size_t group_count, block_count;
    uint32_t *group_of; /* [mesh_count]: index of its group, or NO_GROUP */
    double *sums;       /* the tables */
    uint64_t sum_count;
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

/* The number of lookups along a triangle's edge, by the length of its longest edge in texels. */
static uint32_t lookups(const struct texture *t, const float *uvs, const uint32_t *corner)
{
    double longest = 0.0;

    for (int k = 0; k < 3; k++) {
        const float *a = uvs + 2 * (size_t)corner[k], *b = uvs + 2 * (size_t)corner[(k + 1) % 3];
        longest = fmax(longest, hypot((a[0] - b[0]) * (double)t->width, (a[1] - b[1]) * (double)t->height));
    }
    return (uint32_t)fmin(fmax(1.0, ceil(longest / TEXELS_A_LOOKUP)), LOOKUPS_MAX); /* 1 for NaN, too */
}

/* The mean luminance that the triangle emits. An estimate suffices, because it only determines the sampling
 * probability. */
static double mean_emission(const struct scene *s, const struct mesh *m, uint32_t triangle)
{
    const struct material *material = &s->materials[m->material];
    const uint32_t *corner = m->indices + 3 * (size_t)triangle;
    const float *uvs = material->second & MAP_EMISSION ? m->more_uvs : m->uvs;

    if (material->emission_texture == MATERIAL_NO_TEXTURE || !uvs)
        return luminance(scene_emission(s, m->material, (const float[]){ 0.0f, 0.0f }, NULL));
    const uint32_t n = lookups(&s->textures[material->emission_texture], uvs, corner);
    double sum = 0.0;
    /* The centres of the n^2 small triangles that lines parallel to the sides make: upright ones, and between them
     * those that stand on a tip. */
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = 0; j < 2 * (n - i) - 1; j++) {
            const double third = j % 2 ? 2.0 / 3.0 : 1.0 / 3.0, u = (i + third) / n, v = (j / 2 + third) / n;
            float uv[2];
            for (int k = 0; k < 2; k++)
                uv[k] =
                    (float)((1.0 - u - v) * uvs[2 * (size_t)corner[0] + (size_t)k] +
                            u * uvs[2 * (size_t)corner[1] + (size_t)k] + v * uvs[2 * (size_t)corner[2] + (size_t)k]);
            sum += luminance(scene_emission(s, m->material, uv, NULL));
        }
    return sum / ((double)n * n);
}

/* The ratio of areas between two placements of the same arrays, exact except for anisotropic scaling. */
static double area_ratio(const struct mesh *m, const struct mesh *source)
{
    return pow(mesh_volume_scale(m) / mesh_volume_scale(source), 2.0 / 3.0);
}

/* Power of the triangles of a group, into its block's table. */
static void fill_group(struct emitters *e, const struct group *g)
{
    const struct mesh *m = &e->scene->meshes[g->mesh];
    const struct block *b = &e->blocks[g->block];
    double *out = e->sums + b->table + (g->first - b->first) + 1;

#pragma omp parallel for schedule(dynamic, 256)
    for (uint32_t t = 0; t < m->triangle_count; t++)
        out[t] = double_area(m, t) * mean_emission(e->scene, m, t);
}

/* Makes running sums of a block's table, and its power. */
static void finish_table(struct emitters *e, struct block *b)
{
    double *sums = e->sums + b->table, sum = 0.0;

    for (uint64_t i = 1; i <= b->count; i++)
        sums[i] = sum += sums[i];
    for (uint64_t i = 1; i <= b->count && sum > 0.0; i++)
        sums[i] /= sum;
    b->power = sum;
}

/* Without power the table is that of no triangles. */
static void fill_sums(struct emitters *e)
{
    double sum = 0.0, below = 0.0;

    for (size_t g = 0; g < e->group_count; g++) {
        const struct mesh *m = &e->scene->meshes[e->groups[g].mesh];
        struct block *b = &e->blocks[e->groups[g].block];
        if (m->source == 0)
            fill_group(e, &e->groups[g]);
        else
            b->power = e->blocks[e->groups[e->group_of[m->source - 1]].block].power *
                       area_ratio(m, &e->scene->meshes[m->source - 1]);
        if (m->source == 0 && (g + 1 == e->group_count || e->groups[g + 1].block != e->groups[g].block))
            finish_table(e, b);
    }
    for (size_t i = 0; i < e->block_count; i++)
        sum += e->blocks[i].power;
    for (size_t i = 0; i < e->block_count; i++) {
        e->blocks[i].below = below / sum;
        e->blocks[i].share = e->blocks[i].power / sum;
        below += e->blocks[i].power;
    }
    if (!(sum > 0.0))
        e->triangle_count = 0;
}

static void find_groups(struct emitters *e)
{
    const struct scene *s = e->scene;
    bool open = false; /* the last block takes further meshes */

    for (uint32_t i = 0; i < s->mesh_count; i++) {
        const struct mesh *m = &s->meshes[i];
        e->group_of[i] = NO_GROUP;
        if (!emits(s, i))
            continue;
        if (!open || m->placed) {
            e->blocks[e->block_count] = (struct block){ .first = e->triangle_count, .table = e->sum_count };
            if (m->source != 0)
                e->blocks[e->block_count].table = e->blocks[e->groups[e->group_of[m->source - 1]].block].table;
            else
                e->sum_count++;
            e->block_count++;
        }
        open = !m->placed;
        struct block *b = &e->blocks[e->block_count - 1];
        b->count += m->triangle_count;
        e->sum_count += m->source == 0 ? m->triangle_count : 0;
        e->group_of[i] = (uint32_t)e->group_count;
        e->groups[e->group_count++] = (struct group){ i, (uint32_t)e->block_count - 1, e->triangle_count };
        e->triangle_count += m->triangle_count;
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
    e->blocks = mem_alloc(scene->mesh_count ? scene->mesh_count : 1, sizeof(*e->blocks));
    e->group_of = mem_alloc(scene->mesh_count ? scene->mesh_count : 1, sizeof(*e->group_of));
    if (e->groups && e->blocks && e->group_of) {
        find_groups(e);
        e->sums = mem_alloc(e->sum_count + 1, sizeof(*e->sums));
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
    mem_free(e->blocks);
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

static const struct block *find_block(const struct emitters *e, double x)
{
    size_t low = 0, high = e->block_count;

    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (e->blocks[middle].below <= x)
            low = middle;
        else
            high = middle;
    }
    return &e->blocks[low];
}

/* The triangle of a block, counted over all groups, whose part of [0, 1) holds x. */
static uint64_t find_triangle(const struct emitters *e, const struct block *b, double x)
{
    uint64_t low = 0, high = b->count;

    while (high - low > 1) {
        const uint64_t middle = low + (high - low) / 2;
        if (e->sums[b->table + middle] <= x)
            low = middle;
        else
            high = middle;
    }
    return b->first + low;
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
static double area_density(const struct emitters *e, const struct group *g, uint32_t triangle)
{
    const struct block *b = &e->blocks[g->block];
    const double *sum = e->sums + b->table + (g->first - b->first) + triangle;

    return b->share * (sum[1] - sum[0]) / (0.5 * double_area(&e->scene->meshes[g->mesh], triangle));
}

/* Whether the lamp has surface, not a hole, where a shadow ray ends. The ray itself ends before the lamp and cannot
 * test it. */
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
    const struct block *b = find_block(e, x[0]);
    if (!(b->share > 0.0)) /* rounding at the end of the list */
        return false;
    const uint64_t index = find_triangle(e, b, (x[0] - b->below) / b->share);
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
    /* Any point of the triangle shows which side `from` is on. */
    rays_surface(e->rays, &at, vec3_sub(from, p[0]), &s);
    out->to = vec3_sub(surface_start(&s, 1.0f), from);
    const double distance = vec3_length(out->to);
    out->dir = vec3_scale(out->to, (float)(1.0 / distance));
    const double cosine = -vec3_dot_double(s.geometric, out->dir);
    const float *uv = map_uv(&e->scene->materials[m->material], MAP_EMISSION, &s);
    const struct vec3 emission = scene_emission(e->scene, m->material, uv, NULL);
    if (!(distance > 0.0 && cosine > 0.0 && luminance(emission) > 0.0) || !is_covered(e, &at, from, out->to))
        return false;
    out->tfar = SHADOW_END;
    out->density = area_density(e, g, at.triangle) * distance * distance / cosine;
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
    return area_density(e, &e->groups[group], h->triangle) * (double)h->t * h->t / cosine;
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
