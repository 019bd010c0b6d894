/* Shared by the suite: the line that each case prints, the methods of direct light with their claims, generated
 * scenes with everything that lights them, and sums over seeds. */
#pragma once

#include "light/estimators/points.h"
#include "light/estimators/tracing.h"

#include "image/film/film.h"
#include "light/frame/frame_plan.h"
#include "light/frame/relight.h"
#include "light/resolve/resolve.h"
#include "measure/compare/metrics.h"

#include <omp.h>

/* The long form: more seeds, larger maps. */
static inline bool full(void)
{
    const char *said = getenv("STABILITY_FULL");
    return said && said[0];
}

static int broken; /* failed cases of the running claim */

/* One line: case | methods | measured | bound | verdict. */
static inline void say(const char *name, const char *methods, const char *measured, const char *bound,
                       const char *verdict, bool good)
{
    printf("%s | %s | %s | %s | %s\n", name, methods, measured, bound, good ? verdict : "BROKEN");
    fflush(stdout);
    broken += !good;
}

/* A case of one number: `sign` is its required relation to the bound, `yes` whether it holds. */
static inline void say_bounded(const char *name, const char *methods, const char *what, double value, const char *sign,
                               double bound, bool yes, const char *where, const char *verdict)
{
    char measured[256], limit[64];

    snprintf(measured, sizeof(measured), "%s %.3g%s%s%s", what, value, where[0] ? " (" : "", where,
             where[0] ? ")" : "");
    snprintf(limit, sizeof(limit), "%s %.3g", sign, bound);
    say(name, methods, measured, limit, verdict, yes);
}

/* The case holds while `value` is at most `bound`; `what` names the value, `where` (may be "") its place. NaN does
 * not hold. */
static inline void holds_below(const char *name, const char *methods, const char *what, double value, double bound,
                               const char *where)
{
    say_bounded(name, methods, what, value, "<=", bound, value <= bound, where, "holds");
}

/* A method that must fail: the case states the minimum failure. */
static inline void fails_above(const char *name, const char *methods, const char *what, double value, double bound,
                               const char *where)
{
    say_bounded(name, methods, what, value, ">=", bound, value >= bound, where, "fails as stated");
}

/* Indicators of a failure without a reference. */
static inline void shows_above(const char *name, const char *methods, const char *what, double value, double bound,
                               const char *where)
{
    say_bounded(name, methods, what, value, ">=", bound, value >= bound, where, "shows");
}

/* A counted case: `count` of `total` were correct. */
static inline void holds_all(const char *name, const char *methods, const char *what, uint64_t count, uint64_t total)
{
    char measured[256], limit[64];

    snprintf(measured, sizeof(measured), "%s: %llu of %llu", what, (unsigned long long)count,
             (unsigned long long)total);
    snprintf(limit, sizeof(limit), "all");
    say(name, methods, measured, limit, "holds", count == total && total > 0);
}

/* Ends a claim: all its lines are printed before a failed one makes it fail. */
static inline void verdict(void)
{
    const int count = broken;

    broken = 0;
    assert_int_equal(count, 0);
}

/* Claims of a method of direct light: an error that stays small, at some tens of samples, ... */
enum claim {
    ANY_SKY = 1,     /* under a uniform sky */
    SMALL_SUN = 2,   /* however small the light is */
    SHARP_LOBE = 4,  /* however sharp the lobe is */
    OWN_SOURCE = 8,  /* evaluates the lat-long source, not the cube map */
    HIDDEN_SUN = 16, /* with the sun down and its face partly up */
};

struct variant {
    const char *name;
    struct direct_desc desc; /* method and options */
    unsigned claims;
};

static const struct variant variants[] = {
    { "uniform", { .method = METHOD_UNIFORM }, ANY_SKY },
    { "brdf", { .method = METHOD_BRDF }, ANY_SKY | SHARP_LOBE },
    { "light", { .method = METHOD_LIGHT }, ANY_SKY | SMALL_SUN },
    { "faces-uniform", { .method = METHOD_FACES_UNIFORM }, ANY_SKY | SMALL_SUN },
    { "faces", { .method = METHOD_FACES }, ANY_SKY | SMALL_SUN },
    { "faces, sun", { .method = METHOD_FACES, .sun = true }, ANY_SKY | SMALL_SUN | HIDDEN_SUN },
    { "faces, 4 x 4 cells", { .method = METHOD_FACES, .cells = 4 }, ANY_SKY | SMALL_SUN },
    { "faces, 8 x 8 cells, sun",
      { .method = METHOD_FACES, .cells = 8, .sun = true },
      ANY_SKY | SMALL_SUN | HIDDEN_SUN },
    { "mis", { .method = METHOD_MIS }, ANY_SKY | SMALL_SUN | SHARP_LOBE | HIDDEN_SUN },
    { "mis, sun", { .method = METHOD_MIS, .sun = true }, ANY_SKY | SMALL_SUN | SHARP_LOBE | HIDDEN_SUN },
    { "mis, compensated", { .method = METHOD_MIS, .compensate = COMPENSATE_ON }, ANY_SKY | SMALL_SUN | SHARP_LOBE },
    { "mis, all options",
      { .method = METHOD_MIS, .compensate = COMPENSATE_ON, .sun = true, .cells = 4, .scatter = true },
      ANY_SKY | SMALL_SUN | SHARP_LOBE | HIDDEN_SUN },
    { "latlong", { .method = METHOD_LATLONG }, ANY_SKY | SMALL_SUN | OWN_SOURCE },
    { "latlong-rows", { .method = METHOD_LATLONG_ROWS }, ANY_SKY | SMALL_SUN | OWN_SOURCE },
    { "auto", { .method = METHOD_AUTO }, ANY_SKY | SMALL_SUN | SHARP_LOBE | HIDDEN_SUN },
};
enum { VARIANTS = sizeof(variants) / sizeof(variants[0]) };

/* Their names in the table. */
static inline const char *claimants(unsigned claim)
{
    static char text[64];
    int count = 0;

    for (int k = 0; k < VARIANTS; k++)
        count += (variants[k].claims & claim) == claim;
    const char *what = claim == ANY_SKY     ? "all direct"
                       : claim & SHARP_LOBE ? "by lobes"
                       : claim & HIDDEN_SUN ? "sun apart or mis"
                       : claim & SMALL_SUN  ? "by light"
                                            : "direct";
    snprintf(text, sizeof(text), "%s (%d)", what, count);
    return text;
}

/* The best of a value, and its place. */
struct worst {
    double value;
    char where[160];
};

static inline void worst_of(struct worst *w, double value, const char *a, const char *b)
{
    if (!(value <= w->value)) { /* NaN is the worst of all, and stays */
        w->value = isnan(w->value) ? w->value : value;
        snprintf(w->where, sizeof(w->where), "%s%s%s", a, a[0] && b[0] ? ", " : "", b);
    }
}

/* Shades by a variant: without visibility if rays is NULL. */
static inline struct direct_stats shade_by(struct direct *d, const struct gbuffer *g, const struct rays *rays,
                                           const struct environment *e, const struct variant *v, uint32_t samples,
                                           uint64_t seed, float *lo)
{
    struct direct_desc desc = v->desc;
    struct direct_stats stats;

    desc.samples = samples;
    desc.seed = seed;
    desc.no_visibility = !rays;
    assert_int_equal(direct_shade(d, g, rays, e, &desc, lo, &stats), ERR_OK);
    return stats;
}

/* Mean luminance over the lit points. */
static inline double mean_of(const struct gbuffer *g, const float *lo)
{
    double sum = 0.0;

    for (uint32_t i = 0; i < g->packet_count; i++)
        for (uint32_t l = 0; l < g->packets[i].count; l++) {
            const float *p = lo + (size_t)i * 3 * PACKET + l;
            sum += rgb_luminance(p[0], p[PACKET], p[2 * PACKET]);
        }
    return sum / (double)g->point_count;
}

/* Means over all points, seed by seed: points share their samples, seeds are the replicates. */
static inline struct tally tally_by(const struct gbuffer *g, const struct environment *e, const struct variant *v,
                                    uint32_t samples, uint32_t seeds)
{
    float *lo = mem_alloc(g->packet_count, 3 * PACKET * sizeof(float));
    struct direct *d = direct_create(best_kernels());
    struct tally t = { 0 };

    omp_set_num_threads(1); /* small work items; the cores may be busy */
    for (uint32_t k = 0; k < seeds; k++) {
        shade_by(d, g, NULL, e, v, samples, rng_mix(k, 7 * samples + (uint64_t)(v - variants)), lo);
        tally_add(&t, mean_of(g, lo));
    }
    direct_destroy(d);
    mem_free(lo);
    return t;
}

/* Standard errors between a mean and its expectation; sums of floats are good to 2e-6. */
static inline double z_of(const struct tally *t, double want)
{
    return fabs(tally_mean(t) - want) / (tally_error(t) + 2e-6 * fabs(want));
}

/* Directions of a cube map's texel or of a lat-long texel, `sub` x `sub` of them, weighted by solid angle. */
typedef void (*for_direction)(void *user, const double w[3], double solid_angle, const float rgb[3]);

static inline void each_cube_direction(const struct environment *e, for_direction call, void *user)
{
    const uint32_t n = e->n;

    for (uint32_t t = 0; t < CUBE_FACES * n * n; t++) {
        const struct texel *x = &e->texels[t];
        const uint32_t sub = x->r > 100.0f ? 48 : 6, i = t / n % n, j = t % n;
        const double step = 2.0 / (n * sub);
        for (uint32_t k = 0; x->r + x->g + x->b > 0.0f && k < sub * sub; k++) {
            const double u = -1.0 + step * (j * sub + k % sub + 0.5), v = -1.0 + step * (i * sub + k / sub + 0.5);
            const double r2 = 1.0 + u * u + v * v;
            double w[3];
            cube_direction(t / (n * n), u, v, w);
            for (int c = 0; c < 3; c++)
                w[c] /= sqrt(r2);
            call(user, w, step * step / (r2 * sqrt(r2)), (const float[3]){ x->r, x->g, x->b });
        }
    }
}

/* The same for a lat-long source with the top row first, not rotated. */
static inline void each_source_direction(const struct environment *e, for_direction call, void *user)
{
    const uint32_t width = e->image.width, height = e->image.height;

    for (uint32_t t = 0; t < width * height; t++) {
        const float *x = e->image.rgb + 3 * (size_t)t;
        const uint32_t sub = x[0] > 100.0f ? 48 : 6;
        for (uint32_t k = 0; x[0] + x[1] + x[2] > 0.0f && k < sub * sub; k++) {
            const double phi = PI - 2.0 * PI * (t % width + (k % sub + 0.5) / sub) / width;
            const double y0 = t / width + (double)(k / sub) / sub, y1 = y0 + 1.0 / sub;
            const double theta = PI * 0.5 * (y0 + y1) / height;
            const double angle = (cos(PI * y0 / height) - cos(PI * y1 / height)) * 2.0 * PI / (width * sub);
            const double w[3] = { sin(theta) * sin(phi), cos(theta), sin(theta) * cos(phi) };
            call(user, w, angle, x);
        }
    }
}

/* Light on a plane: its normal and the incident luminance. */
struct plane_light {
    double n[3], sum;
};

static inline void add_plane_light(void *user, const double w[3], double solid_angle, const float rgb[3])
{
    struct plane_light *p = user;
    const double cosine = w[0] * p->n[0] + w[1] * p->n[1] + w[2] * p->n[2];

    if (cosine > 0.0)
        p->sum += cosine * solid_angle * rgb_luminance(rgb[0], rgb[1], rgb[2]);
}

/* Irradiance of luminance on a plane, by quadrature of the same function that the variant evaluates. */
static inline double irradiance(const struct environment *e, const double n[3], bool source)
{
    struct plane_light p = { { n[0], n[1], n[2] }, 0.0 };

    if (source)
        each_source_direction(e, add_plane_light, &p);
    else
        each_cube_direction(e, add_plane_light, &p);
    return p.sum;
}

/* Lights the texels whose centre is within `radius` degrees of w, at least the nearest. */
static inline void sky_disc(struct frame *f, const double w[3], double radius_degrees, float r, float g, float b)
{
    double nearest = -2.0;
    uint32_t best = 0;

    for (int pass = 0; pass < 2; pass++)
        for (uint32_t t = 0; t < f->width * f->height; t++) {
            const double phi = PI - 2.0 * PI * (t % f->width + 0.5) / f->width;
            const double theta = PI * (t / f->width + 0.5) / f->height;
            const double c = w[0] * sin(theta) * sin(phi) + w[1] * cos(theta) + w[2] * sin(theta) * cos(phi);
            if (pass == 0 && c > nearest) {
                nearest = c;
                best = t;
            }
            if (pass == 1 && (t == best || c > cos(radius_degrees * PI / 180.0)))
                sky_paint(f, t % f->width, t / f->width, r, g, b);
        }
}

static inline void unit3(double w[3])
{
    const double l = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);

    for (int c = 0; c < 3; c++)
        w[c] /= l;
}

/* A generated scene with everything that relighting needs; takes ownership of the scene. Free with set_destroy. */
static inline struct prepared_scene *set_of(struct scene *s, const struct camera *camera, uint32_t width,
                                            uint32_t height, uint32_t edge_rays)
{
    struct prepared_scene *set = mem_alloc(1, sizeof(*set));
    struct gbuffer_desc g = { .camera = camera, .width = width, .height = height, .edge_rays = edge_rays };
    struct reason why = { "" };

    if (s->triangle_count == 0)
        assert_int_equal(scene_finish(s, "a scene made by hand", &why), ERR_OK);
    set->scene = s;
    set->rays = rays_create_for(s, cpu_best());
    assert_non_null(set->rays);
    if (gbuffer_create(s, set->rays, &g, &set->gbuffer, &why))
        fail_msg("%s", why.text);
    view_init(&set->view, camera, width, height);
    facts_of_set(s, set->gbuffer, &set->facts);
    return set;
}

static inline struct relight_stats image_of(struct relighter *r, const struct environment *e,
                                            const struct relight_desc *desc, float *rgb)
{
    struct relight_stats stats;

    assert_int_equal(relighter_run(r, e, desc, rgb, &stats), ERR_OK);
    return stats;
}
