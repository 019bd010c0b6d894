#include "light/denoise/denoise.h"

#include "base/mem.h"

#include <math.h>
#include <string.h>

#define GROUP 128 /* packets, side by side in the image for the most part, that share w */
#define FLOATS ((size_t)3 * PACKET)
#define SOFT 1e-2 /* of relMSE */

struct accumulation {
    struct denoiser *denoiser;
    uint32_t packets;
    uint64_t key, turn; /* images since it began */
    bool still;         /* the sky is that of the last image */
    bool shows;         /* `shown` is light with this key */
    bool leaves;        /* gives way to the cache's light (accumulation_leave) */
    unsigned steps;     /* of the glide that this image may begin */
    unsigned glide;     /* still to take */
    float *half[2];     /* B, [packets][3][16], as what follows */
    float *shown;
    float *target; /* what it moves to */
    float *count;  /* [packets]: n; 0: nothing is known */
    const float *samples[2];
    const float *scale; /* what errors are relative to: `shown`, or what the caller gave */
    double soft;        /* 1e-2 mean(scale)^2 */
};

struct accumulation *accumulation_create(const struct gbuffer *g, struct denoiser *denoiser)
{
    struct accumulation *h = mem_alloc(1, sizeof(*h));
    const uint32_t packets = g->packet_count;

    if (!h)
        return NULL;
    h->denoiser = denoiser;
    h->packets = packets;
    for (int k = 0; k < 2; k++)
        h->half[k] = mem_alloc(packets, FLOATS * sizeof(float));
    h->shown = mem_alloc(packets, FLOATS * sizeof(float));
    h->target = mem_alloc(packets, FLOATS * sizeof(float));
    h->count = mem_alloc(packets, sizeof(*h->count));
    if (!h->half[0] || !h->half[1] || !h->shown || !h->target || !h->count) {
        accumulation_destroy(h);
        return NULL;
    }
    return h;
}

void accumulation_destroy(struct accumulation *h)
{
    if (!h)
        return;
    mem_free(h->half[0]);
    mem_free(h->half[1]);
    mem_free(h->shown);
    mem_free(h->target);
    mem_free(h->count);
    mem_free(h);
}

uint64_t accumulation_turn(const struct accumulation *h)
{
    return h->turn;
}

void accumulation_begin(struct accumulation *h, uint64_t key, unsigned steps)
{
    if (h->key != key) {
        memset(h->count, 0, h->packets * sizeof(*h->count));
        h->shows = false;
    }
    if (h->key != key || steps == 0)
        h->glide = 0;
    h->key = key;
    h->still = false;
    h->steps = steps;
}

unsigned accumulation_glides(const struct accumulation *h)
{
    return h->glide;
}

void accumulation_hold(struct accumulation *h, bool still)
{
    h->still = still;
}

/* Summed in one order. */
static double softness(const struct accumulation *h)
{
    double sum = 0.0;

    for (size_t k = 0; k < h->packets * FLOATS; k++)
        sum += (double)h->scale[k];
    const double mean = sum / (double)(h->packets * FLOATS);
    return SOFT * mean * mean + 1e-30;
}

/* Sums of V and D over a packet. */
static void compare(const struct accumulation *h, uint32_t packet, double *own, double *off)
{
    const float *a = h->samples[0], *b = h->samples[1];

    for (size_t k = packet * FLOATS; k < (packet + 1) * FLOATS; k++) {
        const double r = (double)h->scale[k], per = 1.0 / (r * r + h->soft);
        const double apart = (double)a[k] - (double)b[k];
        const double from = 0.5 * ((double)a[k] + (double)b[k] - (double)h->half[0][k] - (double)h->half[1][k]);
        *own += 0.25 * apart * apart * per;
        *off += from * from * per;
    }
}

/* share: V / D. */
static void add_packet(struct accumulation *h, uint32_t packet, double share)
{
    const double n = (double)h->count[packet], w = fmin(n / (n + 1.0), share);

    for (int half = 0; half < 2; half++) {
        const float *s = h->samples[half];
        float *to = h->half[half];
        for (size_t k = packet * FLOATS; k < (packet + 1) * FLOATS; k++)
            to[k] = s[k] + (float)w * (to[k] - s[k]);
    }
    h->count[packet] = (float)(1.0 / (1.0 - w));
}

/* The means cover a group, because those of one packet are too noisy. */
static void add_group(struct accumulation *h, uint32_t g)
{
    const uint32_t first = g * GROUP, end = h->packets - first < GROUP ? h->packets : first + GROUP;
    double own = 0.0, off = 0.0;

    for (uint32_t i = first; i < end; i++)
        if (h->count[i] > 0.0f)
            compare(h, i, &own, &off);
    for (uint32_t i = first; i < end; i++)
        add_packet(h, i, own < off && !h->still ? own / off : 1.0);
}

/* The mean light of a moving sky, by colour, before B's groups are compared with the samples: a group's noise hides
 * what all have lost. The correction has the weight of the change against the variance of the samples' sum: that of
 * independent samples or, if more, of the two halves' sums, which have what pixels share. */
static void follow_mean(struct accumulation *h)
{
    const float *a = h->samples[0], *b = h->samples[1];
    double now[3] = { 0.0 }, was[3] = { 0.0 }, noise[3] = { 0.0 }, all[3] = { 0.0 };
    float gain[3];

    for (size_t k = 0; k < h->packets * FLOATS; k++) {
        const size_t c = k / PACKET % 3;
        const double apart = (double)a[k] - (double)b[k];
        now[c] += 0.5 * ((double)a[k] + (double)b[k]);
        was[c] += 0.5 * ((double)h->half[0][k] + (double)h->half[1][k]);
        noise[c] += 0.25 * apart * apart;
        all[c] += 0.5 * apart;
    }
    for (int c = 0; c < 3; c++) {
        const double by = now[c] - was[c], variance = fmax(noise[c], all[c] * all[c]);
        const double share = by != 0.0 ? fmax(0.0, 1.0 - variance / (by * by)) : 0.0;
        gain[c] = was[c] > 0.0 ? (float)(1.0 + share * by / was[c]) : 1.0f;
    }
#pragma omp parallel for schedule(static)
    for (size_t k = 0; k < h->packets * FLOATS; k++)
        for (int half = 0; half < 2; half++)
            h->half[half][k] *= gain[k / PACKET % 3];
}

void accumulation_add(struct accumulation *h, const float *const samples[2], const float *scale)
{
    const uint32_t groups = (h->packets + GROUP - 1) / GROUP;

    for (int k = 0; k < 2; k++)
        h->samples[k] = samples ? samples[k] : denoiser_half(h->denoiser, k);
    if (h->shows && !h->still)
        follow_mean(h);
    h->scale = scale ? scale : h->shown;
    h->soft = softness(h);
#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t g = 0; g < groups; g++)
        add_group(h, g);
}

/* In the denoiser's own halves, whose samples are taken. */
static void add_more(struct accumulation *h, const float *const more[2])
{
    for (int k = 0; k < 2; k++) {
        float *to = denoiser_half(h->denoiser, k);
#pragma omp parallel for schedule(static)
        for (size_t i = 0; i < h->packets * FLOATS; i++)
            to[i] = h->half[k][i] + more[k][i];
    }
}

/* The share of the way after a part of the steps. */
static float way(const struct accumulation *h, float x)
{
    return h->steps == ACCUMULATION_GLIDE ? x * x * (3.0f - 2.0f * x) : x;
}

/* Of the way that is left, in a glide's step that begins; 1: all of it. */
static float glide_share(const struct accumulation *h)
{
    if (h->glide <= 1)
        return 1.0f;
    const float from = way(h, 1.0f - (float)h->glide / (float)h->steps);
    return (way(h, 1.0f - (float)(h->glide - 1) / (float)h->steps) - from) / (1.0f - from);
}

void accumulation_glide(struct accumulation *h, float *lo)
{
    const float step = glide_share(h);

#pragma omp parallel for schedule(static)
    for (size_t k = 0; k < h->packets * FLOATS; k++) {
        h->shown[k] = step < 1.0f ? h->shown[k] + step * (h->target[k] - h->shown[k]) : h->target[k];
        lo[k] = fmaxf(h->shown[k], 0.0f);
    }
    h->glide -= h->glide > 0;
}

unsigned accumulation_leave(struct accumulation *h, bool last, float *lo)
{
    memcpy(h->target, lo, h->packets * FLOATS * sizeof(float));
    if (!h->shows || !h->leaves)
        h->glide = h->shows ? h->steps = ACCUMULATION_GLIDE : 1;
    else if (!last && h->glide <= ACCUMULATION_STEADY)
        h->glide = h->steps = ACCUMULATION_STEADY;
    h->leaves = h->shows = true;
    accumulation_glide(h, lo);
    return h->glide;
}

/* Begins to move to what was filtered. */
static void show(struct accumulation *h, float *lo)
{
    h->glide = h->shows && h->steps > 0 ? h->steps : 1;
    h->shows = true;
    h->leaves = false;
    h->turn++;
    accumulation_glide(h, lo);
}

void accumulation_show(struct accumulation *h, float *lo)
{
    const float *const half[2] = { h->half[0], h->half[1] };

    denoiser_filter(h->denoiser, half, h->target);
    show(h, lo);
}

void accumulation_show_part(struct accumulation *h, uint32_t part, const float *const more[2], float *lo)
{
    const float *const half[2] = { denoiser_half(h->denoiser, 0), denoiser_half(h->denoiser, 1) };

    if (part == 0)
        add_more(h, more);
    denoiser_filter_part(h->denoiser, part, half, h->target);
    if (part + 1 == denoiser_parts(h->denoiser))
        show(h, lo);
}

const float *accumulation_half(const struct accumulation *h, int k)
{
    return h->half[k];
}
