/* What decoders keep from one file to the next: where its pieces lie, and that nothing of the last file is in them. */
#include "base/mem.h"

#include "support/unit.h"

#include <stdbool.h>

/* Takes and gives back a file's worth; true when all of it lay within one stretch of memory as long as the sizes. */
static bool is_one_stretch(struct scratch *s, const size_t *sizes, size_t n)
{
    uint8_t *p[300];
    uintptr_t low = UINTPTR_MAX, high = 0;
    size_t sum = 0;

    scratch_begin(s);
    for (size_t i = 0; i < n; i++) {
        p[i] = scratch_alloc(s, sizes[i]);
        assert_non_null(p[i]);
        assert_int_equal((uintptr_t)p[i] % 64, 0);
        for (size_t k = 0; k < sizes[i]; k++)
            assert_int_equal(p[i][k], 0);
        memset(p[i], 0x55, sizes[i]);
        low = (uintptr_t)p[i] < low ? (uintptr_t)p[i] : low;
        high = (uintptr_t)p[i] + sizes[i] > high ? (uintptr_t)p[i] + sizes[i] : high;
        sum += sizes[i] <= 4096 ? sizes[i] + 64 : 2 * sizes[i];
    }
    for (size_t i = 0; i < n; i++) { /* nobody wrote into another's */
        for (size_t k = 0; k < sizes[i]; k++)
            assert_int_equal(p[i][k], 0x55);
        scratch_free(s, p[i]);
    }
    return high - low <= sum;
}

static void a_second_file_finds_one_block_for_all(void **state)
{
    static const size_t sizes[] = { 1, 64, 63, 0, 100000, 65536, 4096, 4097, 7 };
    struct scratch *s = scratch_create();
    (void)state;

    is_one_stretch(s, sizes, 9);
    assert_true(is_one_stretch(s, sizes, 9));
    assert_true(is_one_stretch(s, sizes, 9));
    scratch_destroy(s);
}

static void more_pieces_than_are_counted_are_served_too(void **state)
{
    size_t sizes[300];
    struct scratch *s = scratch_create();
    (void)state;

    for (size_t i = 0; i < 300; i++)
        sizes[i] = i;
    for (int file = 0; file < 3; file++)
        is_one_stretch(s, sizes, 300);
    is_one_stretch(NULL, sizes, 300);
    scratch_destroy(s);
}

/* A buffer that grows again and again, as a library's does from chunk to chunk, does not make the block grow without
 * bounds: what is given back behind it is free again. */
static void what_is_given_back_last_is_taken_again(void **state)
{
    struct scratch *s = scratch_create();
    (void)state;

    for (int file = 0; file < 2; file++) {
        scratch_begin(s);
        uint8_t *first = scratch_alloc(s, 1000);
        uint8_t *a = scratch_alloc(s, 5000), *b = scratch_alloc(s, 6000);
        scratch_free(s, a); /* b stands behind it: not yet */
        uint8_t *c = scratch_alloc(s, 100);
        if (file == 1)
            assert_true(c > b);
        scratch_free(s, c);
        scratch_free(s, b);
        uint8_t *again = scratch_alloc(s, 12000);
        if (file == 1)
            assert_ptr_equal(again, a);
        scratch_free(s, again);
        scratch_free(s, first);
    }
    scratch_destroy(s);
}

/* More than is kept: from the system each time, and no block of that size stays. */
static void what_is_kept_has_a_bound(void **state)
{
    struct scratch *s = scratch_create();
    (void)state;

    for (int file = 0; file < 3; file++) {
        scratch_begin(s);
        void *large = scratch_alloc(s, SCRATCH_MAX + 1), *half = scratch_alloc(s, SCRATCH_MAX / 2 + 1),
             *more = scratch_alloc(s, SCRATCH_MAX / 2 + 1);
        assert_true(large && half && more);
        scratch_free(s, half);
        scratch_free(s, more);
        scratch_free(s, large);
    }
    scratch_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_second_file_finds_one_block_for_all),
    cmocka_unit_test(more_pieces_than_are_counted_are_served_too),
    cmocka_unit_test(what_is_given_back_last_is_taken_again),
    cmocka_unit_test(what_is_kept_has_a_bound),
};
UNIT_MAIN(tests)
