/* The filter on made-up surfaces: what it must leave alone, what it must average, and what it must not mix. Light of
 * known mean and variance gives each claim a closed form. */
#include "light/denoise/denoise.h"
#include "light/denoise/filter_kernel.h"

#include "base/mem.h"
#include "base/rng.h"
#include "support/unit.h"

#include <math.h>
#include <string.h>

enum { WIDTH = 64, HEIGHT = 48, PIXELS = WIDTH * HEIGHT, PACKETS = PIXELS / PACKET };

/* A plane at distance 10 that fills the image, one point per pixel in the image's order. */
struct wall {
    struct gbuffer g;
    struct view view;
    float *half[2], *out;
};

static struct wall wall_make(void)
{
    struct wall w = { .g = { .width = WIDTH, .height = HEIGHT, .packet_count = PACKETS, .pixel_angle = 0.01f } };

    w.g.packets = mem_alloc(PACKETS, sizeof(*w.g.packets));
    w.g.entries = mem_alloc(PIXELS, sizeof(*w.g.entries));
    w.g.entry_first = mem_alloc(PIXELS + 1, sizeof(uint32_t));
    w.half[0] = mem_alloc(PACKETS * 3 * PACKET, sizeof(float));
    w.half[1] = mem_alloc(PACKETS * 3 * PACKET, sizeof(float));
    w.out = mem_alloc(PACKETS * 3 * PACKET, sizeof(float));
    for (uint32_t i = 0; i < PIXELS; i++) {
        struct shade_packet *p = &w.g.packets[i / PACKET];
        const uint32_t l = i % PACKET;
        p->kind = LOBE_LAMBERT;
        p->count = PACKET;
        p->x[l] = 0.1f * ((float)(i % WIDTH) - WIDTH / 2);
        p->y[l] = 0.1f * ((float)(i / WIDTH) - HEIGHT / 2);
        p->z[l] = -10.0f;
        p->ns_z[l] = p->ng_z[l] = 1.0f;
        for (int c = 0; c < 3; c++)
            p->diffuse[c][l] = 0.5f;
        w.g.entries[i] = (struct gbuffer_entry){ i, { 1.0f, 1.0f, 1.0f } };
        w.g.entry_first[i + 1] = i + 1;
    }
    return w;
}

static void wall_finish(struct wall *w)
{
    mem_free(w->g.packets);
    mem_free(w->g.entries);
    mem_free(w->g.entry_first);
    mem_free(w->half[0]);
    mem_free(w->half[1]);
    mem_free(w->out);
}

static float *at(float *lo, uint32_t pixel, int c)
{
    return &lo[((size_t)(pixel / PACKET) * 3 + (size_t)c) * PACKET + pixel % PACKET];
}

/* Both halves: mean(x) plus independent noise, even over +-spread. */
static void light(struct wall *w, float (*mean)(uint32_t x), float spread, uint64_t seed)
{
    struct rng r = { seed };

    for (uint32_t i = 0; i < PIXELS; i++)
        for (int k = 0; k < 2; k++)
            for (int c = 0; c < 3; c++)
                *at(w->half[k], i, c) = mean(i % WIDTH) + spread * (2.0f * (float)rng_next(&r) - 1.0f);
}

static void run(struct wall *w, const char *level)
{
    struct filter *f = filter_create(&w->g, &w->view, level);

    assert_non_null(f);
    filter_run(f, (const float *const[]){ w->half[0], w->half[1] }, w->out);
    filter_destroy(f);
}

static float one(uint32_t x)
{
    (void)x;
    return 1.0f;
}

static float step(uint32_t x)
{
    return x < WIDTH / 2 ? 1.0f : 4.0f;
}

/* Mean squared distance of the output from mean(x), over columns first .. end - 1. */
static double error_of(struct wall *w, float (*mean)(uint32_t x), uint32_t first, uint32_t end)
{
    double sum = 0.0;

    for (uint32_t i = 0; i < PIXELS; i++)
        for (int c = 0; c < 3 && i % WIDTH >= first && i % WIDTH < end; c++)
            sum += pow((double)(*at(w->out, i, c) - mean(i % WIDTH)), 2.0);
    return sum / (3.0 * HEIGHT * (end - first));
}

static void light_without_noise_passes_unchanged(void **state)
{
    struct wall w = wall_make();

    (void)state;
    light(&w, step, 0.0f, 1);
    run(&w, NULL);
    for (uint32_t i = 0; i < PIXELS; i++)
        assert_float_equal(*at(w.out, i, 0), step(i % WIDTH), 1e-6);
    wall_finish(&w);
}

/* Five levels of the spline have a variance of 1 + 4 + 16 + 64 + 256 = 341 pixels squared, and would leave 1 / (4 pi
 * 341) of white noise. Borders and rejected neighbours leave more: 1 / 100 is required. */
static void noise_on_a_plain_wall_is_averaged_away(void **state)
{
    const double spread = 0.5, variance = spread * spread / 3.0 / 2.0; /* of the halves' mean */
    struct wall w = wall_make();
    double sum = 0.0;

    (void)state;
    light(&w, one, (float)spread, 2);
    run(&w, NULL);
    const double left = error_of(&w, one, 0, WIDTH) / variance;
    print_message("%.4f of the variance is left\n", left);
    assert_true(left < 0.01);
    for (uint32_t i = 0; i < PIXELS; i++)
        sum += (double)*at(w.out, i, 1);
    /* the mean of 3072 pixels has a standard error of 0.0037 */
    assert_float_equal(sum / PIXELS, 1.0, 0.015);
    wall_finish(&w);
}

/* A step of light that noise does not hide, ten of its standard deviations: next to it no light of the other side. */
static void an_edge_of_light_above_the_noise_stays(void **state)
{
    struct wall w = wall_make();

    (void)state;
    light(&w, step, 0.3f, 3);
    run(&w, NULL);
    const double beside = error_of(&w, step, WIDTH / 2 - 2, WIDTH / 2 + 2);
    print_message("squared error beside the edge %.5f, of the noise 0.015\n", beside);
    assert_true(beside < 0.015);
    wall_finish(&w);
}

/* Noise that hides the step, which only the surfaces tell apart: beside their border the light stays apart all the
 * same. Mixed, the four columns on either side come near 2.5. */
static void expect_apart(struct wall *w)
{
    double sum[2] = { 0.0, 0.0 };

    light(w, step, 8.0f, 4);
    run(w, NULL);
    for (uint32_t i = 0; i < PIXELS; i++)
        if (i % WIDTH >= WIDTH / 2 - 4 && i % WIDTH < WIDTH / 2 + 4)
            sum[i % WIDTH >= WIDTH / 2] += (double)*at(w->out, i, 0) / (4 * HEIGHT);
    print_message("means %.3f and %.3f\n", sum[0], sum[1]);
    assert_float_equal(sum[0], 1.0, 0.12); /* without the light of the other side: 0.05 measured */
    assert_float_equal(sum[1], 4.0, 0.12);
}

static void light_does_not_cross_creases(void **state)
{
    struct wall w = wall_make();

    (void)state;
    for (uint32_t i = 0; i < PIXELS; i++)
        if (i % WIDTH >= WIDTH / 2) {
            w.g.packets[i / PACKET].ns_z[i % PACKET] = 0.6f;
            w.g.packets[i / PACKET].ns_x[i % PACKET] = 0.8f;
        }
    expect_apart(&w);
    wall_finish(&w);
}

/* Parallel walls, one 20 pixels' widths behind the other. */
static void light_does_not_cross_gaps(void **state)
{
    struct wall w = wall_make();

    (void)state;
    for (uint32_t i = 0; i < PIXELS; i++)
        if (i % WIDTH >= WIDTH / 2)
            w.g.packets[i / PACKET].z[i % PACKET] = -8.0f;
    for (uint32_t i = 0; i < PIXELS; i++)
        w.g.packets[i / PACKET].z[i % PACKET] *= 4.0f; /* 8 apart: beyond two pixels even at the last level */
    expect_apart(&w);
    wall_finish(&w);
}

static void what_a_mirror_shows_stays_apart(void **state)
{
    struct wall w = wall_make();

    (void)state;
    for (uint32_t i = 0; i < PIXELS; i++)
        w.g.packets[i / PACKET].behind[i % PACKET] = i % WIDTH >= WIDTH / 2;
    expect_apart(&w);
    wall_finish(&w);
}

/* Light is filtered before the surface's reflectance, so that textures stay sharp: white and black tiles. */
static void textures_stay_sharp(void **state)
{
    struct wall w = wall_make();
    struct rng r = { 5 };

    (void)state;
    for (uint32_t i = 0; i < PIXELS; i++) {
        const float tile = i % WIDTH / 4 % 2 ? 0.9f : 0.1f;
        for (int c = 0; c < 3; c++) {
            w.g.packets[i / PACKET].diffuse[c][i % PACKET] = tile;
            for (int k = 0; k < 2; k++)
                *at(w.half[k], i, c) = tile * (1.0f + 1.8f * ((float)rng_next(&r) - 0.5f));
        }
    }
    run(&w, NULL);
    for (uint32_t i = 0; i < PIXELS; i++)
        assert_float_equal(*at(w.out, i, 2) / w.g.packets[i / PACKET].diffuse[2][i % PACKET], 1.0, 0.3);
    wall_finish(&w);
}

/* An even wall with noise: hardly any of its variance is left. */
static void expect_filtered(struct wall *w)
{
    light(w, one, 0.5f, 6);
    run(w, NULL);
    const double left = error_of(w, one, 0, WIDTH) / (0.25 / 6.0);
    print_message("%.4f of the variance is left\n", left);
    assert_true(left < 0.05);
}

/* A point that a pixel shows beside a larger one is not in the image, but takes its light from there. */
static void small_points_of_a_pixel_are_filtered_too(void **state)
{
    struct wall w = wall_make();

    (void)state;
    /* pixel 2k shows points 2k and 2k + 1, and pixel 2k + 1 nothing */
    for (uint32_t i = 0; i < PIXELS; i++) {
        w.g.entries[i].weight[0] = w.g.entries[i].weight[1] = w.g.entries[i].weight[2] = i % 2 ? 0.3f : 0.7f;
        w.g.entry_first[i + 1] = 2 * (i / 2 + 1);
    }
    expect_filtered(&w);
    wall_finish(&w);
}

static float dim(uint32_t x)
{
    (void)x;
    return 0.08f;
}

/* Their neighbours, all larger points, are turned away by angles at which weights are about the smallest float. */
static void small_points_among_strangers_keep_their_light(void **state)
{
    struct wall w = wall_make();

    (void)state;
    light(&w, dim, 0.0f, 6);
    for (uint32_t i = 0; i < PIXELS; i++) {
        struct shade_packet *p = &w.g.packets[i / PACKET];
        for (int c = 0; c < 3; c++)
            w.g.entries[i].weight[c] = 0.4f - 0.1f * (float)(i % 4);
        w.g.entry_first[i + 1] = 4 * (i / 4 + 1);
        if (i % 4 < 2)
            continue;
        const float cosine = 0.15f + 0.15f * (float)i / PIXELS;
        p->ns_z[i % PACKET] = p->ng_z[i % PACKET] = cosine;
        p->ns_x[i % PACKET] = p->ng_x[i % PACKET] = sqrtf(1.0f - cosine * cosine);
    }
    run(&w, NULL);
    for (uint32_t i = 0; i < PIXELS; i++)
        assert_float_equal(*at(w.out, i, 0), 0.08, 1e-4);
    wall_finish(&w);
}

/* Pixel 2k shows both sides of a leaf, points 2k and 2k + 1, or a coat and what is below it. Both have neighbours of
 * their kind. */
static void expect_both_filtered(void (*make_other)(struct shade_packet *p, uint32_t lane))
{
    struct wall w = wall_make();

    for (uint32_t i = 0; i < PIXELS; i++) {
        w.g.entry_first[i + 1] = 2 * (i / 2 + 1);
        if (i % 2)
            make_other(&w.g.packets[i / PACKET], i % PACKET);
    }
    expect_filtered(&w);
    wall_finish(&w);
}

static void turn_over(struct shade_packet *p, uint32_t lane)
{
    p->ns_z[lane] = p->ng_z[lane] = -1.0f;
}

static void put_on_a_coat(struct shade_packet *p, uint32_t lane)
{
    p->layer[lane] = LAYER_COAT;
}

static void put_behind(struct shade_packet *p, uint32_t lane)
{
    p->behind[lane] = 1;
}

static void both_sides_of_a_leaf_are_filtered(void **state)
{
    (void)state;
    expect_both_filtered(turn_over);
}

static void a_coat_and_what_is_below_are_filtered(void **state)
{
    (void)state;
    expect_both_filtered(put_on_a_coat);
}

static void what_a_pane_reflects_is_filtered(void **state)
{
    (void)state;
    expect_both_filtered(put_behind);
}

/* A point like no other, that found something bright by chance, and one that is bright. */
static void a_speck_goes_and_a_light_stays(void **state)
{
    const uint32_t speck = 20 * WIDTH + 20, lit = 20 * WIDTH + 40;
    struct wall w = wall_make();

    (void)state;
    light(&w, one, 0.5f, 8);
    for (int c = 0; c < 3; c++) {
        *at(w.half[0], speck, c) = 200.0f;
        *at(w.half[1], speck, c) = 180.0f;
        *at(w.half[0], lit, c) = 200.0f;
        *at(w.half[1], lit, c) = 198.0f;
    }
    w.g.packets[speck / PACKET].behind[speck % PACKET] = 1;
    w.g.packets[lit / PACKET].behind[lit % PACKET] = 1;
    run(&w, NULL);
    assert_true(*at(w.out, speck, 0) < 1.5f);
    assert_float_equal(*at(w.out, lit, 0), 199.0, 1e-3);
    wall_finish(&w);
}

/* A shadow one pixel wide. Bright paths found by chance, three pixels away, raise the variance of 7 x 7 points, so that
 * the filter's weights take it for noise. Both its halves say otherwise. A half that is dark by itself does not. */
static void run_thin_shadow(uint8_t behind, double *shadow, double *lone_point)
{
    const uint32_t y = 20, lone = 35 * WIDTH + 30;
    struct wall w = wall_make();

    for (uint32_t i = 0; i < PIXELS; i++)
        w.g.packets[i / PACKET].behind[i % PACKET] = behind;
    light(&w, one, 0.2f, 9);
    for (uint32_t x = 0; x < WIDTH; x++)
        for (int c = 0; c < 3; c++) {
            *at(w.half[0], y * WIDTH + x, c) *= 0.1f;
            *at(w.half[1], y * WIDTH + x, c) *= 0.1f;
            *at(w.half[x / 16 % 2], (y - 3) * WIDTH + x, c) += x % 16 ? 0.0f : 14.0f;
            *at(w.half[x / 16 % 2], (y + 3) * WIDTH + x, c) += x % 16 ? 0.0f : 14.0f;
        }
    for (int c = 0; c < 3; c++)
        *at(w.half[0], lone, c) = 0.0f;
    run(&w, NULL);
    *shadow = 0.0;
    for (uint32_t x = 0; x < WIDTH; x++)
        *shadow += *at(w.out, y * WIDTH + x, 1) / WIDTH;
    *lone_point = *at(w.out, lone, 1);
    print_message("%.3f in a shadow of 0.1, %.3f where one half is dark\n", *shadow, *lone_point);
    wall_finish(&w);
}

static void a_shadow_thinner_than_the_filter_stays(void **state)
{
    double shadow, lone;

    (void)state;
    run_thin_shadow(0, &shadow, &lone);
    assert_true(shadow < 0.55);
    assert_true(lone > 0.8);
}

static void behind_glass_it_counts_as_noise(void **state)
{
    double shadow, lone;

    (void)state;
    run_thin_shadow(1, &shadow, &lone);
    assert_true(shadow > 0.55);
    assert_true(lone > 0.8);
}

/* Points beside larger ones, as behind frosted glass: all at depths of their own, and a path in ten finds light. */
static void lonely_small_points_keep_their_light_in_the_mean(void **state)
{
    struct rng r = { 12 };
    struct wall w = wall_make();
    double sum = 0.0, truth = 0.0;

    (void)state;
    light(&w, one, 0.5f, 6);
    for (uint32_t i = 0; i < PIXELS; i++) {
        w.g.entries[i].weight[0] = w.g.entries[i].weight[1] = w.g.entries[i].weight[2] = i % 2 ? 0.3f : 0.7f;
        w.g.entry_first[i + 1] = 2 * (i / 2 + 1);
        if (i % 2 == 0)
            continue;
        w.g.packets[i / PACKET].z[i % PACKET] = -20.0f - 100.0f * (float)rng_next(&r);
        for (int k = 0; k < 2; k++) {
            const float found = rng_next(&r) < 0.1f ? 5.0f : 0.0f;
            for (int c = 0; c < 3; c++)
                *at(w.half[k], i, c) = found;
        }
    }
    run(&w, NULL);
    for (uint32_t i = 1; i < PIXELS; i += 2) {
        sum += *at(w.out, i, 0);
        truth += 0.5 * (*at(w.half[0], i, 0) + *at(w.half[1], i, 0));
    }
    print_message("%.4f of the light is left\n", sum / truth);
    assert_float_equal(sum / truth, 1.0, 0.05);
    wall_finish(&w);
}

static void every_cpu_level_has_the_same_bits(void **state)
{
    struct wall w = wall_make();
    float *first = mem_alloc(PACKETS * 3 * PACKET, sizeof(float));
    int levels = 0;

    (void)state;
    light(&w, step, 2.0f, 7);
    run(&w, cpu_names[CPU_BASELINE]);
    memcpy(first, w.out, PACKETS * 3 * PACKET * sizeof(float));
    for (enum cpu_level level = CPU_BASELINE; level <= cpu_best(); level++, levels++) {
        assert_int_equal(filter_kernel_select(cpu_names[level])->cpu, level);
        run(&w, cpu_names[level]);
        assert_memory_equal(first, w.out, PACKETS * 3 * PACKET * sizeof(float));
    }
    print_message("%d levels\n", levels);
    mem_free(first);
    wall_finish(&w);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(light_without_noise_passes_unchanged),
    cmocka_unit_test(noise_on_a_plain_wall_is_averaged_away),
    cmocka_unit_test(an_edge_of_light_above_the_noise_stays),
    cmocka_unit_test(light_does_not_cross_creases),
    cmocka_unit_test(light_does_not_cross_gaps),
    cmocka_unit_test(what_a_mirror_shows_stays_apart),
    cmocka_unit_test(textures_stay_sharp),
    cmocka_unit_test(small_points_of_a_pixel_are_filtered_too),
    cmocka_unit_test(small_points_among_strangers_keep_their_light),
    cmocka_unit_test(both_sides_of_a_leaf_are_filtered),
    cmocka_unit_test(a_coat_and_what_is_below_are_filtered),
    cmocka_unit_test(what_a_pane_reflects_is_filtered),
    cmocka_unit_test(a_speck_goes_and_a_light_stays),
    cmocka_unit_test(a_shadow_thinner_than_the_filter_stays),
    cmocka_unit_test(behind_glass_it_counts_as_noise),
    cmocka_unit_test(lonely_small_points_keep_their_light_in_the_mean),
    cmocka_unit_test(every_cpu_level_has_the_same_bits),
};
UNIT_MAIN(tests)
