#include "history/stated.h"

#include "base/mem.h"

#include <math.h>
#include <string.h>

#define SOFT 1e-2      /* of relMSE */
#define AROUND 0.25f   /* of the mean of the pixels around: x at least */
#define DARK_FROM 4.0f /* squared differences, in variances, from which x is not P */
#define KEPT 0.8       /* of a measurement's weight, by each further one */
#define NORMALS 6      /* directions of a normal: its largest coordinate and its sign */
#define GROUPS (PACKET_SETS * NORMALS)

struct stated {
    const struct gbuffer *g;
    float *noise_at;            /* [height][width]: squared noise of the halves' mean, summed over r, g and b */
    float *x;                   /* [height][width][3] */
    float *scale;               /* [height][width][3]: 1 / (x^2 + 1e-2 m^2) */
    uint8_t *group;             /* [packet_count][16] */
    float soft;                 /* 1e-2 m^2 */
    bool seen;                  /* x and scale are those of picture `pictures` */
    unsigned pictures;          /* of this sky: k */
    double weight, sum, square; /* of q, of q times the constant, of q^2 times its variance; weight 0: none measured */
};

static uint8_t group_of(const struct gbuffer *g, uint32_t point)
{
    const struct shade_packet *p = &g->packets[point / PACKET];
    const uint32_t lane = point % PACKET;
    const float n[3] = { p->ns_x[lane], p->ns_y[lane], p->ns_z[lane] };
    uint32_t axis = 0;

    for (uint32_t c = 1; c < 3; c++)
        axis = fabsf(n[c]) > fabsf(n[axis]) ? c : axis;
    return (uint8_t)(NORMALS * packet_set(point / PACKET) + 2 * axis + (n[axis] < 0.0f));
}

struct stated *stated_create(const struct gbuffer *g)
{
    struct stated *s = mem_alloc(1, sizeof(*s));

    if (!s)
        return NULL;
    s->g = g;
    const size_t pixels = (size_t)g->width * g->height;
    s->noise_at = mem_alloc(pixels, sizeof(float));
    s->x = mem_alloc(pixels, 3 * sizeof(float));
    s->scale = mem_alloc(pixels, 3 * sizeof(float));
    s->group = mem_alloc(g->packet_count, PACKET);
    if (!s->noise_at || !s->x || !s->scale || !s->group) {
        stated_destroy(s);
        return NULL;
    }
    for (uint32_t point = 0; point < g->packet_count * PACKET; point++)
        s->group[point] = group_of(g, point);
    return s;
}

void stated_destroy(struct stated *s)
{
    if (!s)
        return;
    mem_free(s->noise_at);
    mem_free(s->x);
    mem_free(s->scale);
    mem_free(s->group);
    mem_free(s);
}

void stated_forget(struct stated *s)
{
    s->weight = s->sum = s->square = 0.0;
    s->pictures = 0;
    s->seen = false;
}

/* The picture's light of `points` in a pixel. */
static void add_points(const struct gbuffer *g, uint32_t pixel, const float *points, float out[3])
{
    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *e = &g->entries[k];
        const size_t at = (size_t)(e->point / PACKET) * 3 * PACKET + e->point % PACKET;
        for (size_t c = 0; c < 3; c++)
            out[c] += e->weight[c] * points[at + c * PACKET];
    }
}

/* The mean over 3 x 3 pixels of channel c of a picture of n channels. */
static float mean_around(const struct gbuffer *g, const float *of, uint32_t x, uint32_t y, size_t n, size_t c)
{
    float sum = 0.0f, count = 0.0f;

    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < g->height; v++)
        for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < g->width; u++, count += 1.0f)
            sum += of[n * ((size_t)v * g->width + u) + c];
    return sum / count;
}

/* noise_at and, in x, the picture with what the halves say of thin shadows. */
static void find_x(struct stated *s, const float *rgb, const struct stated_light *light)
{
    const uint32_t width = s->g->width, height = s->g->height;

#pragma omp parallel for schedule(static)
    for (uint32_t i = 0; i < width * height; i++) {
        float h[2][3] = { { 0.0f } };
        for (int k = 0; k < 2; k++)
            add_points(s->g, i, light->half[k], h[k]);
        s->noise_at[i] = 0.0f;
        for (int c = 0; c < 3; c++)
            s->noise_at[i] += 0.25f * (h[0][c] - h[1][c]) * (h[0][c] - h[1][c]);
    }
#pragma omp parallel for schedule(static)
    for (uint32_t i = 0; i < width * height; i++) {
        float h[2][3] = { { 0.0f } }, shown[3] = { 0.0f }, sum[3] = { 0.0f }, off = 0.0f;
        add_points(s->g, i, light->shown, shown);
        for (int k = 0; k < 2; k++)
            add_points(s->g, i, light->half[k], h[k]);
        for (int c = 0; c < 3; c++) {
            const float d = 0.5f * (h[0][c] + h[1][c]) - shown[c];
            sum[0] += h[0][c];
            sum[1] += h[1][c];
            sum[2] += shown[c];
            off += d * d;
        }
        const float noise = DARK_FROM * mean_around(s->g, s->noise_at, i % width, i / width, 1, 0);
        const float w = fmaxf(sum[0], sum[1]) < sum[2] && off > noise ? noise / off : 1.0f;
        for (int c = 0; c < 3; c++)
            s->x[3 * (size_t)i + c] =
                fmaxf(rgb[3 * (size_t)i + c] + (1.0f - w) * (0.5f * (h[0][c] + h[1][c]) - shown[c]), 0.0f);
    }
}

void stated_see(struct stated *s, const float *rgb, const struct stated_light *light)
{
    const struct gbuffer *g = s->g;
    const size_t values = 3 * (size_t)g->width * g->height;
    double mean = 0.0;

    for (size_t i = 0; i < values; i++)
        mean += (double)rgb[i] / (double)values;
    s->soft = (float)(SOFT * mean * mean + 1e-30);
    find_x(s, rgb, light);
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < g->height; y++)
        for (uint32_t i = 0; i < 3 * g->width; i++) {
            const size_t at = 3 * (size_t)y * g->width + i;
            const float x = fmaxf(s->x[at], AROUND * mean_around(g, rgb, i / 3, y, 3, i % 3));
            s->scale[at] = 1.0f / (x * x + s->soft);
        }
    s->pictures++;
    s->seen = true;
}

/* New samples, and what the packets' shared light samples tint. */
struct samples {
    const float *const *half, *const *more, *shown;
    double tint[2][GROUPS][3]; /* of P, in each half */
};

static float sample_of(const struct samples *n, int j, size_t at)
{
    return n->half[j][at] + (n->more[j] ? n->more[j][at] : 0.0f);
}

/* Least squares of S - P = tint * P. */
static double fit(double off, double was)
{
    return was > 0.0 ? off / was : 0.0;
}

/* What the points of a group have in common in half j, beyond all with the same normal. Sums are in one order. */
static void find_tints(const struct stated *s, struct samples *n, int j)
{
    double(*off)[3] = n->tint[j], was[GROUPS][3] = { { 0.0 } };

    memset(off, 0, sizeof(n->tint[j]));
    for (uint32_t i = 0; i < s->g->packet_count; i++)
        for (uint32_t l = 0; l < s->g->packets[i].count; l++)
            for (uint32_t c = 0, k = s->group[i * PACKET + l]; c < 3; c++) {
                const size_t at = ((size_t)i * 3 + c) * PACKET + l;
                const double p = (double)n->shown[at], per = 1.0 / (p * p + (double)s->soft);
                off[k][c] += per * p * ((double)sample_of(n, j, at) - p);
                was[k][c] += per * p * p;
            }
    for (uint32_t k = 0; k < 3 * NORMALS; k++) {
        const uint32_t c = k % 3;
        double all = 0.0, all_was = 0.0;
        for (uint32_t i = k / 3; i < GROUPS; i += NORMALS) {
            all += off[i][c];
            all_was += was[i][c];
        }
        for (uint32_t i = k / 3; i < GROUPS; i += NORMALS)
            off[i][c] = fit(off[i][c], was[i][c]) - fit(all, all_was);
    }
}

/* A pixel's product of the halves' differences from P, without tints. */
static double pixel_error(const struct stated *s, const struct samples *n, uint32_t pixel)
{
    float off[2][3] = { { 0.0f } };
    double out = 0.0;

    for (uint32_t k = s->g->entry_first[pixel]; k < s->g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *e = &s->g->entries[k];
        const size_t at = (size_t)(e->point / PACKET) * 3 * PACKET + e->point % PACKET;
        for (size_t c = 0; c < 3; c++)
            for (int j = 0; j < 2; j++)
                off[j][c] +=
                    e->weight[c] * (sample_of(n, j, at + c * PACKET) -
                                    n->shown[at + c * PACKET] * (1.0f + (float)n->tint[j][s->group[e->point]][c]));
    }
    for (size_t c = 0; c < 3; c++)
        out += (double)(s->scale[3 * (size_t)pixel + c] * off[0][c] * off[1][c]);
    return out;
}

/* M and its variance, from the means over the sets of pixels' first points. */
static double measure(const struct stated *s, const struct samples *n, double *variance)
{
    const uint32_t pixels = s->g->width * s->g->height;
    double sum[PACKET_SETS] = { 0.0 }, count[PACKET_SETS] = { 0.0 }, all = 0.0, seen = 0.0, sets = 0.0;
    double mean = 0.0, square = 0.0;

    for (uint32_t i = 0; i < pixels; i++)
        if (s->g->entry_first[i] < s->g->entry_first[i + 1]) {
            const uint32_t set = s->group[s->g->entries[s->g->entry_first[i]].point] / NORMALS;
            sum[set] += pixel_error(s, n, i);
            count[set] += 1.0;
        }
    for (int k = 0; k < PACKET_SETS; k++)
        if (count[k] > 0.0) {
            const double own = sum[k] / count[k];
            all += sum[k];
            seen += count[k];
            sets += 1.0;
            mean += own;
            square += own * own;
        }
    const double share = seen / (3.0 * pixels);
    *variance = sets > 1.0 ? share * share * (square - mean * mean / sets) / (sets * (sets - 1.0)) : INFINITY;
    return all / (3.0 * pixels);
}

static double samples_of(unsigned picture)
{
    return pow(2.0 * picture - 1.0, STATED_FALL);
}

void stated_take(struct stated *s, const float *const half[2], const float *const more[2], const float *shown)
{
    struct samples n = { .half = half, .more = more, .shown = shown };
    double variance;

    if (!s->seen)
        return;
    for (int j = 0; j < 2; j++)
        find_tints(s, &n, j);
    const double by = samples_of(s->pictures), m = measure(s, &n, &variance);
    s->weight = KEPT * s->weight + 1.0;
    s->sum = KEPT * s->sum + by * m;
    s->square = KEPT * KEPT * s->square + by * by * variance;
    s->seen = false;
}

double stated_error(const struct stated *s)
{
    if (!(s->weight > 0.0) || !s->seen || !(s->square <= STATED_DOUBT * STATED_DOUBT * s->sum * s->sum))
        return 0.0;
    return fmax(s->sum, 0.0) / (s->weight * samples_of(s->pictures));
}
