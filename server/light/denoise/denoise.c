#include "light/denoise/denoise.h"

#include "base/mem.h"

struct denoiser {
    struct filter *filter;
    float *half[2]; /* [packet_count][3][16] */
    uint64_t uses;
};

struct denoiser *denoiser_create(const struct gbuffer *g, const struct view *v, const char *level)
{
    struct denoiser *d = mem_alloc(1, sizeof(*d));

    if (!d)
        return NULL;
    d->filter = filter_create(g, v, level);
    for (int k = 0; k < 2; k++)
        d->half[k] = mem_alloc(g->packet_count, 3 * PACKET * sizeof(float));
    if (!d->filter || !d->half[0] || !d->half[1]) {
        denoiser_destroy(d);
        return NULL;
    }
    return d;
}

void denoiser_destroy(struct denoiser *d)
{
    if (!d)
        return;
    filter_destroy(d->filter);
    mem_free(d->half[0]);
    mem_free(d->half[1]);
    mem_free(d);
}

float *denoiser_half(struct denoiser *d, int k)
{
    d->uses++;
    return d->half[k];
}

void denoiser_filter(struct denoiser *d, const float *const half[2], float *lo)
{
    d->uses++;
    filter_run(d->filter, half, lo);
}

uint32_t denoiser_parts(const struct denoiser *d)
{
    return filter_parts(d->filter);
}

void denoiser_filter_part(struct denoiser *d, uint32_t part, const float *const half[2], float *lo)
{
    d->uses++;
    filter_part(d->filter, part, half, lo);
}

uint64_t denoiser_uses(const struct denoiser *d)
{
    return d->uses;
}
