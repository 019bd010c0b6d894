#include "gbuffer_build.h"

#include <assert.h>
#include <math.h>
#include <string.h>

/* A camera ray is followed until less than this share of it is left [docs/REFERENCES.md names no source: our choice].
 */
#define CUT 1e-3f
#define RAYS_MAX 256u
/* Below this alpha a GGX lobe is a mirror. */
#define ALPHA_DELTA 1e-3f

struct branch {
    struct vec3 origin, dir;
    float weight[3]; /* flux: without the n^2 of the medium */
    float ior;       /* of the medium the ray runs in */
    float distance;  /* m, from the eye */
    uint32_t bounces;
};

struct chain {
    const struct sight *sight;
    struct leaf *leaves;
    uint32_t leaf_count;
    struct branch pending[LEAF_MAX];
    uint32_t pending_count;
    double cut;
};

static float mean3(const float w[3])
{
    return (w[0] + w[1] + w[2]) / 3.0f;
}

static void push(struct chain *c, const struct branch *b)
{
    if (mean3(b->weight) <= 0.0f)
        return;
    if (c->pending_count + c->leaf_count < LEAF_MAX)
        c->pending[c->pending_count++] = *b;
    else
        c->cut += mean3(b->weight);
}

static struct branch pop_heaviest(struct chain *c)
{
    uint32_t best = 0;

    for (uint32_t i = 1; i < c->pending_count; i++) {
        if (mean3(c->pending[i].weight) > mean3(c->pending[best].weight))
            best = i;
    }
    const struct branch b = c->pending[best];
    c->pending[best] = c->pending[--c->pending_count];
    return b;
}

static double pending_weight(const struct chain *c)
{
    double sum = 0.0;
    for (uint32_t i = 0; i < c->pending_count; i++)
        sum += mean3(c->pending[i].weight);
    return sum;
}

/* Radiance over index squared is what stays along a ray [Veach 1997, section 5.2]: a leaf inside a medium of index n
 * counts n^-2 at the eye, which stands in air. */
static struct leaf *new_leaf(struct chain *c, const struct branch *b)
{
    assert(c->leaf_count < LEAF_MAX);
    struct leaf *l = &c->leaves[c->leaf_count++];
    memset(l, 0, sizeof(*l));
    for (int k = 0; k < 3; k++)
        l->weight[k] = b->weight[k] / (b->ior * b->ior);
    l->arrival = b->dir;
    l->bounces = b->bounces;
    return l;
}

static struct vec3 towards_white(struct vec3 f0, float x)
{
    return vec3_make(f0.x + (1.0f - f0.x) * x, f0.y + (1.0f - f0.y) * x, f0.z + (1.0f - f0.z) * x);
}

/* glTF's F0: 0.04 of a dielectric, the base colour of a metal [glTF 2.0, appendix B]. */
static struct vec3 ggx_f0(struct vec3 base, float metallic)
{
    const float d = 0.04f * (1.0f - metallic);
    return vec3_make(d + base.x * metallic, d + base.y * metallic, d + base.z * metallic);
}

static struct vec3 base_colour(const struct scene *scene, const struct material *m, const float uv[2])
{
    if (m->texture == MATERIAL_NO_TEXTURE)
        return m->diffuse;
    return vec3_mul(m->diffuse, texture_lookup(&scene->textures[m->texture], uv[0], uv[1]));
}

static void fill_lobe(struct leaf *l, const struct material *m, struct vec3 base)
{
    const float alpha = m->roughness * m->roughness;

    l->kind = LOBE_LAMBERT;
    l->diffuse = base;
    if (m->kind == MATERIAL_PHONG && m->specular.x + m->specular.y + m->specular.z > 0.0f) {
        l->kind = LOBE_PHONG;
        l->specular = m->specular;
        l->gloss = m->exponent;
    } else if (m->kind == MATERIAL_GGX) {
        l->diffuse = vec3_scale(base, 1.0f - m->metallic);
        if (alpha >= ALPHA_DELTA) { /* else the lobe was followed as a mirror, and the diffuse part is what is left */
            l->kind = LOBE_GGX;
            l->specular = ggx_f0(base, m->metallic);
            l->gloss = alpha;
        }
    }
}

/* The normal to reflect and refract by: the shading normal, unless that would send the ray through the surface. */
static struct vec3 optical_normal(const struct surface *s, struct vec3 dir, struct vec3 *reflected)
{
    struct vec3 n = s->shading;
    *reflected = vec3_sub(dir, vec3_scale(n, 2.0f * vec3_dot(dir, n)));
    if (vec3_dot(dir, n) >= 0.0f || vec3_dot(*reflected, s->geometric) <= 0.0f) {
        n = s->geometric;
        *reflected = vec3_sub(dir, vec3_scale(n, 2.0f * vec3_dot(dir, n)));
    }
    *reflected = vec3_normalize(*reflected);
    return n;
}

static struct vec3 start_at(const struct surface *s, float side)
{
    return vec3_add(s->position, vec3_scale(s->geometric, side * s->offset));
}

static void scale_weight(struct branch *b, float r, float g, float bl)
{
    b->weight[0] *= r;
    b->weight[1] *= g;
    b->weight[2] *= bl;
}

static void push_reflection(struct chain *c, const struct branch *in, const struct surface *s, struct vec3 reflectance)
{
    struct branch b = *in;

    (void)optical_normal(s, in->dir, &b.dir);
    b.origin = start_at(s, 1.0f);
    b.bounces++;
    scale_weight(&b, reflectance.x, reflectance.y, reflectance.z);
    push(c, &b);
}

/* Unpolarised Fresnel reflectance of a dielectric; eta is the index behind over the index before the surface, cos_i > 0
 * [Born and Wolf 1999, section 1.5.2]. *cos_t is 0 on total reflection. */
static double fresnel(double cos_i, double eta, double *cos_t)
{
    const double sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);

    *cos_t = 0.0;
    if (sin2_t >= 1.0)
        return 1.0;
    *cos_t = sqrt(1.0 - sin2_t);
    const double parallel = (eta * cos_i - *cos_t) / (eta * cos_i + *cos_t);
    const double across = (cos_i - eta * *cos_t) / (cos_i + eta * *cos_t);
    return 0.5 * (parallel * parallel + across * across);
}

static void push_glass(struct chain *c, const struct branch *in, const struct surface *s, float ior)
{
    struct branch r = *in, t = *in;
    double cos_t;

    /* Glass stands in air: what is not inside is of index 1. */
    const float behind = s->outside ? ior : 1.0f;
    const double eta = s->outside ? (double)ior : 1.0 / (double)ior;
    const struct vec3 n = optical_normal(s, in->dir, &r.dir);
    const double cos_i = fmin(1.0, -(double)vec3_dot(in->dir, n));
    const double f = fresnel(cos_i, eta, &cos_t);

    r.origin = start_at(s, 1.0f);
    r.bounces++;
    scale_weight(&r, (float)f, (float)f, (float)f);
    push(c, &r);
    if (f >= 1.0)
        return;
    t.dir =
        vec3_normalize(vec3_add(vec3_scale(in->dir, (float)(1.0 / eta)), vec3_scale(n, (float)(cos_i / eta - cos_t))));
    t.origin = start_at(s, -1.0f);
    t.ior = behind;
    t.bounces++;
    scale_weight(&t, (float)(1.0 - f), (float)(1.0 - f), (float)(1.0 - f));
    push(c, &t);
}

static void push_glossy_mirror(struct chain *c, const struct branch *b, const struct surface *s,
                               const struct material *m, struct vec3 base)
{
    struct vec3 reflected;
    const struct vec3 n = optical_normal(s, b->dir, &reflected);
    const float x = 1.0f - fminf(1.0f, fmaxf(0.0f, -vec3_dot(b->dir, n)));

    /* [Schlick 1994, Eq. 15] */
    push_reflection(c, b, s, towards_white(ggx_f0(base, m->metallic), x * x * x * x * x));
}

/* Meets the branch's surface: ends there, goes on, or both. True when the surface has a delta lobe. */
static bool meet(struct chain *c, struct branch *b, const struct hit *h)
{
    const struct scene *scene = c->sight->scene;
    const uint32_t material = scene->meshes[h->mesh].material;
    const struct material *m = &scene->materials[material];
    struct surface s;

    rays_surface(c->sight->rays, h, vec3_scale(b->dir, -1.0f), &s);
    b->distance += h->t; /* dir is of unit length */
    if (m->kind == MATERIAL_GLASS) {
        push_glass(c, b, &s, m->ior);
        return true;
    }
    const struct vec3 base = base_colour(scene, m, s.uv);
    if (m->kind == MATERIAL_MIRROR) {
        push_reflection(c, b, &s, base);
        return true;
    }
    const bool delta = m->kind == MATERIAL_GGX && m->roughness * m->roughness < ALPHA_DELTA;
    if (!delta || m->metallic < 1.0f) {
        struct leaf *l = new_leaf(c, b);
        l->mesh = h->mesh;
        l->material = material;
        l->surface = s;
        l->footprint = b->distance * c->sight->pixel_angle;
        fill_lobe(l, m, base);
    }
    if (delta)
        push_glossy_mirror(c, b, &s, m, base);
    return delta;
}

uint32_t sight_trace(const struct sight *s, struct vec3 origin, struct vec3 dir, struct leaf out[LEAF_MAX],
                     bool *specular, struct sight_count *count)
{
    struct chain c;
    uint32_t rays = 0;

    c.sight = s;
    c.leaves = out;
    c.leaf_count = c.pending_count = 0;
    c.cut = 0.0;
    *specular = false;
    push(&c, &(struct branch){ .origin = origin, .dir = dir, .weight = { 1.0f, 1.0f, 1.0f }, .ior = 1.0f });
    while (c.pending_count > 0 && rays < RAYS_MAX && (rays == 0 || pending_weight(&c) >= (double)CUT)) {
        struct branch b = pop_heaviest(&c);
        struct hit h;
        rays++;
        if (!rays_intersect(s->rays, b.origin, b.dir, 0.0f, &h))
            new_leaf(&c, &b)->escaped = true;
        else if (meet(&c, &b, &h) && b.bounces == 0)
            *specular = true;
    }
    count->rays += rays;
    count->cut += c.cut + pending_weight(&c);
    return c.leaf_count;
}
