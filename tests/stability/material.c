/* Rough lobes from matte to almost a mirror: their response to a white sky, and to one with contrasts, against
 * quadrature in double precision, for every method that supports them. Each comparison is of one lobe seen from one
 * direction, by its mean over seeds in standard errors. */
#include "stability.h"

#include "scene/surface/lobe.h"
#include "sky/tables/samples.h"

#include "sky/tables/sampling.h"

#define Z_LIMIT 5.2 /* two-sided 2e-7: passed by chance once in 10^4 runs of 500 comparisons */

static const double views[] = { 0.0, 45.0, 80.0 }; /* degrees from the normal */
enum { VIEWS = 3, GLOSSES = 11, LOBES = VIEWS * GLOSSES, PACKETS = (LOBES + PACKET - 1) / PACKET };

static const float alphas[GLOSSES] = { 0.0011f, 0.01f, 0.0225f, 0.04f, 0.09f, 0.16f, 0.25f, 0.36f, 0.49f, 0.81f, 1.0f };
static const float exponents[GLOSSES] = { 1, 2, 5, 10, 30, 100, 300, 1000, 3000, 5000, 10000 };

/* Lobe i of the list: its gloss, and the direction to the viewer; the normal is not along an axis. */
static struct lobe lobe_at(enum lobe_kind kind, float diffuse, float specular, uint32_t i, struct vec3 *wo)
{
    const struct vec3 n = vec3_normalize(vec3_make(0.3f, 0.9f, -0.2f));
    const double a = views[i % VIEWS] * PI / 180.0;
    struct vec3 t, u;

    frame_about(n, &t, &u);
    *wo = vec3_normalize(vec3_add(vec3_scale(n, (float)cos(a)), vec3_scale(t, (float)sin(a))));
    return (struct lobe){ .kind = kind,
                          .geometric = n,
                          .shading = n,
                          .diffuse = { diffuse, diffuse, diffuse },
                          .specular = { specular, specular, specular },
                          .gloss = (double)(kind == LOBE_PHONG ? exponents : alphas)[i / VIEWS] };
}

static struct gbuffer lobes_make(enum lobe_kind kind, float diffuse, float specular)
{
    struct gbuffer g = points_make(PACKETS, kind, diffuse, specular, 1.0f);

    for (uint32_t k = 0; k < PACKETS * PACKET; k++) {
        struct shade_packet *p = &g.packets[k / PACKET];
        const uint32_t l = k % PACKET;
        struct vec3 wo;
        const struct lobe x = lobe_at(kind, diffuse, specular, k < LOBES ? k : LOBES - 1, &wo);
        p->ns_x[l] = p->ng_x[l] = x.shading.x;
        p->ns_y[l] = p->ng_y[l] = x.shading.y;
        p->ns_z[l] = p->ng_z[l] = x.shading.z;
        p->wo_x[l] = wo.x;
        p->wo_y[l] = wo.y;
        p->wo_z[l] = wo.z;
        p->gloss[l] = (float)x.gloss;
    }
    return g;
}

/* Light towards wo, of the cube map or of the source, by midpoints about the mirror direction, denser near it: 6e-4
 * of the sphere's polar range at the centre of the sharpest lobe here. */
static double lobe_light(const struct environment *e, const struct latlong *source, const struct lobe *x,
                         struct vec3 wo)
{
    enum { RINGS = 450, SPOKES = 180 };
    const struct vec3 r = vec3_add(vec3_scale(x->shading, 2.0f * vec3_dot(x->shading, wo)), vec3_scale(wo, -1.0f));
    struct vec3 t, u;
    double sum = 0.0, before = 0.0;

    frame_about(r, &t, &u);
    for (int i = 0; i < RINGS; i++) {
        const double after = PI * pow((i + 1.0) / RINGS, 4.0), a = 0.5 * (before + after);
        const double angle = (cos(before) - cos(after)) * 2.0 * PI / SPOKES;
        before = after;
        for (int k = 0; k < SPOKES; k++) {
            const double phi = 2.0 * PI * (k + 0.5 * (i % 2)) / SPOKES, s = sin(a);
            const double c[3] = { s * cos(phi), s * sin(phi), cos(a) };
            const struct vec3 w =
                vec3_make((float)(c[0] * t.x + c[1] * u.x + c[2] * r.x), (float)(c[0] * t.y + c[1] * u.y + c[2] * r.y),
                          (float)(c[0] * t.z + c[1] * u.z + c[2] * r.z));
            const double cosine = vec3_dot(w, x->shading);
            double brdf[3];
            float rgb[3], pdf;
            if (cosine <= 0.0)
                continue;
            lobe_evaluate(x, wo, w, brdf);
            const float d[3] = { w.x, w.y, w.z };
            if (source)
                latlong_evaluate(source, d, rgb, &pdf);
            else
                (void)environment_evaluate(e, d, rgb, &pdf);
            sum += brdf[0] * cosine * angle * rgb_luminance(rgb[0], rgb[1], rgb[2]);
        }
    }
    return sum;
}

/* The worst deviation of the lobes first .. last by a variant, in standard errors (plus the quadrature's rounding,
 * `slack` of the value), and the largest standard error, relative. */
static void compare(const struct environment *e, const struct gbuffer *g, const double *want, uint32_t first,
                    uint32_t last, const struct variant *v, uint32_t samples, double slack, struct worst *z,
                    struct worst *error)
{
    const uint32_t seeds = full() ? 256 : 32;
    static float lo[PACKETS * 3 * PACKET];
    struct tally t[LOBES] = { { 0.0, 0.0, 0.0 } };
    struct direct *d = direct_create(best_kernels());

    omp_set_num_threads(1);
    for (uint32_t k = 0; k < seeds; k++) {
        shade_by(d, g, NULL, e, v, samples, rng_mix(k, (uint64_t)(v - variants)), lo);
        for (uint32_t i = 0; i < LOBES; i++) {
            const float *p = lo + (size_t)(i / PACKET) * 3 * PACKET + i % PACKET;
            tally_add(&t[i], rgb_luminance(p[0], p[PACKET], p[2 * PACKET]));
        }
    }
    direct_destroy(d);
    for (uint32_t i = first; i < last; i++) {
        char where[64];
        const bool phong = g->packets[0].kind == LOBE_PHONG;
        snprintf(where, sizeof(where), "%s %g at %g degrees", phong ? "exponent" : "alpha",
                 (double)(phong ? exponents : alphas)[i / VIEWS], views[i % VIEWS]);
        worst_of(z, fabs(tally_mean(&t[i]) - want[i]) / (tally_error(&t[i]) + slack * want[i]), v->name, where);
        worst_of(error, tally_error(&t[i]) / want[i], v->name, where);
    }
}

struct lobe_set {
    const char *name;
    enum lobe_kind kind;
    float diffuse, specular;
    uint32_t rough_first, rough_last; /* lobes for which light samples alone suffice */
};

static const struct lobe_set lobe_sets[] = {
    { "metal", LOBE_GGX, 0.0f, 0.9f, 6 * VIEWS, LOBES },
    { "varnish", LOBE_GGX, 0.7f, 0.04f, 6 * VIEWS, LOBES },
    { "phong", LOBE_PHONG, 0.3f, 0.6f, 0, 5 * VIEWS },
};

static void under(const char *name, const struct environment *e, uint32_t samples, double slack, double error_limit,
                  bool sun)
{
    struct worst z[2] = { { 0.0, "" } }, error[2] = { { 0.0, "" } };
    struct latlong source = { 0 };
    struct reason why;
    char text[128];

    assert_int_equal(latlong_build(&source, e, &why), ERR_OK);
    for (size_t s = 0; s < sizeof(lobe_sets) / sizeof(lobe_sets[0]); s++) {
        const struct lobe_set *set = &lobe_sets[s];
        struct gbuffer g = lobes_make(set->kind, set->diffuse, set->specular);
        double want[LOBES], want_source[LOBES] = { 0.0 };
        for (uint32_t i = 0; i < LOBES; i++) {
            struct vec3 wo;
            const struct lobe x = lobe_at(set->kind, set->diffuse, set->specular, i, &wo);
            want[i] = lobe_light(e, NULL, &x, wo);
            if (i >= set->rough_first && i < set->rough_last)
                want_source[i] = lobe_light(e, &source, &x, wo);
        }
        for (int k = 0; k < VARIANTS; k++) {
            const bool sharp = variants[k].claims & SHARP_LOBE;
            if ((sun && !(variants[k].claims & SMALL_SUN)) || (!sharp && sun))
                continue;
            const bool own = variants[k].claims & OWN_SOURCE;
            compare(e, &g, own ? want_source : want, sharp ? 0 : set->rough_first, sharp ? LOBES : set->rough_last,
                    &variants[k], sharp ? samples : 8 * samples, slack, &z[sharp], &error[sharp]);
        }
        points_free(&g);
    }
    latlong_finish(&source);
    snprintf(text, sizeof(text), "%s: alpha 0.001 to 1, exponents 1 to 10^4", name);
    holds_below(text, sun ? "mis, auto (5)" : "brdf, mis, auto (6)", "standard errors from quadrature", z[1].value,
                Z_LIMIT, z[1].where);
    holds_below(text, sun ? "mis, auto (5)" : "brdf, mis, auto (6)", "relative standard error", error[1].value,
                error_limit, error[1].where);
    if (sun)
        return;
    snprintf(text, sizeof(text), "%s: alpha from 0.25, exponents up to 30", name);
    holds_below(text, "by light alone (9)", "standard errors from quadrature", z[0].value, Z_LIMIT, z[0].where);
    holds_below(text, "by light alone (9)", "relative standard error", error[0].value, error_limit, error[0].where);
}

/* 99 lobes by 6 methods, the rougher half of them by 9 more: about 1000 comparisons. Standard errors: the second line
 * of each; a bias of ten times that is always detected. */
static void albedo_is_that_of_quadrature_at_every_roughness(void **state)
{
    (void)state;
    struct environment *e = sky_environment(sky_constant(32, 16, 1.0f), 16, 0.0);
    under("albedo", e, 64, 2e-3, 0.03, false);
    environment_destroy(e);
    verdict();
}

/* A coarse sky, of texels between 1/8 and 8, so that a sharp lobe sees one border or none. */
static void lobes_of_every_sharpness_see_the_sky_that_is_there(void **state)
{
    (void)state;
    struct environment *e = sky_environment(sky_noise(32, 16, 3, 6.0, 0.0), 8, 20.0);
    under("sky of contrasts", e, 64, 4e-3, 0.05, false);
    environment_destroy(e);
    verdict();
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(albedo_is_that_of_quadrature_at_every_roughness),
    cmocka_unit_test(lobes_of_every_sharpness_see_the_sky_that_is_there),
};
UNIT_MAIN(tests)
