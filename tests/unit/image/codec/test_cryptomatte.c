/* Ids by published values of MurmurHash3_x86_32, and manifests that JSON readers take. */
#include "image/codec/encode.h"

#include "support/unit.h"

#include <math.h>
#include <string.h>

static void hashes_are_those_of_murmur_3(void **state)
{
    static const struct {
        const char *text;
        uint32_t hash;
    } known[] = {
        { "", 0 },
        { "hello", 0x248bfa47 },
        { "hello, world", 0x149bbb7f },
        { "The quick brown fox jumps over the lazy dog", 0x2e4ff723 },
    };
    (void)state;

    for (size_t k = 0; k < sizeof(known) / sizeof(known[0]); k++)
        assert_int_equal(cryptomatte_hash(known[k].text), known[k].hash);
}

/* Among many names some have exponents that no number may have: those move by one, and no other bit changes. */
static void ids_are_normal_numbers(void **state)
{
    unsigned moved = 0;
    (void)state;

    for (int k = 0; k < 5000; k++) {
        char name[16];
        uint32_t bits;
        snprintf(name, sizeof(name), "object %d", k);
        const float id = cryptomatte_id(name);
        const uint32_t hash = cryptomatte_hash(name), exponent = hash >> 23 & 255;
        memcpy(&bits, &id, sizeof(bits));
        assert_true(isnormal(id));
        const uint32_t change = exponent == 0 ? 1u << 23 : exponent == 255 ? 0xffffffffu - (1u << 23) + 1 : 0;
        assert_int_equal(bits, hash + change);
        moved += change != 0;
    }
    assert_true(moved > 5);
}

static void manifests_name_each_once_and_quote(void **state)
{
    static const char *const names[] = { "wall", "a \"b\" \\", "wall", "tab\t" };
    struct cryptomatte c;
    (void)state;

    assert_int_equal(cryptomatte_init(&c, "CryptoObject", names, 4), ERR_OK);
    assert_string_equal(c.key[0], "cryptomatte/3ae39a5/name");
    assert_string_equal(c.key[3], "cryptomatte/3ae39a5/manifest");
    assert_string_equal(c.value[0], "CryptoObject");
    assert_string_equal(c.value[1], "MurmurHash3_32");
    assert_string_equal(c.value[2], "uint32_to_float32");
    const char *wall = strstr(c.value[3], "\"wall\":\"");
    assert_non_null(wall);
    assert_null(strstr(wall + 1, "\"wall\""));
    assert_non_null(strstr(c.value[3], "\"a \\\"b\\\" \\\\\":\""));
    assert_non_null(strstr(c.value[3], "\"tab\\u0009\":\""));
    cryptomatte_finish(&c);
    assert_int_equal(cryptomatte_init(&c, "CryptoObject", names, 0), ERR_OK);
    assert_string_equal(c.value[3], "{}");
    cryptomatte_finish(&c);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(hashes_are_those_of_murmur_3),
    cmocka_unit_test(ids_are_normal_numbers),
    cmocka_unit_test(manifests_name_each_once_and_quote),
};

UNIT_MAIN(tests)
