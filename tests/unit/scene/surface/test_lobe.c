/* The rough lobe one direction at a time: against the packets' lobes, its own samples, and quadrature. */
#include "light/estimators/points.h"

#include "scene/surface/lobe.h"
#include "scene/surface/lobes.h"

static struct vec3 turned(struct vec3 n, double z, double phi)
{
    struct vec3 t, u;
    const double r = sqrt(fmax(0.0, 1.0 - z * z));

    frame_about(n, &t, &u);
    return vec3_normalize(vec3_add(
        vec3_scale(n, (float)z), vec3_add(vec3_scale(t, (float)(r * cos(phi))), vec3_scale(u, (float)(r * sin(phi))))));
}

static double cosine(struct vec3 a, struct vec3 b)
{
    return (double)a.x * b.x + (double)a.y * b.y + (double)a.z * b.z;
}

static struct lobe lobe_make(enum lobe_kind kind, float diffuse, float specular, double gloss, struct vec3 n)
{
    return (struct lobe){
        .kind = kind,
        .geometric = n,
        .shading = n,
        .diffuse = { diffuse, 0.8f * diffuse, 0.5f * diffuse },
        .specular = { specular, 0.9f * specular, 0.7f * specular },
        .gloss = gloss,
    };
}

/* Lane l of a packet with random normals (the geometric one up to 35 degrees off the shading one) and a viewer above
 * the geometric surface, who may be below the shading one. */
static struct lobe random_point(struct rng *r, struct shade_packet *p, int l, struct vec3 *wo)
{
    const struct vec3 ng = random_direction(r), ns = turned(ng, 1.0 - 0.18 * rng_next(r), 2.0 * PI * rng_next(r));
    const double z = rng_next(r), gloss = p->kind == LOBE_GGX ? 1e-3 + rng_next(r) : exp(7.0 * rng_next(r)) - 1.0;
    struct lobe m = lobe_make((enum lobe_kind)p->kind, 0.5f, 0.4f, (float)gloss, ns);

    *wo = turned(ng, z, 2.0 * PI * rng_next(r));
    m.geometric = ng;
    p->ng_x[l] = ng.x, p->ng_y[l] = ng.y, p->ng_z[l] = ng.z;
    p->ns_x[l] = ns.x, p->ns_y[l] = ns.y, p->ns_z[l] = ns.z;
    p->wo_x[l] = wo->x, p->wo_y[l] = wo->y, p->wo_z[l] = wo->z;
    p->gloss[l] = (float)gloss;
    p->diffuse[0][l] = m.diffuse.x, p->diffuse[1][l] = m.diffuse.y, p->diffuse[2][l] = m.diffuse.z;
    p->specular[0][l] = m.specular.x, p->specular[1][l] = m.specular.y, p->specular[2][l] = m.specular.z;
    return m;
}

static bool near(double a, double b)
{
    return fabs(a - b) <= 5e-3 * fmax(fabs(a), fabs(b)) + 1e-6;
}

/* BRDF times cosine and density at 400 packets a kind, directions by either's lobes and from all over the sphere
 * in turn. The packets' lobes are floats, with powers up to 1100: 0.5 %. */
static void one_direction_at_a_time_is_as_sixteen(void **state)
{
    static const enum lobe_kind kinds[] = { LOBE_LAMBERT, LOBE_PHONG, LOBE_GGX };
    struct rng r = { 5 };
    (void)state;
    for (int k = 0; k < 3; k++) {
        uint32_t lit = 0;
        for (int trial = 0; trial < 400; trial++) {
            struct shade_packet p = { .kind = kinds[k], .count = PACKET };
            struct lobe lobe[PACKET];
            struct vec3 wo[PACKET], wi[PACKET];
            struct lanes d[3], seen, many[3], many_pdf, square[2];
            struct lobes s;
            for (int l = 0; l < PACKET; l++) {
                lobe[l] = random_point(&r, &p, l, &wo[l]);
                square[0].v[l] = (float)rng_next(&r) * 0.999999f;
                square[1].v[l] = (float)rng_next(&r) * 0.999999f;
            }
            lobes_set_up(&p, &s);
            lobes_sample(&s, &p, square, d);
            for (int l = 0; l < PACKET; l++) {
                const float length = d[0].v[l] * d[0].v[l] + d[1].v[l] * d[1].v[l] + d[2].v[l] * d[2].v[l];
                assert_true(fabsf(length - 1.0f) < 2e-3f); /* or the frame of its normal is none */
                const double x[3] = { rng_next(&r), rng_next(&r), rng_next(&r) };
                wi[l] = trial % 3 == 0   ? random_direction(&r)
                        : trial % 3 == 1 ? lobe_sample(&lobe[l], wo[l], x)
                                         : vec3_make(d[0].v[l], d[1].v[l], d[2].v[l]);
                d[0].v[l] = wi[l].x, d[1].v[l] = wi[l].y, d[2].v[l] = wi[l].z;
            }
            lobes_see(&p, d, &seen);
            lobes_evaluate(&s, &p, d, &seen, many, &many_pdf);
            for (int l = 0; l < PACKET; l++) {
                double brdf[3];
                lobe_evaluate(&lobe[l], wo[l], wi[l], brdf);
                const double in = cosine(lobe[l].shading, wi[l]), pdf = lobe_density(&lobe[l], wo[l], wi[l]);
                if (!near(brdf[0] * fmax(0.0, in), many[0].v[l]) || (brdf[0] > 0.0 && !near(pdf, many_pdf.v[l])))
                    printf("kind %d, gloss %g: %g, packet %g; density %g, packet %g\n", (int)p.kind, lobe[l].gloss,
                           brdf[0] * in, many[0].v[l], pdf, many_pdf.v[l]);
                for (int c = 0; c < 3; c++)
                    assert_true(near(brdf[c] * fmax(0.0, in), many[c].v[l]));
                if (brdf[0] > 0.0) { /* below the surface a packet's density is 0: nothing is counted there */
                    assert_true(near(pdf, many_pdf.v[l]));
                    lit++;
                }
            }
        }
        assert_true(lit > 2000);
    }
}

/* The lobes of the tests below, from smooth to sharp. */
static const struct {
    enum lobe_kind kind;
    float diffuse, specular;
    double gloss;
} stuffs[] = {
    { LOBE_LAMBERT, 0.7f, 0.0f, 0.0 }, { LOBE_PHONG, 0.3f, 0.7f, 0.0 },   { LOBE_PHONG, 0.3f, 0.7f, 1.0 },
    { LOBE_PHONG, 0.2f, 0.8f, 10.0 },  { LOBE_PHONG, 0.0f, 1.0f, 100.0 }, { LOBE_PHONG, 0.4f, 0.6f, 1e3 },
    { LOBE_PHONG, 0.0f, 1.0f, 1e4 },   { LOBE_GGX, 1.0f, 0.04f, 1.0 },    { LOBE_GGX, 1.0f, 0.04f, 0.5 },
    { LOBE_GGX, 1.0f, 0.04f, 0.2 },    { LOBE_GGX, 1.0f, 0.04f, 0.05 },   { LOBE_GGX, 1.0f, 0.04f, 0.01 },
    { LOBE_GGX, 0.0f, 1.0f, 1.0 },     { LOBE_GGX, 0.0f, 1.0f, 0.5 },     { LOBE_GGX, 0.0f, 1.0f, 0.2 },
    { LOBE_GGX, 0.0f, 1.0f, 0.05 },    { LOBE_GGX, 0.0f, 1.0f, 0.01 },    { LOBE_GGX, 0.0f, 1.0f, 0.00101 },
    { LOBE_GGX, 1.0f, 0.04f, 0.0 },
};
#define STUFFS (sizeof(stuffs) / sizeof(stuffs[0]))

static const double cosines_out[] = { 1.0, 0.8, 0.45, 0.12 };

enum { RINGS = 1200, SPOKES = 144 };

/* Quadrature over the sphere in polar coordinates about the mirror direction, their angle pi t^3: dense where a sharp
 * lobe stands. out: density of the lobe; albedo of the first channel. */
static void integrate(const struct lobe *m, struct vec3 wo, double *density, double *albedo)
{
    const struct vec3 mirror = vec3_normalize(vec3_sub(vec3_scale(m->shading, 2.0f * vec3_dot(wo, m->shading)), wo));

    *density = *albedo = 0.0;
    for (int i = 0; i < RINGS; i++) {
        const double x = (i + 0.5) / RINGS, gamma = PI * x * x * x, ring = sin(gamma) * 3.0 * PI * x * x / RINGS;
        for (int k = 0; k < SPOKES; k++) {
            const struct vec3 wi = turned(mirror, cos(gamma), 2.0 * PI * (k + 0.5) / SPOKES);
            const double measure = ring * 2.0 * PI / SPOKES;
            double brdf[3];
            lobe_evaluate(m, wo, wi, brdf);
            *density += lobe_density(m, wo, wi) * measure;
            *albedo += brdf[0] * fmax(0.0, cosine(m->shading, wi)) * measure;
        }
    }
}

/* 2^16 samples, evenly spread (the first number by the golden ratio): their mean weight is the albedo. Quadrature gives
 * that within 0.2 %, and finds that the density adds up to 1; nothing gives back more than it gets. */
static void albedo_by_samples_is_that_of_quadrature(void **state)
{
    enum { SAMPLES = 1 << 16 };
    static double at[SAMPLES][2];
    const struct vec3 n = vec3_normalize(vec3_make(0.3f, -0.5f, 0.8f));
    (void)state;
    for (uint32_t s = 0; s < SAMPLES; s++)
        rng_sobol2(11, s, at[s]);
    for (size_t i = 0; i < STUFFS; i++)
        for (int k = 0; k < 4; k++) {
            const struct lobe m = lobe_make(stuffs[i].kind, stuffs[i].diffuse, stuffs[i].specular, stuffs[i].gloss, n);
            const struct vec3 wo = turned(n, cosines_out[k], 1.0);
            double whole, want, got = 0.0;
            integrate(&m, wo, &whole, &want);
            for (uint32_t s = 0; s < SAMPLES; s++) {
                double brdf[3];
                const double x[3] = { fmod(s * 0.6180339887498949, 1.0), at[s][0], at[s][1] };
                const struct vec3 wi = lobe_sample(&m, wo, x);
                const double p = lobe_density(&m, wo, wi);
                lobe_evaluate(&m, wo, wi, brdf);
                got += p > 0.0 ? brdf[0] * cosine(n, wi) / p / SAMPLES : 0.0;
            }
            if (fabs(got / want - 1.0) >= 2e-3 || fabs(whole - 1.0) >= 2e-3 || got > 1.0 + 1e-4)
                printf("kind %d, gloss %g, cosine %g: albedo %.5f, quadrature %.5f, density %.5f\n", (int)m.kind,
                       m.gloss, cosines_out[k], got, want, whole);
            assert_true(fabs(got / want - 1.0) < 2e-3);
            assert_true(fabs(whole - 1.0) < 2e-3);
            assert_true(got <= 1.0 + 1e-4);
        }
}

/* Chi-square of 40000 samples in 12 x 24 cells about the mirror direction, whose angles grow as in the quadrature,
 * against the density there. Cells that expect fewer than 10 go together. The statistic's z stays below 5 in each of
 * 76 tests; a density that is 10 % off everywhere, up or down, adds 400 to it, which is a z of 16 in all 288 cells and
 * more in fewer. */
static void samples_follow_the_density(void **state)
{
    enum { SAMPLES = 40000, CELL_RINGS = 12, CELL_SPOKES = 24, CELLS = CELL_RINGS * CELL_SPOKES };
    const struct vec3 n = vec3_normalize(vec3_make(-0.6f, 0.2f, -0.5f));
    struct rng r = { 21 };
    (void)state;
    for (size_t i = 0; i < STUFFS; i++)
        for (int k = 0; k < 4; k++) {
            const struct lobe m = lobe_make(stuffs[i].kind, stuffs[i].diffuse, stuffs[i].specular, stuffs[i].gloss, n);
            const struct vec3 wo = turned(n, cosines_out[k], -2.0);
            const struct vec3 mirror = vec3_normalize(vec3_sub(vec3_scale(n, 2.0f * vec3_dot(wo, n)), wo));
            double want[CELLS] = { 0 }, got[CELLS] = { 0 }, chi = 0.0, rest[2] = { 0 };
            struct vec3 t, u;
            int cells = 0;
            frame_about(mirror, &t, &u);
            for (int a = 0; a < RINGS; a++)
                for (int b = 0; b < SPOKES; b++) {
                    const double x = (a + 0.5) / RINGS, gamma = PI * x * x * x;
                    const struct vec3 wi = turned(mirror, cos(gamma), 2.0 * PI * (b + 0.5) / SPOKES);
                    want[a * CELL_RINGS / RINGS * CELL_SPOKES + b * CELL_SPOKES / SPOKES] +=
                        SAMPLES * lobe_density(&m, wo, wi) * sin(gamma) * 6.0 * PI * PI * x * x / RINGS / SPOKES;
                }
            for (int s = 0; s < SAMPLES; s++) {
                const double x[3] = { rng_next(&r), rng_next(&r), rng_next(&r) };
                const struct vec3 wi = lobe_sample(&m, wo, x), off = vec3_sub(wi, mirror);
                const double gamma = 2.0 * asin(fmin(1.0, 0.5 * sqrt(cosine(off, off))));
                const double phi = atan2(cosine(wi, u), cosine(wi, t)) / (2.0 * PI);
                const int ring = (int)fmin(CELL_RINGS - 1, cbrt(gamma / PI) * CELL_RINGS);
                const int spoke = (int)fmin(CELL_SPOKES - 1, (phi - floor(phi)) * CELL_SPOKES);
                got[ring * CELL_SPOKES + spoke] += 1.0;
            }
            for (int c = 0; c < CELLS; c++) {
                if (want[c] < 10.0) {
                    rest[0] += want[c];
                    rest[1] += got[c];
                    continue;
                }
                chi += (got[c] - want[c]) * (got[c] - want[c]) / want[c];
                cells++;
            }
            const double z = (chi - cells) / sqrt(2.0 * cells);
            const double z_rest = (rest[1] - rest[0]) / sqrt(rest[0] + 1.0);
            if (z >= 5.0 || fabs(z_rest) >= 5.0)
                printf("kind %d, gloss %g, cosine %g: chi2 %.1f in %d cells, rest %.1f for %.1f\n", (int)m.kind,
                       m.gloss, cosines_out[k], chi, cells, rest[1], rest[0]);
            assert_true(cells > 20 && z < 5.0 && fabs(z_rest) < 5.0);
        }
}

/* What is reflected at most, in the brightest colour: F rises to 1 towards grazing; a matte part is there from
 * anywhere. */
static void the_albedo_for_plans_follows_fresnel(void **state)
{
    struct lobe l = { .kind = LOBE_GGX, .shading = { 0, 0, 1 }, .geometric = { 0, 0, 1 }, .gloss = 0.1f };
    const struct vec3 up = { 0, 0, 1 }, half = { sqrtf(0.75f), 0, 0.5f }, along = { 1, 0, 0 }, below = { 0, 0, -1 };
    (void)state;

    l.specular = vec3_make(0.04f, 0.02f, 0.03f);
    assert_float_equal(lobe_albedo(&l, up), 0.04, 1e-6);
    assert_float_equal(lobe_albedo(&l, half), 0.04 + 0.96 / 32.0, 1e-6);
    assert_float_equal(lobe_albedo(&l, along), 1.0, 1e-6);
    assert_float_equal(lobe_albedo(&l, below), 1.0, 1e-6);
    l.diffuse = vec3_make(0.1f, 0.5f, 0.2f);
    assert_float_equal(lobe_albedo(&l, up), 0.52, 1e-6);
    assert_float_equal(lobe_albedo(&l, half), 0.52, 1e-6);
    l.diffuse = vec3_make(0.6f, 0.1f, 0.2f);
    assert_float_equal(lobe_albedo(&l, up), 0.64, 1e-6);
    l.diffuse = vec3_make(0.1f, 0.1f, 0.7f);
    assert_float_equal(lobe_albedo(&l, up), 0.73, 1e-6);
    l.kind = LOBE_PHONG;
    assert_float_equal(lobe_albedo(&l, along), 0.73, 1e-6);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(the_albedo_for_plans_follows_fresnel),
    cmocka_unit_test(one_direction_at_a_time_is_as_sixteen),
    cmocka_unit_test(albedo_by_samples_is_that_of_quadrature),
    cmocka_unit_test(samples_follow_the_density),
};
UNIT_MAIN(tests)
