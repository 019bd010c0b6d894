/* The store of light paths in files: what is read lights as before, and wrong numbers do no harm. */
#include "light/estimators/tracing.h"
#include "light/estimators/worlds.h"

#include "light/cache/cache_file.h"
#include "light/estimators/caustic_store.h"
#include "support/sections.h"

enum { CLASSES = PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC, SIDE = 8, VALUES = 3 * SIDE * SIDE };

static void save_splats(const void *store, struct cache_writer *w)
{
    caustic_store_save(store, w);
}

static struct caustic_store *empty_store(const struct stage *x)
{
    const struct caustic_store_desc desc = { .classes = CLASSES, .paths = 60000, .parts = 3, .seed = 8 };
    struct caustic_store *out;
    struct reason why;

    assert_int_equal(caustic_store_create(x->scene, x->rays, &x->view, &desc, &out, &why), ERR_OK);
    return out;
}

/* NULL: it was refused. */
static struct caustic_store *load_splats(struct section *s, const struct stage *x)
{
    struct cache_reader *r = section_read(s);
    struct caustic_store *out = empty_store(x);
    struct reason why;

    enum err e = caustic_store_load(out, r, &why);
    if (!e)
        e = cache_reader_end(r, &why);
    cache_reader_close(r);
    if (!e)
        return out;
    caustic_store_destroy(out);
    return NULL;
}

static void a_file_holds_light_paths(void **state)
{
    (void)state;
    struct environment *e = sky_environment(sky_overcast(64, 32), 64, 0.0);
    struct stage x = busy_stage();
    struct caustic_store *s = empty_store(&x);
    static float before[VALUES], after[VALUES];
    struct rng random = { 4 };
    uint32_t refused = 0;
    double sum = 0.0;

    assert_int_equal(caustic_store_turn(s, 0, NULL, NULL), ERR_OK);
    assert_int_equal(caustic_store_light(s, e, INFINITY, before), ERR_OK);
    struct section section = section_of(s, save_splats);
    struct caustic_store *again = load_splats(&section, &x);
    assert_non_null(again);
    assert_true(caustic_store_is_complete(again));
    assert_int_equal(caustic_store_stats(again)->splats, caustic_store_stats(s)->splats);
    assert_int_equal(caustic_store_light(again, e, INFINITY, after), ERR_OK);
    for (int i = 0; i < VALUES; i++)
        sum += (double)before[i];
    assert_true(sum > 0.0);
    assert_memory_equal(before, after, sizeof(before));
    assert_int_equal(caustic_store_turn(again, 1, NULL, NULL), ERR_OK); /* it goes on as the other one would */
    assert_int_equal(caustic_store_stats(again)->renewed, 1);
    caustic_store_destroy(again);
    for (int k = 0; k < 200; k++) {
        section_spoil(&section, &random);
        again = load_splats(&section, &x);
        if (again)
            assert_int_equal(caustic_store_light(again, e, INFINITY, after), ERR_OK);
        refused += again == NULL;
        caustic_store_destroy(again);
        section_mend(&section);
    }
    assert_true(refused > 20);
    /* damage that only the checksum tells leaves the store empty, and its next turn traces all */
    struct cache_reader *r = section_read(&section);
    struct reason why;
    again = empty_store(&x);
    section.file[section.file_size - 1] ^= 1;
    assert_int_equal(caustic_store_load(again, r, &why), ERR_FORMAT);
    cache_reader_close(r);
    assert_int_equal(caustic_store_stats(again)->filled, 0);
    assert_int_equal(caustic_store_turn(again, 0, NULL, NULL), ERR_OK);
    memset(after, 0, sizeof(after));
    assert_int_equal(caustic_store_light(again, e, INFINITY, after), ERR_OK);
    assert_memory_equal(before, after, sizeof(before));
    caustic_store_destroy(again);
    section_free(&section);
    caustic_store_destroy(s);
    environment_destroy(e);
    stage_free(&x);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_file_holds_light_paths),
};
UNIT_MAIN(tests)
