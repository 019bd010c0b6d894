#include "light/audit/audit.h"

#include "base/cancel.h"
#include "base/mem.h"
#include "base/rng.h"

#include <math.h>
#include <string.h>

#define SOFT 1e-2          /* of relMSE */
#define CLEARLY 6.0        /* variances */
#define ROUND 64           /* pixels */
#define SHARE_EVEN 0.25    /* of the draws that are even over all pixels, so that none is impossible; */
#define SHARE_SCATTER 0.35 /* of an unfiltered image, that follow its scatter, and */
#define SHARE_LONELY 0.4   /* that follow single pixels unlike those around; */
#define SHARE_CALM 0.15    /* of a filtered one, that follow its scatter, and */
#define SHARE_HALVES 0.2   /* each, that follow what its halves say of the filter's error */
#define FIRST_PATHS 16     /* of an estimate, at first; without a filter, if there are rays for it, */
#define NOISY_PATHS 64     /* so many, as more of the truth comes from the estimates then */
#define MOST_PATHS 2048
#define RAYS_OF_PATH 4  /* about */
#define Y_ERROR 0.02    /* relative variance that the mean of four estimates has at most, so that 1 / x^2 is right */
#define LEAST 320       /* pixels that state an error, */
#define LEAST_BOUND 128 /* and that bound it */
#define KEPT 8192       /* pixels at most */

struct answer { /* of one pixel */
    uint32_t pixel;
    float share; /* of its error in the image's: 1 / (N p) */
    struct audit_light light[AUDIT_PARTS];
};

struct sums {                                      /* over answers k of weights w_k */
    double weight, value, square;                  /* of w, w v, w v^2 */
    double weight2, weight2_value, weight2_square; /* of w^2, w^2 v, w^2 v^2 */
};

struct audit {
    const struct audit_desc *desc; /* of the image, and so is rgb */
    const float *rgb;
    uint32_t width, height, pixels;
    double soft;           /* 1e-2 m^2 */
    double *sums, *share;  /* [pixels]: running sums of probabilities; working memory */
    struct answer *answer; /* [KEPT], of this key */
    uint32_t count;
    uint64_t key, rounds;
    struct sums own, past; /* of the last image's judged answers; of those that images before had */
    bool mapped, sized;    /* sums are those of this key, or of one like it; paths are as many as needed */
    double noise;          /* mean relative variance of one path */
    double usual;          /* the image's error as estimated before: that of d at a pixel of which nothing is known */
    uint32_t paths;
};

struct audit *audit_create(uint32_t width, uint32_t height)
{
    struct audit *a = mem_alloc(1, sizeof(*a));

    if (!a)
        return NULL;
    a->width = width;
    a->height = height;
    a->pixels = width * height;
    a->paths = FIRST_PATHS;
    a->sums = mem_alloc(a->pixels, sizeof(*a->sums));
    a->share = mem_alloc(2 * (size_t)a->pixels, sizeof(*a->share));
    a->answer = mem_alloc(KEPT, sizeof(*a->answer));
    if (!a->sums || !a->share || !a->answer) {
        audit_destroy(a);
        return NULL;
    }
    return a;
}

void audit_destroy(struct audit *a)
{
    if (!a)
        return;
    mem_free(a->sums);
    mem_free(a->share);
    mem_free(a->answer);
    mem_free(a);
}

void audit_forget(struct audit *a)
{
    a->count = 0;
    a->rounds = 0;
    a->own = a->past = (struct sums){ .weight = 0.0 };
}

/* ---- Where the error may be ---- */

/* The squared scatter of an image around a pixel, relative as relMSE is. */
static double scatter_at_pixel(const struct audit *a, uint32_t pixel)
{
    const uint32_t width = a->width, height = a->height, x = pixel % width, y = pixel / width;
    double sum = 0.0;

    for (int c = 0; c < 3; c++) {
        double mean = 0.0, square = 0.0, count = 0.0;
        for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < height; v++)
            for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < width; u++, count += 1.0) {
                const double d = (double)a->rgb[3 * ((size_t)v * width + u) + (size_t)c];
                mean += d;
                square += d * d;
            }
        mean /= count;
        sum += fmax(square / count - mean * mean, 0.0) / (mean * mean + a->soft);
    }
    return sum;
}

/* What the halves before a filter say of a pixel's error. Where both differ from d to the same side, d is probably
 * wrong, */
static double both_off(const struct audit *a, uint32_t pixel)
{
    double sum = 0.0;

    for (size_t c = 3 * (size_t)pixel; c < 3 * (size_t)pixel + 3; c++) {
        const double d = (double)a->rgb[c], h[2] = { (double)a->desc->half[0][c], (double)a->desc->half[1][c] };
        const double x = fmin(fmax(h[0], h[1]), d);
        sum += fmax((h[0] - d) * (h[1] - d), 0.0) / (x * x + a->soft);
    }
    return sum;
}

/* and where their mean does, by much. */
static double mean_off(const struct audit *a, uint32_t pixel)
{
    double sum = 0.0;

    for (size_t c = 3 * (size_t)pixel; c < 3 * (size_t)pixel + 3; c++) {
        const double d = (double)a->rgb[c], h = 0.5 * ((double)a->desc->half[0][c] + (double)a->desc->half[1][c]);
        const double x = fmin(h, d);
        sum += (h - d) * (h - d) / (x * x + a->soft);
    }
    return sum;
}

/* The filter removes dark points of a pixel's size among bright ones. Either half may have found them. */
static double darker(const struct audit *a, uint32_t pixel)
{
    double sum = 0.0;

    for (size_t c = 3 * (size_t)pixel; c < 3 * (size_t)pixel + 3; c++) {
        const double d = (double)a->rgb[c];
        const double x = fmin(fmin((double)a->desc->half[0][c], (double)a->desc->half[1][c]), d);
        sum += (d - x) * (d - x) / (x * x + a->soft);
    }
    return sum;
}

static double grey(const struct audit *a, size_t pixel)
{
    return (double)a->rgb[3 * pixel] + (double)a->rgb[3 * pixel + 1] + (double)a->rgb[3 * pixel + 2];
}

/* How far the pixel is from the median around it, squared: a single bright pixel among dark ones is wrong, and its
 * neighbours are not. */
static double lonely(const struct audit *a, uint32_t pixel)
{
    const uint32_t width = a->width, height = a->height, x = pixel % width, y = pixel / width;
    double near[9];
    int count = 0;

    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < height; v++)
        for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < width; u++) {
            const double d = grey(a, (size_t)v * width + u);
            int k = count++;
            for (; k > 0 && near[k - 1] > d; k--)
                near[k] = near[k - 1];
            near[k] = d;
        }
    const double own = grey(a, pixel), middle = near[count / 2], dark = fmin(middle, own);
    return (own - middle) * (own - middle) / (dark * dark + 9.0 * a->soft);
}

static bool is_seen(const struct audit *a, uint32_t pixel)
{
    return !a->desc->mask || a->desc->mask[pixel];
}

/* Adds a share of the probabilities, in proportion to `of`. */
static void add_share(struct audit *a, double share, const double *of)
{
    double sum = 0.0;

    for (uint32_t i = 0; i < a->pixels; i++)
        sum += is_seen(a, i) ? of[i] : 0.0;
    for (uint32_t i = 0; i < a->pixels && sum > 0.0; i++)
        a->sums[i] += is_seen(a, i) ? share * of[i] / sum : 0.0;
}

/* The mean over 3 x 3 pixels. */
static double around(const struct audit *a, const double *of, uint32_t x, uint32_t y)
{
    const uint32_t width = a->width, height = a->height;
    double sum = 0.0, count = 0.0;

    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < height; v++)
        for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < width; u++, count += 1.0)
            sum += of[(size_t)v * width + u];
    return sum / count;
}

static void at_all_pixels(const struct audit *a, double (*of)(const struct audit *, uint32_t), double *out)
{
#pragma omp parallel for schedule(static)
    for (uint32_t i = 0; i < a->pixels; i++)
        out[i] = of(a, i);
}

static void around_all_pixels(const struct audit *a, const double *of, double *out)
{
#pragma omp parallel for schedule(static)
    for (uint32_t i = 0; i < a->pixels; i++)
        out[i] = around(a, of, i % a->width, i / a->width);
}

/* The shares of a filtered image that follow its halves. */
static void add_halves(struct audit *a, double *own, double *wide)
{
    at_all_pixels(a, mean_off, own);
    add_share(a, SHARE_HALVES, own);
    at_all_pixels(a, both_off, own);
    around_all_pixels(a, own, wide);
    add_share(a, SHARE_HALVES, wide);
    at_all_pixels(a, darker, own);
    around_all_pixels(a, own, wide);
    for (uint32_t i = 0; i < a->pixels; i++)
        wide[i] = own[i] * own[i] / (wide[i] + 1e-3);
    add_share(a, SHARE_HALVES, wide);
}

/* Fills a->sums: the probabilities of drawing each pixel. */
static void find_probabilities(struct audit *a)
{
    double *own = a->share, before = 0.0;

    memset(a->sums, 0, a->pixels * sizeof(*a->sums));
    for (uint32_t i = 0; i < a->pixels; i++)
        own[i] = 1.0;
    add_share(a, SHARE_EVEN, own);
    at_all_pixels(a, scatter_at_pixel, own);
    add_share(a, a->desc->half[0] ? SHARE_CALM : SHARE_SCATTER, own);
    if (a->desc->half[0]) {
        add_halves(a, own, a->share + a->pixels);
    } else {
        at_all_pixels(a, lonely, own);
        add_share(a, SHARE_LONELY, own);
    }
    for (uint32_t i = 0; i < a->pixels; i++)
        a->sums[i] = before += a->sums[i];
    a->mapped = true;
}

/* ---- Drawing and judging ---- */

/* The pixel of a number in [0, 1). */
static uint32_t pixel_of(const struct audit *a, double x)
{
    const double at = x * a->sums[a->pixels - 1];
    uint32_t low = 0, high = a->pixels - 1;

    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (a->sums[middle] > at)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

static double probability(const struct audit *a, uint32_t pixel)
{
    return (a->sums[pixel] - (pixel > 0 ? a->sums[pixel - 1] : 0.0)) / a->sums[a->pixels - 1];
}

/* The variance of the mean of the estimates but i and j, as their paths show it. */
static double variance_of_others(const struct answer *of, int i, int j, int c)
{
    const int parts = AUDIT_PARTS - 2;
    double sum = 0.0;

    for (int k = 0; k < AUDIT_PARTS; k++)
        sum += k != i && k != j ? of->light[k].variance[c] / (parts * parts) : 0.0;
    return sum;
}

/* 1 / (t^2 + soft) from an x about t of this variance. The weight is convex, so that a noisy x has a larger one on
 * average: by the second term of its expansion, which is taken off in a way that stays positive. */
static double weight_at(const struct audit *a, double x, double variance)
{
    const double weight = 1.0 / (x * x + a->soft);

    return weight / (1.0 + fmax(variance * (3.0 * x * x - a->soft) * weight * weight, -0.5));
}

/* The share of the truth that x takes from y, the mean of the estimates but i and j, and the rest from d: by the
 * variances of y, as its paths show it, and of d, which is that of the image's mean error, or what d and y tell. */
static double share_of_mean(const struct audit *a, const struct answer *of, int i, int j, double y[3])
{
    const float *d = a->rgb + 3 * (size_t)of->pixel;
    const int parts = AUDIT_PARTS - 2;
    double off = 0.0, noise = 0.0, usual = 0.0;

    for (int c = 0; c < 3; c++) {
        y[c] = 0.0;
        for (int k = 0; k < AUDIT_PARTS; k++)
            y[c] += k != i && k != j ? of->light[k].rgb[c] / parts : 0.0;
        noise += variance_of_others(of, i, j, c);
        off += ((double)d[c] - y[c]) * ((double)d[c] - y[c]);
        usual += a->usual * (fmax((double)(d[c] * d[c]), y[c] * y[c]) + a->soft);
    }
    const double own = fmax(usual, off - CLEARLY * noise);
    return own > 0.0 ? own / (own + noise) : 0.0;
}

/* A pixel's error in this image, relative as relMSE is: the mean over all pairs of estimates. */
static double judge(const struct audit *a, const struct answer *of)
{
    const float *shown = a->rgb + 3 * (size_t)of->pixel;
    double out = 0.0;

    for (int i = 0; i < AUDIT_PARTS; i++)
        for (int j = i + 1; j < AUDIT_PARTS; j++) {
            double y[3];
            const double w = share_of_mean(a, of, i, j, y);
            for (int c = 0; c < 3; c++) {
                const double d = (double)shown[c], x = d + w * (y[c] - d), noise = variance_of_others(of, i, j, c);
                out += (d - of->light[i].rgb[c]) * (d - of->light[j].rgb[c]) * weight_at(a, x, w * w * noise) / 3.0;
            }
        }
    return out / (AUDIT_PARTS * (AUDIT_PARTS - 1) / 2);
}

/* The relative variance of one path of a round's estimates, on average. */
static double noise_of(const struct audit *a, const struct answer *round)
{
    double out = 0.0;

    for (uint32_t k = 0; k < ROUND; k++)
        for (int c = 0; c < 3; c++) {
            const double d = (double)a->rgb[3 * (size_t)round[k].pixel + (size_t)c];
            double mean = 0.0, square = 0.0;
            for (int j = 0; j < AUDIT_PARTS; j++) {
                mean += round[k].light[j].rgb[c] / AUDIT_PARTS;
                square += round[k].light[j].rgb[c] * round[k].light[j].rgb[c];
            }
            out += (double)round[k].share * a->paths * fmax(square - AUDIT_PARTS * mean * mean, 0.0) /
                   (AUDIT_PARTS - 1) / (3.0 * ROUND * (d * d + a->soft));
        }
    return out;
}

/* Draws evenly along the running sums. Returns its rays. */
static uint64_t run_round(struct audit *a)
{
    const uint64_t seed = rng_mix(rng_mix(a->desc->seed, a->key), a->rounds++);
    const double shift = rng_unit(rng_hash(seed));
    struct answer *round = a->answer + a->count;
    uint64_t rays = 0;

#pragma omp parallel for schedule(dynamic, 1)
    for (uint32_t k = 0; k < ROUND; k++) {
        struct answer *own = &round[k];
        own->pixel = pixel_of(a, (k + shift) / ROUND);
        own->share = (float)(1.0 / (a->pixels * probability(a, own->pixel)));
        for (uint32_t j = 0; j < AUDIT_PARTS; j++)
            a->desc->trace(a->desc->self,
                           &(struct audit_question){ own->pixel, a->paths, rng_mix(seed, 1 + AUDIT_PARTS * k + j) },
                           &own->light[j]);
    }
    for (uint32_t k = 0; k < ROUND; k++)
        for (int j = 0; j < AUDIT_PARTS; j++)
            rays += round[k].light[j].rays;
    a->noise = noise_of(a, round);
    a->count += ROUND;
    return rays;
}

static void add_to(struct sums *to, const struct sums *from, double weight)
{
    to->weight += weight * from->weight;
    to->value += weight * from->value;
    to->square += weight * from->square;
    to->weight2 += weight * weight * from->weight2;
    to->weight2_value += weight * weight * from->weight2_value;
    to->weight2_square += weight * weight * from->weight2_square;
}

static void estimate(const struct sums *s, struct audit_result *out)
{
    /* n: the number of equally weighted answers that say as much. */
    const double n = s->weight2 > 0.0 ? s->weight * s->weight / s->weight2 : 0.0,
                 mean = s->weight > 0.0 ? s->value / s->weight : 0.0;
    const double scatter = s->weight2_square - 2.0 * mean * s->weight2_value + mean * mean * s->weight2;

    out->error = mean;
    out->deviation = n > 1.0 ? sqrt(fmax(scatter, 0.0) * n / (n - 1.0)) / s->weight : 0.0;
    out->pixels = (uint32_t)n;
}

/* The estimate from all answers, in a fixed order: from this key's, if they suffice, else also from those before. */
static void sum_up(struct audit *a, struct audit_result *out)
{
    a->own = (struct sums){ .weight = 0.0 };
    for (uint32_t k = 0; k < a->count; k++) {
        const double v = (double)a->answer[k].share * judge(a, &a->answer[k]);
        add_to(&a->own, &(struct sums){ 1.0, v, v * v, 1.0, v, v * v }, 1.0);
    }
    estimate(&a->own, out);
    out->older = a->past.weight > 0.0 && !(a->count >= LEAST && out->deviation <= AUDIT_ENOUGH * out->error);
    if (!out->older)
        return;
    struct sums all = a->own;
    add_to(&all, &a->past, 1.0);
    estimate(&all, out);
}

/* A second time with the error that the first time found. */
static void find_error(struct audit *a, struct audit_result *out)
{
    for (int k = 0; k < 2; k++) {
        sum_up(a, out);
        a->usual = fmax(out->error, 0.0);
    }
}

/* Of the first round, whose rays are given: as many paths as bring the variance of one estimate to four times the
 * image's squared error, that of their mean to once: with fewer their noise dominates, with more the scatter of
 * errors over pixels. But no more than LEAST pixels can have. */
static uint32_t paths_for(const struct audit *a, double error, uint64_t rays)
{
    const double rounds = (double)LEAST / ROUND;
    uint32_t n = a->paths;

    while (n < MOST_PATHS && n * 4.0 * fmin(fmax(error, 0.0), Y_ERROR) < a->noise &&
           rounds * (double)rays * 2 * n / a->paths <= (double)a->desc->rays)
        n *= 2;
    return n;
}

static uint32_t first_paths(const struct audit_desc *desc)
{
    uint32_t n = desc->half[0] || desc->bounds ? FIRST_PATHS : NOISY_PATHS;

    while (n > FIRST_PATHS && (uint64_t)LEAST * AUDIT_PARTS * n * RAYS_OF_PATH > desc->rays)
        n /= 2;
    return n;
}

/* Takes over what an image before tells of this one. */
static void follow(struct audit *a, const struct audit_desc *desc)
{
    const struct sums before = a->past;

    if (!(desc->like_last > 0.0))
        a->past = (struct sums){ .weight = 0.0 };
    if (desc->key == a->key && a->count > 0)
        return;
    a->past = (struct sums){ .weight = 0.0 };
    add_to(&a->past, &before, desc->like_last);
    add_to(&a->past, &a->own, desc->like_last);
    if (!(a->past.weight > 0.0)) {
        a->paths = first_paths(desc);
        a->sized = a->mapped = false;
        a->usual = 0.0;
    }
    a->own = (struct sums){ .weight = 0.0 };
    a->key = desc->key;
    a->count = 0;
}

static void begin(struct audit *a, const struct audit_desc *desc, const float *rgb)
{
    const size_t values = 3 * (size_t)a->pixels;
    double mean = 0.0;

    follow(a, desc);
    a->desc = desc;
    a->rgb = rgb;
    if (a->count == 0 && desc->rays == 0) /* nothing is judged */
        return;
    for (size_t i = 0; i < values; i++)
        mean += (double)rgb[i];
    mean /= (double)values;
    a->soft = SOFT * mean * mean + 1e-30;
}

/* An error that few pixels have, few draws may not have met, and their scatter does not show it. */
static void state(const struct audit_desc *desc, struct audit_result *out)
{
    const double error = fmax(out->error, 0.0), unmet = fmax(sqrt(desc->uneven / fmax(out->pixels, 1.0)), desc->hidden);

    if (out->pixels < LEAST_BOUND || !(out->deviation > 0.0) || is_cancelled(desc->cancel))
        return;
    if (out->pixels >= LEAST && out->deviation <= AUDIT_DOUBT * error && !desc->bounds && !out->older)
        out->states = error;
    else
        out->at_most = error + 2.0 * fmax(out->deviation, error * unmet);
}

void audit_image(struct audit *a, const struct audit_desc *desc, const float *rgb, struct audit_result *out)
{
    begin(a, desc, rgb);
    *out = (struct audit_result){ .rays = 0 };
    find_error(a, out);
    while (out->rays < desc->rays && a->count + ROUND <= KEPT && !is_cancelled(desc->cancel) &&
           !(out->pixels >= LEAST && out->deviation <= AUDIT_ENOUGH * out->error)) {
        if (!a->mapped)
            find_probabilities(a);
        if (!(a->sums[a->pixels - 1] > 0.0))
            break;
        const uint64_t rays = run_round(a);
        out->rays += rays;
        find_error(a, out);
        const uint32_t paths = a->sized || desc->bounds ? a->paths : paths_for(a, out->error, rays);
        if (paths > a->paths) /* the first round told only how many an estimate needs */
            a->count = 0;
        a->paths = paths;
        a->sized = true;
    }
    out->paths = a->paths;
    state(desc, out);
}
