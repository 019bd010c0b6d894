#include "scene/lamps/lamps.h"

#include "base/cancel.h"
#include "base/mem.h"

#define NUMBER_PAIRS (WALK_NUMBERS / 2)

struct lamps {
    struct lamps_desc desc;
    struct emitters *emitters;
    float *sums; /* [packet_count][3][16] */
    uint64_t samples, rays;
};

struct lamps *lamps_create(const struct lamps_desc *desc)
{
    struct lamps *l = mem_alloc(1, sizeof(*l));

    if (!l)
        return NULL;
    l->desc = *desc;
    l->emitters = emitters_create(desc->scene, desc->rays);
    l->sums = mem_alloc(desc->gbuffer->packet_count ? desc->gbuffer->packet_count : 1, 3 * PACKET * sizeof(*l->sums));
    if (!l->emitters || !l->sums) {
        lamps_destroy(l);
        return NULL;
    }
    return l;
}

void lamps_destroy(struct lamps *l)
{
    if (!l)
        return;
    emitters_destroy(l->emitters);
    mem_free(l->sums);
    mem_free(l);
}

/* A batch: numbers that all points share. */
struct batch {
    const struct lamps *lamps;
    struct walk_world world;
    uint64_t first;
    uint32_t samples;
    uint64_t (*numbers)[WALK_NUMBERS]; /* [samples], in units of 2^-64 */
};

/* Consecutive pairs from sequences of their own. */
static void fill_numbers(struct batch *b)
{
    const uint64_t seed = b->lamps->desc.seed;

    for (uint32_t i = 0; i < b->samples; i++)
        for (uint32_t pair = 0; pair < NUMBER_PAIRS; pair++) {
            const uint32_t index = (uint32_t)(b->first + i);
            double x[2];
            rng_sobol2(rng_mix(seed, 2 * pair), pair ? rng_shuffled(rng_mix(seed, 2 * pair + 1), index) : index, x);
            for (uint32_t k = 0; k < 2; k++)
                b->numbers[i][2 * pair + k] = (uint64_t)(x[k] * 0x1p53) << 11;
        }
}

static struct walk_start start_at(const struct shade_packet *p, uint32_t l)
{
    return (struct walk_start){
        .lobe = lobe_of_lane(p, l),
        .origin = { p->x[l], p->y[l], p->z[l] },
        .wo = { p->wo_x[l], p->wo_y[l], p->wo_z[l] },
    };
}

/* All samples of one point, whose numbers get a digital shift of its own. */
static void refine_point(const struct batch *b, uint64_t point, const struct walk_start *start, double sum[3],
                         uint64_t *rays)
{
    const uint64_t seed = rng_mix(b->lamps->desc.seed, 0x6c616d7073 + point); /* "lamps" */

    for (uint32_t i = 0; i < b->samples; i++) {
        struct rng rng = { rng_mix(seed, WALK_NUMBERS + b->first + i) };
        double x[WALK_NUMBERS];
        for (uint64_t k = 0; k < WALK_NUMBERS; k++)
            x[k] = rng_unit(b->numbers[i][k] ^ rng_mix(seed, k));
        walk_sample(&b->world, start, x, &rng, sum, rays);
    }
}

static void refine_packet(const struct batch *b, uint32_t packet, uint64_t *rays)
{
    const struct shade_packet *p = &b->lamps->desc.gbuffer->packets[packet];
    float *out = b->lamps->sums + (size_t)packet * 3 * PACKET;

    for (uint32_t l = 0; l < p->count; l++) {
        const struct walk_start start = start_at(p, l);
        double sum[3] = { 0.0, 0.0, 0.0 };
        refine_point(b, (uint64_t)packet * PACKET + l, &start, sum, rays);
        for (int c = 0; c < 3; c++)
            out[c * PACKET + l] += (float)sum[c];
    }
}

bool lamps_refine(struct lamps *l, uint32_t samples, const atomic_bool *cancel)
{
    const struct lamps_desc *d = &l->desc;
    struct batch b = { .lamps = l,
                       .world = { d->scene, d->rays, l->emitters, d->by_lobes_alone },
                       .first = l->samples,
                       .samples = samples };
    uint64_t rays = 0;

    b.numbers = mem_alloc(samples, sizeof(*b.numbers));
    if (!b.numbers)
        return false;
    fill_numbers(&b);
#pragma omp parallel for schedule(dynamic, 4) reduction(+ : rays)
    for (uint32_t i = 0; i < d->gbuffer->packet_count; i++)
        if (!is_cancelled(cancel))
            refine_packet(&b, i, &rays);
    mem_free(b.numbers);
    l->samples += samples;
    l->rays += rays;
    return !is_cancelled(cancel);
}

const float *lamps_sums(const struct lamps *l)
{
    return l->sums;
}

void lamps_get_stats(const struct lamps *l, struct lamps_stats *out)
{
    *out = (struct lamps_stats){
        .triangles = emitters_triangles(l->emitters),
        .lights = emitters_lights(l->emitters),
        .samples = l->samples,
        .rays = l->rays,
    };
}
