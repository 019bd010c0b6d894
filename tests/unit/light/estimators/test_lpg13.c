/* The figures of [LPG13], measured again.
 *
 * Closed form for a matte point that sees everything. Within a face f a sample has the density p_f(w), and brings
 * X = s(w) / (mu_f p_f(w)); its mean is J_f / mu_f, its second moment K_f / mu_f^2, with
 *     J_f = integral of s over f,   K_f = integral of s^2 / p_f over f,   s = albedo / pi  L max(0, n.w).
 * Eq. 4 sums beta_i X_i, the beta_i being 1 but for the last one, which is the fraction of N_f: for independent samples
 *     variance = 1 / N_s^2  sum over f of B_f (K_f - J_f^2) / mu_f^2,   B_f = floor(N_f) + frac(N_f)^2.
 * What is drawn is a scrambled Sobol sequence, each point of which is uniform alone while the points of a set are not
 * independent. At N_s = 1 no face is given more than its first sample, and faces have seeds of their own: there the
 * estimator itself must have this variance. At N_s = 60 an estimator of the test's own with independent numbers is held
 * to it, and what the sequence gains is printed.
 * Samples that turn out to be behind the point are not traced: the rays of a point are on average
 *     sum over f of ceil(N_f) times the integral of p_f over what is in front. */
#include "light/estimators/points.h"

#include "light/estimators/dragon.h"
#include "light/resolve/resolve.h"
#include "measure/compare/metrics.h"

#include <omp.h>

#define ALBEDO 0.5
#define SKY "sky/sky.0012.exr" /* a morning, the sun at 26 degrees */
#define LIMIT 4.5

enum { SPLIT = 4 }; /* quadrature: SPLIT^2 places in a texel */

struct terms { /* of one face at one point */
    double mean, second, front;
};

static void integrate(const struct environment *e, const struct vec3 n, struct terms t[CUBE_FACES])
{
    const uint32_t size = e->n;
    const double step = 2.0 / (size * SPLIT);

    memset(t, 0, CUBE_FACES * sizeof(*t));
    for (uint32_t k = 0; k < CUBE_FACES * size * size; k++) {
        const struct texel *x = &e->texels[k];
        const uint32_t f = k / (size * size), i = k / size % size, j = k % size;
        const double light = rgb_luminance(x->r, x->g, x->b);
        if (!(x->density > 0.0f))
            continue;
        for (int q = 0; q < SPLIT * SPLIT; q++) {
            const double u = -1.0 + step * (j * SPLIT + q % SPLIT + 0.5);
            const double v = -1.0 + step * (i * SPLIT + q / SPLIT + 0.5);
            const double r2 = 1.0 + u * u + v * v, r3 = r2 * sqrt(r2);
            double d[3];
            cube_direction(f, u, v, d);
            const double cosine = (n.x * d[0] + n.y * d[1] + n.z * d[2]) / sqrt(r2);
            if (cosine <= 0.0)
                continue;
            const double s = ALBEDO / PI * light * cosine, pdf = x->density * r3 / e->energy[f];
            t[f].mean += s / r3 * step * step;
            t[f].second += s * s / pdf / r3 * step * step;
            t[f].front += pdf / r3 * step * step;
        }
    }
}

/* Eq. 3, or a sixth each. */
static void shares(const struct environment *e, struct vec3 n, bool even, double mu[CUBE_FACES])
{
    double sum = 0.0;

    for (uint32_t f = 0; f < CUBE_FACES; f++) {
        float c[4][3];
        cube_corners(f, c);
        mu[f] = even ? 1.0 / CUBE_FACES : 0.0;
        for (int k = 0; k < 4 && !even; k++)
            mu[f] += fmax(0.0, n.x * c[k][0] + n.y * c[k][1] + n.z * c[k][2]) * e->energy[f];
        sum += mu[f];
    }
    for (uint32_t f = 0; f < CUBE_FACES; f++)
        mu[f] /= sum;
}

struct figure {
    double mean, variance, rays, chosen;
};

static struct figure closed_form(const struct environment *e, struct vec3 n, bool even, uint32_t samples)
{
    struct terms t[CUBE_FACES];
    double mu[CUBE_FACES];
    struct figure out = { 0 };

    integrate(e, n, t);
    shares(e, n, even, mu);
    for (uint32_t f = 0; f < CUBE_FACES; f++) {
        const double count = mu[f] * samples, whole = floor(count), rest = count - whole;
        if (!(mu[f] > 0.0) || !(e->energy[f] > 0.0))
            continue;
        out.mean += t[f].mean;
        out.variance += (whole + rest * rest) * (t[f].second - t[f].mean * t[f].mean) / (mu[f] * mu[f]);
        out.rays += ceil(count) * t[f].front;
        out.chosen += ceil(count);
    }
    out.variance /= (double)samples * samples;
    return out;
}

/* Running moments about a value near the mean. */
struct moments {
    double about, sum[5];
};

static void add(struct moments *m, double x)
{
    const double d = x - m->about;

    m->sum[0] += 1.0;
    m->sum[1] += d;
    m->sum[2] += d * d;
    m->sum[3] += d * d * d;
    m->sum[4] += d * d * d * d;
}

/* Variance and its standard error, from the fourth moment. */
static double variance_of(const struct moments *m, double *error)
{
    const double n = m->sum[0], a = m->sum[1] / n, s2 = m->sum[2] / n, s3 = m->sum[3] / n, s4 = m->sum[4] / n;
    const double variance = s2 - a * a, fourth = s4 - 4.0 * a * s3 + 6.0 * a * a * s2 - 3.0 * a * a * a * a;

    *error = sqrt(fmax(0.0, fourth - variance * variance) / n);
    return variance * n / (n - 1.0);
}

/* 16 points that look anywhere; the first eight are upright. */
static struct gbuffer look_about(void)
{
    struct gbuffer g = points_make(1, LOBE_LAMBERT, (float)ALBEDO, 0.0f, 0.0f);
    struct shade_packet *p = g.packets;

    points_scatter(&g, 3);
    for (int l = 0; l < 8; l++) {
        p->ns_x[l] = p->ng_x[l] = (float)sin(2.0 * PI * (l + 0.3) / 8.0);
        p->ns_y[l] = p->ng_y[l] = 0.0f;
        p->ns_z[l] = p->ng_z[l] = (float)cos(2.0 * PI * (l + 0.3) / 8.0);
    }
    return g;
}

static struct vec3 normal_of(const struct shade_packet *p, int l)
{
    return vec3_make(p->ns_x[l], p->ns_y[l], p->ns_z[l]);
}

static void measure_variances(const struct environment *e, const struct gbuffer *g, enum method method,
                              uint32_t samples, uint32_t seeds, struct moments m[PACKET])
{
    static float lo[3 * PACKET];
    struct direct *d = direct_create(best_kernels());

    omp_set_num_threads(1); /* one packet at a time */
    for (int l = 0; l < PACKET; l++)
        m[l] = (struct moments){ .about = closed_form(e, normal_of(g->packets, l), true, 1).mean };
    for (uint64_t seed = 0; seed < seeds; seed++) {
        shade(d, g, e, method, samples, rng_mix(seed, samples), lo);
        for (int l = 0; l < PACKET; l++)
            add(&m[l], rgb_luminance(lo[l], lo[PACKET + l], lo[2 * PACKET + l]));
    }
    direct_destroy(d);
}

/* 64 comparisons, of mean and variance: passed by chance but once in 2300. The variances' standard errors are asserted
 * to be below 4 %, so a formula off by 40 % is told apart at any point, and one off by a tenth at most. */
static void a_single_sample_has_the_closed_form_variance(void **state)
{
    struct moments m[PACKET];
    (void)state;
    struct environment *e = sky_environment(sky_with_sun(64, 32, 300.0f), 32, 10.0);
    struct gbuffer g = look_about();
    for (int even = 0; even < 2; even++) {
        measure_variances(e, &g, even ? METHOD_FACES_UNIFORM : METHOD_FACES, 1, 16384, m);
        for (int l = 0; l < PACKET; l++) {
            const struct figure want = closed_form(e, normal_of(g.packets, l), even, 1);
            double error;
            const double variance = variance_of(&m[l], &error), mean = m[l].about + m[l].sum[1] / m[l].sum[0];
            const double z = (variance - want.variance) / (error + 2e-3 * want.variance);
            const double z_mean = (mean - want.mean) / (sqrt(variance / m[l].sum[0]) + 1e-3 * want.mean);
            if (!(fabs(z) < LIMIT && fabs(z_mean) < LIMIT && error < 0.04 * want.variance))
                printf("even %d, point %d: mean %g, want %g; variance %g +- %g, want %g\n", even, l, mean, want.mean,
                       variance, error, want.variance);
            assert_true(fabs(z) < LIMIT && fabs(z_mean) < LIMIT && error < 0.04 * want.variance);
        }
    }
    points_free(&g);
    environment_destroy(e);
}

/* Eq. 4 and 5 with independent numbers. */
static double independent_estimate(const struct environment *e, struct vec3 n, const double mu[CUBE_FACES],
                                   uint32_t samples, struct rng *r)
{
    double sum = 0.0;

    for (uint32_t f = 0; f < CUBE_FACES; f++) {
        const double count = mu[f] * samples;
        for (uint32_t i = 0; i < count && e->energy[f] > 0.0; i++) {
            const double x[2] = { rng_next(r), rng_next(r) };
            float w[3], rgb[3], pdf;
            samples_invert_face(e, f, x, w);
            environment_evaluate(e, w, rgb, &pdf);
            const double cosine = fmax(0.0, n.x * w[0] + n.y * w[1] + n.z * w[2]);
            sum += fmin(1.0, count - i) * ALBEDO / PI * rgb_luminance(rgb[0], rgb[1], rgb[2]) * cosine / (mu[f] * pdf);
        }
    }
    return sum / samples;
}

static void sixty_independent_samples_have_the_closed_form_variance(void **state)
{
    struct moments m[PACKET];
    (void)state;
    struct environment *e = sky_environment(sky_with_sun(64, 32, 300.0f), 32, 10.0);
    struct gbuffer g = look_about();
    for (int even = 0; even < 2; even++) {
        double gain = 0.0;
        measure_variances(e, &g, even ? METHOD_FACES_UNIFORM : METHOD_FACES, 60, 512, m);
        for (int l = 0; l < PACKET; l++) {
            const struct vec3 n = normal_of(g.packets, l);
            const struct figure want = closed_form(e, n, even, 60);
            struct moments own = { .about = want.mean };
            struct rng r = { rng_mix(9, (uint64_t)(2 * l + even)) };
            double mu[CUBE_FACES], error;
            shares(e, n, even, mu);
            for (int k = 0; k < 4096; k++)
                add(&own, independent_estimate(e, n, mu, 60, &r));
            const double variance = variance_of(&own, &error);
            const double z = (variance - want.variance) / (error + 2e-3 * want.variance);
            if (!(fabs(z) < LIMIT))
                printf("even %d, point %d: variance %g +- %g, want %g\n", even, l, variance, error, want.variance);
            assert_true(fabs(z) < LIMIT && error < 0.04 * want.variance);
            gain += variance_of(&m[l], &error) / want.variance / PACKET;
        }
        printf("%s, 60 samples: the Sobol sequence has %.3f of the variance of independent ones\n",
               even ? "faces-uniform" : "faces", gain);
        assert_true(gain < 1.0);
    }
    points_free(&g);
    environment_destroy(e);
}

/* Walls that have all of the sun's face behind them, under a sky that is three times as bright at the zenith as at the
 * horizon, above ground of a tenth: closed form, 60 samples. */
static void walls_that_face_away_need_fewer_rays(void **state)
{
    double worst_rays = 0.0, worst_samples = 0.0, mean_rays = 0.0, walls = 0.0;
    (void)state;
    struct frame f = sky_overcast(128, 64);
    sky_paint(&f, 32, 26, 3e4f, 2.7e4f, 2.1e4f); /* 17 degrees up, on the face of +X */
    struct environment *e = sky_environment(f, 64, 0.0);
    for (int k = 0; k < 32; k++) {
        const double phi = 2.0 * PI * (k + 0.5) / 32.0;
        const struct vec3 n = vec3_make((float)sin(phi), 0.0f, (float)cos(phi));
        double mu[CUBE_FACES];
        shares(e, n, false, mu);
        if (mu[0] > 0.0)
            continue;
        const struct figure by_shares = closed_form(e, n, false, 60), even = closed_form(e, n, true, 60);
        const double ratio = by_shares.variance / even.variance;
        worst_rays = fmax(worst_rays, ratio * by_shares.rays / even.rays);
        worst_samples = fmax(worst_samples, ratio);
        mean_rays += ratio * by_shares.rays / even.rays;
        walls += 1.0;
    }
    printf("%.0f walls: faces needs at most %.3f times the samples of faces-uniform, %.3f times the rays (mean %.3f)\n",
           walls, worst_samples, worst_rays, mean_rays / walls);
    assert_true(walls >= 6);
    assert_true(worst_samples <= 0.65 && worst_rays < 0.8);
    environment_destroy(e);
}

/* Upright within 6 degrees, and all of the face below its horizon. */
static bool faces_away(const struct environment *e, const struct vec3 n, uint32_t face)
{
    double mu[CUBE_FACES];

    shares(e, n, false, mu);
    return fabsf(n.y) <= 0.1f && mu[face] == 0.0;
}

/* Points of a view evenly from all over the image, as matte ones, `packets` full packets of them where there are as
 * many: all that there are, or those that are upright and face away from the sun. */
static struct gbuffer take_points(const struct dragon_view *v, uint32_t packets, bool away)
{
    struct gbuffer part = points_make(packets, LOBE_LAMBERT, (float)ALBEDO, 0.0f, 0.0f);
    const uint32_t wanted = packets * PACKET;
    struct sky_table t = { 0 };
    uint32_t count = 0, found = 0;
    float a, b;

    assert_int_equal(sky_table_build(&t, v->e, &(struct sky_table_desc){ .cells = 1, .sun = true }), ERR_OK);
    assert_true(t.has_sun);
    const uint32_t face = cube_locate(t.sun_axis, &a, &b);
    for (int pass = 0; pass < 2; pass++) { /* count, then take */
        const uint32_t all = found;
        found = 0;
        for (uint32_t k = 0; k < v->g->packet_count * PACKET; k++) {
            const struct shade_packet *p = &v->g->packets[k / PACKET];
            struct shade_packet *q = &part.packets[count / PACKET % packets];
            const uint32_t from = k % PACKET, to = count % PACKET;
            if (!p->valid[from] || (away && !faces_away(v->e, normal_of(p, (int)from), face)))
                continue;
            found++;
            if (pass == 0 || (uint64_t)found * wanted / all <= count || count == wanted)
                continue;
            q->x[to] = p->x[from], q->y[to] = p->y[from], q->z[to] = p->z[from];
            q->ng_x[to] = p->ng_x[from], q->ng_y[to] = p->ng_y[from], q->ng_z[to] = p->ng_z[from];
            q->ns_x[to] = p->ns_x[from], q->ns_y[to] = p->ns_y[from], q->ns_z[to] = p->ns_z[from];
            q->wo_x[to] = p->wo_x[from], q->wo_y[to] = p->wo_y[from], q->wo_z[to] = p->wo_z[from];
            count++;
        }
    }
    part.packet_count = count / PACKET;
    part.point_count = part.packet_count * PACKET;
    sky_table_finish(&t);
    return part;
}

#define MOST_POINTS 128

struct spread {                     /* over seeds */
    double relative;                /* mean over the points of variance over mean squared */
    double rays, useful, effective; /* per point; share of effective samples */
    double variance[MOST_POINTS];
};

static struct spread measure_spread(const struct dragon_view *v, const struct gbuffer *part, enum method method,
                                    uint32_t samples, uint64_t first, uint32_t seeds)
{
    static float lo[MOST_POINTS * 3];
    static double sum[MOST_POINTS], squares[MOST_POINTS];
    struct direct *d = direct_create(best_kernels());
    struct direct_desc desc = { .method = method, .samples = samples };
    const uint32_t points = (uint32_t)part->point_count;
    uint64_t chosen = 0, effective = 0, rays = 0;
    struct spread out = { 0 };
    uint32_t seen = 0;

    memset(sum, 0, sizeof(sum));
    memset(squares, 0, sizeof(squares));
    for (uint64_t seed = first; seed < first + seeds; seed++) {
        struct direct_stats stats;
        desc.seed = rng_mix(seed, samples + 1000 * (uint64_t)method);
        assert_int_equal(direct_shade(d, part, v->rays, v->e, &desc, lo, &stats), ERR_OK);
        chosen += stats.chosen;
        effective += stats.effective;
        rays += stats.rays;
        for (uint32_t k = 0; k < points; k++) {
            const float *p = lo + (size_t)(k / PACKET) * 3 * PACKET + k % PACKET;
            const double y = rgb_luminance(p[0], p[PACKET], p[2 * PACKET]);
            sum[k] += y / seeds;
            squares[k] += y * y / seeds;
        }
    }
    direct_destroy(d);
    for (uint32_t k = 0; k < points; k++) {
        out.variance[k] = (squares[k] - sum[k] * sum[k]) * seeds / (seeds - 1);
        if (sum[k] > 0.0) {
            out.relative += out.variance[k] / (sum[k] * sum[k]);
            seen++;
        }
    }
    out.relative /= seen;
    out.rays = (double)rays / seeds / points;
    out.useful = (double)effective / (double)chosen;
    out.effective = (double)effective / seeds / points;
    return out;
}

static double interpolate(double y, double y0, double y1, double x0, double x1)
{
    return exp(log(x0) + (log(y) - log(y0)) / (log(y1) - log(y0)) * (log(x1) - log(x0)));
}

/* The closed form at the points of a part, which takes no notice of shadows: mean relative variance and rays. The sky
 * at a quarter of the resolution is as good for that, and every eighth point. */
static void print_closed_form(const struct gbuffer *part, double *ratio)
{
    struct environment *e = load_sky(unit_data(SKY), 64);
    struct figure sum[2] = { { 0 } };

    for (uint32_t k = 0; k < part->point_count; k += 8)
        for (int even = 0; even < 2; even++) {
            const struct vec3 n = normal_of(&part->packets[k / PACKET], (int)(k % PACKET));
            const struct figure f = closed_form(e, n, even, 60);
            sum[even].variance += f.variance / (f.mean * f.mean);
            sum[even].rays += f.rays;
            sum[even].chosen += f.chosen;
        }
    *ratio = sum[0].variance / sum[1].variance;
    printf("closed form, independent samples, no shadows: %.1f %% and %.1f %% effective, %.3f times the samples, %.3f "
           "times "
           "the rays\n",
           100.0 * sum[0].rays / sum[0].chosen, 100.0 * sum[1].rays / sum[1].chosen, *ratio,
           *ratio * sum[0].rays / sum[1].rays);
    environment_destroy(e);
}

/* A point of the image at which 180 samples by sixths are just as good as 60 by shares: picked by some seeds,
 * measured by others. The ratio of the two variances, whose standard error is about 10 %. */
static double find_the_papers_point(const struct dragon_view *v)
{
    struct gbuffer part = take_points(v, 8, false);
    const struct spread by_shares = measure_spread(v, &part, METHOD_FACES, 60, 0, 64);
    const struct spread even = measure_spread(v, &part, METHOD_FACES_UNIFORM, 180, 0, 64);
    struct environment *e = load_sky(unit_data(SKY), 64);
    uint32_t picked = 0, more = 0;

    for (uint32_t k = 0; k < part.point_count; k++) {
        const double own = fabs(log(by_shares.variance[k] / even.variance[k]));
        more += by_shares.variance[k] <= even.variance[k];
        if (own < fabs(log(by_shares.variance[picked] / even.variance[picked])))
            picked = k;
    }
    struct gbuffer one = { .packets = &part.packets[picked / PACKET], .packet_count = 1, .point_count = PACKET };
    const uint32_t l = picked % PACKET;
    const double a = measure_spread(v, &one, METHOD_FACES, 60, 5000, 384).variance[l];
    const double b = measure_spread(v, &one, METHOD_FACES_UNIFORM, 180, 5000, 384).variance[l];
    const struct vec3 n = normal_of(one.packets, (int)l);
    const struct figure f = closed_form(e, n, false, 60), u = closed_form(e, n, true, 180);
    printf(
        "60 by shares are at least as good as 180 by sixths at %u of %u points from all over the image; equal at one "
        "with normal %.2f %.2f %.2f: variances %.3e and %.3e, %.0f and %.0f effective\n",
        more, (uint32_t)part.point_count, (double)n.x, (double)n.y, (double)n.z, a, b, f.rays, u.rays);
    points_free(&part);
    environment_destroy(e);
    return a / b;
}

/* Fig. 2 on the dragon: how many samples faces-uniform takes for the variance that faces has at 60, over upright matte
 * points that have the sun's face behind them, with shadows. A sample is a ray there as in the paper, which shades all
 * that it chooses. Of rays that are really traced next to none are saved: what is behind the point is not traced here,
 * and that is just what the sixths waste. So is it in the closed form: printed, and held to a looser bound, since it
 * knows nothing of what the sequence gains. The mean of 128 points over 96 seeds is good to some 8 %,
 * over the 64 of each commit to 10 %. */
static void figure_2_on_the_dragon(void **state)
{
    enum { COUNTS = 3 };
    const uint32_t seeds = seeds_count(64, 96);
    static const uint32_t counts[COUNTS] = { 60, 100, 150 };
    static struct spread even[COUNTS];
    (void)state;
    struct dragon_view v = view_load(480, 270, SKY);
    struct gbuffer part = take_points(&v, 8, true);
    const struct spread by_shares = measure_spread(&v, &part, METHOD_FACES, 60, 0, seeds);
    double samples = 0.0, rays = 0.0, closed;
    assert_true(part.point_count >= 64);
    printf("faces 60: relative variance %.3e, %.1f rays, %.1f %% of the samples effective\n", by_shares.relative,
           by_shares.rays, 100.0 * by_shares.useful);
    for (int k = 0; k < COUNTS; k++) {
        even[k] = measure_spread(&v, &part, METHOD_FACES_UNIFORM, counts[k], 0, seeds);
        printf("faces-uniform %u: relative variance %.3e, %.1f rays, %.1f %% effective\n", counts[k], even[k].relative,
               even[k].rays, 100.0 * even[k].useful);
        if (k > 0 && samples == 0.0 && (even[k].relative < by_shares.relative || k == COUNTS - 1)) {
            const double y = by_shares.relative, y0 = even[k - 1].relative, y1 = even[k].relative;
            samples = interpolate(y, y0, y1, counts[k - 1], counts[k]);
            rays = interpolate(y, y0, y1, even[k - 1].rays, even[k].rays);
        }
    }
    printf("the same variance: 60 samples against %.0f (%.3f), %.1f rays traced against %.1f (%.3f)\n", samples,
           60.0 / samples, by_shares.rays, rays, by_shares.rays / rays);
    print_closed_form(&part, &closed);
    const double picked = find_the_papers_point(&v);
    assert_true(60.0 / samples <= 0.6);
    assert_true(closed <= 0.7);
    assert_true(by_shares.useful > 1.4 * even[0].useful);
    assert_true(picked > 0.7 && picked < 1.43);
    points_free(&part);
    view_free(&v);
}

/* The slope of log y over log x. */
static double slope_of(const uint32_t *x, const double *y, int count)
{
    double sx = 0.0, sy = 0.0, sxx = 0.0, sxy = 0.0;

    for (int k = 0; k < count; k++) {
        const double a = log(x[k]), b = log(y[k]);
        sx += a / count, sy += b / count, sxx += a * a / count, sxy += a * b / count;
    }
    return (sxy - sx * sy) / (sxx - sx * sx);
}

enum { WIDTH = 64, HEIGHT = 36, PIXELS = WIDTH * HEIGHT };

struct camera_work {
    struct dragon_view v;
    struct direct *d;
    float *lo;
    uint8_t mask[PIXELS];
    float reference[3 * PIXELS];
};

/* The mean of `count` images by `mis`. */
static void take(struct camera_work *c, uint32_t samples, uint64_t first, uint32_t count, float *rgb)
{
    static float one[3 * PIXELS];
    struct direct_desc desc = { .method = METHOD_MIS, .samples = samples };
    struct direct_stats stats;

    memset(rgb, 0, 3 * PIXELS * sizeof(*rgb));
    for (desc.seed = first; desc.seed < first + count; desc.seed++) {
        assert_int_equal(direct_shade(c->d, c->v.g, c->v.rays, c->v.e, &desc, c->lo, &stats), ERR_OK);
        resolve_pixels(c->v.g, c->lo, c->v.e, one);
        for (uint32_t i = 0; i < 3 * PIXELS; i++)
            rgb[i] += one[i] / (float)count;
    }
}

static double delta_e(struct camera_work *c, const float *rgb)
{
    struct metrics m;

    assert_true(metrics_compare(rgb, c->reference, c->mask, WIDTH, HEIGHT, 0.0, NULL, &m));
    return m.delta_e;
}

/* Fig. 3: mean delta E of `mis` over samples per pixel; reference: 12 seeds of 960 samples, whose own error adds 4 % to
 * the last figure (5 seeds in each commit: 10 %, a slope of 0.02). Independent samples fall with slope -1/2: so do here
 * means of images of 15 samples under seeds of their own. The samples of one image are a net and fall faster. */
static void figure_3_on_the_dragon(void **state)
{
    static const uint32_t counts[] = { 15, 60, 240, 960 }, seeds[] = { 8, 6, 4, 2 }, images[] = { 1, 4, 16 };
    static struct camera_work c;
    static float rgb[3 * PIXELS];
    double by_samples[4], by_images[3];
    (void)state;
    c.v = view_load(WIDTH, HEIGHT, SKY);
    c.d = direct_create(best_kernels());
    c.lo = mem_alloc(c.v.g->packet_count, 3 * PACKET * sizeof(float));
    resolve_mask(c.v.g, c.mask);
    take(&c, 960, 1000, seeds_count(5, 12), c.reference);
    for (int k = 0; k < 4; k++) {
        by_samples[k] = 0.0;
        for (uint32_t s = 0; s < seeds[k]; s++) {
            take(&c, counts[k], s, 1, rgb);
            by_samples[k] += delta_e(&c, rgb) / seeds[k];
        }
        printf("%u samples: delta E %.3f\n", counts[k], by_samples[k]);
    }
    for (int k = 0; k < 3; k++) {
        by_images[k] = 0.0;
        for (uint32_t s = 0; s < 4; s++) {
            take(&c, 15, 100 + 20 * s, images[k], rgb);
            by_images[k] += delta_e(&c, rgb) / 4;
        }
        printf("%u images of 15 samples: delta E %.3f\n", images[k], by_images[k]);
    }
    const double net = slope_of(counts, by_samples, 4), independent = slope_of(images, by_images, 3);
    printf("slope %.3f over the samples of an image, %.3f over independent images\n", net, independent);
    assert_true(by_samples[2] <= 1.0);
    assert_true(net < -0.4);
    assert_true(independent > -0.6 && independent < -0.4);
    direct_destroy(c.d);
    mem_free(c.lo);
    view_free(&c.v);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_single_sample_has_the_closed_form_variance),
    cmocka_unit_test(sixty_independent_samples_have_the_closed_form_variance),
    cmocka_unit_test(walls_that_face_away_need_fewer_rays),
    cmocka_unit_test(figure_2_on_the_dragon),
    cmocka_unit_test(figure_3_on_the_dragon),
};
UNIT_MAIN(tests)
