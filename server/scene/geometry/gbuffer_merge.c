#include "scene/geometry/gbuffer_build.h"

#include <math.h>

#define COS_5_DEGREES 0.99619470f       /* between arrivals by mirrors and glass */
#define COS_10_DEGREES 0.98480775f      /* between normals */
#define COS_30_DEGREES 0.86602540f      /* between those that are interpolated or mapped anyway */
#define LOBE_PART 0.8f                  /* of alpha, radians */
#define REACH 6.0f                      /* footprints: a shadow often ends within them */
#define WIDTH_PART 0.5f                 /* of the narrower of two escapes */
#define FAINT (float)(1.5 * LEAF_LEAST) /* sum of weights below which an escape may turn by */
#define FAINT_REACH 0.1f                /* radians, about a cell of the light-transport cache */
#define ROUGHNESS_STEP 0.1f             /* lobes whose roughness differs by more are not averaged */

/* Whether the lobes differ too little to matter, as they do within a texel or two of most roughness maps. */
static bool lobes_alike(const struct leaf *a, const struct leaf *b)
{
    return fabsf(sqrtf(a->gloss) - sqrtf(b->gloss)) <= ROUGHNESS_STEP;
}

/* The least cosine between normals that count as one. Where they differ by more than a lobe is wide, the sun's
 * highlight would be on all of a pixel or on nothing. */
static float least_cosine(const struct leaf *a, const struct leaf *b)
{
    const float alpha = fminf(lobe_width(a->kind, a->gloss), lobe_width(b->kind, b->gloss));

    if (alpha <= 0.0f)
        return COS_10_DEGREES;
    return fmaxf(COS_10_DEGREES, fminf(0.99999f, 1.0f - 0.5f * (LOBE_PART * alpha) * (LOBE_PART * alpha)));
}

static float total(const struct leaf *l)
{
    return l->weight[0] + l->weight[1] + l->weight[2];
}

/* The angle between escapes that one lookup of their common width replaces. */
static float miss_reach(const struct sight *s, const struct leaf *a, const struct leaf *b)
{
    const float least = fmaxf(1.5f * s->pixel_angle /* a diagonal */, WIDTH_PART * fminf(a->footprint, b->footprint));

    return total(a) < FAINT && total(b) < FAINT ? fmaxf(least, FAINT_REACH) : least;
}

bool leaf_alike(const struct sight *s, const struct leaf *a, const struct leaf *b, float reach)
{
    if (a->missed && b->missed)
        return vec3_length(vec3_sub(a->arrival, b->arrival)) <= miss_reach(s, a, b);
    if (a->missed != b->missed || a->bounces != b->bounces)
        return false;
    if (a->mesh != b->mesh || a->material != b->material || a->kind != b->kind || a->layer != b->layer ||
        !lobes_alike(a, b))
        return false;
    /* A normal map is averaged, as it is over a pixel with a single ray. */
    const struct material *m = &s->scene->materials[a->material];
    const bool mapped = (m->maps & MAP_NORMAL) && (a->layer == LAYER_BASE || m->coat_bent);
    /* With interpolated normals, the geometric normals only determine what lies below the horizon. */
    const float least = least_cosine(a, b),
                geometric_least = s->scene->meshes[a->mesh].normals ? COS_30_DEGREES : least;
    if (vec3_dot(a->surface.shading, b->surface.shading) < (mapped ? COS_30_DEGREES : least) ||
        vec3_dot(a->surface.geometric, b->surface.geometric) < geometric_least)
        return false;
    if (a->bounces > 0 && vec3_dot(a->arrival, b->arrival) < COS_5_DEGREES)
        return false;
    const struct vec3 apart = vec3_sub(b->surface.position, a->surface.position);
    const float step = fmaxf(a->footprint, b->footprint); /* behind mirrors and glass it tells little of nearness */
    return fabsf(vec3_dot(apart, a->surface.geometric)) <= step &&
           (a->bounces > 0 || vec3_length(apart) <= reach * step);
}

/* The position of a leaf in clustering space: escapes by direction, points by position. */
static struct vec3 whereabouts(const struct leaf *l)
{
    return l->missed ? l->arrival : l->surface.position;
}

/* Variances add: width^2 / 12 is the mean of the leaves' own and half the variance of their directions about the mean,
 * per axis. */
static float merged_width(const struct leaf *leaves, const struct leaf_link *links, uint32_t first, struct vec3 mean)
{
    double sum = 0.0, all = 0.0;

    for (uint32_t i = first; i != LEAF_END; i = links[i].next) {
        const struct leaf *l = &leaves[i];
        const struct vec3 off = vec3_sub(l->arrival, mean);
        const double w = total(l);
        sum += w * ((double)l->footprint * l->footprint + 6.0 * (double)vec3_dot(off, off));
        all += w;
    }
    return (float)sqrt(sum / all);
}

/* The mean lobe of a material whose roughness or metallic varies: in gloss it is approximate. */
static void merge_lobes(const struct leaf *leaves, const struct leaf_link *links, uint32_t first, struct leaf *out)
{
    double specular[3] = { 0.0 }, weight[3] = { 0.0 }, gloss = 0.0, all = 0.0;
    float *const to[3] = { &out->specular.x, &out->specular.y, &out->specular.z };

    for (uint32_t i = first; i != LEAF_END; i = links[i].next) {
        const struct leaf *l = &leaves[i];
        const float from[3] = { l->specular.x, l->specular.y, l->specular.z };
        for (int k = 0; k < 3; k++) {
            specular[k] += (double)l->weight[k] * from[k];
            weight[k] += l->weight[k];
        }
        gloss += (double)total(l) * l->gloss;
        all += total(l);
    }
    for (int k = 0; k < 3; k++)
        *to[k] = weight[k] > 0.0 ? (float)(specular[k] / weight[k]) : 0.0f;
    out->gloss = (float)(gloss / all);
}

/* The mean normal of a cluster; it still faces the same side of `out`, which is one of them. */
static void merge_normals(const struct leaf *leaves, const struct leaf_link *links, uint32_t first, struct leaf *out)
{
    struct vec3 sum = { 0.0f, 0.0f, 0.0f };

    for (uint32_t i = first; i != LEAF_END; i = links[i].next)
        sum = vec3_add(sum, vec3_scale(leaves[i].surface.shading, total(&leaves[i])));
    if (vec3_dot(sum, out->surface.geometric) > 0.0f)
        out->surface.shading = vec3_normalize(sum);
}

/* The cells in which rays may start on the plane of `out`: all of the cluster's, or none if some of it is above. */
static void merge_cells(const struct leaf *leaves, const struct leaf_link *links, uint32_t first, struct leaf *out)
{
    for (uint32_t i = first; i != LEAF_END; i = links[i].next) {
        out->cells |= leaves[i].cells;
        if (!leaf_level(out, &leaves[i], 1.0f))
            out->pixel = 0.0f;
    }
}

/* Merges the cluster of seed `first`. Colours are averaged per channel with the weights, which is exact, since a pixel
 * is linear in them. */
static struct leaf merge_cluster(const struct sight *s, const struct leaf *leaves, const struct leaf_link *links,
                                 uint32_t first)
{
    double weight[3] = { 0.0 }, colour[3] = { 0.0 }, place[3] = { 0.0 }, all = 0.0;
    uint32_t nearest = first;
    float least = INFINITY;

    for (uint32_t i = first; i != LEAF_END; i = links[i].next) {
        const struct leaf *l = &leaves[i];
        const struct vec3 p = whereabouts(l);
        const double w = total(l);
        const float diffuse[3] = { l->diffuse.x, l->diffuse.y, l->diffuse.z };
        for (int k = 0; k < 3; k++) {
            weight[k] += l->weight[k];
            colour[k] += (double)l->weight[k] * diffuse[k];
        }
        place[0] += w * p.x;
        place[1] += w * p.y;
        place[2] += w * p.z;
        all += w;
    }
    const struct vec3 mean = vec3_make((float)(place[0] / all), (float)(place[1] / all), (float)(place[2] / all));
    for (uint32_t i = first; i != LEAF_END; i = links[i].next) {
        const float d = vec3_length(vec3_sub(whereabouts(&leaves[i]), mean));
        if (d < least) {
            least = d;
            nearest = i;
        }
    }
    struct leaf l = leaves[nearest];
    for (int k = 0; k < 3; k++)
        l.weight[k] = (float)weight[k];
    l.diffuse = vec3_make(weight[0] > 0.0 ? (float)(colour[0] / weight[0]) : 0.0f,
                          weight[1] > 0.0 ? (float)(colour[1] / weight[1]) : 0.0f,
                          weight[2] > 0.0 ? (float)(colour[2] / weight[2]) : 0.0f);
    const uint32_t maps = l.missed ? 0 : s->scene->materials[l.material].maps;
    if (maps & (MAP_ROUGHNESS | MAP_COAT_ROUGHNESS))
        merge_lobes(leaves, links, first, &l);
    if (maps & MAP_NORMAL)
        merge_normals(leaves, links, first, &l);
    if (l.missed) {
        l.arrival = vec3_normalize(mean);
        l.footprint = merged_width(leaves, links, first, mean);
    } else {
        merge_cells(leaves, links, first, &l);
    }
    return l;
}

void leaves_merge(const struct sight *s, struct leaf *leaves, struct leaf_link *links, uint32_t *count)
{
    uint32_t clusters = 0;

    /* Each leaf joins the first seed it is similar to, else becomes a seed. */
    for (uint32_t i = 0; i < *count; i++) {
        uint32_t k = 0;
        while (k < clusters && !leaf_alike(s, &leaves[links[k].seed], &leaves[i], REACH))
            k++;
        if (k == clusters)
            links[clusters++].seed = i;
        struct leaf_link *first = &links[links[k].seed];
        if (first != &links[i])
            links[first->last].next = i;
        first->last = i;
        links[i].next = LEAF_END;
    }
    for (uint32_t k = 0; k < clusters; k++) /* writes at or before its seed, which no later cluster reads */
        leaves[k] = merge_cluster(s, leaves, links, links[k].seed);
    *count = clusters;
}

void leaves_thin(struct leaf *leaves, double start, uint32_t *count)
{
    double sum = start * LEAF_LEAST;
    uint32_t kept = 0;

    for (uint32_t i = 0; i < *count; i++) {
        struct leaf l = leaves[i];
        const double weight = total(&l) / 3.0;
        if (!l.missed && l.bounces > 0 && weight < LEAF_LEAST) {
            sum += weight;
            if (sum < LEAF_LEAST)
                continue;
            sum -= LEAF_LEAST;
            for (int k = 0; k < 3; k++)
                l.weight[k] *= (float)(LEAF_LEAST / weight);
        }
        leaves[kept++] = l;
    }
    *count = kept;
}
