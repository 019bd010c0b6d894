/* Daylight coefficients for Radiance: patches in its order and axes, images that add up, files as it reads them. */
#include "image/codec/decode.h"
#include "image/codec/encode.h"
#include "light/estimators/points.h"
#include "light/radiance/components.h"
#include "light/resolve/resolve.h"
#include "measure/compare/metrics.h"
#include "sky/daylight/reinhart.h"
#include "sky/daylight/sky.h"
#include "sky/daylight/sky_sun.h"
#include "support/sets.h"

enum { WIDTH = 48, HEIGHT = 27, PIXELS = WIDTH * HEIGHT, PATCHES = 146, MOST = 2306 };

/* ---- Patches ---- */

static void patches_are_tregenzas(void **state)
{
    static const uint32_t in_row[] = { 30, 30, 24, 24, 18, 12, 6, 1 };
    uint32_t k = 1;
    (void)state;

    assert_int_equal(reinhart_count(1), 146);
    assert_int_equal(reinhart_count(2), 578);
    assert_int_equal(reinhart_count(4), 2306);
    assert_true(reinhart_patch(1, 0).altitude < -1.57);
    for (uint32_t row = 0; row < 8; row++)
        for (uint32_t j = 0; j < in_row[row]; j++, k++) {
            const struct reinhart_patch p = reinhart_patch(1, k);
            assert_int_equal(p.row, row);
            assert_true(fabs(p.altitude * 180.0 / PI - (row < 7 ? 6.0 + 12.0 * row : 90.0)) < 1e-9);
            assert_true(fabs(p.azimuth * 180.0 / PI - 360.0 * j / in_row[row]) < 1e-9);
        }
    assert_int_equal(k, PATCHES);
}

/* The texels of each patch have its solid angle in sum, and all together the sphere's. */
static void solid_angles_are_those_of_their_texels(void **state)
{
    (void)state;

    for (uint32_t mf = 1; mf <= 4; mf *= 2) {
        static double sum[MOST];
        uint32_t width, height;
        double whole = 0.0;
        memset(sum, 0, sizeof(sum));
        reinhart_size(mf, &width, &height);
        for (uint32_t y = 0; y < height; y++)
            for (uint32_t x = 0; x < width; x++)
                sum[reinhart_at(mf, x, y)] += 2.0 * PI / width * (cos(PI * y / height) - cos(PI * (y + 1) / height));
        for (uint32_t k = 0; k < reinhart_count(mf); k++) {
            const double said = reinhart_patch(mf, k).solid_angle;
            assert_true(fabs(sum[k] - said) < 1e-9 * said);
            whole += said;
        }
        assert_true(fabs(whole - 4.0 * PI) < 1e-9);
    }
}

/* A direction of Radiance, X to the east, Y to the north, Z up, in our axes as sky.h has them. */
static void from_radiance(double altitude, double azimuth, float w[3])
{
    const double x = sin(azimuth) * cos(altitude), y = cos(azimuth) * cos(altitude), z = sin(altitude);

    w[0] = (float)-x;
    w[1] = (float)z;
    w[2] = (float)y;
}

static struct environment *environment_of(uint32_t mf, const float (*radiance)[3])
{
    struct frame f = { 0 };
    uint32_t width, height;

    reinhart_size(mf, &width, &height);
    assert_int_equal(frame_reserve_texels(&f, width, height), ERR_OK);
    reinhart_sky(mf, radiance, f.rgb);
    return sky_environment(f, 256, 0.0);
}

/* Each patch shines in its middle and near its four corners with its own number, where Radiance looks for it. */
static void patches_are_where_radiance_looks(void **state)
{
    (void)state;

    for (uint32_t mf = 1; mf <= 2; mf++) {
        static float number[MOST][3];
        const uint32_t count = reinhart_count(mf);
        const double height = 0.5 * PI / (7 * mf + 0.5);
        for (uint32_t k = 0; k < count; k++)
            number[k][0] = number[k][1] = number[k][2] = (float)(k + 1);
        struct environment *e = environment_of(mf, (const float(*)[3])number);
        for (uint32_t k = 1; k + 1 < count; k++) {
            const struct reinhart_patch p = reinhart_patch(mf, k);
            const uint32_t next = k + 2 < count && reinhart_patch(mf, k + 1).row == p.row ? k + 1 : 0;
            const double wide = next ? reinhart_patch(mf, next).azimuth - p.azimuth : 0.0;
            for (int corner = 0; corner < 5; corner++) { /* 4 is the middle */
                const double up = corner == 4 ? 0.0 : corner & 1 ? 0.3 : -0.3;
                const double east = corner == 4 ? 0.0 : corner & 2 ? 0.3 : -0.3;
                float w[3], rgb[3], pdf;
                from_radiance(p.altitude + up * height, p.azimuth + east * wide, w);
                environment_evaluate(e, w, rgb, &pdf);
                assert_true(fabsf(rgb[0] - (float)(k + 1)) < 1e-3f * (float)(k + 1));
            }
        }
        environment_destroy(e);
    }
}

/* By the computed sky's own compass: a sun at each patch's place lies in that patch. */
static void the_sun_is_in_the_patch_of_its_azimuth(void **state)
{
    struct sky_desc sky;
    struct sky_state at;
    struct reason why;
    uint32_t width, height;
    (void)state;

    assert_int_equal(sky_parse("", &sky, &why), ERR_OK);
    reinhart_size(1, &width, &height);
    for (uint32_t k = 1; k < PATCHES - 1; k++) {
        const struct reinhart_patch p = reinhart_patch(1, k);
        sky_state_for_sun(&sky, p.altitude, p.azimuth, &at);
        const double *w = at.sun_direction;
        const double u = 0.5 - atan2(w[0], w[2]) / (2.0 * PI),
                     v = acos(w[1]) / PI; /* lat-long, as docs/internals/how-it-works.md */
        assert_int_equal(reinhart_at(1, (uint32_t)(u * width) % width, (uint32_t)(v * height)), k);
    }
}

/* ---- Images ---- */

struct stage {
    struct prepared_scene *set;
    struct relight_desc light;
    struct environment_desc environment;
    struct components_desc desc;
    uint8_t mask[PIXELS];
    struct reason why;
};

static struct stage *stage_make(enum method method, uint32_t samples)
{
    const struct prepared_scene_desc desc = { .width = WIDTH, .height = HEIGHT };
    struct stage *s = mem_alloc(1, sizeof(*s));

    s->set = set_of(&desc);
    resolve_mask(s->set->gbuffer, s->mask);
    s->light = (struct relight_desc){ .direct = { .method = method, .samples = samples } };
    s->desc = (struct components_desc){
        .mf = 1, .set = s->set, .kernels = best_kernels(), .light = &s->light, .environment = &s->environment
    };
    return s;
}

static void stage_finish(struct stage *s)
{
    set_destroy(s->set);
    mem_free(s);
}

static struct components *begin(struct stage *s)
{
    struct components *c;

    assert_int_equal(components_create(&s->desc, &c, &s->why), ERR_OK);
    return c;
}

static void picture(struct components *c, float radiance[PATCHES][3], float *rgb)
{
    struct reason why;

    assert_int_equal(components_image(c, (const float(*)[3])radiance, rgb, &why), ERR_OK);
}

/* To RGBE and back as Radiance reads it, (m + 1/2) / 256, so that what is compared is what dctimestep adds up. */
static void through_file(float *rgb, uint32_t width, uint32_t height)
{
    const struct hdr_desc d = { rgb, width, height, NULL };
    struct image im = { 0 };
    struct reason why;
    uint8_t *bytes;
    size_t size;

    assert_int_equal(hdr_encode(&d, &bytes, &size, &why), ERR_OK);
    assert_int_equal(decode_image(bytes, size, "component", &im, &why), ERR_OK);
    assert_true(im.width == width && im.height == height);
    for (size_t i = 0; i < (size_t)width * height; i++) {
        const float *t = im.rgb + 3 * i;
        int exponent;
        (void)frexpf(fmaxf(t[0], fmaxf(t[1], t[2])), &exponent);
        for (int c = 0; c < 3; c++)
            rgb[3 * i + (size_t)c] = t[0] + t[1] + t[2] > 0.0f ? t[c] + ldexpf(0.5f, exponent - 8) : 0.0f;
    }
    image_finish(&im);
    mem_free(bytes);
}

/* The sums of component images under `skies` skies at once, as dctimestep makes them. */
static void add_components(struct components *c, uint32_t skies, float radiance[][PATCHES][3], float sum[][3 * PIXELS])
{
    static float one[PATCHES][3], rgb[3 * PIXELS];

    memset(one, 0, sizeof(one));
    memset(sum, 0, skies * sizeof(*sum));
    for (uint32_t k = 0; k < PATCHES; k++) {
        one[k][0] = one[k][1] = one[k][2] = 1.0f;
        picture(c, one, rgb);
        one[k][0] = one[k][1] = one[k][2] = 0.0f;
        through_file(rgb, WIDTH, HEIGHT);
        for (uint32_t s = 0; s < skies; s++)
            for (uint32_t i = 0; i < 3 * PIXELS; i++)
                sum[s][i] += radiance[s][k][i % 3] * rgb[i];
    }
}

enum { EVEN, COLOURED, SKIES };

/* An even sky of 1, and one whose patches have colours of their own from 0.05 to 1. */
static void paint(float radiance[SKIES][PATCHES][3])
{
    struct rng r = { 7 };

    for (uint32_t k = 0; k < PATCHES; k++)
        for (int c = 0; c < 3; c++) {
            radiance[EVEN][k][c] = 1.0f;
            radiance[COLOURED][k][c] = (float)(0.05 + 0.95 * rng_next(&r));
        }
}

static struct metrics compare(const struct stage *s, const float *x, const float *r, const char *what)
{
    struct metrics m;

    assert_true(metrics_compare(x, r, s->mask, WIDTH, HEIGHT, 0.02, NULL, &m));
    printf("%s: mean ratio %.5f, relMSE %.3g, delta E %.3f\n", what, m.mean_ratio, m.rel_mse, m.delta_e);
    return m;
}

/* Against the very operator under the same sky, rounding alone is left, and what is cut off below 0: 146 images, each
 * off by 1/512 of its largest at most. Against mis with 1024 samples, whose own noise is some 2e-4, the cache's bias.
 */
static void they_add_up_to_the_image(void **state)
{
    static float radiance[SKIES][PATCHES][3], sum[SKIES][3 * PIXELS], rgb[3 * PIXELS];
    struct stage *cached = stage_make(METHOD_CACHED, 64), *mis = stage_make(METHOD_MIS, 1024);
    struct components *c = begin(cached), *truth = begin(mis);
    (void)state;

    paint(radiance);
    add_components(c, SKIES, radiance, sum);
    for (int s = 0; s < SKIES; s++) {
        picture(c, radiance[s], rgb);
        const struct metrics same = compare(cached, sum[s], rgb, "against the operator");
        picture(truth, radiance[s], rgb);
        const struct metrics m = compare(cached, sum[s], rgb, "against mis");
        assert_true(fabs(same.mean_ratio - 1.0) < 2e-3 && same.rel_mse < 1e-5);
        assert_true(fabs(m.mean_ratio - 1.0) < 5e-3 && m.rel_mse < 1e-3);
    }
    components_destroy(c);
    components_destroy(truth);
    stage_finish(cached);
    stage_finish(mis);
}

/* ---- Files ---- */

static void rgbe_is_as_radiance_has_it(void **state)
{
    float few[3 * 2] = { 1.0f, 0.5f, 0.25f, 0.0f, -1.0f, 0.0f };
    const struct hdr_desc flat = { few, 2, 1, "VIEW= -vtv\n" };
    static const char header[] = "#?RADIANCE\nVIEW= -vtv\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n";
    static const uint8_t texels[8] = { 255, 128, 64, 128, 0, 0, 0, 0 }; /* 255.5 / 256, not 128.5 / 128 */
    enum { W = 300, H = 5 };
    static float rgb[3 * W * H], back[3 * W * H];
    struct rng r = { 3 };
    struct reason why;
    uint8_t *bytes;
    size_t size;
    (void)state;

    assert_int_equal(hdr_encode(&flat, &bytes, &size, &why), ERR_OK);
    assert_int_equal(size, sizeof(header) - 1 + sizeof(texels));
    assert_memory_equal(bytes, header, sizeof(header) - 1);
    assert_memory_equal(bytes + sizeof(header) - 1, texels, sizeof(texels));
    mem_free(bytes);
    for (uint32_t i = 0; i < W * H; i++) /* runs of all lengths, black ones too, and noise */
        for (int c = 0; c < 3; c++)
            rgb[3 * i + (uint32_t)c] = i % 97 < 60 && i > 2 ? rgb[3 * (i - 1) + (uint32_t)c]
                                       : i % 7 == 0         ? 0.0f
                                                            : (float)exp2(40.0 * rng_next(&r) - 20.0);
    memcpy(back, rgb, sizeof(back));
    through_file(back, W, H);
    for (uint32_t i = 0; i < W * H; i++) {
        const float *t = rgb + 3 * i, most = fmaxf(t[0], fmaxf(t[1], t[2]));
        for (int c = 0; c < 3; c++)
            assert_true(fabsf(back[3 * i + (uint32_t)c] - t[c]) <= most / 255.9f);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(patches_are_tregenzas),
    cmocka_unit_test(solid_angles_are_those_of_their_texels),
    cmocka_unit_test(patches_are_where_radiance_looks),
    cmocka_unit_test(the_sun_is_in_the_patch_of_its_azimuth),
    cmocka_unit_test(they_add_up_to_the_image),
    cmocka_unit_test(rgbe_is_as_radiance_has_it),
};
UNIT_MAIN(tests)
