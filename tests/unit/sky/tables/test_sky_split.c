/* The sky of the cache of light transport: its split keeps the energy, its cells the mean, its samples the rest. */
#include "sky/tables/sky_split.h"
#include "support/skies.h"

#include <omp.h>

/* Energies of both parts by colour, and those of the sky itself. */
static void sum_energies(const struct sky_split *s, const struct environment *e, double parts[3], double whole[3])
{
    const uint32_t n = e->n;

    for (int c = 0; c < 3; c++)
        parts[c] = whole[c] = 0.0;
    for (uint32_t k = 0; k < SKY_CELLS; k++)
        for (int c = 0; c < 3; c++)
            parts[c] += (double)s->cells[k / SKY_CHUNK][c][k % SKY_CHUNK] * sky_cell_solid_angle(k);
    for (uint32_t k = 0; k < s->sun_count; k++) {
        const struct texel *t = &e->texels[s->sun[k]];
        const float g = rgb_luminance(t->r, t->g, t->b);
        const double part = (1.0 - (double)sky_lower(s->level, g)) * e->solid_angle[s->sun[k] % (n * n)];
        parts[0] += part * (double)t->r;
        parts[1] += part * (double)t->g;
        parts[2] += part * (double)t->b;
    }
    for (uint32_t k = 0; k < CUBE_FACES * n * n; k++) {
        const double part = e->solid_angle[k % (n * n)];
        whole[0] += part * (double)e->texels[k].r;
        whole[1] += part * (double)e->texels[k].g;
        whole[2] += part * (double)e->texels[k].b;
    }
}

static struct frame random_sky(uint64_t seed)
{
    struct frame f = sky_constant(48, 24, 0.0f);
    struct rng r = { seed };

    for (uint32_t i = 0; i < 3 * 48 * 24; i++)
        f.rgb[i] = (float)pow(rng_next(&r), 8.0) * 100.0f;
    return f;
}

/* Sizes that 16 divides, that divide 16, and neither. */
static void the_split_keeps_the_energy(void **state)
{
    static const uint32_t sizes[] = { 64, 32, 24, 16, 10, 8, 3, 1 };
    struct sky_split s = { .level = 0.0f }; /* one for all: skies may change their size */
    (void)state;

    for (size_t k = 0; k < sizeof(sizes) / sizeof(sizes[0]); k++)
        for (int kind = 0; kind < 3; kind++) {
            struct environment *e = sky_environment(kind == 0   ? sky_with_sun(64, 32, 1e5f)
                                                    : kind == 1 ? sky_overcast(64, 32)
                                                                : random_sky(k),
                                                    sizes[k], 30.0);
            double parts[3], whole[3];
            assert_int_equal(sky_split_take(&s, e), ERR_OK);
            sum_energies(&s, e, parts, whole);
            for (int c = 0; c < 3; c++)
                assert_true(fabs(parts[c] - whole[c]) < 1e-6 * whole[c]);
            assert_true(kind != 0 || sizes[k] < 16 || s.sun_count > 0);
            assert_true(kind != 1 || s.sun_count == 0);
            environment_destroy(e);
        }
    sky_split_finish(&s);
}

static void a_constant_sky_has_constant_cells(void **state)
{
    static const uint32_t sizes[] = { 64, 24, 10, 1 };
    struct sky_split s = { .level = 0.0f };
    (void)state;

    for (size_t k = 0; k < sizeof(sizes) / sizeof(sizes[0]); k++) {
        struct environment *e = sky_environment(sky_constant(32, 16, 0.75f), sizes[k], 0.0);
        assert_int_equal(sky_split_take(&s, e), ERR_OK);
        assert_int_equal(s.sun_count, 0);
        for (uint32_t i = 0; i < SKY_CELLS; i++)
            for (int c = 0; c < 3; c++)
                assert_true(fabsf(s.cells[i / SKY_CHUNK][c][i % SKY_CHUNK] - 0.75f) < 2e-5f);
        environment_destroy(e);
    }
    sky_split_finish(&s);
}

static void a_black_sky_is_black_in_both_parts(void **state)
{
    struct environment *e = sky_environment(sky_constant(32, 16, 0.0f), 32, 0.0);
    struct sky_split s = { .level = 0.0f };
    (void)state;

    assert_int_equal(sky_split_take(&s, e), ERR_OK);
    assert_int_equal(s.sun_count, 0);
    for (uint32_t i = 0; i < SKY_CELLS; i++)
        assert_true(s.cells[i / SKY_CHUNK][0][i % SKY_CHUNK] == 0.0f);
    environment_destroy(e);
    sky_split_finish(&s);
}

/* One texel in the dark: there is no level, and all of it is bright. */
static void a_lone_light_is_bright_as_a_whole(void **state)
{
    struct frame f = sky_constant(64, 32, 0.0f);
    struct sky_split s = { .level = 0.0f };
    double parts[3], whole[3];
    (void)state;

    sky_paint(&f, 20, 8, 5.0f, 4.0f, 3.0f);
    struct environment *e = sky_environment(f, 64, 0.0);
    assert_int_equal(sky_split_take(&s, e), ERR_OK);
    sum_energies(&s, e, parts, whole);
    assert_true(s.level == 0.0f && s.sun_count > 0);
    for (int c = 0; c < 3; c++)
        assert_true(fabs(parts[c] - whole[c]) < 1e-6 * whole[c]);
    environment_destroy(e);
    sky_split_finish(&s);
}

/* A sun of which a good part is below the level. Radiance over density is nearly constant, but for colour and the place
 * within a texel: 4096 stratified samples give its integral to 1e-4, and any error in density by a hundredth would be
 * seen a hundred times over. */
static void samples_of_the_bright_part_give_its_energy(void **state)
{
    struct environment *e = sky_environment(sky_with_sun(64, 32, 60.0f), 64, 0.0);
    struct sky_split s = { .level = 0.0f };
    double sum[3] = { 0.0 }, parts[3], whole[3];
    enum { SAMPLES = 4096 };
    (void)state;

    assert_int_equal(sky_split_take(&s, e), ERR_OK);
    sum_energies(&s, e, parts, whole);
    for (uint32_t k = 0; k < SKY_CELLS; k++)
        for (int c = 0; c < 3; c++)
            parts[c] -= (double)s.cells[k / SKY_CHUNK][c][k % SKY_CHUNK] * sky_cell_solid_angle(k);
    for (uint32_t i = 0; i < SAMPLES; i++) {
        double x[2];
        float w[3], rgb[3], u, v;
        rng_sobol2(5, i, x);
        sky_split_sample(&s, e, x, w, rgb);
        const uint32_t at = cube_texel(e->n, w, &u, &v);
        assert_true(rgb_luminance(e->texels[at].r, e->texels[at].g, e->texels[at].b) > s.level);
        for (int c = 0; c < 3; c++)
            sum[c] += (double)rgb[c] / SAMPLES;
    }
    for (int c = 0; c < 3; c++)
        assert_true(fabs(sum[c] - parts[c]) < 3e-4 * parts[c]);
    environment_destroy(e);
    sky_split_finish(&s);
}

static void threads_do_not_change_the_sky(void **state)
{
    struct environment *e = sky_environment(random_sky(9), 64, 0.0);
    struct sky_split one = { .level = 0.0f }, many = { .level = 0.0f };
    const int threads = omp_get_max_threads();
    (void)state;

    omp_set_num_threads(1);
    assert_int_equal(sky_split_take(&one, e), ERR_OK);
    omp_set_num_threads(3);
    assert_int_equal(sky_split_take(&many, e), ERR_OK);
    omp_set_num_threads(threads);
    assert_memory_equal(one.cells, many.cells, sizeof(one.cells));
    assert_int_equal(one.sun_count, many.sun_count);
    assert_memory_equal(one.sun_cdf, many.sun_cdf, one.sun_count * sizeof(*one.sun_cdf));
    environment_destroy(e);
    sky_split_finish(&one);
    sky_split_finish(&many);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(the_split_keeps_the_energy),
    cmocka_unit_test(a_constant_sky_has_constant_cells),
    cmocka_unit_test(a_black_sky_is_black_in_both_parts),
    cmocka_unit_test(a_lone_light_is_bright_as_a_whole),
    cmocka_unit_test(samples_of_the_bright_part_give_its_energy),
    cmocka_unit_test(threads_do_not_change_the_sky),
};
UNIT_MAIN(tests)
