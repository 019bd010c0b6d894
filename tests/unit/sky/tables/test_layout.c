/* Layouts: what each keeps, which way each looks, and that all show the same sky. */
#include "sky/tables/layout.h"

#include "sky/tables/resampling.h"
#include "support/layouts.h"
#include "support/skies.h"

static const struct {
    enum layout layout;
    uint32_t width, height, n;
} cases[] = {
    { LAYOUT_LATLONG, 64, 32, 16 },   { LAYOUT_LATLONG_BOTTOM_FIRST, 37, 19, 33 },
    { LAYOUT_CUBE, 16, 96, 16 },      { LAYOUT_CUBE, 1, 6, 7 },
    { LAYOUT_CUBE, 33, 198, 16 },     { LAYOUT_HCROSS, 64, 48, 9 },
    { LAYOUT_VCROSS, 63, 84, 16 },    { LAYOUT_VCROSS, 96, 128, 64 },
    { LAYOUT_CUBE_3X2, 48, 32, 16 },  { LAYOUT_CUBE_6X1, 90, 15, 16 },
    { LAYOUT_BALL, 16, 16, 33 },      { LAYOUT_BALL, 101, 101, 16 },
    { LAYOUT_BALL, 200, 120, 64 },    { LAYOUT_BALL, 64, 65, 1 },
    { LAYOUT_FISHEYE, 16, 16, 33 },   { LAYOUT_FISHEYE, 101, 101, 17 },
    { LAYOUT_FISHEYE, 160, 200, 64 }, { LAYOUT_FISHEYE, 64, 64, 1 },
};
#define CASES (sizeof(cases) / sizeof(cases[0]))
static const double rotations[] = { 0.0, 0.5 * PI, 0.7, -2.5 };
#define ROTATIONS (sizeof(rotations) / sizeof(rotations[0]))

static double texel_solid_angle(uint32_t n, size_t t)
{
    const double s = 2.0 / n, u = -1.0 + s * (double)(t % n), v = -1.0 + s * (double)(t / n % n);
    return cube_solid_angle(u, v, u + s, v + s);
}

static struct resampler *make_resampler(size_t q, double rotation)
{
    return resampling_make(cases[q].layout, cases[q].width, cases[q].height, cases[q].n, rotation);
}

static void every_layout_keeps_a_constant(void **state)
{
    (void)state;
    for (size_t q = 0; q < CASES * ROTATIONS; q++) {
        const uint32_t n = cases[q / ROTATIONS].n;
        struct resampler *r = make_resampler(q / ROTATIONS, rotations[q % ROTATIONS]);
        struct frame f = sky_constant(r->table->key.width, r->table->key.height, 3.0f);
        float *cube = resampling_cube(r, f.rgb, 2.0f);
        for (size_t t = 0; t < 6 * (size_t)n * n; t++)
            assert_true(fabsf(cube[4 * t] / 6.0f - 1.0f) < 1e-5f);
        mem_free(cube);
        frame_finish(&f);
        resampler_destroy(r);
    }
}

/* What each source texel brings to all cube texels, against its own solid angle; what is masked brings nothing. */
static void every_layout_keeps_every_texels_energy(void **state)
{
    (void)state;
    for (size_t q = 0; q < CASES * ROTATIONS; q++) {
        struct resampler *r = make_resampler(q / ROTATIONS, rotations[q % ROTATIONS]);
        const struct resample_key *key = &r->table->key;
        double *arrived = resampling_arrived(r), sum = 0.0, worst = 0.0;
        assert_int_equal(r->table->factor, 1);
        for (uint32_t y = 0; y < key->height; y++)
            for (uint32_t x = 0; x < key->width; x++) {
                const double low[2] = { x, y }, high[2] = { x + 1, y + 1 }, got = arrived[(size_t)y * key->width + x];
                const double want = layout_solid_angle(key->layout, key->width, key->height, low, high);
                sum += want;
                worst = fmax(worst, want > 0.0 ? fabs(got / want - 1.0) : got);
            }
        assert_true(worst < 1e-5);
        assert_true(fabs(sum / layout_shown(key->layout) - 1.0) < 1e-9);
        mem_free(arrived);
        resampler_destroy(r);
    }
}

/* Images in which every texel shows its own direction as a colour, (2 + x, 2 + y, 2 + z); masked ones are NaN's
 * opposite, so large that they would be seen. */
static const struct {
    enum layout layout;
    uint32_t width, height;
    double seen, lit; /* how far a lookup, and a texel of the cube map, may be off */
} images[] = {
    { LAYOUT_LATLONG, 256, 128, 0.015, 0.06 }, { LAYOUT_LATLONG_BOTTOM_FIRST, 256, 128, 0.015, 0.06 },
    { LAYOUT_CUBE, 64, 384, 0.02, 0.06 },      { LAYOUT_HCROSS, 256, 192, 0.02, 0.06 },
    { LAYOUT_VCROSS, 192, 256, 0.02, 0.06 },   { LAYOUT_BALL, 512, 512, 0.02, 0.06 },
    { LAYOUT_FISHEYE, 200, 200, 0.02, 0.06 },  { LAYOUT_CUBE_3X2, 192, 128, 0.02, 0.06 },
    { LAYOUT_CUBE_6X1, 384, 64, 0.02, 0.06 },
};
#define IMAGES (sizeof(images) / sizeof(images[0]))

static struct frame sky_of_directions(size_t q)
{
    struct frame f = sky_constant(images[q].width, images[q].height, 1e6f);
    for (uint32_t y = 0; y < f.height; y++)
        for (uint32_t x = 0; x < f.width; x++) {
            double w[3];
            if (test_direction(layout_name(images[q].layout), f.width, f.height, x + 0.5, y + 0.5, w))
                sky_paint(&f, x, y, 2.0f + (float)w[0], 2.0f + (float)w[1], 2.0f + (float)w[2]);
            else if (layout_is_disc(images[q].layout) &&
                     hypot(2.0 * x + 1.0 - f.width, 2.0 * y + 1.0 - f.height) < f.width + 2.0)
                sky_paint(&f, x, y, 2.0f, 2.0f, 2.0f); /* cut by the circle: its centre is outside, a part is not */
        }
    return f;
}

/* The direction in the image's own frame. */
static void turn_back(const float w[3], double degrees, double own[3])
{
    const double c = cos(degrees * PI / 180.0), s = sin(degrees * PI / 180.0);
    own[0] = c * w[0] - s * w[2];
    own[1] = w[1];
    own[2] = s * w[0] + c * w[2];
}

/* Looks along w and reads the cube map there: both must show w itself; what a fisheye does not see, its mean. */
static void check_direction(const struct environment *e, size_t q, double degrees, const float w[3])
{
    float seen[3], lit[3], pdf;
    double own[3], want[3];

    turn_back(w, degrees, own);
    /* Near a ball's rim a texel spans many degrees, as it does at a fisheye's horizon where the mean takes over. */
    if ((images[q].layout == LAYOUT_BALL && own[2] < -0.95) ||
        (images[q].layout == LAYOUT_FISHEYE && fabs(own[1]) < 0.05))
        return;
    const bool below = images[q].layout == LAYOUT_FISHEYE && own[1] < 0.0;
    for (int c = 0; c < 3; c++)
        want[c] = below ? (c == 1 ? 2.5 : 2.0) : 2.0 + own[c];
    environment_lookup(e, vec3_make(w[0], w[1], w[2]), seen);
    environment_evaluate(e, w, lit, &pdf);
    for (int c = 0; c < 3; c++) {
        assert_true(fabs(seen[c] - want[c]) < images[q].seen);
        assert_true(fabs(lit[c] - want[c]) < images[q].lit);
    }
}

static void every_layout_shows_each_direction_where_it_says(void **state)
{
    static const double turns[] = { 0.0, 90.0, -37.0 };
    static const float axes[6][3] = { { 1, 0, 0 }, { -1, 0, 0 }, { 0, 1, 0 }, { 0, -1, 0 }, { 0, 0, 1 }, { 0, 0, -1 } };
    (void)state;
    for (size_t q = 0; q < 3 * IMAGES; q++) {
        struct rng random = { 7 };
        struct environment *e = sky_environment_of(sky_of_directions(q / 3), images[q / 3].layout, 48, turns[q % 3]);
        for (int k = 0; k < 6; k++)
            check_direction(e, q / 3, turns[q % 3], axes[k]);
        for (int k = 0; k < 3000; k++) {
            const double z = 2.0 * rng_next(&random) - 1.0, phi = 2.0 * PI * rng_next(&random), s = sqrt(1.0 - z * z);
            check_direction(e, q / 3, turns[q % 3],
                            (const float[3]){ (float)(s * cos(phi)), (float)(s * sin(phi)), (float)z });
        }
        environment_destroy(e);
    }
}

/* The same smooth sky through each layout gives the cube map of lat-long, within 0.001 (a ball: 0.01) of radiance 2. */
static void every_layout_gives_the_same_cube_map(void **state)
{
    const uint32_t n = 32;
    struct environment *first = sky_environment(sky_of_directions(0), n, 20.0);
    (void)state;
    for (size_t q = 1; q < IMAGES; q++) {
        struct environment *e = sky_environment_of(sky_of_directions(q), images[q].layout, n, 20.0);
        double sum = 0.0;
        size_t count = 0;
        for (size_t t = 0; t < 6 * (size_t)n * n; t++) {
            const float *a = &first->texels[t].r, *b = &e->texels[t].r;
            if (images[q].layout == LAYOUT_FISHEYE && a[1] < 2.0f + 2.0f / (float)n)
                continue;
            for (int c = 0; c < 3; c++)
                sum += (a[c] - b[c]) * (a[c] - b[c]);
            count += 3;
        }
        /* a texel at a ball's rim spans ten degrees */
        assert_true(sqrt(sum / (double)count) < (images[q].layout == LAYOUT_BALL ? 0.01 : 0.001));
        assert_true(images[q].layout == LAYOUT_FISHEYE || fabs(e->total_energy / first->total_energy - 1.0) < 1e-3);
        environment_destroy(e);
    }
    environment_destroy(first);
}

/* More texels than the cube map can use: reduced first, and still all of the light of each arrives. */
static void large_images_are_reduced_and_keep_their_energy(void **state)
{
    static const struct {
        enum layout layout;
        uint32_t width, height;
    } large[] = { { LAYOUT_LATLONG, 1601, 801 }, { LAYOUT_LATLONG_BOTTOM_FIRST, 1601, 801 },
                  { LAYOUT_CUBE, 421, 421 * 6 }, { LAYOUT_HCROSS, 1204, 903 },
                  { LAYOUT_BALL, 1031, 1040 },   { LAYOUT_FISHEYE, 1040, 1031 } };
    (void)state;
    for (size_t q = 0; q < sizeof(large) / sizeof(large[0]); q++) {
        const uint32_t n = 4, w = large[q].width, h = large[q].height;
        struct resampler *r = resampling_make(large[q].layout, w, h, n, 0.3);
        struct frame f = sky_constant(w, h, 0.0f);
        double got = 0.0, want = 0.0;
        assert_int_equal(r->table->factor, 2);
        for (uint32_t k = 0; k < 5; k++) { /* the last ones are in blocks that the border cuts */
            const uint32_t x = k == 4 ? w / 2 : w / 5 * k, y = k == 4 ? h - 1 : h / 3 + k;
            const double low[2] = { x, y }, high[2] = { x + 1, y + 1 };
            const double omega = layout_solid_angle(large[q].layout, w, h, low, high);
            if (omega == 0.0)
                continue;
            sky_paint(&f, x, y, (float)(1.0 / omega), 0.0f, 0.0f);
            want += 4.0 * PI / layout_shown(large[q].layout); /* the mean of it fills what is not seen */
        }
        float *cube = resampling_cube(r, f.rgb, 1.0f);
        for (size_t k = 0; k < 6 * (size_t)n * n; k++)
            got += cube[4 * k] * texel_solid_angle(n, k);
        mem_free(cube);
        assert_true(want > 0.0 && fabs(got / want - 1.0) < 1e-5);
        frame_finish(&f);
        resampler_destroy(r);
    }
}

/* A flat Radiance file of one cell of a horizontal cross, each texel its own direction; returns its size. */
static size_t put_face(uint8_t *to, uint32_t size, uint32_t column, uint32_t row)
{
    size_t at = (size_t)sprintf((char *)to, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %u +X %u\n", size, size);
    for (uint32_t i = 0; i < size * size; i++) {
        double w[3] = { 0.0, 0.0, 0.0 };
        assert_true(test_direction("hcross", 4.0 * size, 3.0 * size, column * size + i % size + 0.5,
                                   row * size + i / size + 0.5, w));
        for (int c = 0; c < 3; c++)
            to[at++] = (uint8_t)((2.0 + w[c]) * 64.0); /* exponent 130: 4 is 256 */
        to[at++] = 130;
    }
    return at;
}

/* px lies to the right of pz, which is at +Z: the cells of a horizontal cross, as graphics libraries unfold a cube. */
static void six_files_are_the_cells_of_a_horizontal_cross(void **state)
{
    static const uint32_t cell[6][2] = { { 2, 1 }, { 0, 1 }, { 1, 0 }, { 1, 2 }, { 1, 1 }, { 3, 1 } };
    struct rng random = { 3 };
    struct reason why = { "" };
    struct frame f = { 0 };
    (void)state;
    assert_int_equal(frame_reserve_bytes(&f, 6 * (64 * 64 * 4 + 100)), ERR_OK);
    f.size = 0;
    for (int k = 0; k < 6; k++) {
        f.faces[k] = put_face(f.bytes + f.size, 64, cell[k][0], cell[k][1]);
        f.size += f.faces[k];
    }
    struct environment *e = environment_create(&(struct environment_desc){ .n = 48 });
    assert_int_equal(environment_update(e, &f, &why), ERR_OK);
    for (int k = 0; k < 1000; k++) {
        const double z = 2.0 * rng_next(&random) - 1.0, phi = 2.0 * PI * rng_next(&random), s = sqrt(1.0 - z * z);
        const float w[3] = { (float)(s * cos(phi)), (float)(s * sin(phi)), (float)z };
        float rgb[3];
        environment_lookup(e, vec3_make(w[0], w[1], w[2]), rgb);
        for (int c = 0; c < 3; c++)
            assert_true(fabsf(rgb[c] - 2.0f - w[c]) < 0.04f);
    }
    put_face(f.bytes + f.faces[0], 32, 0, 0 + 1); /* the second face is of another size */
    assert_int_equal(environment_update(e, &f, &why), ERR_FORMAT);
    assert_non_null(strstr(why.text, "face nx"));
    frame_finish(&f);
    environment_destroy(e);
}

static void check_choice(enum layout option, enum layout file, uint32_t width, uint32_t height, const char *refusal)
{
    struct reason why = { "" };
    struct frame f = sky_constant(width, height, 1.0f);
    struct environment *e = environment_create(&(struct environment_desc){ .n = 8, .layout = option });

    snprintf(f.name, sizeof(f.name), "odd.exr");
    assert_int_equal(environment_decode(e, &f, &why), ERR_OK);
    e->image.layout = file; /* as of a file that says this */
    assert_int_equal(environment_rebuild(e, &why), refusal ? ERR_UNSUPPORTED : ERR_OK);
    assert_true(e->ready == !refusal);
    if (refusal && (!strstr(why.text, refusal) || !strstr(why.text, "odd.exr"))) {
        printf("said: %s\n", why.text);
        fail();
    }
    if (!refusal)
        assert_int_equal(e->resampler->table->key.layout, option ? option : file ? file : LAYOUT_LATLONG);
    frame_finish(&f);
    environment_destroy(e);
}

static void option_wins_over_file_and_file_over_shape(void **state)
{
    (void)state;
    check_choice(LAYOUT_AUTO, LAYOUT_AUTO, 40, 20, NULL);
    check_choice(LAYOUT_AUTO, LAYOUT_CUBE, 10, 60, NULL);
    check_choice(LAYOUT_AUTO, LAYOUT_LATLONG, 10, 60, NULL);
    check_choice(LAYOUT_FISHEYE, LAYOUT_LATLONG, 40, 20, NULL);
    check_choice(LAYOUT_LATLONG, LAYOUT_CUBE, 10, 60, NULL);
}

/* A frame may bring the word of whoever sent it, which stands between the option and the file. */
static void a_frames_own_word_is_heard(void **state)
{
    struct reason why = { "" };
    struct frame f = sky_constant(40, 30, 1.0f);
    struct environment *e = environment_create(&(struct environment_desc){ .n = 8 });
    (void)state;
    snprintf(f.layout, sizeof(f.layout), "hcross");
    assert_int_equal(environment_update(e, &f, &why), ERR_OK);
    assert_int_equal(e->resampler->table->key.layout, LAYOUT_HCROSS);
    snprintf(f.layout, sizeof(f.layout), "auto"); /* texels of 4:3 that nobody names */
    assert_int_equal(environment_update(e, &f, &why), ERR_UNSUPPORTED);
    snprintf(f.layout, sizeof(f.layout), "mercator");
    assert_int_equal(environment_update(e, &f, &why), ERR_FORMAT);
    assert_non_null(strstr(why.text, "mercator"));
    frame_finish(&f);
    environment_destroy(e);
}

static void unknown_shapes_ask_for_the_layouts_that_fit(void **state)
{
    (void)state;
    check_choice(LAYOUT_AUTO, LAYOUT_AUTO, 512, 512,
                 "512x512 is not 2:1, so the layout is ambiguous: specify --layout ball or");
    check_choice(LAYOUT_AUTO, LAYOUT_AUTO, 10, 60, "--layout cube");
    check_choice(LAYOUT_AUTO, LAYOUT_AUTO, 40, 30, "--layout hcross");
    check_choice(LAYOUT_AUTO, LAYOUT_AUTO, 30, 40, "--layout vcross");
    check_choice(LAYOUT_AUTO, LAYOUT_AUTO, 60, 10, "--layout cube-6x1");
    check_choice(LAYOUT_AUTO, LAYOUT_AUTO, 60, 40, "--layout cube-3x2, ball or fisheye");
    check_choice(LAYOUT_AUTO, LAYOUT_AUTO, 50, 20, "--layout latlong, ball");
}

static void shapes_that_cannot_be_the_layout_are_refused_by_name(void **state)
{
    (void)state;
    check_choice(LAYOUT_CUBE, LAYOUT_AUTO, 40, 20, "40x20 does not fit the layout cube");
    check_choice(LAYOUT_AUTO, LAYOUT_CUBE, 40, 20, "layout cube");
    check_choice(LAYOUT_HCROSS, LAYOUT_AUTO, 30, 40, "layout hcross");
    check_choice(LAYOUT_HCROSS, LAYOUT_AUTO, 41, 30, "layout hcross");
    check_choice(LAYOUT_CUBE_3X2, LAYOUT_AUTO, 40, 30, "layout cube-3x2");
    check_choice(LAYOUT_VCROSS, LAYOUT_AUTO, 40, 30, "layout vcross");
    check_choice(LAYOUT_BALL, LAYOUT_AUTO, 15, 40, "too small for a ball");
    check_choice(LAYOUT_FISHEYE, LAYOUT_AUTO, 40, 15, "too small for a fisheye");
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(every_layout_keeps_a_constant),
    cmocka_unit_test(every_layout_keeps_every_texels_energy),
    cmocka_unit_test(every_layout_shows_each_direction_where_it_says),
    cmocka_unit_test(every_layout_gives_the_same_cube_map),
    cmocka_unit_test(large_images_are_reduced_and_keep_their_energy),
    cmocka_unit_test(six_files_are_the_cells_of_a_horizontal_cross),
    cmocka_unit_test(option_wins_over_file_and_file_over_shape),
    cmocka_unit_test(a_frames_own_word_is_heard),
    cmocka_unit_test(unknown_shapes_ask_for_the_layouts_that_fit),
    cmocka_unit_test(shapes_that_cannot_be_the_layout_are_refused_by_name),
};
UNIT_MAIN(tests)
