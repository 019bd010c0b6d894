/* All loops that there is more than one build of, each CPU level against the baseline, over seeds, tails and hurtful
 * inputs: the same order of operations and no contraction, so the same bits are asked for. The seed is printed and may
 * be given as RELIGHT_TEST_SEED. */
#include "light/estimators/levels.h"
#include "light/estimators/points.h"

#include "base/cpu.h"
#include "image/film/film.h"
#include "image/film/tone_kernel.h"
#include "light/cache_indirect/internal.h"
#include "scene/surface/lanes.h"

#include <float.h>
#include <omp.h>

static uint64_t first_seed(void)
{
    const char *text = getenv("RELIGHT_TEST_SEED");
    const uint64_t seed = text ? strtoull(text, NULL, 0) : 1;
    printf("seed %llu\n", (unsigned long long)seed);
    return seed;
}

/* Materials and directions that hurt: no albedo at all, exponent 0 and 10^4, a viewer at grazing angle, normals along
 * the axes and against the z axis, where frames have their pole. */
static void make_hurtful(struct gbuffer *g, uint64_t seed)
{
    struct rng r = { seed };
    static const float exponents[] = { 0.0f, 1.0f, 17.5f, 150.0f, 1e4f };

    points_scatter(g, seed);
    for (uint32_t i = 0; i < g->packet_count; i++)
        for (int l = 0; l < PACKET; l++) {
            struct shade_packet *p = &g->packets[i];
            p->gloss[l] = p->kind == LOBE_GGX ? (float)(0.001 + rng_next(&r)) : exponents[(int)(5.0 * rng_next(&r))];
            for (int c = 0; c < 3; c++) {
                p->diffuse[c][l] = rng_next(&r) < 0.2 ? 0.0f : (float)(0.5 * rng_next(&r));
                p->specular[c][l] = rng_next(&r) < 0.2 ? 0.0f : (float)(0.5 * rng_next(&r));
            }
            if (l == 3)
                p->ns_x[l] = p->ns_y[l] = p->ng_x[l] = p->ng_y[l] = 0.0f, p->ns_z[l] = p->ng_z[l] = -1.0f;
            if (l == 5)
                p->valid[l] = 0;
        }
}

static void every_level_gives_the_bits_of_the_baseline(void **state)
{
    enum { PACKETS = 6 };
    static float want[PACKETS * 3 * PACKET], got[PACKETS * 3 * PACKET + PACKET];
    const struct kernels *const *all = kernels_all();
    const uint64_t seed = first_seed();
    (void)state;
    struct environment *e = sky_environment(sky_with_sun(64, 32, 1e6f), 32, 10.0);
    for (int kind = LOBE_LAMBERT; kind <= LOBE_GGX; kind++) {
        struct gbuffer g = points_make(PACKETS, (enum lobe_kind)kind, 0, 0, 0);
        for (uint64_t s = seed; s < seed + 8; s++) {
            make_hurtful(&g, s);
            for (int m = METHOD_UNIFORM; m <= METHOD_MIS; m++) {
                struct direct *baseline = direct_create(all[0]);
                shade(baseline, &g, e, (enum method)m, 21, s, want);
                direct_destroy(baseline);
                for (size_t k = 1; all[k]; k++) {
                    struct direct *d = direct_create(all[k]);
                    memset(got, 0x55, sizeof(got));
                    shade(d, &g, e, (enum method)m, 21, s, got);
                    for (int l = 0; l < PACKET; l++) /* the guard behind the last packet stands */
                        assert_int_equal(((uint32_t *)got)[PACKETS * 3 * PACKET + l], 0x55555555);
                    if (memcmp(want, got, sizeof(want)) != 0)
                        printf("level %s, %s, seed %llu\n", all[k]->level, method_name((enum method)m),
                               (unsigned long long)s);
                    assert_memory_equal(want, got, sizeof(want));
                    direct_destroy(d);
                }
            }
        }
        points_free(&g);
    }
    environment_destroy(e);
}

/* Strata of other kinds, and sets. One thread and two, too. */
static void every_level_gives_the_same_bits_at_all_options(void **state)
{
    enum { PACKETS = 40 };
    static float want[PACKETS * 3 * PACKET], got[PACKETS * 3 * PACKET];
    static const struct direct_desc options[] = {
        { .method = METHOD_FACES, .cells = 8, .samples = 21 },
        { .method = METHOD_FACES_UNIFORM, .cells = 2, .sun = true, .samples = 40 },
        { .method = METHOD_FACES, .sun = true, .scatter = true, .samples = 9 },
        { .method = METHOD_MIS, .cells = 4, .sun = true, .compensate = COMPENSATE_ON, .scatter = true, .samples = 33 },
        { .method = METHOD_MIS, .sun = true, .compensate = COMPENSATE_AUTO, .samples = 7 },
        { .method = METHOD_LATLONG, .samples = 16 },
        { .method = METHOD_LATLONG_ROWS, .scatter = true, .samples = 16 },
    };
    const struct kernels *const *all = kernels_all();
    const uint64_t seed = first_seed();
    struct direct_stats stats;
    (void)state;
    struct environment *e = sky_environment(sky_with_sun(64, 32, 1e6f), 32, 10.0);
    for (int kind = LOBE_LAMBERT; kind <= LOBE_GGX; kind++) {
        struct gbuffer g = points_make(PACKETS, (enum lobe_kind)kind, 0, 0, 0);
        make_hurtful(&g, seed);
        for (size_t o = 0; o < sizeof(options) / sizeof(options[0]); o++)
            for (size_t k = 0; all[k]; k++)
                for (int threads = 1; threads <= 2; threads++) {
                    struct direct_desc desc = options[o];
                    struct direct *d = direct_create(all[k]);
                    float *lo = k == 0 && threads == 1 ? want : got;
                    desc.seed = seed;
                    desc.no_visibility = true;
                    omp_set_num_threads(threads);
                    assert_int_equal(direct_shade(d, &g, NULL, e, &desc, lo, &stats), ERR_OK);
                    assert_memory_equal(want, lo, sizeof(want));
                    for (size_t i = 0; i < PACKETS * 3 * PACKET; i++)
                        assert_true(isfinite(lo[i]) && lo[i] >= 0.0f);
                    direct_destroy(d);
                }
        points_free(&g);
    }
    environment_destroy(e);
}

/* Counts of samples that leave every remainder of a vector of 16, at every share of them. */
static void every_level_gives_the_same_bits_at_every_count(void **state)
{
    enum { PACKETS = 2 };
    static float want[PACKETS * 3 * PACKET], got[PACKETS * 3 * PACKET];
    const struct kernels *const *all = kernels_all();
    const uint64_t seed = first_seed();
    (void)state;
    struct environment *e = sky_environment(sky_with_sun(64, 32, 1e6f), 32, 10.0);
    for (int kind = LOBE_LAMBERT; kind <= LOBE_GGX; kind++) {
        struct gbuffer g = points_make(PACKETS, (enum lobe_kind)kind, 0, 0, 0);
        make_hurtful(&g, seed);
        for (int m = METHOD_UNIFORM; m <= METHOD_MIS; m++)
            for (uint32_t n = 1; n <= 35; n++)
                for (size_t k = 0; all[k]; k++) {
                    struct direct *d = direct_create(all[k]);
                    shade(d, &g, e, (enum method)m, n, seed + n, k == 0 ? want : got);
                    direct_destroy(d);
                    if (k > 0 && memcmp(want, got, sizeof(want)) != 0)
                        fail_msg("level %s, %s, %u samples", all[k]->level, method_name((enum method)m), n);
                }
        points_free(&g);
    }
    environment_destroy(e);
}

/* The tone map as programs call it; tests/unit/image/film/test_tone_kernel.c looks at its loop alone. */
static void every_level_gives_the_same_codes(void **state)
{
    enum { WIDEST = 600, GUARD = 64 };
    static const float odd[] = { 0.0f,     -0.0f,     0x1p-149f, -0x1p-149f, FLT_MIN, FLT_MAX, -FLT_MAX,
                                 INFINITY, -INFINITY, NAN,       -NAN,       -1.0f,   0.18f,   10.0f };
    static const double gains[] = { 1.0, 0.01, 1e30, 1e-30, INFINITY, NAN };
    static float rgb[3 * WIDEST];
    static uint8_t want[3 * WIDEST + GUARD], got[3 * WIDEST + GUARD];
    const struct kernels *const *all = kernels_all();
    const uint64_t seed = first_seed();
    (void)state;

    for (uint64_t s = seed; s < seed + 200; s++) {
        struct rng r = { s };
        for (size_t i = 0; i < 3 * WIDEST; i++)
            rgb[i] = rng_next(&r) < 0.2 ? odd[(size_t)(rng_next(&r) * (sizeof(odd) / sizeof(odd[0])))]
                                        : (float)exp2(18.0 * rng_next(&r) - 14.0);
        const uint32_t width = s - seed < 48 ? (uint32_t)(s - seed) + 1 : 1 + (uint32_t)(rng_next(&r) * WIDEST);
        for (int c = TONE_FILMIC; c <= TONE_LINEAR; c++)
            for (size_t k = 0; all[k]; k++) {
                const struct tone_desc desc = { gains[s % 6], (enum tone_curve)c, all[k]->level };
                uint8_t *out = k == 0 ? want : got;
                memset(out, 0x55, sizeof(got));
                tone_map(rgb, width, 1, &desc, out);
                if (k > 0 && memcmp(want, got, sizeof(want)) != 0)
                    fail_msg("level %s, %s, %u pixels, seed %llu", all[k]->level,
                             choice_name(tone_choices, (int)desc.curve), width, (unsigned long long)s);
                for (size_t i = 3 * (size_t)width; i < sizeof(got); i++) /* what lies behind the image stands */
                    assert_int_equal(out[i], 0x55);
            }
    }
}

static void one_name_lowers_every_kernel(void **state)
{
    const struct kernels *const *direct = kernels_all();
    const struct tone_kernel *const *tone = tone_kernels_all();
    const struct kernels *chosen;
    struct reason why;
    enum cpu_level level;
    int k = 0;
    (void)state;

    for (; direct[k] && tone[k]; k++) {
        assert_int_equal(cpu_select(cpu_names[k], &level, &why), ERR_OK);
        assert_int_equal(level, k);
        assert_int_equal(kernels_select(cpu_names[level], &chosen, &why), ERR_OK);
        assert_string_equal(chosen->level, cpu_names[level]);
        assert_int_equal(tone_kernel_select(chosen->level)->cpu, level);
        assert_ptr_equal(tone_kernel_select(chosen->level), tone[k]);
    }
    assert_true(!direct[k] && !tone[k]); /* every level of the one is one of the other */
    assert_int_equal(k, cpu_best() + 1);
    assert_int_equal(kernels_select(NULL, &chosen, &why), ERR_OK);
    assert_ptr_equal(chosen, direct[k - 1]);
    assert_ptr_equal(tone_kernel_select(NULL), tone[k - 1]);
    assert_int_equal(kernels_select("v9", &chosen, &why), ERR_USAGE);
    assert_null(chosen);
    assert_non_null(strstr(why.text, "--cpu 'v9' is unknown"));
}

static void results_are_finite_and_not_negative(void **state)
{
    enum { PACKETS = 16 };
    static float lo[PACKETS * 3 * PACKET];
    (void)state;
    struct environment *e = sky_environment(sky_with_sun(64, 32, 1e9f), 32, 10.0);
    struct gbuffer g = points_make(PACKETS, LOBE_PHONG, 0, 0, 0);
    struct direct *d = direct_create(best_kernels());
    for (uint64_t s = 0; s < 16; s++) {
        make_hurtful(&g, s);
        for (int m = METHOD_UNIFORM; m <= METHOD_MIS; m++)
            for (uint32_t n = 1; n < 40; n += 13) {
                shade(d, &g, e, (enum method)m, n, s, lo);
                for (size_t k = 0; k < PACKETS * 3 * PACKET; k++)
                    assert_true(isfinite(lo[k]) && lo[k] >= 0.0f);
            }
    }
    direct_destroy(d);
    points_free(&g);
    environment_destroy(e);
}

static void lane_functions_keep_their_stated_error(void **state)
{
    double worst_log = 0.0, worst_exp = 0.0, worst_power = 0.0;
    (void)state;
    for (int k = 0; k < 2000000; k++) {
        const float x = (float)exp2(-100.0 + 200.0 * k / 2000000.0);
        const double want = log2((double)x);
        if (fabs(want) > 1e-3)
            worst_log = fmax(worst_log, fabs(lane_log2(x) - want) / fmax(fabs(want), 1.0));
        const float y = (float)(-126.0 + 252.0 * k / 2000000.0);
        worst_exp = fmax(worst_exp, fabs(lane_exp2(y) / exp2((double)y) - 1.0));
        const float near_one = 1.0f - (float)k * 0x1p-24f * 0.01f;
        if (near_one < 1.0f)
            worst_power = fmax(worst_power, fabs(lane_power(near_one, 1e4f) / pow((double)near_one, 1e4) - 1.0) *
                                                (pow((double)near_one, 1e4) > 1e-6));
    }
    double worst_sincos = 0.0;
    for (int k = 0; k < 1 << 20; k++) {
        const float u = (float)k * 0x1p-20f;
        float sine, cosine;
        lane_sincos(u, &sine, &cosine);
        worst_sincos = fmax(worst_sincos, fmax(fabs(sine - sin(2.0 * PI * u)), fabs(cosine - cos(2.0 * PI * u))));
    }
    assert_true(worst_sincos < 2e-7);
    printf("log2 %.2e, exp2 %.2e, power %.2e\n", worst_log, worst_exp, worst_power);
    assert_true(worst_log < 3e-7);
    assert_true(worst_exp < 3e-7);
    assert_true(worst_power < 2e-5);
    assert_true(lane_power(0.0f, 3.0f) == 0.0f && lane_power(-1.0f, 3.0f) == 0.0f);
    assert_true(lane_exp2(-200.0f) == 0.0f && lane_power(1.0f, 1e4f) == 1.0f);
}

/* Indirect light's loops: ranks that fill no sixteen and that fill them, every number of packets, all kinds and rows.
 */
static void every_level_gives_the_same_indirect_light(void **state)
{
    enum { BASIS = 48, MOST = 37, BYTES = MOST * (3 * BASIS + (int)sizeof(float) + 48 + TRANSPORT_POINTS) };
    const struct kernels *const *all = kernels_all();
    static const uint32_t ranks[] = { 1, 5, 16, 17, MOST };
    static int8_t bytes[BYTES];
    struct rng r = { first_seed() };
    _Alignas(64) float y[3 * BASIS], from[3 * BASIS];
    const size_t packet = 3 * PACKET * sizeof(float);
    (void)state;

    for (int i = 0; i < BYTES; i++)
        bytes[i] = (int8_t)(255.0 * rng_next(&r) - 127.0);
    for (int i = 0; i < 3 * BASIS; i++) {
        y[i] = (float)(4.0 * rng_next(&r) - 1.0);
        from[i] = (float)(rng_next(&r) - 0.5);
    }
    for (int kind = LOBE_LAMBERT; kind <= LOBE_GGX; kind++) {
        struct gbuffer g = points_make(TRANSPORT_PACKETS, (enum lobe_kind)kind, 0, 0, 0);
        make_hurtful(&g, r.state);
        for (size_t i = 0; i < 4 * sizeof(ranks) / sizeof(ranks[0]); i++) {
            const uint32_t rank = ranks[i / 4], points = (uint32_t)(i % 4 + 1) * PACKET;
            const struct indirect_piece q = { bytes, rank, BASIS - PACKET };
            const float gain = 0.01f, weight[3] = { 0.3f, -0.7f, 0.11f };
            const struct transport_block dark = { .packets = points / PACKET, .kind = (uint32_t)kind };
            float want[3][TRANSPORT_POINTS] = { { 0.0f } }, want_lo[TRANSPORT_PACKETS * 3 * PACKET],
                  want_sum[3 * BASIS];
            for (uint32_t k = 0; k < rank; k++)
                memcpy(bytes + k * sizeof(gain), &gain, sizeof(gain));
            for (size_t k = 0; all[k]; k++) {
                const struct indirect_kernels *b = indirect_kernels_of(all[k]);
                _Alignas(64) float z[3 * 48], lo[TRANSPORT_PACKETS * 3 * PACKET], to[3 * BASIS];
                struct transport_rows rows = { .count = TRANSPORT_ROWS };
                b->project(&q, y, BASIS, z);
                for (uint32_t row = 0; row < TRANSPORT_ROWS; row++)
                    b->expand(bytes, rank, z, indirect_columns(rank), points, rows.at[row]);
                transport_kernels_of(all[k])->cells(&dark, g.packets, NULL, &rows, lo);
                memcpy(to, y, sizeof(to));
                b->add(to, from, weight, BASIS);
                if (k == 0) {
                    memcpy(want, rows.at[0], sizeof(want));
                    memcpy(want_lo, lo, dark.packets * packet);
                    memcpy(want_sum, to, sizeof(want_sum));
                }
                assert_true(rows.at[0][0][0] != 0.0f && lo[0] >= 0.0f);
                assert_memory_equal(want, rows.at[0], sizeof(want));
                assert_memory_equal(want_lo, lo, dark.packets * packet);
                assert_memory_equal(want_sum, to, sizeof(want_sum));
            }
        }
        points_free(&g);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(every_level_gives_the_bits_of_the_baseline),
    cmocka_unit_test(every_level_gives_the_same_bits_at_all_options),
    cmocka_unit_test(every_level_gives_the_same_bits_at_every_count),
    cmocka_unit_test(every_level_gives_the_same_codes),
    cmocka_unit_test(every_level_gives_the_same_indirect_light),
    cmocka_unit_test(one_name_lowers_every_kernel),
    cmocka_unit_test(results_are_finite_and_not_negative),
    cmocka_unit_test(lane_functions_keep_their_stated_error),
};
UNIT_MAIN(tests)
