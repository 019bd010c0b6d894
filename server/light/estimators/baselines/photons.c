#include "light/estimators/baselines/path.h"

#include "base/cancel.h"
#include "base/mem.h"
#include "light/estimators/baselines/chains.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#define EMITTED_MAX (UINT64_C(1) << 20)
#define BLOCK 4096 /* particles whose photons are collected in one list */
#define NEAREST_MIN 16u
#define NEAREST_MAX 128u /* bounds arrays on the stack */

struct photon {
    float at[3];
    struct vec3 dir; /* direction of travel, unit */
    float flux[3];   /* W, up to the sky's scale */
    uint32_t axis;   /* splitting axis of the kd-tree node */
};

struct map { /* a balanced kd-tree; the root of a range is its middle [Jensen 1996] */
    struct photon *photons;
    uint32_t count;
};

struct list { /* photons of one block */
    struct photon *photons;
    uint32_t count;
    size_t capacity;
    bool failed;
};

struct session {
    const struct path_world *world;
    const struct path_desc *desc;
    uint64_t seed, emitted;
    struct map caustics, indirect;
};

static bool store(struct list *l, const struct particle *p)
{
    l->failed = !mem_reserve(&l->photons, l->count, &l->capacity, sizeof(*l->photons));
    if (l->failed)
        return false;
    const struct vec3 x = p->at.surface.position;
    l->photons[l->count++] = (struct photon){
        .at = { x.x, x.y, x.z },
        .dir = p->dir,
        .flux = { (float)p->flux[0], (float)p->flux[1], (float)p->flux[2] },
    };
    return true;
}

/* L S+ D: photons that arrive through mirrors and glass alone. */
static bool meet_caustic(void *data, const struct particle *p)
{
    if (p->rough_events > 0 || (p->events > 0 && !store(data, p)))
        return false;
    return p->at.delta != DELTA_NONE;
}

/* Photons that have been scattered by a D lobe. */
static bool meet_indirect(void *data, const struct particle *p)
{
    return p->rough_events == 0 || store(data, p);
}

/* Partitions [first, last) about its median along `axis`. */
static void split(struct photon *p, uint32_t first, uint32_t last, uint32_t axis)
{
    const uint32_t middle = first + (last - first) / 2;

    while (last - first > 1) {
        const float pivot = p[first + (last - first) / 2].at[axis];
        uint32_t i = first, j = last - 1;
        for (;;) {
            while (p[i].at[axis] < pivot)
                i++;
            while (p[j].at[axis] > pivot)
                j--;
            if (i >= j)
                break;
            const struct photon t = p[i];
            p[i++] = p[j];
            p[j--] = t;
        }
        if (middle < i)
            last = i;
        else
            first = i;
    }
}

static void build(struct photon *p, uint32_t first, uint32_t last)
{
    float low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };
    uint32_t axis = 0;

    if (last - first < 2)
        return;
    for (uint32_t i = first; i < last; i++)
        for (int k = 0; k < 3; k++) {
            low[k] = fminf(low[k], p[i].at[k]);
            high[k] = fmaxf(high[k], p[i].at[k]);
        }
    for (uint32_t k = 1; k < 3; k++)
        axis = high[k] - low[k] > high[axis] - low[axis] ? k : axis;
    const uint32_t middle = first + (last - first) / 2;
    split(p, first, last, axis);
    p[middle].axis = axis;
    build(p, first, middle);
    build(p, middle + 1, last);
}

/* Traces particles through the boxes and builds a kd-tree of the photons that `meet` accepts. */
static enum err emit(const struct session *s, const struct box *boxes, uint32_t box_count, uint64_t stream,
                     bool (*meet)(void *, const struct particle *), struct map *out, uint64_t *rays)
{
    const uint64_t blocks = (s->emitted + BLOCK - 1) / BLOCK;
    struct list *lists = mem_alloc(blocks, sizeof(*lists));
    uint64_t traced = 0, total = 0;
    enum err e = ERR_NOMEM;

    if (!lists)
        return ERR_NOMEM;
#pragma omp parallel for schedule(dynamic, 1) reduction(+ : traced)
    for (uint64_t b = 0; b < blocks; b++) {
        for (uint64_t i = b * BLOCK; i < (b + 1) * BLOCK && i < s->emitted && !lists[b].failed; i++) {
            struct rng rng = { rng_mix(rng_mix(s->seed, stream), i) };
            if (!is_cancelled(s->desc->cancel))
                chains_from_sky(s->world, boxes, box_count, &rng, meet, &lists[b], &traced);
        }
    }
    bool failed = false;
    for (uint64_t b = 0; b < blocks; b++) {
        total += lists[b].count;
        failed = failed || lists[b].failed;
    }
    if (!failed && total <= UINT32_MAX)
        out->photons = mem_alloc(total, sizeof(*out->photons));
    if (out->photons) {
        for (uint64_t b = 0; b < blocks; b++) { /* in order: the tree does not depend on the number of threads */
            if (lists[b].count > 0)
                memcpy(out->photons + out->count, lists[b].photons, lists[b].count * sizeof(*out->photons));
            out->count += lists[b].count;
        }
        for (uint32_t i = 0; i < out->count; i++)
            for (int k = 0; k < 3; k++)
                out->photons[i].flux[k] /= (float)s->emitted;
        build(out->photons, 0, out->count);
        e = ERR_OK;
    }
    *rays += traced;
    for (uint64_t b = 0; b < blocks; b++)
        mem_free(lists[b].photons);
    mem_free(lists);
    return e;
}

struct nearest { /* a max-heap by distance */
    float x[3];
    uint32_t count, room;
    float distance2[NEAREST_MAX];
    uint32_t index[NEAREST_MAX];
};

static void keep(struct nearest *n, float d2, uint32_t index)
{
    uint32_t at = n->count;

    if (n->count < n->room) {
        n->count++; /* sift up */
        for (; at > 0 && n->distance2[(at - 1) / 2] < d2; at = (at - 1) / 2) {
            n->distance2[at] = n->distance2[(at - 1) / 2];
            n->index[at] = n->index[(at - 1) / 2];
        }
    } else {
        if (d2 >= n->distance2[0])
            return;
        at = 0; /* replace the farthest: sift down */
        for (uint32_t child; (child = 2 * at + 1) < n->count; at = child) {
            if (child + 1 < n->count && n->distance2[child + 1] > n->distance2[child])
                child++;
            if (n->distance2[child] <= d2)
                break;
            n->distance2[at] = n->distance2[child];
            n->index[at] = n->index[child];
        }
    }
    n->distance2[at] = d2;
    n->index[at] = index;
}

static void find(const struct map *m, uint32_t first, uint32_t last, struct nearest *n)
{
    if (first >= last)
        return;
    const uint32_t middle = first + (last - first) / 2;
    const struct photon *p = &m->photons[middle];
    const float d[3] = { n->x[0] - p->at[0], n->x[1] - p->at[1], n->x[2] - p->at[2] }, cut = d[p->axis];

    if (cut < 0.0f)
        find(m, first, middle, n);
    else
        find(m, middle + 1, last, n);
    keep(n, d[0] * d[0] + d[1] * d[1] + d[2] * d[2], middle);
    if (n->count == n->room && cut * cut >= n->distance2[0])
        return;
    if (cut < 0.0f)
        find(m, middle + 1, last, n);
    else
        find(m, first, middle, n);
}

struct gather {
    const struct session *session;
    double rgb[3];
};

/* The farthest photon defines the radius and is not counted, which makes the estimate exact for uniform density. */
static void gather_from(const struct map *m, const struct scatter *at, struct vec3 dir, const double weight[3],
                        double rgb[3])
{
    const struct vec3 x = at->surface.position;
    const uint32_t room = (uint32_t)(sqrt((double)m->count) / 8.0);
    struct nearest n = { .x = { x.x, x.y, x.z } };

    n.room = room < NEAREST_MIN ? NEAREST_MIN : room > NEAREST_MAX ? NEAREST_MAX : room;
    find(m, 0, m->count, &n);
    if (n.count < 2 || !(n.distance2[0] > 0.0f))
        return;
    const double disc = PI * n.distance2[0];
    for (uint32_t i = 1; i < n.count; i++) {
        const struct photon *p = &m->photons[n.index[i]];
        double f[3];
        chains_scatter(at, dir, vec3_scale(p->dir, -1.0f), f);
        for (int k = 0; k < 3; k++)
            rgb[k] += weight[k] * f[k] * p->flux[k] / disc;
    }
}

static void light_point(void *data, const struct scatter *at, struct vec3 dir, const double weight[3])
{
    struct gather *g = data;

    gather_from(&g->session->caustics, at, dir, weight, g->rgb);
    gather_from(&g->session->indirect, at, dir, weight, g->rgb);
}

/* Adds the radiance estimate of the maps to the image. */
static void read_maps(const struct session *s, float *rgb, struct path_stats *stats)
{
    const struct view *view = s->world->view;
    const uint32_t samples = (s->desc->samples + 7) / 8;
    uint64_t rays = 0, pixels = 0;

#pragma omp parallel for schedule(dynamic, 1) reduction(+ : rays, pixels)
    for (uint32_t y = 0; y < view->height; y++) {
        for (uint32_t x = 0; x < view->width; x++) {
            const size_t pixel = (size_t)y * view->width + x;
            struct gather g = { .session = s };
            if (is_cancelled(s->desc->cancel))
                break;
            for (uint32_t i = 0; i < samples; i++) {
                struct rng rng = { rng_mix(rng_mix(s->seed, pixel), i) };
                const double xy[2] = { x + rng_next(&rng), y + rng_next(&rng) };
                chains_from_eye(s->world, xy, &rng, light_point, &g, &rays);
            }
            for (int k = 0; k < 3; k++)
                rgb[3 * pixel + (size_t)k] += (float)(g.rgb[k] / samples);
            pixels++;
        }
    }
    stats->rays += rays;
    stats->samples += pixels * samples;
}

static enum err make_maps(struct session *s, struct path_stats *stats)
{
    const size_t casters = scene_casters(s->world->scene, NULL, 0);
    const struct box bounds = { s->world->scene->low, s->world->scene->high };
    enum err e = ERR_OK;

    if ((s->desc->classes & PATH_CAUSTICS) && casters > 0) {
        struct box *boxes = mem_alloc(casters, sizeof(*boxes));
        if (!boxes)
            return ERR_NOMEM;
        scene_casters(s->world->scene, boxes, casters);
        e = emit(s, boxes, start_join(boxes, casters), UINT64_MAX, meet_caustic, &s->caustics, &stats->rays);
        stats->samples += s->emitted;
        mem_free(boxes);
    }
    if (!e && (s->desc->classes & PATH_INDIRECT)) {
        e = emit(s, &bounds, 1, UINT64_MAX - 1, meet_indirect, &s->indirect, &stats->rays);
        stats->samples += s->emitted;
    }
    return e;
}

enum err photons_render(const struct path_world *world, const struct path_desc *desc, float *rgb,
                        struct path_stats *stats)
{
    struct path_desc own = *desc;
    struct session s = { .world = world, .desc = desc, .seed = rng_mix(rng_mix(desc->seed, desc->pass), 'p') };

    assert(world->environment->ready && desc->samples >= 1);
    own.classes &= PATH_BACKGROUND | PATH_DIRECT;
    enum err e = path_render(world, &own, rgb, stats);
    stats->bias = "caustics and indirect light blurred over photon discs";
    if (e || !(desc->classes & (PATH_CAUSTICS | PATH_INDIRECT)) || !(world->environment->total_energy > 0.0))
        return e;
    s.emitted = (uint64_t)world->view->width * world->view->height * desc->samples;
    if (s.emitted > EMITTED_MAX)
        s.emitted = EMITTED_MAX;
    e = make_maps(&s, stats);
    if (!e)
        read_maps(&s, rgb, stats);
    mem_free(s.caustics.photons);
    mem_free(s.indirect.photons);
    return e;
}
