/* What it would cost to correct the cached image by random samples so that it is unbiased in the mean. At a point, a
 * cell c is drawn with a probability p(c) by its light, and a direction within it; the correction of one sample is (f
 * cos V L(w) / density  -  T(p, c) L(c)) / p(c), the traced light less what the cache holds of the same cell: a control
 * variate, whose mean is the cache's bias. Prints its variance beside that of tracing without a cache, and the bias
 * that it removes, all relative as relMSE is, over the matte points of a scene whose sky has no sun. */
#include "figure.h"

#include "base/mem.h"
#include "base/rng.h"
#include "base/vec.h"
#include "light/cache_direct/internal.h"
#include "light/frame/relight.h"
#include "sky/tables/cube.h"

#include <math.h>
#include <string.h>

struct flags {
    const char *scene, *sky;
    uint32_t size[2], samples;
};

static const struct setting rows[] = {
    { "scene", "FILE", "scene; without it the built-in one", NULL, ALL, TEXT, AT(scene) },
    { "sky", "S", "source of the sky, its first frame is used", "cie:1", ALL, TEXT, AT(sky) },
    { "size", "WxH", "of the image, in pixels", "64x36", ALL, .type = SETTING_SIZE, AT(size) },
    { "samples", "N", "of each point", "2048", ALL, WHOLE(2, 1000000), AT(samples) },
    { .name = NULL },
};

struct study {
    struct prepared_scene *set;
    struct environment *sky;
    struct transport *transport;
    double chance[SKY_CELLS], cdf[SKY_CELLS]; /* p(c) */
    float (*held)[TRANSPORT_POINTS];          /* [SKY_CELLS]: T(p, c) L(c) of a block, mean of the colours */
};

struct sums {
    double plain, plain2, rest, rest2; /* of the traced light and of the correction, and of their squares */
};

static double mean_of(const struct sky_split *s, uint32_t cell)
{
    const float(*at)[SKY_CHUNK] = s->cells[cell / SKY_CHUNK];
    return ((double)at[0][cell % SKY_CHUNK] + (double)at[1][cell % SKY_CHUNK] + (double)at[2][cell % SKY_CHUNK]) / 3.0;
}

static void make_chances(struct study *s)
{
    double sum = 0.0;

    for (uint32_t c = 0; c < SKY_CELLS; c++)
        sum += s->chance[c] = mean_of(&s->transport->sky, c) * sky_cell_solid_angle(c % (SKY_EDGE * SKY_EDGE));
    for (uint32_t c = 0; c < SKY_CELLS; c++) {
        s->chance[c] /= sum;
        s->cdf[c] = (c ? s->cdf[c - 1] : 0.0) + s->chance[c];
    }
}

/* What the cache holds of each cell: the block's light under a sky of that cell alone. */
static void hold(struct study *s, const struct transport_block *b)
{
    struct sky_split one = { .level = INFINITY };
    float out[3][TRANSPORT_POINTS];

    for (uint32_t c = 0; c < SKY_CELLS; c++) {
        for (int k = 0; k < 3; k++)
            one.cells[c / SKY_CHUNK][k][c % SKY_CHUNK] = s->transport->sky.cells[c / SKY_CHUNK][k][c % SKY_CHUNK];
        s->transport->kernels->expand(&b->pieces[0], &one, b->packets * PACKET, out);
        for (uint32_t i = 0; i < b->packets * PACKET; i++) {
            const struct shade_packet *p = &s->set->gbuffer->packets[b->first + i / PACKET];
            s->held[c][i] = 0.0f;
            for (int k = 0; k < 3; k++)
                s->held[c][i] += out[k][i] * p->diffuse[k][i % PACKET] / 3.0f;
        }
        memset(one.cells[c / SKY_CHUNK], 0, sizeof(one.cells[0]));
    }
}

static uint32_t draw_cell(const struct study *s, double x)
{
    uint32_t low = 0, high = SKY_CELLS - 1;

    while (low < high) {
        const uint32_t middle = (low + high) / 2;
        if (s->cdf[middle] > x)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

/* A direction of a cell; returns the solid angle over the probability. */
static double draw_direction(uint32_t cell, struct rng *r, double w[3])
{
    const uint32_t place = cell % (SKY_EDGE * SKY_EDGE);
    const double step = 2.0 / SKY_EDGE;
    uint32_t i = 0, j = 0;

    for (uint32_t b = 0; b < 4; b++) {
        j |= (place >> 2 * b & 1u) << b;
        i |= (place >> (2 * b + 1) & 1u) << b;
    }
    const double u = -1.0 + step * (j + rng_next(r)), v = -1.0 + step * (i + rng_next(r));
    cube_direction(cell / (SKY_EDGE * SKY_EDGE), u, v, w);
    const double length = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    for (int k = 0; k < 3; k++)
        w[k] /= length;
    return step * step / pow(1.0 + u * u + v * v, 1.5);
}

/* One sample of a packet's points, which share it. at: the packet's first point in the block. */
static void sample(struct study *s, const struct shade_packet *p, uint32_t at, struct rng *r, struct sums sums[PACKET])
{
    const uint32_t cell = draw_cell(s, rng_next(r));
    _Alignas(64) int32_t valid[PACKET];
    struct ray16 ray = { .org_x = { 0 } };
    double w[3], cosine[PACKET];
    const double measure = draw_direction(cell, r, w);
    const float d[3] = { (float)w[0], (float)w[1], (float)w[2] };
    float u, v;
    const struct texel *t = &s->sky->texels[cube_texel(s->sky->n, d, &u, &v)];

    for (uint32_t l = 0; l < PACKET; l++) {
        const float shading = p->ns_x[l] * d[0] + p->ns_y[l] * d[1] + p->ns_z[l] * d[2];
        const float geometric = p->ng_x[l] * d[0] + p->ng_y[l] * d[1] + p->ng_z[l] * d[2];
        cosine[l] = shading > 0.0f && geometric > 0.0f ? (double)shading : 0.0;
        valid[l] = cosine[l] > 0.0 ? p->valid[l] : 0;
        ray.org_x[l] = p->x[l];
        ray.org_y[l] = p->y[l];
        ray.org_z[l] = p->z[l];
        ray.dir_x[l] = d[0];
        ray.dir_y[l] = d[1];
        ray.dir_z[l] = d[2];
        ray.tfar[l] = INFINITY;
        ray.mask[l] = UINT32_MAX;
    }
    rays_occluded16(s->set->rays, RAYS_TOGETHER, valid, &ray);
    for (uint32_t l = 0; l < p->count; l++) {
        const double light =
            (double)(p->diffuse[0][l] * t->r + p->diffuse[1][l] * t->g + p->diffuse[2][l] * t->b) / 3.0;
        const double traced = valid[l] && ray.tfar[l] > 0.0f ? light * cosine[l] / PI * measure / s->chance[cell] : 0.0;
        const double rest = traced - (double)s->held[cell][at + l] / s->chance[cell];
        sums[l].plain += traced;
        sums[l].plain2 += traced * traced;
        sums[l].rest += rest;
        sums[l].rest2 += rest * rest;
    }
}

/* Variances of one sample, and the square of the bias, of all points: each over the square of the point's light. */
struct result {
    double plain, rest, bias, count;
};

static void study_block(struct study *s, const struct transport_block *b, uint32_t samples, double mean,
                        struct result *out)
{
    hold(s, b);
    for (uint32_t k = 0; k < b->packets; k++) {
        struct sums sums[PACKET] = { { 0.0 } };
        struct rng r = { 77 + b->first + k };
        const struct shade_packet *p = &s->set->gbuffer->packets[b->first + k];
        for (uint32_t n = 0; n < samples; n++)
            sample(s, p, k * PACKET, &r, sums);
        for (uint32_t l = 0; l < p->count; l++) {
            const double n = samples, light = sums[l].plain / n, bias = sums[l].rest / n;
            const double over = light * light + 1e-2 * mean * mean, noise = sums[l].rest2 / n - bias * bias;
            out->plain += (sums[l].plain2 / n - light * light) / over;
            out->rest += noise / over;
            out->bias += (bias * bias - noise / n) / over;
            out->count += 1.0;
        }
    }
}

static void set_up(struct study *s, const struct flags *o)
{
    struct prepared_scene_desc desc = { .scene = o->scene, .width = o->size[0], .height = o->size[1] };
    const struct transport_desc cache = { .max_bytes = (uint64_t)1 << 30 };
    struct frame frame = figure_frame(o->sky);
    struct reason why = { "" };

    s->sky = figure_sky(&frame, true);
    frame_finish(&frame);
    figure_must(kernels_select(NULL, &desc.kernels, &why), &why);
    figure_must(set_create(&desc, &s->set, &why), &why);
    figure_must(transport_create(s->set->gbuffer, s->set->rays, desc.kernels, &cache, &s->transport, &why), &why);
    figure_must(sky_split_take(&s->transport->sky, s->sky), &why);
    if (s->transport->sky.sun_count)
        figure_must(err_say(&why, ERR_USAGE, "%s has a sun: take another sky", o->sky), &why);
    s->held = mem_alloc(SKY_CELLS, sizeof(*s->held));
    figure_must(s->held ? ERR_OK : ERR_NOMEM, &why);
}

/* The mean light of the matte points, for relMSE's floor. */
static double mean_light(struct study *s)
{
    const struct transport_frame frame = { .end = 0 };
    const struct gbuffer *g = s->set->gbuffer;
    float *lo = mem_alloc((size_t)g->packet_count * 3 * PACKET, sizeof(float));
    struct transport_frame_stats stats;
    double sum = 0.0, count = 0.0;

    if (!lo || transport_shade(s->transport, s->sky, &frame, lo, &stats))
        exit(1);
    for (uint32_t k = 0; k < g->packet_count; k++)
        for (uint32_t i = 0; i < 3 * PACKET && g->packets[k].kind == LOBE_LAMBERT; i++) {
            sum += (double)lo[(size_t)k * 3 * PACKET + i];
            count += i % PACKET < g->packets[k].count;
        }
    mem_free(lo);
    return sum / count;
}

int main(int argc, char **argv)
{
    struct flags flags = { 0 };
    struct command command = {
        .name = "unbiased",
        .synopsis = "[flags]",
        .about =
            "The variance of correcting the cache's direct light by random samples, and the bias that they remove.",
        .lists = { { rows, &flags } },
    };
    struct study s = { .set = NULL };
    struct result sum = { 0.0 };

    figure_begin(&command, argc, argv);
    set_up(&s, &flags);
    make_chances(&s);
    const double mean = mean_light(&s);
    for (uint32_t k = 0; k < s.transport->block_count; k++)
        if (s.transport->blocks[k].kind == LOBE_LAMBERT)
            study_block(&s, &s.transport->blocks[k], flags.samples, mean, &sum);
    printf("%s, %s, %.0f matte points; of one sample a point:\n", s.set->name, s.sky->name, sum.count);
    printf("variance of tracing alone     %.4g\n", sum.plain / sum.count);
    printf("variance of the correction    %.4g\n", sum.rest / sum.count);
    printf("bias squared, which it removes %.3g\n", sum.bias / sum.count);
    printf("samples per point until the noise falls to that bias: %.0f\n", sum.rest / sum.bias);
    mem_free(s.held);
    transport_destroy(s.transport);
    set_destroy(s.set);
    environment_destroy(s.sky);
    return 0;
}
