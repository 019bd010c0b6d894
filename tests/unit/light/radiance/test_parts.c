/* Daylight coefficients read back: skies as patches, sums of images and of matrices, and what is refused. */
#include "base/rng.h"
#include "image/codec/encode.h"
#include "light/estimators/points.h"
#include "light/radiance/components.h"
#include "sky/daylight/reinhart.h"
#include "support/sets.h"
#include "support/skies.h"

#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { PATCHES = 146, MOST = 2306, WIDTH = 9, HEIGHT = 6, PIXELS = WIDTH * HEIGHT };

/* ---- Skies ---- */

static struct frame patch_sky(uint32_t mf, const float (*radiance)[3])
{
    struct frame f = { 0 };
    uint32_t width, height;

    reinhart_size(mf, &width, &height);
    assert_int_equal(frame_reserve_texels(&f, width, height), ERR_OK);
    reinhart_sky(mf, radiance, f.rgb);
    return f;
}

static void fill(float (*radiance)[3], uint32_t count)
{
    struct rng r = { 5 };

    for (uint32_t k = 0; k < count; k++)
        for (int c = 0; c < 3; c++)
            radiance[k][c] = (float)(k % 7 == 0 ? 1e4 * rng_next(&r) : rng_next(&r));
}

static void compare(const float (*have)[3], const float (*want)[3], uint32_t count)
{
    for (uint32_t k = 0; k < count; k++)
        for (int c = 0; c < 3; c++)
            if (!(fabsf(have[k][c] - want[k][c]) <= 1e-5f * want[k][c]))
                fail_msg("patch %u, channel %d: %g instead of %g", k, c, (double)have[k][c], (double)want[k][c]);
}

/* A sky of patches has their radiances, whatever its neighbours shine with. */
static void a_sky_of_patches_keeps_their_radiances(void **state)
{
    static float radiance[MOST][3], got[MOST][3];
    (void)state;

    fill(radiance, MOST);
    for (uint32_t mf = 1; mf <= 4; mf *= 2) {
        struct environment *e = sky_environment(patch_sky(mf, (const float(*)[3])radiance), 16, 0.0);
        assert_int_equal(sky_patches(e, mf, got), ERR_OK);
        compare((const float(*)[3])got, (const float(*)[3])radiance, reinhart_count(mf));
        environment_destroy(e);
    }
}

/* By 60 degrees, which all rows' patches divide, patches turn into patches: those that the environment shows there. */
static void a_turned_sky_is_found_where_it_shines(void **state)
{
    static float radiance[PATCHES][3], got[PATCHES][3], shown[PATCHES][3];
    (void)state;

    fill(radiance, PATCHES);
    for (int bottom = 0; bottom < 2; bottom++) {
        struct frame f = patch_sky(1, (const float(*)[3])radiance);
        for (uint32_t y = 0; bottom && y < f.height / 2; y++) /* upside down */
            for (uint32_t i = 0; i < 3 * f.width; i++) {
                float *a = f.rgb + (size_t)3 * f.width * y + i,
                      *b = f.rgb + (size_t)3 * f.width * (f.height - 1 - y) + i;
                const float t = *a;
                *a = *b;
                *b = t;
            }
        struct environment *e = sky_environment_of(f, bottom ? LAYOUT_LATLONG_BOTTOM_FIRST : LAYOUT_LATLONG, 64, 60.0);
        assert_int_equal(sky_patches(e, 1, got), ERR_OK);
        for (uint32_t k = 0; k < PATCHES; k++) {
            const struct reinhart_patch p = reinhart_patch(1, k);
            const struct vec3 w = { (float)(-sin(p.azimuth) * cos(p.altitude)), (float)sin(p.altitude),
                                    (float)(cos(p.azimuth) * cos(p.altitude)) };
            environment_lookup(e, w, shown[k]);
        }
        compare((const float(*)[3])got, (const float(*)[3])shown, PATCHES);
        environment_destroy(e);
    }
}

/* Of a radiance a + b sin(altitude) a row of patches has the mean a + b (sin top + sin bottom) / 2; texels do not
 * divide the rows: where a row's edge cuts one of height h, its own gradient is lost, at most b h / 8 for a share h /
 * row. The lower hemisphere has a - b / 2. */
static void a_gradient_has_its_mean_in_each_patch(void **state)
{
    static float got[MOST][3];
    enum { W = 500, H = 250 };
    const double a = 3.0, b = 2.0;
    (void)state;

    for (uint32_t mf = 1; mf <= 4; mf *= 4) {
        struct frame f = { 0 };
        assert_int_equal(frame_reserve_texels(&f, W, H), ERR_OK);
        for (uint32_t y = 0; y < H; y++) {
            const double top = sin(PI * (0.5 - (double)y / H)), bottom = sin(PI * (0.5 - (y + 1.0) / H));
            for (uint32_t i = 0; i < 3 * W; i++) /* the mean of the texel */
                f.rgb[(size_t)3 * W * y + i] = (float)(a + b * 0.5 * (top + bottom));
        }
        struct environment *e = sky_environment(f, 64, 17.0);
        assert_int_equal(sky_patches(e, mf, got), ERR_OK);
        assert_true(fabs((double)got[0][1] - (a - 0.5 * b)) < 1e-5);
        for (uint32_t k = 1; k < reinhart_count(mf); k++) {
            const struct reinhart_row row = reinhart_row(mf, reinhart_patch(mf, k).row);
            const double want = a + b * 0.5 * (sin(row.top) + sin(row.bottom));
            const double h = PI / H;
            if (!(fabs((double)got[k][2] - want) < b * h / 8.0 * h / (row.top - row.bottom) + 1e-5))
                fail_msg("MF:%u patch %u: %.6f instead of %.6f", mf, k, (double)got[k][2], want);
        }
        environment_destroy(e);
    }
}

/* A cube map's texels go to patches by their middles: a sky of one half is 5 on one side of the meridian. */
static void a_cube_map_is_divided_by_its_texels(void **state)
{
    static float got[PATCHES][3];
    enum { N = 32 };
    struct frame f = { 0 };
    (void)state;

    assert_int_equal(frame_reserve_texels(&f, N, 6 * N), ERR_OK);
    for (uint32_t i = 0; i < 3 * N * 6 * N; i++)
        f.rgb[i] = i < 3 * N * N ? 5.0f : 0.0f; /* the face +X, which is west */
    struct environment *e = sky_environment_of(f, LAYOUT_CUBE, N, 0.0);
    assert_int_equal(sky_patches(e, 1, got), ERR_OK);
    for (uint32_t k = 1; k < PATCHES; k++) {
        const struct reinhart_patch p = reinhart_patch(1, k);
        const double west = -sin(p.azimuth) * cos(p.altitude),
                     other = fmax(fabs(cos(p.azimuth) * cos(p.altitude)), sin(p.altitude));
        if (west > 1.4 * other) /* all of the patch */
            assert_true(fabsf(got[k][0] - 5.0f) < 1e-4f);
        if (west < 0.7 * other)
            assert_true(got[k][0] < 1e-4f);
    }
    environment_destroy(e);
}

/* ---- Parts ---- */

struct folder {
    char path[64], pattern[96];
};

static struct folder folder_of_parts(void)
{
    struct folder f;

    snprintf(f.path, sizeof(f.path), "/tmp/parts-XXXXXX");
    assert_non_null(mkdtemp(f.path));
    snprintf(f.pattern, sizeof(f.pattern), "%s/%%03d.hdr", f.path);
    return f;
}

static void name_of(const struct folder *f, uint32_t k, char *out, size_t size)
{
    snprintf(out, size, "%s/%03u.hdr", f->path, k);
}

static void folder_finish(const struct folder *f)
{
    char name[128];

    for (uint32_t k = 0; k < PATCHES + 2; k++) {
        name_of(f, k, name, sizeof(name));
        (void)unlink(name);
    }
    snprintf(name, sizeof(name), "%s/view.mtx", f->path);
    (void)unlink(name);
    assert_int_equal(rmdir(f->path), 0);
}

static void write_part(const struct folder *f, uint32_t k, const float *rgb, uint32_t width, uint32_t height)
{
    char name[128];
    struct reason why;

    name_of(f, k, name, sizeof(name));
    assert_int_equal(hdr_write(&(struct hdr_desc){ rgb, width, height, NULL }, name, &why), ERR_OK);
}

/* Images with values of RGBE's own, as Radiance reads them: (m + 1/2) / 256 times a power of two that a texel's
 * largest channel has with a mantissa of at least 128. */
static void make_parts(float part[PATCHES][PIXELS][3])
{
    struct rng r = { 11 };

    for (uint32_t k = 0; k < PATCHES; k++)
        for (uint32_t i = 0; i < PIXELS; i++) {
            const int exponent = (int)(12.0 * rng_next(&r)) - 12;
            for (uint32_t c = 0; c < 3; c++)
                part[k][i][c] =
                    ldexpf(floorf((float)(c == i % 3 ? 130.0 + 120.0 * rng_next(&r) : 129.0 * rng_next(&r))) + 0.5f,
                           exponent - 8);
            if (i % 11 == 5)
                memset(part[k][i], 0, sizeof(part[k][i]));
        }
}

static void write_parts(const struct folder *f, float part[PATCHES][PIXELS][3])
{
    for (uint32_t k = 0; k < PATCHES; k++)
        write_part(f, k, part[k][0], WIDTH, HEIGHT);
}

static struct parts *read_parts(const char *from)
{
    struct parts *p;
    struct reason why;

    if (parts_create(&(struct parts_desc){ from, WIDTH, HEIGHT, 0 }, &p, &why))
        fail_msg("%s", why.text);
    assert_int_equal(parts_bytes(p), PATCHES * 3 * WIDTH * HEIGHT * sizeof(uint16_t));
    return p;
}

/* The sum in double precision. */
static void expect_sum(const struct parts *p, float part[PATCHES][PIXELS][3], double within)
{
    static float radiance[PATCHES][3], rgb[3 * PIXELS];

    fill(radiance, PATCHES);
    radiance[20][0] = 0.0f;
    parts_image(p, (const float(*)[3])radiance, rgb);
    for (uint32_t i = 0; i < PIXELS; i++)
        for (uint32_t c = 0; c < 3; c++) {
            double want = 0.0;
            for (uint32_t k = 0; k < PATCHES; k++)
                want += (double)radiance[k][c] * (double)part[k][i][c];
            if (!(fabs((double)rgb[3 * i + c] - want) <= within * want))
                fail_msg("pixel %u, channel %u: %g instead of %g", i, c, (double)rgb[3 * i + c], want);
        }
}

static void parts_add_up_as_dctimestep_adds_them(void **state)
{
    static float part[PATCHES][PIXELS][3];
    const struct folder f = folder_of_parts();
    (void)state;

    make_parts(part);
    write_parts(&f, part);
    struct parts *p = read_parts(f.pattern);
    expect_sum(p, part, 1e-5);
    parts_destroy(p);
    folder_finish(&f);
}

/* A row for each pixel, a column for each patch, in binary floats: halves keep 11 bits of each. */
static void a_view_matrix_adds_up_too(void **state)
{
    static float part[PATCHES][PIXELS][3];
    const struct folder f = folder_of_parts();
    char name[128];
    (void)state;

    make_parts(part);
    for (uint32_t k = 0; k < PATCHES; k++)
        for (uint32_t i = 0; i < PIXELS; i++)
            part[k][i][1] *= 1.1f;
    snprintf(name, sizeof(name), "%s/view.mtx", f.path);
    FILE *out = fopen(name, "wb");
    assert_non_null(out);
    fprintf(out, "#?RADIANCE\nrcontrib\nNCOMP=3\nNCOLS=%d\nBigEndian=0\nFORMAT=float\n\n", PATCHES);
    for (uint32_t i = 0; i < PIXELS; i++)
        for (uint32_t k = 0; k < PATCHES; k++)
            assert_int_equal(fwrite(part[k][i], sizeof(float), 3, out), 3);
    assert_int_equal(fclose(out), 0);
    struct parts *p = read_parts(name);
    expect_sum(p, part, 0x1p-11);
    parts_destroy(p);
    folder_finish(&f);
}

static void refuse(const char *from, uint32_t width, uint64_t bytes, enum err code, const char *words)
{
    struct parts *p;
    struct reason why = { "" };

    assert_int_equal(parts_create(&(struct parts_desc){ from, width, HEIGHT, bytes }, &p, &why), code);
    assert_null(p);
    if (!strstr(why.text, words))
        fail_msg("'%s' does not say '%s'", why.text, words);
}

static void what_is_no_set_of_parts_is_refused(void **state)
{
    static float part[PATCHES][PIXELS][3];
    const struct folder f = folder_of_parts();
    char name[128];
    (void)state;

    refuse(f.pattern, WIDTH, 0, ERR_FORMAT, "/000.hdr is missing or not readable: there are 0 files from number 0 on");
    make_parts(part);
    write_parts(&f, part);
    refuse(f.pattern, 2 * WIDTH, 0, ERR_USAGE, "/000.hdr: is 9x6 pixels, and the image 18x6: set its size with --size");
    refuse(f.pattern, WIDTH, 1000, ERR_RANGE, "take 0 MB, above the 0 MB of --cache-memory");
    write_part(&f, 101, part[101][0], 6, 9);
    refuse(f.pattern, WIDTH, 0, ERR_USAGE, "/101.hdr: is 6x9 pixels, and the image 9x6: all parts must have");
    write_part(&f, 101, part[101][0], 9, 6);
    write_part(&f, 146, part[101][0], 9, 6);
    refuse(f.pattern, WIDTH, 0, ERR_FORMAT,
           "/147.hdr is missing or not readable: there are 147 files from number 0 on, and a sky of Reinhart MF:2 has "
           "578");
    name_of(&f, 146, name, sizeof(name));
    assert_int_equal(unlink(name), 0);
    name_of(&f, 145, name, sizeof(name));
    assert_int_equal(unlink(name), 0);
    refuse(f.pattern, WIDTH, 0, ERR_FORMAT, "has 146 patches, of which 0 is the ground: is it missing?");
    name_of(&f, 57, name, sizeof(name));
    assert_int_equal(truncate(name, 30), 0);
    write_part(&f, 145, part[145][0], 9, 6);
    refuse(f.pattern, WIDTH, 0, ERR_FORMAT, "/057.hdr");
    refuse("/nowhere/%d/%d.hdr", WIDTH, 0, ERR_USAGE, "--parts");
    snprintf(name, sizeof(name), "%s/view.mtx", f.path);
    refuse(name, WIDTH, 0, ERR_IO, "No such file");
    for (int bad = 0; bad < 3; bad++) {
        static const char *const says[] = { "has 145 columns; a sky has 146, 578 or 2306",
                                            "has 7 rows, and an image of 9x6 54 pixels", "goes on after 54 x 145" };
        FILE *out = fopen(name, "w");
        assert_non_null(out);
        fprintf(out, "#?RADIANCE\nNROWS=%d\nNCOLS=%d\nNCOMP=3\nFORMAT=ascii\n\n", bad == 1 ? 7 : PIXELS,
                bad == 1 ? 146 : 145);
        for (int i = 0; i < (bad == 1 ? 7 * 146 : PIXELS * 145 + bad); i++)
            fputs("1 1 1\n", out);
        assert_int_equal(fclose(out), 0);
        refuse(name, WIDTH, 0, bad == 1 ? ERR_USAGE : ERR_FORMAT, says[bad]);
    }
    folder_finish(&f);
}

/* Through relighter_run: the image of the environment's patches for the first camera, and for no other. */
static void a_relighter_shows_them_for_one_camera(void **state)
{
    static float part[PATCHES][PIXELS][3], radiance[PATCHES][3], want[3 * PIXELS], rgb[3 * PIXELS];
    const struct folder f = folder_of_parts();
    const struct prepared_scene_desc one = { .width = WIDTH, .height = HEIGHT };
    struct prepared_scene_desc two = one;
    struct reason why = { "" };
    struct relight_stats stats;
    (void)state;

    make_parts(part);
    write_parts(&f, part);
    struct parts *p = read_parts(f.pattern);
    struct relight_whole whole = parts_whole(p);
    struct relight_desc light = { .direct = { .method = METHOD_COMPONENTS, .samples = 1, .why = &why },
                                  .whole = &whole };
    fill(radiance, PATCHES);
    struct environment *e = sky_environment(patch_sky(1, (const float(*)[3])radiance), 16, 0.0);
    two.camera = "@0,3,9;0,0,0;40";
    struct prepared_scene *sets[2] = { set_of(&one), set_of(&two) };
    for (int k = 0; k < 2; k++) {
        struct relighter *r = relighter_create(sets[k], best_kernels());
        assert_int_equal(relighter_run(r, e, &light, rgb, &stats), k == 0 ? ERR_OK : ERR_UNSUPPORTED);
        relighter_destroy(r);
    }
    assert_non_null(strstr(why.text, "another camera needs components of its own"));
    parts_image(p, (const float(*)[3])radiance, want);
    for (uint32_t i = 0; i < 3 * PIXELS; i++)
        assert_true(fabsf(rgb[i] - want[i]) <= 1e-5f * want[i]);
    assert_non_null(stats.bias);
    light.whole = NULL;
    struct relighter *r = relighter_create(sets[0], best_kernels());
    assert_int_equal(relighter_run(r, e, &light, rgb, &stats), ERR_UNSUPPORTED);
    assert_non_null(strstr(why.text, "needs --parts"));
    relighter_destroy(r);
    set_destroy(sets[0]);
    set_destroy(sets[1]);
    environment_destroy(e);
    parts_destroy(p);
    folder_finish(&f);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_sky_of_patches_keeps_their_radiances), cmocka_unit_test(a_turned_sky_is_found_where_it_shines),
    cmocka_unit_test(a_gradient_has_its_mean_in_each_patch),  cmocka_unit_test(a_cube_map_is_divided_by_its_texels),
    cmocka_unit_test(parts_add_up_as_dctimestep_adds_them),   cmocka_unit_test(a_view_matrix_adds_up_too),
    cmocka_unit_test(what_is_no_set_of_parts_is_refused),     cmocka_unit_test(a_relighter_shows_them_for_one_camera),
};
UNIT_MAIN(tests)
