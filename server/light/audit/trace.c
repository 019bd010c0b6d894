#include "light/audit/audit.h"

#include "base/rng.h"
#include "light/estimators/baselines/path.h"

struct sequence { /* numbers of a path */
    struct numbers numbers;
    const struct audit_numbers *table;
    uint64_t seed, stream;
    uint32_t path;
};

void audit_numbers_fill(struct audit_numbers *n)
{
    for (uint32_t i = 0; i < AUDIT_NUMBERS_PATHS; i++)
        for (uint32_t pair = 0; pair < AUDIT_NUMBERS_PLACES / 2; pair++) {
            double x[2];
            rng_sobol2(rng_mix(pair, 0), rng_shuffled(rng_mix(pair, 1), i), x);
            for (uint32_t k = 0; k < 2; k++)
                n->at[i][2 * pair + k] = (uint64_t)(x[k] * 0x1p53) << 11;
        }
}

/* The place in the table for number `place` of a path: those of one direction are a pair. */
static uint32_t place_in_table(uint32_t place)
{
    static const uint32_t of[PATH_PLACES_EVENT] = { 0, 1, 4, 2, 3, 6, 7 };

    return place < 2 ? place : 2 + (place - 2) / PATH_PLACES_EVENT * 8 + of[(place - 2) % PATH_PLACES_EVENT];
}

/* A digital shift keeps each number uniform, and the paths of one estimate a net. */
static double numbered(struct numbers *n, uint32_t place)
{
    const struct sequence *s = (const struct sequence *)n; /* the first member */
    const uint32_t at = place_in_table(place);

    if (at >= AUDIT_NUMBERS_PLACES)
        return rng_unit(rng_mix(s->stream, place));
    const uint64_t shift = rng_mix(rng_mix(s->seed, s->path / AUDIT_NUMBERS_PATHS), at);
    return rng_unit(s->table->at[s->path % AUDIT_NUMBERS_PATHS][at] ^ shift);
}

static double weight_of(const struct gbuffer_entry *e)
{
    return rgb_luminance(e->weight[0], e->weight[1], e->weight[2]);
}

/* One entry of the pixel, in proportion to its weight. */
static const struct gbuffer_entry *choose(const struct gbuffer *g, uint32_t pixel, double x, double *probability)
{
    const uint32_t first = g->entry_first[pixel], end = g->entry_first[pixel + 1];
    double all = 0.0, sum = 0.0;

    for (uint32_t k = first; k < end; k++)
        all += weight_of(&g->entries[k]);
    for (uint32_t k = first; k < end; k++) {
        const double own = weight_of(&g->entries[k]);
        sum += own;
        if (own > 0.0 && (x * all < sum || k + 1 == end)) {
            *probability = own / all;
            return &g->entries[k];
        }
    }
    return NULL;
}

/* One path from a pixel's points. */
static void trace_path(const struct audit_world *w, const struct audit_question *q, uint32_t path, double rgb[3],
                       uint64_t *rays)
{
    const struct gbuffer *g = w->gbuffer;
    const struct path_world paths = { w->scene, w->rays, w->view, w->environment, w->bare_ground };
    struct sequence s = { { numbered }, w->numbers, q->seed, rng_mix(q->seed, path), path };
    double p;

    rgb[0] = rgb[1] = rgb[2] = 0.0;
    if (w->whole) {
        const double xy[2] = { q->pixel % g->width + numbered(&s.numbers, 0),
                               q->pixel / g->width + numbered(&s.numbers, 1) };
        path_sample(&paths, w->classes, xy, &s.numbers, rgb, rays);
        return;
    }
    const struct gbuffer_entry *e = choose(g, q->pixel, numbered(&s.numbers, 0), &p);
    if (!e)
        return;
    const struct shade_packet *packet = &g->packets[e->point / PACKET];
    const uint32_t lane = e->point % PACKET;
    path_sample_point(&paths, packet, lane, packet->behind[lane] ? w->behind : w->classes, &s.numbers, rgb, rays);
    for (int c = 0; c < 3; c++)
        rgb[c] *= (double)e->weight[c] / p;
}

/* The sky's part of a pixel, as the image has it. */
static void add_sky(const struct audit_world *w, uint32_t pixel, double rgb[3])
{
    const struct gbuffer *g = w->gbuffer;

    for (uint32_t k = g->miss_first[pixel]; k < g->miss_first[pixel + 1]; k++) {
        float sky[3];
        environment_lookup_wide(w->environment, g->misses[k].direction, g->misses[k].width, sky);
        for (int c = 0; c < 3; c++)
            rgb[c] += (double)(g->misses[k].weight[c] * sky[c]);
    }
}

void audit_trace(void *world, const struct audit_question *q, struct audit_light *out)
{
    const struct audit_world *w = world;

    *out = (struct audit_light){ .rays = 0 };
    for (uint32_t i = 0; i < q->paths; i++) {
        double one[3];
        trace_path(w, q, i, one, &out->rays);
        for (int c = 0; c < 3; c++) { /* means, [Welford 1962] */
            const double before = one[c] - out->rgb[c];
            out->rgb[c] += before / (i + 1);
            out->variance[c] += before * (one[c] - out->rgb[c]);
        }
    }
    for (int c = 0; c < 3; c++) {
        out->variance[c] = q->paths > 1 ? out->variance[c] / q->paths / (q->paths - 1) : 0.0;
    }
    if (w->background && !w->whole)
        add_sky(w, q->pixel, out->rgb);
}
