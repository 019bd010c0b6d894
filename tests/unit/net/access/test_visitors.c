/* Addresses, their limits on wrong tokens, and what a proxy says of them. */
#include "support/unit.h"

#include "net/access/visitors.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#define SECOND INT64_C(1000000)

static struct visitor *find(struct visitors *g, const char *text, int64_t now_us)
{
    struct sockaddr_in four = { .sin_family = AF_INET };
    struct sockaddr_in6 six = { .sin6_family = AF_INET6 };

    if (inet_pton(AF_INET, text, &four.sin_addr) == 1)
        return visitors_find(g, (const struct sockaddr *)&four, now_us);
    assert_int_equal(inet_pton(AF_INET6, text, &six.sin6_addr), 1);
    return visitors_find(g, (const struct sockaddr *)&six, now_us);
}

static void must_have_name(struct visitors *g, const char *address, const char *name, bool loopback)
{
    char text[VISITOR_NAME];
    const struct visitor *v = find(g, address, 0);

    assert_string_equal(visitor_name(v, text), name);
    assert_int_equal(v->loopback, loopback);
}

static void addresses_are_told_apart_as_far_as_one_client_has_them(void **state)
{
    const struct sockaddr none = { .sa_family = AF_UNIX };
    struct visitors g;
    (void)state;

    assert_true(visitors_init(&g, 8));
    assert_ptr_equal(find(&g, "192.0.2.7", 0), find(&g, "::ffff:192.0.2.7", 5));
    assert_ptr_not_equal(find(&g, "192.0.2.7", 0), find(&g, "192.0.2.8", 0));
    assert_ptr_equal(find(&g, "2001:db8:1:2::1", 0), find(&g, "2001:db8:1:2:ffff::9", 0));
    assert_ptr_not_equal(find(&g, "2001:db8:1:2::1", 0), find(&g, "2001:db8:1:3::1", 0));
    must_have_name(&g, "192.0.2.7", "192.0.2.7", false);
    must_have_name(&g, "127.0.0.1", "127.0.0.1", true);
    must_have_name(&g, "127.8.9.1", "127.8.9.1", true);
    must_have_name(&g, "10.127.0.1", "10.127.0.1", false);
    must_have_name(&g, "::1", "::", true);
    must_have_name(&g, "2001:db8:1:2::1", "2001:db8:1:2::", false);
    assert_null(visitors_find(&g, &none, 0));
    visitors_finish(&g);
    assert_null(g.rows);
}

static void a_proxy_names_the_last_address(void **state)
{
    static const struct {
        const char *header, *address;
    } rows[] = { { "192.0.2.1", "192.0.2.1" },
                 { "10.0.0.1, 192.0.2.1", "192.0.2.1" },
                 { "10.0.0.1,\t 2001:db8::5 ", "2001:db8::5" },
                 { "192.0.2.1 x", NULL },
                 { "192.0.2.1, ", NULL },
                 { "unknown", NULL },
                 { "", NULL } };
    struct visitors g;
    char text[64];
    (void)state;

    assert_true(visitors_init(&g, 8));
    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        struct visitor *v = visitors_forwarded(&g, rows[i].header, 0, text, sizeof(text));
        if (!rows[i].address) {
            assert_null(v);
            continue;
        }
        assert_non_null(v);
        assert_true(v->named);
        assert_string_equal(text, rows[i].address);
        assert_ptr_equal(v, find(&g, rows[i].address, 0));
    }
    assert_null(visitors_forwarded(&g, "192.0.2.1", 0, text, strlen("192.0.2.1")));
    assert_non_null(visitors_forwarded(&g, "192.0.2.1", 0, text, strlen("192.0.2.1") + 1));
    visitors_finish(&g);
}

/* Ten at once, then one in ten seconds. */
static void wrong_tokens_are_limited_by_address(void **state)
{
    struct visitors g;
    (void)state;

    assert_true(visitors_init(&g, 8));
    struct visitor *v = find(&g, "192.0.2.1", SECOND), *other = find(&g, "192.0.2.2", SECOND);
    for (int i = 0; i < 10; i++) {
        assert_true(visitor_may_guess(&g, v, SECOND));
        visitor_guessed_wrong(&g, v, SECOND);
    }
    assert_false(visitor_may_guess(&g, v, SECOND));
    visitor_guessed_wrong(&g, v, SECOND); /* does not run up a debt */
    assert_true(visitor_may_guess(&g, other, SECOND));
    assert_false(visitor_may_guess(&g, v, SECOND + 99 * SECOND / 10));
    assert_true(visitor_may_guess(&g, v, SECOND + 101 * SECOND / 10));
    visitor_guessed_wrong(&g, v, SECOND + 101 * SECOND / 10);
    assert_false(visitor_may_guess(&g, v, SECOND + 101 * SECOND / 10));
    for (int i = 0; i < 10; i++) { /* the bucket holds no more than ten */
        assert_true(visitor_may_guess(&g, v, 1000 * SECOND));
        visitor_guessed_wrong(&g, v, 1000 * SECOND);
    }
    assert_false(visitor_may_guess(&g, v, 1000 * SECOND));
    visitors_finish(&g);
}

/* A proxy may invent addresses: sixty wrong tokens of all of them together, one more each second; not those from which
 * a right one came. */
static void addresses_that_a_proxy_names_share_a_limit(void **state)
{
    struct visitors g;
    char text[64];
    (void)state;

    assert_true(visitors_init(&g, 8));
    for (int i = 0; i < 60; i++) {
        char header[32];
        snprintf(header, sizeof(header), "10.0.%d.%d", i / 8, i % 8);
        struct visitor *v = visitors_forwarded(&g, header, 1, text, sizeof(text));
        assert_true(visitor_may_guess(&g, v, 1));
        visitor_guessed_wrong(&g, v, 1);
    }
    struct visitor *late = visitors_forwarded(&g, "10.9.9.9", 1, text, sizeof(text));
    assert_false(visitor_may_guess(&g, late, 1));
    assert_true(visitor_may_guess(&g, find(&g, "192.0.2.1", 1), 1));
    late->known = true;
    assert_true(visitor_may_guess(&g, late, 1));
    late->known = false;
    assert_false(visitor_may_guess(&g, late, 9 * SECOND / 10));
    assert_true(visitor_may_guess(&g, late, 102 * SECOND / 100)); /* looking takes nothing */
    visitor_guessed_wrong(&g, late, 102 * SECOND / 100);
    assert_false(visitor_may_guess(&g, late, 102 * SECOND / 100));
    assert_false(visitor_may_guess(&g, late, 199 * SECOND / 100));
    assert_true(visitor_may_guess(&g, late, 201 * SECOND / 100)); /* the 0.02 left were kept */
    visitors_finish(&g);
}

/* A new address takes a free row, else that of the oldest guess without a connection. */
static void rows_without_connections_are_taken_again(void **state)
{
    struct visitors g;
    char name[32];
    (void)state;

    assert_true(visitors_init(&g, 2));
    assert_int_equal(g.count, 2 + VISITORS_REMEMBERED);
    for (uint32_t i = 0; i < g.count; i++) {
        snprintf(name, sizeof(name), "10.%u.%u.1", i / 250, i % 250);
        find(&g, name, 1000 + (int64_t)(i == 7 ? 0 : i))->connections = i < 7;
    }
    struct visitor *taken = &g.rows[7];
    assert_ptr_equal(find(&g, "192.0.2.1", 5000), taken);
    assert_int_equal(taken->guesses_us, 5000);
    assert_true(taken->guesses == VISITORS_GUESSES);
    assert_ptr_equal(find(&g, "192.0.2.2", 5000), &g.rows[8]);
    for (uint32_t i = 0; i < g.count; i++)
        g.rows[i].connections = 1;
    assert_null(find(&g, "192.0.2.3", 5000));
    assert_ptr_equal(find(&g, "192.0.2.1", 5000), taken);
    visitors_finish(&g);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(addresses_are_told_apart_as_far_as_one_client_has_them),
    cmocka_unit_test(a_proxy_names_the_last_address),
    cmocka_unit_test(wrong_tokens_are_limited_by_address),
    cmocka_unit_test(addresses_that_a_proxy_names_share_a_limit),
    cmocka_unit_test(rows_without_connections_are_taken_again),
};
UNIT_MAIN(tests)
