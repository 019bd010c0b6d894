/* Who comes from where, on a made-up clock. */
#include "support/unit.h"

#include "net/access/visitors.h"

#include <arpa/inet.h>
#include <netinet/in.h>

static struct visitor *find(struct visitors *g, const char *text, int64_t now_us)
{
    struct sockaddr_in four = { .sin_family = AF_INET };
    struct sockaddr_in6 six = { .sin6_family = AF_INET6 };

    if (inet_pton(AF_INET, text, &four.sin_addr) == 1)
        return visitors_find(g, (struct sockaddr *)&four, now_us);
    assert_int_equal(inet_pton(AF_INET6, text, &six.sin6_addr), 1);
    return visitors_find(g, (struct sockaddr *)&six, now_us);
}

static void an_address_is_one_however_it_is_written(void **state)
{
    (void)state;
    struct visitors g;

    assert_true(visitors_init(&g, 4));
    struct visitor *four = find(&g, "203.0.113.7", 0);
    assert_ptr_equal(find(&g, "::ffff:203.0.113.7", 0), four);
    assert_ptr_not_equal(find(&g, "203.0.113.8", 0), four);
    assert_false(four->loopback);
    struct visitor *six = find(&g, "2001:db8:1:2::1", 0);
    assert_ptr_equal(find(&g, "2001:db8:1:2:ffff::", 0), six); /* whoever has the one has the other */
    assert_ptr_not_equal(find(&g, "2001:db8:1:3::1", 0), six);
    assert_true(find(&g, "127.0.0.1", 0)->loopback);
    assert_true(find(&g, "::ffff:127.0.0.2", 0)->loopback);
    assert_true(find(&g, "::1", 0)->loopback);
    assert_false(find(&g, "2001:db8::1", 0)->loopback);
    const struct sockaddr other = { .sa_family = AF_UNIX };
    assert_null(visitors_find(&g, &other, 0));
    visitors_finish(&g);
    visitors_finish(&g);
}

static void guesses_run_out_and_come_back_slowly(void **state)
{
    (void)state;
    struct visitors g;
    int64_t now = 5000000;

    assert_true(visitors_init(&g, 4));
    struct visitor *v = find(&g, "203.0.113.7", now);
    for (int i = 0; i < (int)VISITORS_GUESSES; i++) {
        assert_true(visitor_may_guess(&g, v, now));
        visitor_guessed_wrong(&g, v, now);
    }
    assert_false(visitor_may_guess(&g, v, now));
    now += (int64_t)(0.9e6 / VISITORS_GUESSES_A_S);
    assert_false(visitor_may_guess(&g, v, now));
    now += (int64_t)(0.2e6 / VISITORS_GUESSES_A_S);
    assert_true(visitor_may_guess(&g, v, now));
    visitor_guessed_wrong(&g, v, now);
    assert_false(visitor_may_guess(&g, v, now));
    now += (int64_t)3600 * 1000000; /* an hour buys no more than what one may do at once */
    int may = 0;
    for (; visitor_may_guess(&g, v, now); may++)
        visitor_guessed_wrong(&g, v, now);
    assert_int_equal(may, (int)VISITORS_GUESSES);
    visitors_finish(&g);
}

static void who_guessed_longest_ago_is_forgotten_and_who_is_connected_never(void **state)
{
    (void)state;
    struct visitors g;
    char text[32];

    assert_true(visitors_init(&g, 1));
    struct visitor *here = find(&g, "203.0.113.1", 1);
    here->connections = 1;
    struct visitor *guessing = find(&g, "203.0.113.2", 2);
    for (int i = 0; i < 5000; i++) { /* more addresses than rows, one after another */
        snprintf(text, sizeof(text), "10.0.%d.%d", i / 250, i % 250);
        visitor_guessed_wrong(&g, guessing, 10 + i);
        assert_non_null(find(&g, text, 10 + i));
    }
    assert_ptr_equal(find(&g, "203.0.113.1", 9000), here);
    assert_ptr_equal(find(&g, "203.0.113.2", 9000), guessing);
    for (uint32_t i = 0; i < g.count; i++)
        g.rows[i].connections = g.rows[i].connections ? g.rows[i].connections : 1;
    assert_null(find(&g, "192.0.2.77", 9001)); /* all rows hold a connection */
    visitors_finish(&g);
}

static void a_proxy_is_believed_in_its_last_word_only(void **state)
{
    (void)state;
    static const char *const nonsense[] = { "",        "unknown",       "1.2.3.4.5", "203.0.113.9,", "203.0.113.9 x",
                                            "_hidden", "203.0.113.9:80" };
    struct visitors g;
    char text[64];

    assert_true(visitors_init(&g, 4));
    struct visitor *v = find(&g, "203.0.113.9", 0);
    assert_ptr_equal(visitors_forwarded(&g, "203.0.113.9", 0, text, sizeof(text)), v);
    assert_ptr_equal(visitors_forwarded(&g, "127.0.0.1, 6.6.6.6,\t203.0.113.9 ", 0, text, sizeof(text)), v);
    assert_string_equal(text, "203.0.113.9");
    assert_string_equal(visitor_name(v, text), "203.0.113.9");
    assert_string_equal(visitor_name(find(&g, "2001:db8:0:1:2:3:4:5", 0), text), "2001:db8:0:1::");
    assert_ptr_equal(visitors_forwarded(&g, "6.6.6.6, 2001:db8::5", 0, text, sizeof(text)), find(&g, "2001:db8::1", 0));
    for (size_t i = 0; i < sizeof(nonsense) / sizeof(nonsense[0]); i++)
        if (visitors_forwarded(&g, nonsense[i], 0, text, sizeof(text)))
            fail_msg("'%s' was taken", nonsense[i]);
    visitors_finish(&g);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(an_address_is_one_however_it_is_written),
    cmocka_unit_test(guesses_run_out_and_come_back_slowly),
    cmocka_unit_test(who_guessed_longest_ago_is_forgotten_and_who_is_connected_never),
    cmocka_unit_test(a_proxy_is_believed_in_its_last_word_only),
};
UNIT_MAIN(tests)
