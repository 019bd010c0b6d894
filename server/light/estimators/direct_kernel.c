/* The kernel of direct light: shades one packet of 16 points. Compiled once per CPU level, see CMakeLists.txt. */
#include "base/rng.h"
#include "base/vec.h"
#include "light/estimators/direct.h"
#include "light/estimators/kernels.h"
#include "light/estimators/open_sky.h"
#include "light/estimators/sky_lanes.h"
#include "scene/geometry/lane_rays.h"
#include "scene/surface/lanes.h"
#include "scene/surface/lobes.h"

#include <math.h>

#define TEXT_(a) #a
#define TEXT(a) TEXT_(a)

/* State of a packet, for all its samples. */
struct packet_state {
    const struct direct_frame *frame;
    const struct shade_packet *points;
    const struct light_samples *lights; /* the packet's set */
    struct ray16 rays;
    struct lobes lobes;
    uint32_t samples, lobe_count;       /* of this packet, or its scouts */
    bool scouts;                        /* these are drawn */
    struct lanes sum[3];                /* sum of the estimator's terms, before 1 / N_s */
    struct open_sky *open;              /* NULL: samples are not corrected */
    struct lanes share[STRATA_MAX + 1]; /* mu_f(n); the element after the strata is 0 */
    bool seen[STRATA_MAX];              /* whether any lane sees the stratum; else all of `share` is 0 */
    uint32_t sun;              /* index of the sun in `share`; without a sun, of the element after the strata */
    uint32_t shift[2][PACKET]; /* digital shifts of the BRDF samples' numbers */
    struct lane_pixels pixels;
    uint32_t place[PACKET]; /* shifts of the samples' places in a pixel */
    struct direct_counts *counts;
    struct direct_log *log;         /* records a lane of this packet; NULL in normal rendering */
    struct direct_log_sample *note; /* the current sample's record; NULL likewise */
};

/* One BRDF sample per lane. */
struct lobe_rays {
    struct lanes d[3];
    struct sky_places places;
};

static inline void clamp_cosines(const struct shade_packet *restrict p, const float c[3], struct lanes *restrict out)
{
    const float x = c[0], y = c[1], z = c[2];

    LANES(l)
    {
        const float cosine = p->ns_x[l] * x + p->ns_y[l] * y + p->ns_z[l] * z;
        out->v[l] = cosine > 0.0f ? cosine : 0.0f;
    }
}

/* F_f I_f of a cell; F_f is the sum of the clamped cosines of its corners [LPG13, Eq. 3]. A cell is convex: if all four
 * are zero, so is every cosine in it. */
static void weigh_cell(const struct shade_packet *p, const float corner[4][3], float energy, struct lanes *out)
{
    struct lanes cosine[4];

    for (int k = 0; k < 4; k++)
        clamp_cosines(p, corner[k], &cosine[k]);
    LANES(l) out->v[l] = (((cosine[0].v[l] + cosine[1].v[l]) + cosine[2].v[l]) + cosine[3].v[l]) * energy;
}

/* The same for cells x cells of each face; a corner shared by up to four cells is evaluated once. */
static void weigh_grid(const struct shade_packet *restrict p, const struct light_samples *lights,
                       struct lanes *restrict out)
{
    const uint32_t cells = lights->cells;
    struct lanes border[2][CELLS_MAX + 1]; /* corners above and below a row of cells */

    for (uint32_t row = 0; row < CUBE_FACES * cells; row++, out += cells) {
        const float(*corner)[4][3] = lights->corner + (size_t)row * cells;
        struct lanes *above = border[row & 1], *below = border[~row & 1];
        for (uint32_t j = 0; j <= cells; j++) {
            if (row % cells == 0)
                clamp_cosines(p, j < cells ? corner[j][0] : corner[j - 1][1], &above[j]);
            clamp_cosines(p, j < cells ? corner[j][2] : corner[j - 1][3], &below[j]);
        }
        for (uint32_t j = 0; j < cells; j++) {
            const float energy = (float)lights->energy[row * cells + j];
            LANES(l)
            {
                const float sum = ((above[j].v[l] + above[j + 1].v[l]) + below[j].v[l]) + below[j + 1].v[l];
                out[j].v[l] = sum * energy;
            }
        }
    }
}

/* The same for the sun: four times the clamped cosine of the direction of its cone that is nearest to the normal, so
 * that it is positive wherever the sun is partly visible. */
static void weigh_sun(const struct shade_packet *p, const struct light_samples *lights, float energy, struct lanes *out)
{
    const float c = lights->sun_cos, s = lights->sun_sin;
    const float *axis = lights->sun_axis;

    LANES(l)
    {
        const float cosine = p->ns_x[l] * axis[0] + p->ns_y[l] * axis[1] + p->ns_z[l] * axis[2];
        const float sine2 = 1.0f - cosine * cosine;
        const float edge = cosine * c + sqrtf(sine2 > 0.0f ? sine2 : 0.0f) * s; /* of the angle minus the spread */
        const float nearest = cosine >= c ? 1.0f : edge;
        out->v[l] = nearest > 0.0f ? 4.0f * nearest * energy : 0.0f;
    }
}

/* mu_f(n) = F_f(n) I_f / sum [LPG13, Eq. 3]. Strata that no lane sees stay 0: about half of the cells. */
static void set_up_shares(struct packet_state *s)
{
    const struct light_samples *lights = s->lights;
    const bool grid = s->frame->share == SHARE_CORNERS && lights->cells > 1;
    struct lanes total = { { 0 } };

    if (grid)
        weigh_grid(s->points, lights, s->share);
    for (uint32_t f = 0; f < lights->strata; f++) {
        const float energy = (float)lights->energy[f];
        int seen = 0;
        if (s->frame->share != SHARE_CORNERS)
            LANES(l) s->share[f].v[l] = 1.0f / (float)lights->strata;
        else if (lights->has_sun && f == lights->strata - 1)
            weigh_sun(s->points, lights, energy, &s->share[f]);
        else if (!grid)
            weigh_cell(s->points, lights->corner[f], energy, &s->share[f]);
        LANES(l) total.v[l] += s->share[f].v[l];
        LANES(l) seen += s->share[f].v[l] > 0.0f ? 1 : 0;
        s->seen[f] = seen != 0;
    }
    if (s->frame->share == SHARE_CORNERS)
        for (uint32_t f = 0; f < lights->strata; f++)
            if (s->seen[f])
                LANES(l) s->share[f].v[l] = total.v[l] > 0.0f ? s->share[f].v[l] / total.v[l] : 0.0f;
}

/* Replaces the shares by their mean over the points that see light, so that a share is positive if any of them is. */
static void join_shares(struct packet_state *s)
{
    const uint32_t strata = s->lights->strata;
    struct lanes lit = { { 0 } };
    float count = 0.0f;

    for (uint32_t f = 0; f < strata; f++)
        if (s->seen[f])
            LANES(l) lit.v[l] = s->share[f].v[l] > 0.0f ? 1.0f : lit.v[l];
    LANES(l)
    {
        lit.v[l] = s->points->valid[l] ? lit.v[l] : 0.0f;
        count += lit.v[l];
    }
    for (uint32_t f = 0; f < strata; f++) {
        float sum = 0.0f;
        if (!s->seen[f])
            continue;
        LANES(l) sum += lit.v[l] * s->share[f].v[l];
        LANES(l) s->share[f].v[l] = count > 0.0f ? sum / count : 0.0f;
    }
}

/* Integer counts with mean N q_f for a packet's shares q_f of the cells: the prefix sums of N q_f are cut at u, u + 1,
 * u + 2, ..., with one u per packet, so that each count is one of the two integers next to its mean [Kitagawa 1996].
 * The sun keeps a real-valued count with beta: where it shines it dominates, and one sample more or less would be
 * visible. */
static void count_samples(struct packet_state *s, uint32_t index, float *count)
{
    const struct direct_frame *f = s->frame;
    const double u = rng_unit(rng_mix(rng_mix(f->seed, index), PACKET + s->scouts));
    const double samples = (double)f->light_part * s->samples;
    double sum = u, before = floor(sum);

    for (uint32_t k = 0; k < s->lights->strata; k++) {
        const double mean = samples * (double)s->share[k].v[0];
        count[k] = 0.0f;
        if (k == s->sun) {
            count[k] = (float)mean;
        } else if (s->seen[k]) {
            sum += mean;
            const double now = floor(sum);
            count[k] = (float)(now - before);
            before = now;
        }
    }
}

/* Records the current sample before it is weighted. */
__attribute__((cold, noinline)) static void note_begin(struct packet_state *s, struct direct_log_sample *note,
                                                       const struct lanes d[3], float beta)
{
    s->note = note;
    for (int c = 0; c < 3; c++)
        note->w[c] = d[c].v[s->log->lane];
    note->beta = beta;
    note->chosen = beta > 0.0f;
}

/* part: share of the density by which it was drawn. */
__attribute__((cold, noinline)) static void note_weight(struct packet_state *s, float part, float density)
{
    s->note->mis = density > 0.0f ? part / density : 0.0f;
}

__attribute__((cold, noinline)) static void note_light(struct packet_state *s, const int32_t valid[PACKET],
                                                       const struct lanes rgb[3])
{
    const uint32_t l = s->log->lane;

    s->note->effective = valid[l] != 0;
    s->note->visible = valid[l] != 0 && s->rays.tfar[l] > 0.0f;
    for (int c = 0; c < 3; c++)
        s->note->rgb[c] = rgb[c].v[l];
}

/* Traces the lanes that would contribute and adds the unoccluded ones. Returns the number of rays. */
static inline uint64_t trace_and_add(struct packet_state *s, enum ray_spread spread, const struct lanes d[3],
                                     const struct lanes rgb[3])
{
    const struct shade_packet *p = s->points;
    _Alignas(64) int32_t valid[PACKET];
    int32_t count = 0;

    LANES(l)
    {
        valid[l] = rgb[0].v[l] + rgb[1].v[l] + rgb[2].v[l] > 0.0f ? p->valid[l] : 0;
        count -= valid[l];
    }
    if (count == 0)
        return 0;
    lanes_aim(d, &s->rays);
    if (s->frame->rays) {
        rays_occluded16(s->frame->rays, spread, valid, &s->rays);
        s->counts->rays += (uint64_t)count;
    }
    if (s->log)
        note_light(s, valid, rgb);
    LANES(l)
    {
        const int lit = (valid[l] != 0) & (s->rays.tfar[l] > 0.0f);
        s->sum[0].v[l] += lit ? rgb[0].v[l] : 0.0f;
        s->sum[1].v[l] += lit ? rgb[1].v[l] : 0.0f;
        s->sum[2].v[l] += lit ? rgb[2].v[l] : 0.0f;
    }
    if (s->open)
        open_sky_see(s->open, valid, s->rays.tfar);
    return (uint64_t)count;
}

/* A sample's light, 0 where it is below the geometric surface. */
static inline void weigh(const struct lanes *weight, const struct lanes *above, const struct lanes brdf[3],
                         const struct lanes sky[3], struct lanes rgb[3])
{
    for (int c = 0; c < 3; c++)
        LANES(l) rgb[c].v[l] = above->v[l] * weight->v[l] * brdf[c].v[l] * sky[c].v[l];
}

/* Starts the rays of the i-th sample of a kind elsewhere in the pixel, so that edges of shadows are antialiased. */
static inline void start_rays(struct packet_state *s, uint32_t i, uint32_t kind)
{
    uint32_t place[PACKET];

    LANES(l) place[l] = (s->place[l] + lanes_place(i + 16 * kind)) % PIXEL_CELLS;
    lanes_start(s->points, &s->pixels, place, &s->rays);
}

/* beta of Eq. 5, counted from i = 0: N_f - i clamped to 0..1. */
static inline float beta_of(float n_f, float i)
{
    const float left = n_f - i, some = left < 0.0f ? 0.0f : left;
    return some < 1.0f ? some : 1.0f;
}

/* Adds light sample k, the i-th of its stratum: beta g of Eq. 6. The denominator sums all densities that could have
 * produced the direction: the cell's, the sun's, the lobes'. */
static void add_light_sample(struct packet_state *s, uint32_t i, uint32_t k, const struct lanes *n_f)
{
    const struct light_samples *lights = s->lights;
    const struct lanes *share = &s->share[lights->stratum[k]], *sun_share = &s->share[s->sun];
    const float before = (float)i, brdf_part = s->frame->brdf_part;
    const float pdf_light = s->frame->light_part * lights->pdf[k], pdf_sun = s->frame->light_part * lights->sun_pdf[k];
    const float w[3] = { lights->x[k], lights->y[k], lights->z[k] },
                of_sky[3] = { lights->r[k], lights->g[k], lights->b[k] };
    struct lanes d[3], sky[3], sun, cosine, above, brdf[3], pdf_lobes, weight, rgb[3];

    for (int c = 0; c < 3; c++)
        LANES(l)
        {
            d[c].v[l] = w[c];
            sky[c].v[l] = of_sky[c];
        }
    if (s->log)
        note_begin(s, &s->log->light[k], d, beta_of(n_f->v[s->log->lane], before));
    if (!lobes_face(s->points, d, &cosine, &above))
        return;
    lobes_evaluate(&s->lobes, s->points, d, &cosine, brdf, &pdf_lobes);
    LANES(l)
    {
        const float beta = beta_of(n_f->v[l], before);
        const float density = share->v[l] * pdf_light + sun_share->v[l] * pdf_sun + brdf_part * pdf_lobes.v[l];
        weight.v[l] = density > 0.0f ? beta / density : 0.0f;
        sun.v[l] = pdf_sun;
    }
    weigh(&weight, &above, brdf, sky, rgb);
    if (s->open)
        open_sky_add(s->open, s->points, &weight, &cosine, sky, &sun);
    if (s->log) {
        const uint32_t l = s->log->lane;
        const float drawn = share->v[l] * pdf_light + sun_share->v[l] * pdf_sun;
        note_weight(s, drawn, drawn + brdf_part * pdf_lobes.v[l]);
    }
    start_rays(s, i, lights->stratum[k]);
    s->counts->effective += trace_and_add(s, RAYS_TOGETHER, d, rgb);
}

__attribute__((cold, noinline)) static void note_stratum(struct packet_state *s, uint32_t f, float n_f)
{
    s->log->share[f] = s->seen[f] ? s->share[f].v[s->log->lane] : 0.0f;
    s->log->count[f] = s->seen[f] ? n_f : 0.0f;
}

static void add_light_samples(struct packet_state *s, uint32_t index)
{
    const struct light_samples *lights = s->lights;
    const float part = s->frame->light_part, samples = (float)s->samples;
    const bool systematic = s->frame->systematic;
    float count[STRATA_MAX];

    if (systematic)
        count_samples(s, index, count);
    for (uint32_t f = 0; f < lights->strata; f++) {
        struct lanes n_f;
        int32_t up[PACKET], most = 0, chosen = 0; /* at most 2^20, and 16 times that */
        if (s->log)
            note_stratum(s, f, systematic ? count[f] : s->share[f].v[s->log->lane] * part * samples);
        if (lights->first[f + 1] == lights->first[f] || !s->seen[f] || (s->scouts && f == s->sun))
            continue;
        LANES(l) n_f.v[l] = s->share[f].v[l] * part * samples;
        if (systematic)
            LANES(l) n_f.v[l] = count[f];
        LANES(l)
        {
            const int32_t whole = (int32_t)n_f.v[l];
            up[l] = (whole + ((float)whole < n_f.v[l])) & s->points->valid[l];
        }
        LANES(l) chosen += up[l];
        LANES(l) most = up[l] > most ? up[l] : most;
        s->counts->chosen += (uint64_t)chosen;
        const uint32_t first = lights->first[f], there = lights->first[f + 1] - first;
        for (uint32_t i = 0; i < (uint32_t)most && i < there; i++)
            add_light_sample(s, i, first + i, &n_f);
    }
}

static void take_counts(struct packet_state *s, uint32_t index)
{
    const struct direct_frame *f = s->frame;

    s->samples = f->counts ? f->counts[index] : f->samples;
    s->scouts = false;
}

/* The strata's shares of the packet's light samples. */
static void set_up_strata(struct packet_state *s, uint32_t index)
{
    s->lights = direct_lights(s->frame, index, s->scouts);
    s->sun = s->lights->has_sun ? s->lights->strata - 1 : s->lights->strata;
    set_up_shares(s);
    if (s->frame->systematic)
        join_shares(s);
    LANES(l) s->share[s->lights->strata].v[l] = 0.0f;
}

static void direct_counts(const struct direct_frame *f, const struct shade_packet *p, uint32_t index, uint32_t *count)
{
    struct packet_state s;
    float real[STRATA_MAX];

    s.frame = f;
    s.points = p;
    take_counts(&s, index);
    const uint32_t scouts = direct_scouts(f, s.samples);
    for (uint32_t k = 0; k < (scouts > 0 ? 2 : 1); k++) {
        s.scouts = k > 0;
        s.samples = k > 0 ? scouts : s.samples;
        set_up_strata(&s, index);
        count_samples(&s, index, real);
        for (uint32_t c = 0; c < s.lights->strata; c++) {
            const uint32_t n = (uint32_t)ceilf(real[c]);
            count[c] = k > 0 && count[c] > n ? count[c] : n;
        }
    }
}

/* Draws BRDF sample i of each lane and looks up the sky. All points use the same numbers, each with its own random
 * digital shift, which keeps every number uniform and the set a net. */
static void draw_lobe_rays(const struct packet_state *s, uint32_t i, struct lobe_rays *out)
{
    const struct direct_frame *f = s->frame;
    const uint32_t at = (s->scouts ? f->lobes : 0) + i, x = f->numbers[2 * at], y = f->numbers[2 * at + 1];
    struct lanes square[2];

    LANES(l) /* 24 bits: the maximum stays below 1 in float */
    {
        square[0].v[l] = (float)(int32_t)((x ^ s->shift[0][l]) >> 8) * 0x1p-24f;
        square[1].v[l] = (float)(int32_t)((y ^ s->shift[1][l]) >> 8) * 0x1p-24f;
    }
    lobes_sample(&s->lobes, s->points, square, out->d);
    sky_locate(f->environment, f->table, out->d, &out->places);
}

/* The density with which light samples would have produced the looked-up directions. */
static inline void weigh_seen(const struct packet_state *s, const struct sky_lanes *sky, struct lanes *pdf)
{
    const struct lanes *sun_share = &s->share[s->sun];
    struct lanes share;

    LANES(l) share.v[l] = s->share[sky->stratum[l]].v[l];
    LANES(l) pdf->v[l] = share.v[l] * sky->pdf.v[l] + sun_share->v[l] * sky->pdf_sun.v[l];
}

/* f_i of Eq. 6. A ray that hits anything, including glass, counts 0. */
static void add_lobe_sample(struct packet_state *s, uint32_t i, float beta, const struct lobe_rays *r)
{
    const struct direct_frame *f = s->frame;
    const float light_part = f->light_part, brdf_part = f->brdf_part;
    struct lanes cosine, above, brdf[3], pdf_lobes, pdf_light = { { 0 } }, weight, rgb[3];
    struct sky_lanes sky;

    if (s->log)
        note_begin(s, &s->log->lobes[i], r->d, beta);
    if (!lobes_face(s->points, r->d, &cosine, &above))
        return;
    sky_lookup(f->environment, f->table, &r->places, &sky);
    lobes_evaluate(&s->lobes, s->points, r->d, &cosine, brdf, &pdf_lobes);
    if (light_part > 0.0f)
        weigh_seen(s, &sky, &pdf_light);
    LANES(l)
    {
        const float density = light_part * pdf_light.v[l] + brdf_part * pdf_lobes.v[l];
        weight.v[l] = density > 0.0f ? beta / density : 0.0f;
    }
    weigh(&weight, &above, brdf, sky.rgb, rgb);
    if (s->open)
        open_sky_add(s->open, s->points, &weight, &cosine, sky.rgb, &sky.pdf_sun);
    if (s->log) {
        const float drawn = brdf_part * pdf_lobes.v[s->log->lane];
        note_weight(s, drawn, light_part * pdf_light.v[s->log->lane] + drawn);
    }
    start_rays(s, i, STRATA_MAX);
    trace_and_add(s, RAYS_APART, r->d, rgb);
}

/* The leading bits of the shift are common to a packet: its lanes then sample the same cell of the unit square at a
 * time, so that their rays stay coherent, but differ within it, so that noise shows no blocks. */
static void set_up_shift(struct packet_state *s, uint32_t index)
{
    const struct direct_frame *f = s->frame;
    const uint64_t seed = rng_mix(f->seed, index);
    uint32_t common = 0;

    while (common < 16 && s->lobe_count >> (2 * common + 2))
        common++;
    const uint32_t differ = UINT32_MAX >> common;
    LANES(l)
    {
        const uint64_t own = rng_mix(seed, (uint64_t)l);
        s->shift[0][l] = ((uint32_t)seed & ~differ) | ((uint32_t)own & differ);
        s->shift[1][l] = ((uint32_t)(seed >> 32) & ~differ) | ((uint32_t)(own >> 32) & differ);
    }
}

/* next: the rays of sample 0. Each sample's rays are generated before the previous ones are traced. */
static void add_lobe_samples(struct packet_state *s, struct lobe_rays next[2])
{
    for (uint32_t i = 0; i < s->lobe_count; i++) {
        const float left = s->frame->brdf_part * (float)s->samples - (float)i;
        if (i + 1 < s->lobe_count)
            draw_lobe_rays(s, i + 1, &next[(i + 1) & 1]);
        add_lobe_sample(s, i, left < 1.0f ? left : 1.0f, &next[i & 1]);
    }
}

static void add_samples(struct packet_state *s, uint32_t index)
{
    const struct direct_frame *f = s->frame;
    struct lobe_rays next[2];

    s->lobe_count = (uint32_t)ceilf(f->brdf_part * (float)s->samples);
    if (f->brdf_part > 0.0f) {
        set_up_shift(s, index);
        draw_lobe_rays(s, 0, &next[0]);
    }
    if (f->light_part > 0.0f) {
        set_up_strata(s, index);
        add_light_samples(s, index);
    }
    if (f->brdf_part > 0.0f)
        add_lobe_samples(s, next);
}

static void divide(const struct packet_state *s, float *lo)
{
    for (int c = 0; c < 3; c++)
        LANES(l) lo[c * PACKET + l] = s->sum[c].v[l] / (float)s->samples;
}

__attribute__((cold, noinline)) static void note_correction(struct direct_log *log, const float *before,
                                                            const float *lo)
{
    for (uint32_t c = 0; c < 3; c++)
        log->known[c] = lo[c * PACKET + log->lane] - before[c * PACKET + log->lane];
}

/* Scouts only find out how much of the sky is visible; their light is not added. */
static void add_corrected(struct packet_state *s, uint32_t index, float *lo)
{
    struct open_sky open = { 0 }, seen = { 0 };
    struct direct_log *log = s->log;
    const uint32_t samples = s->samples;
    float before[3 * PACKET];

    s->open = &open;
    add_samples(s, index);
    divide(s, lo);
    s->open = &seen;
    s->log = NULL;
    s->scouts = true;
    s->samples = direct_scouts(s->frame, samples);
    add_samples(s, index);
    memcpy(before, lo, sizeof(before));
    open_sky_correct(s->frame->known, s->points, &s->lobes, &open, samples, &seen, lo);
    if (log)
        note_correction(log, before, lo);
}

static void direct_packet(const struct direct_frame *f, const struct shade_packet *p, uint32_t index, float *lo,
                          struct direct_counts *counts)
{
    struct packet_state s;

    s.frame = f;
    s.points = p;
    s.counts = counts;
    s.open = NULL;
    s.log = f->log && f->log->packet == index ? f->log : NULL;
    take_counts(&s, index);
    for (int c = 0; c < 3; c++)
        LANES(l) s.sum[c].v[l] = 0.0f;
    lobes_set_up(p, &s.lobes);
    lobes_rays(p, &s.rays);
    lanes_pixels(p, &s.pixels);
    LANES(l) s.place[l] = (uint32_t)rng_mix(rng_mix(f->seed, index), l);
    if (direct_scouts(f, s.samples) > 0) {
        add_corrected(&s, index, lo);
    } else {
        add_samples(&s, index);
        divide(&s, lo);
    }
}

extern const struct kernels KERNEL(kernels);
const struct kernels KERNEL(kernels) = { KERNEL_CPU, TEXT(KERNEL_LEVEL), direct_counts, direct_packet };
