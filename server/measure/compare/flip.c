#include "measure/compare/metrics.h"

#include "base/mem.h"
#include "base/vec.h"
#include "image/film/film.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#define KEY 0.18      /* middle grey */
#define RADIUS_MAX 32 /* of any kernel, pixels: 3 * 0.04502 degrees at most pixels per degree is 28 */
#define BANDS 64      /* of pixels; added in order, so that the thread count changes nothing */

/* The exponents and knees that the authors chose [Andersson et al. 2020, sections 4.1.3 and 4.2.2]. */
#define COLOUR_POWER 0.7    /* q_c */
#define COLOUR_KNEE 0.4     /* p_c, as a share of the largest difference */
#define COLOUR_AT_KNEE 0.95 /* p_t */
#define FEATURE_POWER 0.5   /* q_f */
#define FEATURE_WIDTH 0.082 /* w, degrees: of the Gaussian that finds edges and dots, twice its standard deviation */

/* Contrast sensitivity as sums of two Gaussians: the filter at a distance d in degrees is the sum of
 * a sqrt(pi / b) exp(-pi^2 d^2 / b) [Andersson et al. 2020, section 4.1.1]. */
#define GAUSSIANS 2
static const double sensitivity[3][GAUSSIANS][2] = {
    { { 1.0, 0.0047 }, { 0.0, 1e-5 } },  /* black against white */
    { { 1.0, 0.0053 }, { 0.0, 1e-5 } },  /* red against green */
    { { 34.1, 0.04 }, { 13.5, 0.025 } }, /* yellow against blue: the eye is at its most blurred */
};
#define WIDEST 0.04 /* the largest b above */

struct taps { /* of a filter along one axis */
    int radius;
    double at[2 * RADIUS_MAX + 1]; /* at[radius + t] weighs the pixel t further on */
};

struct size {
    uint32_t width, height;
};

/* exp(-pi^2 d^2 / b), not normalized. */
static struct taps gaussian_taps(double b, int radius, double pixels_per_degree)
{
    struct taps taps = { .radius = radius };

    for (int t = -radius; t <= radius; t++) {
        const double d = t / pixels_per_degree;
        taps.at[radius + t] = exp(-PI * PI * d * d / b);
    }
    return taps;
}

static double taps_sum(const struct taps *taps)
{
    double sum = 0.0;

    for (int i = 0; i <= 2 * taps->radius; i++)
        sum += taps->at[i];
    return sum;
}

static void taps_scale(struct taps *taps, double scale)
{
    for (int i = 0; i <= 2 * taps->radius; i++)
        taps->at[i] *= scale;
}

/* Scales what is above 0 to a sum of 1 and what is below to -1: an ideal edge or dot between black and white then gets
 * 1 at most [Andersson et al. 2020, section 4.2.1]. */
static void taps_balance(struct taps *taps)
{
    double above = 0.0, below = 0.0;

    for (int i = 0; i <= 2 * taps->radius; i++) {
        above += taps->at[i] > 0.0 ? taps->at[i] : 0.0;
        below -= taps->at[i] < 0.0 ? taps->at[i] : 0.0;
    }
    for (int i = 0; i <= 2 * taps->radius; i++)
        taps->at[i] /= taps->at[i] > 0.0 ? above : below;
}

/* out[x] += weight * in[x + t], the row going on beyond its ends as it ends. */
static void add_shifted(const double *in, int width, int t, double weight, double *out)
{
    const int begin = t < 0 ? (-t < width ? -t : width) : 0;
    const int end = t > 0 ? (width > t ? width - t : 0) : width;

    for (int x = 0; x < begin; x++)
        out[x] += weight * in[0];
    for (int x = begin; x < end; x++)
        out[x] += weight * in[x + t];
    for (int x = end > begin ? end : begin; x < width; x++)
        out[x] += weight * in[width - 1];
}

static void filter_across(const double *in, struct size s, const struct taps *taps, double *out)
{
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < s.height; y++) {
        double *row = out + (size_t)y * s.width;
        memset(row, 0, s.width * sizeof(*row));
        for (int t = -taps->radius; t <= taps->radius; t++)
            add_shifted(in + (size_t)y * s.width, (int)s.width, t, taps->at[taps->radius + t], row);
    }
}

/* out += in, filtered. */
static void add_filtered_down(const double *in, struct size s, const struct taps *taps, double *out)
{
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < s.height; y++) {
        double *row = out + (size_t)y * s.width;
        for (int t = -taps->radius; t <= taps->radius; t++) {
            const int64_t at = (int64_t)y + t, last = (int64_t)s.height - 1;
            const double *from = in + (size_t)(at < 0 ? 0 : at > last ? last : at) * s.width;
            const double weight = taps->at[taps->radius + t];
            for (uint32_t x = 0; x < s.width; x++)
                row[x] += weight * from[x];
        }
    }
}

/* The eye's blur of one opponent channel. Each Gaussian is separable, their sum is not: they are added with the share
 * that each has of the whole. */
static void blur_channel(const double *in, struct size s, int channel, double pixels_per_degree, double *scratch,
                         double *out)
{
    const int radius = (int)ceil(3.0 * sqrt(WIDEST / (2.0 * PI * PI)) * pixels_per_degree); /* [ibid., Eq. 6] */
    struct taps taps[GAUSSIANS];
    double share[GAUSSIANS], whole = 0.0;

    for (int k = 0; k < GAUSSIANS; k++) {
        const double a = sensitivity[channel][k][0], b = sensitivity[channel][k][1];
        taps[k] = gaussian_taps(b, radius, pixels_per_degree);
        const double sum = taps_sum(&taps[k]);
        share[k] = a * sqrt(PI / b) * sum * sum;
        whole += share[k];
        taps_scale(&taps[k], 1.0 / sum);
    }
    memset(out, 0, (size_t)s.width * s.height * sizeof(*out));
    for (int k = 0; k < GAUSSIANS; k++) {
        if (share[k] <= 0.0)
            continue;
        filter_across(in, s, &taps[k], scratch);
        taps_scale(&taps[k], share[k] / whole);
        add_filtered_down(scratch, s, &taps[k], out);
    }
}

/* Length of a filter's answers along both axes, at most 1. `along` is the derivative, `blur` goes across it. */
static void find_feature(const double *in, struct size s, const struct taps *along, const struct taps *blur,
                         double *scratch, double *other, double *out)
{
    const size_t count = (size_t)s.width * s.height;

    memset(out, 0, count * sizeof(*out));
    memset(other, 0, count * sizeof(*other));
    filter_across(in, s, along, scratch);
    add_filtered_down(scratch, s, blur, out);
    filter_across(in, s, blur, scratch);
    add_filtered_down(scratch, s, along, other);
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++)
        out[i] = sqrt(out[i] * out[i] + other[i] * other[i]);
}

/* First and second derivatives of a Gaussian, on the brightness in 0..1 [Andersson et al. 2020, section 4.2.1]. */
static void find_features(const double *brightness, struct flip_view *v, double pixels_per_degree, double *scratch,
                          double *other)
{
    const struct size s = { v->width, v->height };
    const double sigma = 0.5 * FEATURE_WIDTH * pixels_per_degree;
    const int radius = (int)ceil(3.0 * sigma);
    struct taps blur = { .radius = radius }, edge = blur, point = blur;

    for (int t = -radius; t <= radius; t++) {
        const double g = exp(-t * t / (2.0 * sigma * sigma));
        blur.at[radius + t] = g;
        edge.at[radius + t] = -t * g;
        point.at[radius + t] = (t * t / (sigma * sigma) - 1.0) * g;
    }
    taps_scale(&blur, 1.0 / taps_sum(&blur));
    taps_balance(&edge);
    taps_balance(&point);
    find_feature(brightness, s, &edge, &blur, scratch, other, v->plane[FLIP_EDGE]);
    find_feature(brightness, s, &point, &blur, scratch, other, v->plane[FLIP_POINT]);
}

static double unit(float value)
{
    return value > 0.0f ? (value < 1.0f ? (double)value : 1.0) : 0.0;
}

/* Linear Rec.709 to YCxCz: brightness, red against green, yellow against blue. Linear in light, so that the blur acts
 * on light [Andersson et al. 2020, section 4.1.1]. */
static void to_opponent(const float *rgb, size_t count, double *y, double *cx, double *cz)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++) {
        const double c[3] = { unit(rgb[3 * i]), unit(rgb[3 * i + 1]), unit(rgb[3 * i + 2]) };
        double xyz[3];
        lab_xyz(c, xyz);
        y[i] = 116.0 * xyz[1] - 16.0;
        cx[i] = 500.0 * (xyz[0] - xyz[1]);
        cz[i] = 200.0 * (xyz[1] - xyz[2]);
    }
}

/* A colour seems less colourful where it is dark (Hunt's effect) [Andersson et al. 2020, section 4.1.2]. */
static struct lab hunt(struct lab c)
{
    return (struct lab){ c.l, 0.01 * c.l * c.a, 0.01 * c.l * c.b };
}

/* Back to Rec.709, clipped to what a display can show, and on to L*a*b*. */
static struct lab lab_of_opponent(double y, double cx, double cz)
{
    const double luminance = (y + 16.0) / 116.0;
    const double x = 0.9504559271 * (luminance + cx / 500.0), z = 1.0890577508 * (luminance - cz / 200.0);
    double c[3] = {
        3.2409699419 * x - 1.5373831776 * luminance - 0.4986107603 * z,
        -0.9692436363 * x + 1.8759675015 * luminance + 0.0415550574 * z,
        0.0556300797 * x - 0.2039769589 * luminance + 1.0569715142 * z,
    };
    for (int k = 0; k < 3; k++)
        c[k] = c[k] > 0.0 ? (c[k] < 1.0 ? c[k] : 1.0) : 0.0;
    return hunt(lab_from(c));
}

static void to_lab(const double *const blurred[3], struct flip_view *v)
{
    const size_t count = (size_t)v->width * v->height;

#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++) {
        const struct lab c = lab_of_opponent(blurred[0][i], blurred[1][i], blurred[2][i]);
        v->plane[FLIP_L][i] = c.l;
        v->plane[FLIP_A][i] = c.a;
        v->plane[FLIP_B][i] = c.b;
    }
}

/* The planes of the result hold the opponent channels until the blurred ones are known. */
static void look(struct flip_view *v, const float *rgb, double pixels_per_degree, double *const work[3])
{
    const size_t count = (size_t)v->width * v->height;
    const struct size s = { v->width, v->height };
    double *const *p = v->plane;

    to_opponent(rgb, count, p[FLIP_L], p[FLIP_A], p[FLIP_B]);
    for (int k = 0; k < 3; k++)
        blur_channel(p[FLIP_L + k], s, k, pixels_per_degree, p[FLIP_EDGE], work[k]);
    const double *const blurred[3] = { work[0], work[1], work[2] };
    double *brightness = p[FLIP_L]; /* to_lab comes last: it overwrites this */
    for (size_t i = 0; i < count; i++)
        brightness[i] = (brightness[i] + 16.0) / 116.0;
    find_features(brightness, v, pixels_per_degree, p[FLIP_A], p[FLIP_B]);
    to_lab(blurred, v);
}

bool flip_view_init(struct flip_view *v, const float *rgb, uint32_t width, uint32_t height, double pixels_per_degree)
{
    const size_t count = (size_t)width * height;
    double *work[3] = { NULL, NULL, NULL };
    bool made = true;

    assert(pixels_per_degree > 0.0 && pixels_per_degree <= FLIP_PIXELS_PER_DEGREE_MAX);
    *v = (struct flip_view){ .width = width, .height = height };
    for (int k = 0; k < FLIP_PLANES; k++) {
        v->plane[k] = mem_alloc(count, sizeof(double));
        made = made && v->plane[k];
    }
    for (int k = 0; k < 3; k++) {
        work[k] = mem_alloc(count, sizeof(double));
        made = made && work[k];
    }
    if (made)
        look(v, rgb, pixels_per_degree, work);
    else
        flip_view_finish(v);
    for (int k = 0; k < 3; k++)
        mem_free(work[k]);
    return made;
}

void flip_view_finish(struct flip_view *v)
{
    for (int k = 0; k < FLIP_PLANES; k++)
        mem_free(v->plane[k]);
    *v = (struct flip_view){ .width = 0 };
}

/* HyAB, a distance for colours far apart: brightness by itself, colour as the crow flies [Andersson et al. 2020,
 * Eq. 8]; raised to q_c. */
static double colour_distance(struct lab p, struct lab q)
{
    return pow(fabs(p.l - q.l) + hypot(p.a - q.a, p.b - q.b), COLOUR_POWER);
}

/* Between pure green and pure blue, the furthest apart of all that a display can show: 41.3. */
static double largest_distance(void)
{
    return colour_distance(hunt(lab_from((double[3]){ 0.0, 1.0, 0.0 })), hunt(lab_from((double[3]){ 0.0, 0.0, 1.0 })));
}

/* Distances up to the knee fill 0..0.95: which of two huge errors is larger hardly matters [Andersson et al. 2020,
 * section 4.1.3]. */
static double spread(double distance, double largest)
{
    const double knee = COLOUR_KNEE * largest;
    if (distance < knee)
        return COLOUR_AT_KNEE * distance / knee;
    const double beyond = (distance - knee) / (largest - knee);
    return COLOUR_AT_KNEE + (1.0 - COLOUR_AT_KNEE) * (beyond < 1.0 ? beyond : 1.0);
}

static double pixel_difference(const struct flip_view *a, const struct flip_view *b, size_t i, double largest)
{
    const struct lab p = { a->plane[FLIP_L][i], a->plane[FLIP_A][i], a->plane[FLIP_B][i] };
    const struct lab q = { b->plane[FLIP_L][i], b->plane[FLIP_A][i], b->plane[FLIP_B][i] };
    const double edge = fabs(a->plane[FLIP_EDGE][i] - b->plane[FLIP_EDGE][i]);
    const double point = fabs(a->plane[FLIP_POINT][i] - b->plane[FLIP_POINT][i]);
    const double feature = pow((edge > point ? edge : point) / sqrt(2.0), FEATURE_POWER); /* [ibid., Eq. 9] */
    const double colour = spread(colour_distance(p, q), largest);
    if (colour <= 0.0)
        return 0.0;
    return pow(colour, 1.0 - (feature < 1.0 ? feature : 1.0)); /* [ibid., Eq. 10] */
}

double flip_mean(const struct flip_view *a, const struct flip_view *b, const uint8_t *mask, float *map)
{
    const size_t count = (size_t)a->width * a->height;
    const double largest = largest_distance();
    double sum[BANDS], all = 0.0;
    uint64_t pixels[BANDS], counted = 0;

    assert(a->width == b->width && a->height == b->height);
#pragma omp parallel for schedule(static)
    for (size_t band = 0; band < BANDS; band++) {
        sum[band] = 0.0;
        pixels[band] = 0;
        for (size_t i = count * band / BANDS; i < count * (band + 1) / BANDS; i++) {
            const bool counts = !mask || mask[i];
            const double d = counts ? pixel_difference(a, b, i, largest) : 0.0;
            sum[band] += d;
            pixels[band] += counts;
            if (map)
                map[i] = (float)d;
        }
    }
    for (int band = 0; band < BANDS; band++) {
        all += sum[band];
        counted += pixels[band];
    }
    return counted ? all / (double)counted : 0.0;
}

void flip_tone(const float *rgb, size_t count, double gain, float *display)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++)
        display[i] = (float)tone_value(TONE_FILMIC, gain * (double)rgb[i]);
}

bool flip_compare(const float *x, const float *r, const uint8_t *mask, uint32_t width, uint32_t height,
                  double pixels_per_degree, float *map, double *mean)
{
    const size_t count = (size_t)width * height;
    const float *const images[2] = { x, r };
    struct flip_view views[2] = { { .width = 0 }, { .width = 0 } };
    double log2_mean = log2(KEY); /* a black reference: gain 1 */
    float *display = mem_alloc(3 * count, sizeof(*display));
    bool done = display && (!mask || memchr(mask, 1, count));

    (void)exposure_log2_mean(r, mask, width, height, &log2_mean);
    for (int k = 0; k < 2 && done; k++) {
        flip_tone(images[k], 3 * count, KEY / exp2(log2_mean), display);
        done = flip_view_init(&views[k], display, width, height, pixels_per_degree);
    }
    if (done)
        *mean = flip_mean(&views[0], &views[1], mask, map);
    flip_view_finish(&views[0]);
    flip_view_finish(&views[1]);
    mem_free(display);
    return done;
}
