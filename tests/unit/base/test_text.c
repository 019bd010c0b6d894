#include "base/text.h"

#include "support/unit.h"

/* The vectors of RFC 4648, section 10. */
static void base64_is_that_of_the_vectors(void **state)
{
    static const char *const want[] = { "", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy" };
    (void)state;

    for (size_t n = 0; n <= 6; n++) {
        struct text t = { .bytes = NULL };
        text_add_base64(&t, (const uint8_t *)"foobar", n);
        assert_string_equal(t.bytes ? t.bytes : "", want[n]);
        text_finish(&t);
    }
}

static void long_text_grows(void **state)
{
    struct text t = { .bytes = NULL };
    (void)state;

    for (int k = 0; k < 20000; k++)
        text_add(&t, "%05d,", k);
    assert_true(t.size == 120000 && !t.failed && memcmp(t.bytes + 6 * 12345, "12345,", 6) == 0);
    text_finish(&t);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(base64_is_that_of_the_vectors),
    cmocka_unit_test(long_text_grows),
};
UNIT_MAIN(tests)
