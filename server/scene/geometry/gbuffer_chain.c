#include "scene/geometry/gbuffer_build.h"

#include "scene/geometry/coverage.h"
#include "scene/geometry/scatter_hit.h"

#include "base/rng.h"

#include <math.h>
#include <string.h>

/* Camera rays are traced until less than this share is left [docs/REFERENCES.md has no source: our choice]. */
#define CUT 1e-3f
#define RAYS_MAX 256u
/* Beyond so many rays, after every RAYS_STEP of them, branches stand for others of twice the weight, up to HEAVY. */
#define RAYS_PLENTY 32u
#define RAYS_STEP 4u
#define HEAVY 0.1f

/* Branches lighter than this share of LEAF_LEAST stand for each other, like leaves (leaves_thin), so that glass before
 * glass needs fewer rays. */
#define FAINT 0.125
#define RAYS_IN_PIXEL 16.0f /* at most; wider ones are at the image's corners */

struct branch {
    struct vec3 origin, dir;
    float weight[3]; /* flux: without the n^2 of the medium */
    float ior;       /* of the medium that the ray is in */
    float distance;  /* m, from the camera to origin */
    float behind;    /* m: only hits beyond it count */
    uint32_t bounces;
    struct cone cone;
};

struct chain {
    const struct sight *sight;
    struct leaf *leaves;
    uint32_t leaf_count;
    struct branch pending[LEAF_MAX];
    uint32_t pending_count;
    double cut;
    float glow[3];
    float faint, sum; /* weight below which branches stand for each other; of those since the last that was kept */
    bool heavy; /* `faint` has grown: which branch stands for others is drawn for each, since the sum's would be biased
                   where what is kept decides what comes next */
    struct rng rng;
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

/* Radiance over squared index is invariant along a ray [Veach 1997, section 5.2]: a leaf in a medium of index n has a
 * factor n^-2 for the camera, which is in air. NULL: there are too many. */
static struct leaf *new_leaf(struct chain *c, const struct branch *b)
{
    if (c->leaf_count == LEAF_MAX) {
        c->cut += mean3(b->weight);
        return NULL;
    }
    struct leaf *l = &c->leaves[c->leaf_count++];
    for (int k = 0; k < 3; k++)
        l->weight[k] = b->weight[k] / (b->ior * b->ior);
    l->arrival = b->dir;
    l->bounces = b->bounces;
    return l;
}

/* What the branch sees of a rough surface. */
static void add_rough(struct chain *c, const struct branch *b, const struct hit *h, const struct scatter *at)
{
    const struct vec3 wo = scatter_side(at, vec3_scale(b->dir, -1.0f));
    const float share = at->weight * veil_passes(&at->veil, wo);
    struct leaf *l = new_leaf(c, b);

    if (!l)
        return;
    for (int k = 0; k < 3; k++)
        l->weight[k] *= share;
    l->missed = false;
    l->arrival = vec3_scale(wo, -1.0f);
    l->footprint = (b->distance + h->t) * c->sight->pixel_angle; /* dir is unit */

    l->mesh = at->mesh;
    l->material = at->material;
    l->surface = at->surface;
    l->kind = at->kind;
    l->layer = at->layer;
    l->diffuse = at->diffuse;
    l->specular = at->specular;
    l->gloss = at->gloss;
}

static void add_miss(struct chain *c, const struct branch *b)
{
    struct leaf *l = new_leaf(c, b);

    if (!l)
        return;
    *l = (struct leaf){ .missed = true,
                        .bounces = l->bounces,
                        .arrival = l->arrival,
                        .weight = { l->weight[0], l->weight[1], l->weight[2] },
                        .footprint = cone_width(&b->cone) };
}

/* The surface that the branch hits, and its emission, with textures averaged over the footprint. Returns the covered
 * share; passed: the share of light from behind, per channel. */
static float see(const struct sight *s, const struct branch *b, const struct hit *h, struct footprint *footprint,
                 struct scatter *at, struct vec3 *emission, float passed[3])
{
    const struct mesh *mesh = &s->scene->meshes[h->mesh];
    const struct material *m = &s->scene->materials[mesh->material];
    const bool mapped = mesh->uvs || mesh->more_uvs;
    float uv_step[4][2] = { { 0.0f } };

    rays_surface(s->rays, h, vec3_scale(b->dir, -1.0f), &at->surface);
    if (mapped || material_is_delta(m)) /* else nothing asks for differentials */
        cone_meet(&b->cone, h, &at->surface, b->dir, footprint);
    if (mapped)
        cone_uv(s->scene, h, footprint, uv_step);
    scatter_on(s->scene, h, uv_step, at);
    if (s->lamps)
        *emission = scene_emission(s->scene, at->material, map_uv(m, MAP_EMISSION, &at->surface),
                                   map_step(m, MAP_EMISSION, uv_step));
    return coverage_seen(s->scene, h, at, b->dir, uv_step, passed);
}

/* If only a part of the branch hits surface, the rest continues behind it. */
static void pass(struct chain *c, struct branch *b, const struct hit *h, float coverage, const float passed[3])
{
    struct branch rest = *b;

    if (coverage >= 1.0f)
        return;
    rest.behind = nextafterf(h->t, INFINITY);
    for (int k = 0; k < 3; k++) {
        rest.weight[k] *= passed[k];
        b->weight[k] *= coverage;
    }
    push(c, &rest);
}

/* Emission counts as the radiance in the medium that the surface is in; see new_leaf. */
static void add_glow(struct chain *c, const struct branch *b, struct vec3 emission)
{
    const float scale = 1.0f / (b->ior * b->ior);

    c->glow[0] += b->weight[0] * scale * emission.x;
    c->glow[1] += b->weight[1] * scale * emission.y;
    c->glow[2] += b->weight[2] * scale * emission.z;
}

/* False: others stand for this branch, which is faint. Else its weight is that of all it stands for. */
static bool stands(struct chain *c, struct branch *b)
{
    const float weight = mean3(b->weight);

    if (weight >= c->faint || weight <= 0.0f)
        return true;
    c->sum += weight;
    if (c->heavy ? rng_next(&c->rng) * (double)c->faint >= (double)weight : c->sum < c->faint)
        return false;
    c->sum -= c->faint;
    for (int k = 0; k < 3; k++)
        b->weight[k] *= c->faint / weight;
    return true;
}

/* The branch ends at a layer of the surface, continues, or both. */
static void end_or_continue(struct chain *c, const struct branch *b, const struct hit *h, const struct scatter *at,
                            struct footprint *footprint, float coverage)
{
    struct delta_ray out[2];

    if (at->rough && coverage > 0.0f)
        add_rough(c, b, h, at);
    const uint32_t count = scatter_eye(at, b->dir, out);
    if (count > 0)
        cone_bend(c->sight->scene, h, footprint);
    for (uint32_t i = 0; i < count; i++) {
        struct branch next = *b;
        next.origin = out[i].origin;
        next.dir = out[i].dir;
        next.distance += h->t;
        next.behind = 0.0f;
        next.bounces++;
        cone_turn(&b->cone, footprint, at, b->dir, &out[0], &out[i], &next.cone);
        if (out[i].crosses) /* glass is assumed to be in air */
            next.ior = at->surface.outside ? at->ior : 1.0f;
        for (int k = 0; k < 3; k++)
            next.weight[k] *= at->weight * out[i].weight[k];
        if (stands(c, &next))
            push(c, &next);
    }
}

/* Handles the branch's hit. Returns true if the visible surface has a delta lobe or a coat. */
static bool meet(struct chain *c, struct branch *b, const struct hit *h)
{
    struct scatter at;
    struct footprint footprint;
    struct vec3 emission;
    float passed[3];

    const float coverage = see(c->sight, b, h, &footprint, &at, &emission, passed);
    pass(c, b, h, coverage, passed);
    if (c->sight->lamps && coverage > 0.0f)
        add_glow(c, b, emission);
    end_or_continue(c, b, h, &at, &footprint, coverage);
    if (at.beyond.x + at.beyond.y + at.beyond.z > 0.0f && coverage > 0.0f) {
        struct scatter other = at;
        scatter_turn(&other);
        add_rough(c, b, h, &other);
    }
    if (at.veil.sheen > 0.0f && coverage > 0.0f) {
        struct scatter sheen = at;
        scatter_sheen(&sheen);
        add_rough(c, b, h, &sheen);
    }
    if (!(at.veil.coat > 0.0f))
        return at.delta != DELTA_NONE;
    scatter_coat(&at);
    end_or_continue(c, b, h, &at, &footprint, coverage);
    return true;
}

/* A number in [0, 1) that depends on all bits of a direction. */
static double start_of(struct vec3 dir)
{
    uint32_t bits[3];

    memcpy(bits, &dir, sizeof(bits));
    return rng_unit(rng_mix(rng_mix((uint64_t)bits[0] << 32 | bits[1], bits[2]), 0x666e74u));
}

static void grow_faint(struct chain *c)
{
    c->faint *= 2.0f;
    c->heavy = true;
}

uint32_t sight_trace(const struct sight *s, struct vec3 origin, struct vec3 dir, float angle, bool glance,
                     struct leaf out[LEAF_MAX], struct sighting *found, struct sight_count *count)
{
    struct chain c;
    uint32_t rays = 0;
    bool varies;

    c.sight = s;
    c.leaves = out;
    c.leaf_count = c.pending_count = 0;
    c.cut = 0.0;
    c.faint = (float)(FAINT * LEAF_LEAST) * fminf(s->pixel_angle * s->pixel_angle / (angle * angle), RAYS_IN_PIXEL);
    const double start = start_of(dir);
    c.sum = c.faint * (float)start;
    c.heavy = false;
    c.rng = (struct rng){ rng_mix((uint64_t)(start * 0x1p53), 0x686561u) };
    c.glow[0] = c.glow[1] = c.glow[2] = 0.0f;
    found->uneven = false;
    struct branch camera = { .origin = origin, .dir = dir, .weight = { 1.0f, 1.0f, 1.0f }, .ior = 1.0f };
    cone_begin(&camera.cone, dir, angle);
    push(&c, &camera);
    while (c.pending_count > 0 && rays < RAYS_MAX && (rays == 0 || pending_weight(&c) >= (double)CUT)) {
        struct branch b = pop_heaviest(&c);
        struct hit h;
        if (++rays > RAYS_PLENTY && rays % RAYS_STEP == 0 && c.faint < HEAVY)
            grow_faint(&c);
        const float width = s->holes ? cone_width(&b.cone) : 0.0f;
        const bool met = rays_see(s->rays, b.origin, b.dir, b.behind, width, &h, &varies);
        if (!met)
            add_miss(&c, &b);
        const bool delta = met && meet(&c, &b, &h);
        if (b.bounces == 0 && (delta || varies))
            found->uneven = true;
        if (glance && found->uneven)
            break;
    }
    memcpy(found->glow, c.glow, sizeof(found->glow));
    count->rays += rays;
    if (!(glance && found->uneven))
        count->cut += c.cut + pending_weight(&c);
    return c.leaf_count;
}
