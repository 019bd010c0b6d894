/* Stored eye paths against traced ones: the same paths, so the same light under each sky, but for the rounding of what
 * is stored. */
#include "light/estimators/courts.h"
#include "light/estimators/points.h"

#include "light/cache/cache_file.h"
#include "light/estimators/eye_paths.h"
#include "support/sections.h"

#include <omp.h>

enum { PATHS = 24, CLASSES = PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC };

static struct eye_store *store_of(const struct lit *x, uint32_t classes, uint64_t max_bytes)
{
    const struct eye_store_desc desc = { .classes = classes, .paths = PATHS, .seed = 5, .max_bytes = max_bytes };
    struct eye_store *s;

    assert_int_equal(eye_store_create(x->scene, x->rays, x->gbuffer, &desc, &s), ERR_OK);
    assert_non_null(s);
    return s;
}

/* At every point; half floats have 11 bits. One store serves all skies and each choice of classes. */
static void a_store_lights_each_sky_as_its_own_paths_do(void **state)
{
    (void)state;
    struct environment *const skies[] = { sky_environment(sky_overcast(32, 16), 16, 0.0),
                                          sky_environment(sky_with_sun(32, 16, 20.0f), 32, 0.0) };
    const uint32_t classes[] = { CLASSES, PATH_CAUSTICS, PATH_INDIRECT_CAUSTIC };
    struct lit x = lit_create(mixed_court(), 24, 20);
    float *traced = mem_alloc(x.size, sizeof(float));
    uint32_t lit = 0;

    for (int c = 0; c < 3; c++) {
        struct eye_store *s = store_of(&x, classes[c], 0);
        assert_int_equal(eye_store_stats(s)->per_point, PATHS);
        for (int k = 0; k < 2; k++) {
            clear(&x);
            walk(&x, skies[k], 0, classes[c], PATHS, 5);
            memcpy(traced, x.lo, x.size * sizeof(float));
            clear(&x);
            eye_store_light(s, skies[k], INFINITY, x.lo);
            for (size_t i = 0; i < x.size; i++) {
                assert_true(fabsf(x.lo[i] - traced[i]) <= 1e-3f * traced[i]);
                lit += traced[i] > 0.0f;
            }
        }
        eye_store_destroy(s);
    }
    assert_true(lit > 200);
    mem_free(traced);
    lit_destroy(&x);
    environment_destroy(skies[0]);
    environment_destroy(skies[1]);
}

/* Of a texel of twice the level, a quarter is below it (sky_lower); of the others all. */
static void what_is_above_the_level_is_left_out(void **state)
{
    (void)state;
    struct environment *e = sky_environment(sky_constant(32, 16, 2.0f), 16, 0.0);
    struct lit x = lit_create(mixed_court(), 24, 20);
    struct eye_store *s = store_of(&x, CLASSES, 0);
    float *whole = mem_alloc(x.size, sizeof(float));
    double sum = 0.0;

    eye_store_light(s, e, 2.5f, whole);
    clear(&x);
    eye_store_light(s, e, 1.0f, x.lo);
    for (size_t i = 0; i < x.size; i++) {
        assert_float_equal(x.lo[i], 0.25f * whole[i], 1e-4f * whole[i]);
        sum += x.lo[i];
    }
    assert_true(sum > 0.0);
    mem_free(whole);
    eye_store_destroy(s);
    lit_destroy(&x);
    environment_destroy(e);
}

static void the_same_seed_gives_the_same_bits_at_any_thread_count(void **state)
{
    (void)state;
    struct environment *e = sky_environment(sky_with_sun(32, 16, 20.0f), 16, 0.0);
    struct lit x = lit_create(mixed_court(), 24, 20);
    float *one = mem_alloc(x.size, sizeof(float));
    const int before = omp_get_max_threads();

    for (int threads = 1; threads <= 4; threads++) {
        omp_set_num_threads(threads);
        struct eye_store *s = store_of(&x, CLASSES, 0);
        clear(&x);
        eye_store_light(s, e, INFINITY, x.lo);
        eye_store_destroy(s);
        if (threads == 1)
            memcpy(one, x.lo, x.size * sizeof(float));
        assert_memory_equal(one, x.lo, x.size * sizeof(float));
    }
    omp_set_num_threads(before);
    mem_free(one);
    lit_destroy(&x);
    environment_destroy(e);
}

/* Fewer paths then, of the same mean: a tenth of the memory. */
static void memory_that_does_not_suffice_means_fewer_paths(void **state)
{
    (void)state;
    struct lit x = lit_create(mixed_court(), 24, 20);
    struct eye_store *all = store_of(&x, CLASSES, 0);
    struct eye_store *few = store_of(&x, CLASSES, eye_store_stats(all)->bytes / 10);

    assert_in_range(eye_store_stats(few)->per_point, 1, PATHS / 4);
    assert_true(eye_store_stats(few)->bytes < eye_store_stats(all)->bytes / 4);
    eye_store_destroy(few);
    eye_store_destroy(all);
    lit_destroy(&x);
}

static void cancelled_there_is_no_store(void **state)
{
    (void)state;
    const atomic_bool cancel = true;
    const struct eye_store_desc desc = { .classes = CLASSES, .paths = 1, .cancel = &cancel };
    struct lit x = lit_create(mixed_court(), 24, 20);
    struct eye_store *s;

    assert_int_equal(eye_store_create(x.scene, x.rays, x.gbuffer, &desc, &s), ERR_OK);
    assert_null(s);
    lit_destroy(&x);
}

static void save_ends(const void *store, struct cache_writer *w)
{
    eye_store_save(store, w);
}

/* Reads it, and lights by it whatever it has become; NULL: it was refused. */
static struct eye_store *load_ends(struct section *s, struct lit *x)
{
    struct cache_reader *r = section_read(s);
    struct eye_store *out = NULL;
    struct reason why;

    enum err e = eye_store_load(r, x->gbuffer->packet_count, &out, &why);
    assert_true((e == ERR_OK) == (out != NULL));
    if (!e)
        e = cache_reader_end(r, &why);
    cache_reader_close(r);
    if (e) {
        eye_store_destroy(out);
        return NULL;
    }
    return out;
}

/* The same light from a file; and none, or some, but no fault from one whose numbers are wrong. */
static void a_file_holds_eye_paths(void **state)
{
    (void)state;
    struct environment *e = sky_environment(sky_with_sun(32, 16, 20.0f), 16, 0.0);
    struct lit x = lit_create(mixed_court(), 24, 20);
    struct eye_store *s = store_of(&x, CLASSES, 0);
    float *before = mem_alloc(x.size, sizeof(float));
    struct rng random = { 3 };
    uint32_t refused = 0;

    struct section section = section_of(s, save_ends);
    clear(&x);
    eye_store_light(s, e, INFINITY, before);
    struct eye_store *again = load_ends(&section, &x);
    assert_non_null(again);
    eye_store_light(again, e, INFINITY, x.lo);
    assert_memory_equal(before, x.lo, x.size * sizeof(float));
    assert_memory_equal(eye_store_stats(s), eye_store_stats(again), sizeof(struct eye_store_stats));
    eye_store_destroy(again);
    for (int k = 0; k < 400; k++) {
        section_spoil(&section, &random);
        again = load_ends(&section, &x);
        if (again)
            eye_store_light(again, e, INFINITY, x.lo);
        refused += again == NULL;
        eye_store_destroy(again);
        section_mend(&section);
    }
    assert_true(refused > 100);
    section_free(&section);
    mem_free(before);
    eye_store_destroy(s);
    lit_destroy(&x);
    environment_destroy(e);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_store_lights_each_sky_as_its_own_paths_do),
    cmocka_unit_test(what_is_above_the_level_is_left_out),
    cmocka_unit_test(the_same_seed_gives_the_same_bits_at_any_thread_count),
    cmocka_unit_test(memory_that_does_not_suffice_means_fewer_paths),
    cmocka_unit_test(cancelled_there_is_no_store),
    cmocka_unit_test(a_file_holds_eye_paths),
};
UNIT_MAIN(tests)
