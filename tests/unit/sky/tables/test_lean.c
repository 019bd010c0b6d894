/* A lean rebuild leaves some tables for later: what it makes, and what completes it, has the bits of a whole one. */
#include "support/skies.h"

#include "sky/tables/pyramid.h"
#include "sky/tables/samples.h"

#include <omp.h>

static struct environment *make(uint32_t n, bool lean)
{
    struct environment *e = environment_create(&(struct environment_desc){ .n = n, .lean = lean });

    assert_non_null(e);
    return e;
}

static void update(struct environment *e, float sun)
{
    struct reason why;
    struct frame f = sky_with_sun(64, 32, sun);

    assert_int_equal(environment_update(e, &f, &why), ERR_OK);
    frame_finish(&f);
}

static void assert_same_texels(const struct environment *a, const struct environment *b)
{
    const size_t texels = (size_t)CUBE_FACES * a->n * a->n;

    assert_memory_equal(a->texels, b->texels, texels * sizeof(*a->texels));
    assert_memory_equal(a->face_cdf, b->face_cdf, (size_t)CUBE_FACES * a->n * sizeof(*a->face_cdf));
    assert_memory_equal(a->energy, b->energy, sizeof(a->energy));
    assert_memory_equal(&a->total_energy, &b->total_energy, sizeof(a->total_energy));
}

static void assert_same_pyramid(const struct environment *a, const struct environment *b)
{
    assert_memory_equal(a->pyramid->mean, b->pyramid->mean, sizeof(a->pyramid->mean));
    for (uint32_t k = 1; k < a->pyramid->count; k++) {
        const struct pyramid_level *l = &a->pyramid->level[k], *m = &b->pyramid->level[k];
        assert_memory_equal(l->texels, m->texels, 4 * sizeof(float) * CUBE_FACES * l->n * l->n);
    }
}

static void assert_same_rest(const struct environment *a, const struct environment *b)
{
    const size_t texels = (size_t)CUBE_FACES * a->n * a->n;

    assert_memory_equal(a->row_cdf, b->row_cdf, texels * sizeof(*a->row_cdf));
    assert_same_pyramid(a, b);
}

static void it_comes_to_the_same_bits_once_completed(void **state)
{
    static const uint32_t sizes[] = { 1, 5, 8, 16, 29, 64 };
    (void)state;

    for (size_t s = 0; s < sizeof(sizes) / sizeof(sizes[0]); s++) {
        struct environment *whole = make(sizes[s], false);
        struct environment *lean = make(sizes[s], true);
        for (int frame = 0; frame < 3; frame++) {
            update(whole, 10.0f * (float)(frame + 1));
            update(lean, 10.0f * (float)(frame + 1));
            assert_true(environment_is_complete(whole) && !environment_is_complete(lean));
            assert_false(environment_has_pyramid(lean));
            assert_same_texels(whole, lean);
            if (frame != 0) { /* the pyramid first: the rest of it is made without doing that again */
                environment_complete_pyramid(lean);
                assert_true(environment_has_pyramid(lean) && !environment_is_complete(lean));
                assert_same_pyramid(whole, lean);
            }
            if (frame == 1) /* the next finds what this one has completed, and must not believe in it */
                continue;
            environment_complete(lean);
            environment_complete(whole);
            assert_true(environment_is_complete(lean));
            assert_same_texels(whole, lean);
            assert_same_rest(whole, lean);
        }
        environment_destroy(whole);
        environment_destroy(lean);
    }
}

static void leanness_may_change_from_frame_to_frame(void **state)
{
    struct environment *whole = make(16, false), *e = make(16, true);
    (void)state;

    for (int frame = 0; frame < 4; frame++) {
        environment_configure(e, &(struct environment_desc){ .lean = frame % 2 == 0 });
        update(whole, 5.0f + (float)frame);
        update(e, 5.0f + (float)frame);
        assert_int_equal(environment_is_complete(e), frame % 2);
        assert_same_texels(whole, e);
        if (frame % 2)
            assert_same_rest(whole, e);
    }
    environment_destroy(whole);
    environment_destroy(e);
}

static void threads_that_want_it_at_once_all_get_it(void **state)
{
    struct environment *whole = make(64, false), *lean = make(64, true);
    int wrong = 0;
    (void)state;

    update(whole, 7.0f);
    for (int round = 0; round < 20; round++) {
        update(lean, 7.0f);
#pragma omp parallel for num_threads(8) schedule(static, 1) reduction(+ : wrong)
        for (int k = 0; k < 64; k++) {
            const double x[2] = { (k + 0.5) / 64.0, 0.7 };
            float a[3], b[3];
            environment_complete(lean);
            samples_invert_face(whole, 4, x, a);
            samples_invert_face(lean, 4, x, b);
            wrong += memcmp(a, b, sizeof(a)) != 0;
        }
    }
    assert_int_equal(wrong, 0);
    environment_destroy(whole);
    environment_destroy(lean);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(it_comes_to_the_same_bits_once_completed),
    cmocka_unit_test(leanness_may_change_from_frame_to_frame),
    cmocka_unit_test(threads_that_want_it_at_once_all_get_it),
};
UNIT_MAIN(tests)
