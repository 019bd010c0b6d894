/* The cache of indirect light, held to closed forms, to eye paths, and to a sun that moves. */
#include "light/cache_indirect/bounces.h"
#include "light/cache_indirect/internal.h"

#include <omp.h>

/* Means by colours over the points that are seen directly (0) and behind mirrors and glass (1), without packets that
 * the cache leaves. */
static void means_of(const struct lit *x, const struct transport *t, double mean[2][3], double count[2])
{
    const struct packet_list *left = &t->narrow;

    memset(mean, 0, 6 * sizeof(double));
    count[0] = count[1] = 0.0;
    for (uint32_t i = 0, k = 0; i < x->gbuffer->packet_count; i++) {
        const struct shade_packet *p = &x->gbuffer->packets[i];
        if (k < left->count && left->index[k] == i) {
            k++;
            continue;
        }
        for (uint32_t l = 0; l < p->count; l++) {
            count[p->behind[l]] += 1.0;
            for (int c = 0; c < 3; c++)
                mean[p->behind[l]][c] += (double)x->lo[((size_t)i * 3 + (size_t)c) * PACKET + l];
        }
    }
    for (int k = 0; k < 2; k++)
        for (int c = 0; c < 3; c++)
            mean[k][c] /= fmax(count[k], 1.0);
}

/* In a sphere's inside that is open by a share f of its area every place sees every other with equal weight [the
 * integrating sphere]: under an even sky of 1 what falls on it at once is pi f, and with what comes by way of others
 * pi f / (1 - a (1 - f)). Radiance of what does so alone: a f (a (1 - f)) / (1 - a (1 - f)). The sphere is one of flat
 * triangles; f is taken from where the open rim is, at theta = 60 degrees: (1 - cos theta) / 2 = 1/4. */
static void an_open_sphere_meets_the_closed_form(void **state)
{
    static const double albedos[2] = { 0.5, 0.9 };
    const double f = 0.25;
    (void)state;

    for (int k = 0; k < 2; k++) {
        const double a = albedos[k], want = a * f * (a * (1.0 - f)) / (1.0 - a * (1.0 - f));
        struct scene *s = scene_from(vec3_make(0, 0.2f, 0.9f), vec3_make(0, -0.5f, 0), 1.2f);
        add_sphere(s, lambert((float)a), vec3_make(0, 0, 0), 1.0f, 36, 12);
        struct lit x = lit_create(s, 24, 18);
        struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);
        struct transport *t = direct_of(&x);
        struct indirect_cache *b = indirect_of(&x, t, 1);
        double mean[2][3], count[2];
        shade_indirect(b, &x, e);
        means_of(&x, t, mean, count);
        printf("albedo %.1f: %.4f, want %.4f\n", a, mean[0][1], want);
        assert_true(count[0] > 300.0 && fabs(mean[0][1] / want - 1.0) < 0.015);
        indirect_destroy(b);
        transport_destroy(t);
        environment_destroy(e);
        lit_destroy(&x);
    }
}

/* Every kind of surface, by the mean over the image, for each colour, at points seen directly and behind mirrors and
 * glass: against 256 eye paths (128 in each commit) of each of 8 seeds, whose error is asserted, under an even sky with
 * a soft light at its side. What the cache and the paths count as this class is the same, then: a caustic, or light
 * that comes at once, would be more than the 3 % that the cache may be wrong by. */
static void it_is_the_class_that_eye_paths_find(void **state)
{
    enum { SEEDS = 8 };
    struct lit x = lit_create(mixed_court(), 40, 32);
    struct environment *e = sky_environment(sky_overcast(64, 32), 64, 0.0);
    struct transport *t = direct_of(&x);
    struct indirect_cache *b = indirect_of(&x, t, 2);
    struct tally want[2][3] = { { { 0 } } };
    const uint32_t paths = seeds_count(128, 256);
    double mean[2][3], count[2];
    (void)state;

    for (uint64_t seed = 0; seed < SEEDS; seed++) {
        clear(&x);
        walk(&x, e, PATH_INDIRECT_LIT, PATH_INDIRECT_LIT, paths, seed);
        means_of(&x, t, mean, count);
        for (int k = 0; k < 2; k++)
            for (int c = 0; c < 3; c++)
                tally_add(&want[k][c], mean[k][c]);
    }
    shade_indirect(b, &x, e);
    means_of(&x, t, mean, count);
    assert_true(count[0] > 500.0 && count[1] > 60.0);
    for (int k = 0; k < 2; k++)
        for (int c = 0; c < 3; c++) {
            const double right = tally_mean(&want[k][c]), error = tally_error(&want[k][c]);
            printf("%s, colour %d: %.5f, eye paths %.5f +- %.5f\n", k ? "behind" : "seen", c, mean[k][c], right, error);
            assert_true(error < 4e-3 * seeds_blur(128, 256) * right);
            assert_true(fabs(mean[k][c] / right - 1.0) < 0.03);
        }
    indirect_destroy(b);
    transport_destroy(t);
    environment_destroy(e);
    lit_destroy(&x);
}

static struct scene *matte_court(void)
{
    struct scene *s = scene_from(vec3_make(0.5f, 2.2f, 4.5f), vec3_make(0, 0.5f, 0), 0.8f);
    add_box(s, lambert(0.6f), vec3_make(-3, -0.2f, -3), vec3_make(3, 0, 3));
    add_box(s, lambert(0.7f), vec3_make(-3, 0, -2.2f), vec3_make(3, 2, -2));
    add_box(s, lambert(0.5f), vec3_make(-2.2f, 0, -2), vec3_make(-2, 2, 2));
    add_box(s, lambert(0.4f), vec3_make(-0.5f, 0, -0.5f), vec3_make(0.5f, 1.2f, 0.6f));
    return s;
}

/* A small sun and a dim sky: the points' own light against 4096 eye paths (2048 in each commit), squares of errors over
 * squares of light. Measured 6.5e-3 (8.9e-3); with rows and columns of cells exchanged 5.3e-2. */
static void under_a_sun_it_agrees_with_eye_paths(void **state)
{
    struct lit x = lit_create(matte_court(), 40, 32);
    struct frame sky = sky_constant(64, 32, 0.3f);
    double squares = 0.0, whole = 0.0;
    (void)state;

    sky_paint(&sky, 40, 9, 600.0f, 500.0f, 400.0f);
    struct environment *e = sky_environment(sky, 64, 0.0);
    struct transport *t = direct_of(&x);
    struct indirect_cache *b = indirect_of(&x, t, 3);
    float *want = mem_alloc(x.size, sizeof(*want));
    clear(&x);
    walk(&x, e, PATH_INDIRECT_LIT, PATH_INDIRECT_LIT, seeds_count(2048, 4096), 5);
    memcpy(want, x.lo, x.size * sizeof(*want));
    shade_indirect(b, &x, e);
    for (size_t i = 0; i < x.size; i++) {
        squares += pow((double)(x.lo[i] - want[i]), 2.0);
        whole += pow((double)want[i], 2.0);
    }
    printf("relative square error %.2e\n", squares / whole);
    assert_true(squares < 1.5e-2 * whole);
    mem_free(want);
    indirect_destroy(b);
    transport_destroy(t);
    environment_destroy(e);
    lit_destroy(&x);
}

/* The sun goes 0.1 degree a frame about the vertical axis. The second difference in time of the points, in codes of 8
 * bits where the brightest point is 255 and the tone curve is sRGB's about: everything is linear in the cells' means,
 * which bend only where the sun passes a cell's middle. Measured 0.01; with boxes instead of tents 0.5. */
static void a_moving_sun_does_not_jump(void **state)
{
    enum { FRAMES = 30 };
    struct lit x = lit_create(matte_court(), 24, 18);
    struct transport *t = direct_of(&x);
    struct indirect_cache *b = indirect_of(&x, t, 4);
    struct environment *e = environment_create(&(struct environment_desc){ .n = 128 });
    float *codes = mem_alloc(3 * x.size, sizeof(*codes)), most = 0.0f;
    double worst = 0.0;
    (void)state;

    for (uint32_t i = 0; i < FRAMES; i++) {
        struct frame sky = sky_constant(256, 128, 0.3f);
        struct reason why;
        const float on = (float)i * (0.1f * 256.0f / 360.0f); /* texels */
        const uint32_t texel = 150 + (uint32_t)on;
        const float behind = 8000.0f * (on - (float)(uint32_t)on), before = 8000.0f - behind;
        sky_paint(&sky, texel, 30, before, before, before);
        sky_paint(&sky, texel + 1, 30, behind, behind, behind);
        assert_int_equal(environment_update(e, &sky, &why), ERR_OK);
        frame_finish(&sky);
        shade_indirect(b, &x, e);
        for (size_t k = 0; k < x.size && i == 0; k++)
            most = fmaxf(most, x.lo[k]);
        float *now = codes + i % 3 * x.size;
        for (size_t k = 0; k < x.size; k++) {
            now[k] = 255.0f * powf(fminf(x.lo[k] / most, 1.0f), 1.0f / 2.2f);
            if (i >= 2)
                worst = fmax(worst, fabs((double)now[k] - 2.0 * (double)codes[(i + 2) % 3 * x.size + k] +
                                         (double)codes[(i + 1) % 3 * x.size + k]));
        }
    }
    environment_destroy(e);
    printf("largest second difference: %.3f codes\n", worst);
    assert_true(most > 0.0f && worst < 0.1);
    mem_free(codes);
    indirect_destroy(b);
    transport_destroy(t);
    lit_destroy(&x);
}

static void take_means(const struct environment *e, float out[3][SKY_CELLS])
{
    static struct indirect_tents tents;

    environment_complete_pyramid(e);
    for (uint32_t k = 0; k < INDIRECT_SKY_PARTS; k++)
        indirect_sky_part(e, k, &tents);
    indirect_sky_deal(&tents, out);
}

/* A constant sky has constant means, at any size of map. A texel's energy goes to the cells about it: their mean
 * direction by means times solid angle is the texel's within a cell's third, on edges and corners of faces too. */
static void the_tents_keep_a_constant_and_a_place(void **state)
{
    static const uint32_t sizes[4] = { 1, 20, 64, 100 };
    static float means[3][SKY_CELLS];
    struct environment *one = environment_create(&(struct environment_desc){ .n = 64 });
    struct reason why;
    (void)state;

    for (int k = 0; k < 4; k++) {
        struct environment *e = sky_environment(sky_constant(32, 16, 2.0f), sizes[k], 0.0);
        take_means(e, means);
        for (uint32_t i = 0; i < SKY_CELLS; i++)
            assert_true(fabsf(means[1][i] - 2.0f) < 1e-4f);
        environment_destroy(e);
    }
    for (uint32_t y = 2; y < 64; y += 9)
        for (uint32_t u = 1; u < 128; u += 9) {
            struct frame f = sky_constant(128, 64, 0.0f);
            const double phi = PI - 2.0 * PI * (u + 0.5) / 128.0, theta = PI * (y + 0.5) / 64.0;
            const double want[3] = { sin(theta) * sin(phi), cos(theta), sin(theta) * cos(phi) };
            double at[3] = { 0.0 }, length = 0.0, close = 0.0;
            sky_paint(&f, u, y, 1.0f, 1.0f, 1.0f);
            assert_int_equal(environment_update(one, &f, &why), ERR_OK);
            frame_finish(&f);
            take_means(one, means);
            for (uint32_t i = 0; i < CUBE_FACES * SKY_EDGE * SKY_EDGE; i++) {
                const uint32_t face = i / 256, row = i / 16 % 16, column = i % 16;
                const uint32_t cell = sky_cell(face, row, column);
                double w[3];
                cube_direction(face, -1.0 + (column + 0.5) / 8.0, -1.0 + (row + 0.5) / 8.0, w);
                const double norm = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
                for (int c = 0; c < 3; c++)
                    at[c] += (double)means[0][cell] * sky_cell_solid_angle(cell) * w[c] / norm;
            }
            for (int c = 0; c < 3; c++)
                length += at[c] * at[c];
            for (int c = 0; c < 3; c++)
                close += at[c] * want[c] / sqrt(length);
            assert_true(close > cos(0.04));
        }
    environment_destroy(one);
}

/* A sky without the tables that are left for later has the same means. */
static void a_lean_sky_will_do(void **state)
{
    static float means[2][3][SKY_CELLS];
    struct reason why;
    (void)state;

    for (int lean = 0; lean < 2; lean++) {
        struct environment *e = environment_create(&(struct environment_desc){ .n = 256, .lean = lean });
        struct frame f = sky_with_sun(64, 32, 2e3f);
        assert_int_equal(environment_update(e, &f, &why), ERR_OK);
        frame_finish(&f);
        take_means(e, means[lean]);
        assert_true(environment_is_complete(e) == !lean);
        environment_destroy(e);
    }
    assert_true(means[0][0][0] > 0.0f);
    assert_memory_equal(means[0], means[1], sizeof(means[0]));
}

/* Over many numbers the cells of a texel's direction are those that the texel is dealt to, as often as it is: the means
 * of a sky whose texels have nothing to do with each other are those of the cells' texels by these numbers. Of wrong
 * tents with the same middles the rms would be tenths. */
static void paths_end_in_cells_by_the_same_tents(void **state)
{
    enum { N = 64, NUMBERS = 256 };
    static float texels[CUBE_FACES * N * N][3], means[3][SKY_CELLS];
    static double solid[N * N], sum[SKY_CELLS], omega[SKY_CELLS];
    struct environment *e = sky_environment(sky_constant(32, 16, 1.0f), N, 0.0);
    struct rng r = { 7 };
    double error = 0.0;
    (void)state;

    cube_solid_angles(N, solid);
    for (uint32_t t = 0; t < CUBE_FACES * N * N; t++) {
        const uint32_t row = t / N % N, column = t % N;
        double d[3];
        texels[t][0] = texels[t][1] = texels[t][2] = (float)rng_next(&r);
        cube_direction(t / (N * N), -1.0 + (column + 0.5) * 2.0 / N, -1.0 + (row + 0.5) * 2.0 / N, d);
        const double norm = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        const struct vec3 w = { (float)(d[0] / norm), (float)(d[1] / norm), (float)(d[2] / norm) };
        for (uint32_t i = 0; i < NUMBERS; i++) {
            const uint32_t cell = indirect_cell(w, (i + 0.5) / NUMBERS);
            sum[cell] += solid[t % (N * N)] * (double)texels[t][0];
            omega[cell] += solid[t % (N * N)];
        }
    }
    environment_set_faces(e, texels[0]);
    take_means(e, means);
    for (uint32_t k = 0; k < SKY_CELLS; k++) {
        assert_true(omega[k] > 0.0);
        error += pow(sum[k] / omega[k] - (double)means[0][k], 2.0) / SKY_CELLS;
    }
    print_message("rms %.2e\n", sqrt(error));
    assert_true(sqrt(error) < 1e-3);
    environment_destroy(e);
}

/* What frames use until the full one is there: in the mean as bright within 2 %, and near it at matte points, although
 * those of so small an image are too far apart to be smoothed: eight rays each. */
static void a_quick_one_is_near_the_full_one(void **state)
{
    struct lit x = lit_create(mixed_court(), 96, 54);
    struct transport *t = direct_of(&x);
    struct indirect_desc desc = desc_of(&x, t, 5);
    struct environment *e = sky_environment(sky_overcast(64, 32), 64, 0.0);
    const size_t floats = (size_t)x.gbuffer->packet_count * 3 * PACKET;
    float *full = mem_alloc(floats, sizeof(float));
    double sum[2] = { 0.0 }, error = 0.0, count = 0.0;
    struct indirect_cache *b;
    struct reason why;
    (void)state;

    desc.records = 0;
    for (int k = 0; k < 2; k++) {
        desc.quick = k;
        assert_int_equal(indirect_create(&desc, best_kernels(), &b, &why), ERR_OK);
        shade_indirect(b, &x, e);
        for (size_t i = 0; i < floats; i++)
            sum[k] += (double)x.lo[i];
        if (k == 0)
            memcpy(full, x.lo, floats * sizeof(float));
        indirect_destroy(b);
    }
    const double mean = sum[0] / (double)floats;
    for (size_t i = 0; i < floats; i++) {
        const struct shade_packet *p = &x.gbuffer->packets[i / (3 * PACKET)];
        const double f = (double)full[i], d = (double)x.lo[i] - f;
        if (p->kind != LOBE_LAMBERT || i % PACKET >= p->count)
            continue;
        error += d * d / (f * f + 1e-2 * mean * mean);
        count++;
    }
    error /= count;
    printf("%.3f times as bright, relMSE %.2e of %.0f values\n", sum[1] / sum[0], error, count);
    assert_true(count > 1000.0 && fabs(sum[1] / sum[0] - 1.0) < 0.02 && error < 0.12);
    mem_free(full);
    transport_destroy(t);
    environment_destroy(e);
    lit_destroy(&x);
}

static void bits_do_not_depend_on_threads(void **state)
{
    struct lit x = lit_create(mixed_court(), 24, 18);
    struct environment *e = sky_environment(sky_with_sun(64, 32, 2e3f), 64, 0.0);
    struct transport *t = direct_of(&x);
    float *first = mem_alloc(x.size, sizeof(*first));
    const int before = omp_get_max_threads();
    (void)state;

    for (int threads = 1; threads <= 3; threads++) {
        omp_set_num_threads(threads);
        struct indirect_cache *b = indirect_of(&x, t, 5);
        shade_indirect(b, &x, e);
        if (threads == 1)
            memcpy(first, x.lo, x.size * sizeof(*first));
        assert_memory_equal(first, x.lo, x.size * sizeof(*first));
        indirect_destroy(b);
    }
    omp_set_num_threads(before);
    mem_free(first);
    transport_destroy(t);
    environment_destroy(e);
    lit_destroy(&x);
}

/* Four blocks of points on a floor, a tenth of the distance of what is around apart from end to end; every other point
 * of the last two faces sideways. */
static void points_alike_are_those_near_that_face_the_same_way(void **state)
{
    enum { BLOCKS = 4, POINTS = BLOCKS * TRANSPORT_POINTS };
    struct indirect_smoother *s = indirect_smoother_create();
    (void)state;

    assert_non_null(s);
    for (uint32_t k = 0; k < POINTS; k++) {
        const uint32_t turned = k >= POINTS / 2 && k / 4 % 2;
        s->used[k] = true;
        s->at[0][k] = 0.1f * (float)k / POINTS;
        s->normal[turned ? 0 : 1][k] = 1.0f;
        s->near[k] = 1.0f;
    }
    const float whole = indirect_alike(s, BLOCKS, INDIRECT_GROUP, 0), near = indirect_alike(s, BLOCKS, 0, 0);
    double want[2] = { 0.0 };
    for (uint32_t k = 0; k < POINTS; k++) {
        const double weight = s->normal[1][k] > 0.0f ? 1.0 - (double)s->at[0][k] / 0.3 : 0.0;
        want[0] += weight;
        want[1] += k < TRANSPORT_POINTS ? weight : 0.0;
    }
    assert_true(fabs((double)whole / want[0] - 1.0) < 0.03 && fabs((double)near / want[1] - 1.0) < 0.06);
    for (uint32_t k = 0; k < POINTS; k++)
        s->near[k] = k == 0 ? 1.0f : 1e-4f;
    assert_true(indirect_alike(s, BLOCKS, INDIRECT_GROUP, 0) == 1.0f); /* itself */
    indirect_smoother_destroy(s);
}

/* Of 8 rays every point traces all; of 512 those of large plain surfaces trace few, and lobes that reflect little. */
static void points_among_their_like_trace_fewer_rays(void **state)
{
    struct lit x = lit_create(mixed_court(), 96, 54);
    struct transport *t = direct_of(&x);
    struct indirect_desc desc = desc_of(&x, t, 5);
    static const uint32_t gather[2] = { 8, 512 };
    double rays[2], all = 0.0;
    struct indirect_cache *b;
    struct reason why;
    (void)state;

    for (int k = 0; k < 2; k++) {
        desc.gather = gather[k];
        assert_int_equal(indirect_create(&desc, best_kernels(), &b, &why), ERR_OK);
        rays[k] = (double)b->stats.rays;
        indirect_destroy(b);
    }
    for (uint32_t i = 0; i < x.gbuffer->packet_count; i++)
        all += x.gbuffer->packets[i].count * (lobe_rows((enum lobe_kind)x.gbuffer->packets[i].kind) > 1 ? 2.0 : 1.0);
    const double share = (rays[1] - rays[0]) / (all * (512 - 8));
    printf("share of the rays %.3f\n", share);
    assert_true(share > 0.05 && share < 0.7);
    transport_destroy(t);
    lit_destroy(&x);
}

static void it_is_cancelled_and_refused(void **state)
{
    struct lit x = lit_create(matte_court(), 24, 18);
    struct transport *t = direct_of(&x);
    struct indirect_desc desc = desc_of(&x, t, 6);
    atomic_bool cancel = true;
    struct indirect_cache *b;
    struct reason why;
    (void)state;

    desc.cancel = &cancel;
    assert_int_equal(indirect_create(&desc, best_kernels(), &b, &why), ERR_OK);
    assert_null(b);
    desc.cancel = NULL;
    desc.max_bytes = 1000;
    assert_int_equal(indirect_create(&desc, best_kernels(), &b, &why), ERR_RANGE);
    assert_null(b);
    assert_non_null(strstr(why.text, "--cache-memory"));
    desc.max_bytes = 0;
    assert_int_equal(indirect_create(&desc, best_kernels(), &b, &why), ERR_OK);
    assert_true(indirect_stats(b)->records > 100 && indirect_stats(b)->bytes > 1000 && indirect_stats(b)->rays > 0);
    indirect_destroy(b);
    transport_destroy(t);
    lit_destroy(&x);
}

/* A floor alone gives no light to itself, and to whom nothing is given there is no record to be. */
static void a_floor_alone_has_none(void **state)
{
    struct scene *s = scene_from(vec3_make(0, 2, 4), vec3_make(0, 0, 0), 0.8f);
    (void)state;

    add_box(s, lambert(0.6f), vec3_make(-3, -0.2f, -3), vec3_make(3, 0, 3));
    struct lit x = lit_create(s, 16, 12);
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 16, 0.0);
    struct transport *t = direct_of(&x);
    struct indirect_cache *b = indirect_of(&x, t, 7);
    shade_indirect(b, &x, e);
    for (size_t i = 0; i < x.size; i++)
        assert_true(x.lo[i] == 0.0f);
    indirect_destroy(b);
    transport_destroy(t);
    environment_destroy(e);
    lit_destroy(&x);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(an_open_sphere_meets_the_closed_form),
    cmocka_unit_test(it_is_the_class_that_eye_paths_find),
    cmocka_unit_test(under_a_sun_it_agrees_with_eye_paths),
    cmocka_unit_test(a_moving_sun_does_not_jump),
    cmocka_unit_test(the_tents_keep_a_constant_and_a_place),
    cmocka_unit_test(a_lean_sky_will_do),
    cmocka_unit_test(paths_end_in_cells_by_the_same_tents),
    cmocka_unit_test(a_quick_one_is_near_the_full_one),
    cmocka_unit_test(bits_do_not_depend_on_threads),
    cmocka_unit_test(points_alike_are_those_near_that_face_the_same_way),
    cmocka_unit_test(points_among_their_like_trace_fewer_rays),
    cmocka_unit_test(it_is_cancelled_and_refused),
    cmocka_unit_test(a_floor_alone_has_none),
};
UNIT_MAIN(tests)
