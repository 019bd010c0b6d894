/* Resampling tables that several environments share: one of a key, freed with its last user. */
#include "sky/tables/resample.h"

#include <omp.h>

#include "sky/tables/resampling.h"
#include "support/skies.h"

static struct environment *environment_at(struct resample_tables *tables, double rotation_degrees)
{
    struct reason why;
    struct frame f = sky_overcast(64, 32);
    struct environment *e = environment_create(
        &(struct environment_desc){ .n = 16, .rotation_degrees = rotation_degrees, .tables = tables });
    assert_non_null(e);
    assert_int_equal(environment_update(e, &f, &why), ERR_OK);
    frame_finish(&f);
    return e;
}

static void turn(struct environment *e, double rotation_degrees)
{
    struct reason why;
    environment_configure(e, &(struct environment_desc){ .rotation_degrees = rotation_degrees });
    assert_int_equal(environment_rebuild(e, &why), ERR_OK);
}

static void environments_of_one_key_share_a_table(void **state)
{
    struct resample_tables *tables = resample_tables_create();
    struct environment *e[3], *alone = environment_at(NULL, 0.0);
    (void)state;
    for (int k = 0; k < 3; k++)
        e[k] = environment_at(tables, 0.0);
    assert_int_equal(e[0]->resampler->table->users, 3);
    assert_ptr_equal(e[0]->resampler->table, e[1]->resampler->table);
    assert_ptr_equal(e[0]->resampler->table, e[2]->resampler->table);
    assert_ptr_not_equal(e[0]->resampler->table, alone->resampler->table);
    assert_ptr_not_equal(e[0]->resampler, e[1]->resampler); /* what is a frame's own is not shared */
    assert_memory_equal(e[1]->texels, alone->texels, 6 * 16 * 16 * sizeof(*alone->texels));
    environment_destroy(e[1]);
    assert_int_equal(e[0]->resampler->table->users, 2);
    turn(e[0], 0.0); /* reads the table that the other has let go of */
    environment_destroy(e[0]);
    environment_destroy(e[2]);
    resample_tables_destroy(tables); /* asserts that none is in use, here and below */
    environment_destroy(alone);
}

/* While a sky is turned, one environment after the other goes over to the new table: it is made once, and the old one
 * lasts until the last has left it. */
static void another_rotation_is_another_table(void **state)
{
    struct resample_tables *tables = resample_tables_create();
    struct environment *e[3];
    (void)state;
    for (int k = 0; k < 3; k++)
        e[k] = environment_at(tables, 0.0);
    const struct resample_table *old = e[0]->resampler->table;
    for (int k = 0; k < 3; k++) {
        turn(e[k], 30.0);
        assert_ptr_equal(e[k]->resampler->table, e[0]->resampler->table);
        assert_int_equal(e[k]->resampler->table->users, k + 1);
        assert_true(k == 2 || (e[2]->resampler->table == old && old->users == 2u - (uint32_t)k));
    }
    for (int k = 0; k < 3; k++)
        environment_destroy(e[k]);
    resample_tables_destroy(tables);
}

/* Size and layout too; and a key that does not fit leaves nothing behind. */
static void keys_differ_in_every_part(void **state)
{
    static const struct resample_key keys[] = {
        { LAYOUT_LATLONG, 16, 8, 4, 0.0 }, { LAYOUT_LATLONG_BOTTOM_FIRST, 16, 8, 4, 0.0 },
        { LAYOUT_LATLONG, 32, 8, 4, 0.0 }, { LAYOUT_LATLONG, 16, 16, 4, 0.0 },
        { LAYOUT_LATLONG, 16, 8, 5, 0.0 }, { LAYOUT_LATLONG, 16, 8, 4, 1e-9 },
    };
    struct resample_tables *tables = resample_tables_create();
    struct resample_table *taken[6], *again;
    (void)state;
    for (uint32_t k = 0; k < 6; k++) {
        assert_int_equal(resample_table_take(tables, &keys[k], &taken[k]), ERR_OK);
        assert_int_equal(taken[k]->users, 1);
    }
    for (uint32_t k = 0; k < 6; k++) {
        assert_int_equal(resample_table_take(tables, &keys[k], &again), ERR_OK);
        assert_ptr_equal(again, taken[k]);
        resample_table_release(tables, again);
        resample_table_release(tables, taken[k]);
    }
    assert_int_equal(resample_table_take(tables, &(struct resample_key){ LAYOUT_CUBE, 16, 8, 4, 0.0 }, &again),
                     ERR_UNSUPPORTED);
    assert_null(again);
    resample_tables_destroy(tables);
}

/* Many threads that ask at once for few keys, over and over. */
static void threads_find_each_others_tables(void **state)
{
    struct resample_tables *tables = resample_tables_create();
    int wrong = 0;
    (void)state;
#pragma omp parallel for num_threads(8) schedule(dynamic) reduction(+ : wrong)
    for (int k = 0; k < 400; k++) {
        const struct resample_key key = { LAYOUT_LATLONG, 16, 8, 4, 0.1 * (k % 3) };
        struct resample_table *t, *same;
        wrong += resample_table_take(tables, &key, &t) || !resample_key_equal(&t->key, &key);
        wrong += resample_table_take(tables, &key, &same) || same != t;
        resample_table_release(tables, t);
        wrong += same->octets[0].first != 0; /* still there */
        resample_table_release(tables, same);
    }
    assert_int_equal(wrong, 0);
    resample_tables_destroy(tables);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(environments_of_one_key_share_a_table),
    cmocka_unit_test(another_rotation_is_another_table),
    cmocka_unit_test(keys_differ_in_every_part),
    cmocka_unit_test(threads_find_each_others_tables),
};
UNIT_MAIN(tests)
