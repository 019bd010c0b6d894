#include "support/unit.h"

#include "base/digest.h"

#include <stdbool.h>

static struct digest digest_of(const void *bytes, size_t size)
{
    struct digest d = { { 0 } };

    digest_bytes(&d, bytes, size);
    return d;
}

static bool is_same(struct digest a, struct digest b)
{
    return memcmp(&a, &b, sizeof(a)) == 0;
}

/* Of every length up to beyond xxHash's longest special case, 240: each bit counts, in both halves. */
static void each_bit_changes_both_halves(void **state)
{
    uint8_t bytes[260];

    (void)state;
    for (size_t i = 0; i < sizeof(bytes); i++)
        bytes[i] = (uint8_t)(i * 37);
    for (size_t size = 1; size <= sizeof(bytes); size++) {
        const struct digest d = digest_of(bytes, size);
        assert_true(is_same(d, digest_of(bytes, size)));
        for (size_t bit = 0; bit < 8 * size; bit++) {
            bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
            const struct digest other = digest_of(bytes, size);
            assert_true(other.half[0] != d.half[0] && other.half[1] != d.half[1]);
            bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        }
    }
}

static void order_and_borders_of_items_count(void **state)
{
    struct digest all[6] = { { { 0 } } };

    (void)state;
    digest_bytes(&all[0], "abcd", 4);
    digest_bytes(&all[1], "ab", 2);
    digest_bytes(&all[1], "cd", 2);
    digest_bytes(&all[2], "cd", 2);
    digest_bytes(&all[2], "ab", 2);
    digest_bytes(&all[3], "abcd", 4);
    digest_bytes(&all[3], NULL, 0);
    digest_bytes(&all[4], NULL, 0);
    digest_bytes(&all[4], "abcd", 4);
    for (size_t i = 0; i < 6; i++) /* the last is of nothing */
        for (size_t k = 0; k < i; k++)
            assert_false(is_same(all[i], all[k]));
}

static void a_number_is_its_eight_bytes(void **state)
{
    const uint64_t number = 0x0123456789abcdefu;
    struct digest d = { { 0 } };

    (void)state;
    digest_u64(&d, number);
    assert_true(is_same(d, digest_of(&number, 8)));
}

/* Files stay valid across releases: what names them must not drift with the library. */
static void a_known_digest_stays_what_it_is(void **state)
{
    const struct digest d = digest_of("relight", 7);

    (void)state;
    assert_true(d.half[0] == 0x218b284e66558cfeu && d.half[1] == 0xde5a848aa20af0a4u);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(each_bit_changes_both_halves),
    cmocka_unit_test(order_and_borders_of_items_count),
    cmocka_unit_test(a_number_is_its_eight_bytes),
    cmocka_unit_test(a_known_digest_stays_what_it_is),
};

UNIT_MAIN(tests)
