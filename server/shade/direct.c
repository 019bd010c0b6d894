#include "direct.h"

#include "kernels.h"
#include "mem.h"
#include "rng.h"

#include <assert.h>
#include <math.h>
#include <string.h>
#ifdef __x86_64__
#include <pmmintrin.h>
#endif

struct direct {
    const struct kernels *kernels;
    struct light_samples lights;
    uint32_t *numbers; /* [number_capacity][2] */
    uint32_t number_capacity;
};

struct direct *direct_create(const struct kernels *kernels)
{
    struct direct *d = mem_alloc(1, sizeof(*d));
    if (d)
        d->kernels = kernels;
    return d;
}

void direct_destroy(struct direct *d)
{
    if (!d)
        return;
    samples_finish(&d->lights);
    mem_free(d->numbers);
    mem_free(d);
}

const struct light_samples *direct_samples(const struct direct *d)
{
    return &d->lights;
}

static enum err draw_numbers(struct direct *d, uint32_t count, uint64_t seed)
{
    if (count > d->number_capacity) {
        mem_free(d->numbers);
        d->number_capacity = 0;
        d->numbers = mem_alloc(count, 2 * sizeof(*d->numbers));
        if (!d->numbers)
            return ERR_NOMEM;
        d->number_capacity = count;
    }
    for (uint32_t i = 0; i < count; i++) {
        double x[2];
        rng_sobol2(seed, i, x);
        d->numbers[2 * i] = (uint32_t)(x[0] * 0x1p32);
        d->numbers[2 * i + 1] = (uint32_t)(x[1] * 0x1p32);
    }
    return ERR_OK;
}

/* Denormals cost a hundred cycles each and light nothing: flushed, in every thread alike, so that bits agree. */
static unsigned flush_denormals(void)
{
#ifdef __x86_64__
    const unsigned before = _mm_getcsr();
    _mm_setcsr(before | 0x8040); /* FTZ and DAZ */
    return before;
#else
    return 0;
#endif
}

static void restore_denormals(unsigned before)
{
#ifdef __x86_64__
    _mm_setcsr(before);
#else
    (void)before;
#endif
}

static void shade_packets(const struct direct *d, const struct gbuffer *g, const struct direct_frame *frame,
                          const atomic_bool *cancel, float *lo, struct direct_stats *stats)
{
    uint64_t rays = 0, chosen = 0, effective = 0;

#pragma omp parallel reduction(+ : rays, chosen, effective)
    {
        const unsigned before = flush_denormals();
        struct direct_counts counts = { 0 };
#pragma omp for schedule(dynamic, 32)
        for (uint32_t i = 0; i < g->packet_count; i++) {
            if (cancel && atomic_load_explicit(cancel, memory_order_relaxed))
                continue;
            d->kernels->direct_packet(frame, &g->packets[i], i, lo + (size_t)i * 3 * PACKET, &counts);
        }
        rays += counts.rays;
        chosen += counts.chosen;
        effective += counts.effective;
        restore_denormals(before);
    }
    stats->rays = rays;
    stats->chosen = chosen;
    stats->effective = effective;
}

enum err direct_shade(struct direct *d, const struct gbuffer *g, const struct rays *rays, const struct environment *e,
                      const struct direct_desc *desc, float *lo, struct direct_stats *stats)
{
    const struct method_recipe *recipe = method_recipe(desc->method);
    const uint64_t seed = rng_mix(desc->seed, desc->pass);
    const uint32_t light_count = (uint32_t)ceilf(recipe->light_part * (float)desc->samples);
    const uint32_t lobe_count = (uint32_t)ceilf(recipe->brdf_part * (float)desc->samples);

    assert(e->ready && desc->samples >= 1);
    *stats = (struct direct_stats){ 0 };
    if (!(e->total_energy > 0.0)) { /* a black sky lights nothing */
        memset(lo, 0, (size_t)g->packet_count * 3 * PACKET * sizeof(float));
        d->lights.strata = 0;
        return ERR_OK;
    }
    enum err result = samples_draw(e, recipe->strata, light_count, rng_mix(seed, 0), &d->lights);
    if (!result)
        result = draw_numbers(d, lobe_count, rng_mix(seed, 1));
    if (result)
        return result;
    const struct direct_frame frame = {
        .environment = e,
        .lights = &d->lights,
        .rays = desc->no_visibility ? NULL : rays,
        .share = recipe->share,
        .samples = desc->samples,
        .light_part = recipe->light_part,
        .brdf_part = recipe->brdf_part,
        .numbers = d->numbers,
        .lobe_count = lobe_count,
        .seed = rng_mix(seed, 2),
    };
    shade_packets(d, g, &frame, desc->cancel, lo, stats);
    stats->generated = d->lights.first[d->lights.strata];
    stats->lobes = lobe_count * g->point_count;
    return ERR_OK;
}
