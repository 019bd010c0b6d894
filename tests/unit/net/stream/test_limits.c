/* Clients, their limits on wrong tokens, and what a proxy says of them, on a made-up clock. */
#include "support/unit.h"

#include "net/stream/limits.h"

#include <netinet/in.h>
#include <sys/socket.h>

#define SECOND INT64_C(1000000)

static struct client *find(struct limits *l, const char *text, int64_t now_us)
{
    uint8_t address[16];

    assert_true(address_read(text, address));
    return client_find(l, address, now_us);
}

static void must_have_name(struct limits *l, const char *address, const char *name, bool loopback)
{
    char text[CLIENT_NAME];
    const struct client *c = find(l, address, 0);

    assert_string_equal(client_name(c, text), name);
    assert_int_equal(c->loopback, loopback);
}

static void addresses_are_told_apart_as_far_as_one_client_has_them(void **state)
{
    struct limits l = { 0 };
    (void)state;

    assert_true(limits_init(&l, 8));
    assert_ptr_equal(find(&l, "192.0.2.7", 0), find(&l, "::ffff:192.0.2.7", 5));
    assert_ptr_not_equal(find(&l, "192.0.2.7", 0), find(&l, "192.0.2.8", 0));
    assert_ptr_equal(find(&l, "2001:db8:1:2::1", 0), find(&l, "2001:db8:1:2:ffff::9", 0));
    assert_ptr_equal(find(&l, "2001:db8:1:2::1", 0), find(&l, "2001:db8:1:2:ffff::", 0));
    assert_ptr_not_equal(find(&l, "2001:db8:1:2::1", 0), find(&l, "2001:db8:1:3::1", 0));
    must_have_name(&l, "192.0.2.7", "192.0.2.7", false);
    must_have_name(&l, "127.0.0.1", "127.0.0.1", true);
    must_have_name(&l, "127.8.9.1", "127.8.9.1", true);
    must_have_name(&l, "::ffff:127.0.0.2", "127.0.0.2", true);
    must_have_name(&l, "10.127.0.1", "10.127.0.1", false);
    must_have_name(&l, "::1", "::", true);
    must_have_name(&l, "2001:db8:1:2::1", "2001:db8:1:2::", false);
    must_have_name(&l, "2001:db8::1", "2001:db8::", false);
    must_have_name(&l, "2001:db8:0:1:2:3:4:5", "2001:db8:0:1::", false);
    limits_finish(&l);
    assert_null(l.clients);
    limits_finish(&l);
}

/* A socket's address is the one that its text reads as; other families have none. */
static void addresses_of_sockets_are_those_of_their_texts(void **state)
{
    const struct sockaddr none = { .sa_family = AF_UNIX };
    struct sockaddr_in four = { .sin_family = AF_INET, .sin_addr = { htonl(0xc0000207) } };
    struct sockaddr_in6 six = { .sin6_family = AF_INET6, .sin6_addr = IN6ADDR_LOOPBACK_INIT };
    uint8_t taken[16], read[16];
    (void)state;

    assert_false(address_take(&none, taken));
    assert_true(address_take((const struct sockaddr *)&four, taken) && address_read("192.0.2.7", read));
    assert_memory_equal(taken, read, 16);
    assert_true(address_take((const struct sockaddr *)&six, taken) && address_read("::1", read));
    assert_memory_equal(taken, read, 16);
    assert_false(address_read("192.0.2", read));
}

static void a_proxy_is_believed_in_its_last_word_only(void **state)
{
    static const struct {
        const char *header, *address;
    } rows[] = { { "192.0.2.1", "192.0.2.1" },
                 { "10.0.0.1, 192.0.2.1", "192.0.2.1" },
                 { "127.0.0.1, 6.6.6.6,\t203.0.113.9 ", "203.0.113.9" },
                 { "10.0.0.1,\t 2001:db8::5 ", "2001:db8::5" },
                 { "6.6.6.6, 2001:db8::5", "2001:db8::1" },
                 { "2001:db8:aaaa:bbbb:cccc:dddd:192.100.200.250", "2001:db8:aaaa:bbbb::" } };
    static const char *const nonsense[] = { "",
                                            "unknown",
                                            "1.2.3.4.5",
                                            "192.0.2.1, ",
                                            "203.0.113.9,",
                                            "203.0.113.9 x",
                                            "_hidden",
                                            "203.0.113.9:80",
                                            "2001:db8:aaaa:bbbb:cccc:dddd:192.100.200.2500000" };
    struct limits l = { 0 };
    (void)state;

    assert_true(limits_init(&l, 8));
    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        struct client *c = client_forwarded(&l, rows[i].header, 0);
        assert_non_null(c);
        assert_true(c->named);
        assert_ptr_equal(c, find(&l, rows[i].address, 0));
    }
    must_have_name(&l, "203.0.113.9", "203.0.113.9", false);
    for (size_t i = 0; i < sizeof(nonsense) / sizeof(nonsense[0]); i++)
        if (client_forwarded(&l, nonsense[i], 0))
            fail_msg("'%s' was taken", nonsense[i]);
    limits_finish(&l);
}

/* Ten at once, then one in ten seconds. */
static void wrong_tokens_are_limited_by_address(void **state)
{
    struct limits l = { 0 };
    (void)state;

    assert_true(limits_init(&l, 8));
    struct client *c = find(&l, "192.0.2.1", SECOND), *other = find(&l, "192.0.2.2", SECOND);
    for (int i = 0; i < 10; i++) {
        assert_true(client_may_guess(&l, c, SECOND));
        client_guessed_wrong(&l, c, SECOND);
    }
    assert_false(client_may_guess(&l, c, SECOND));
    client_guessed_wrong(&l, c, SECOND); /* does not run up a debt */
    assert_true(client_may_guess(&l, other, SECOND));
    assert_false(client_may_guess(&l, c, SECOND + 9 * SECOND));
    assert_false(client_may_guess(&l, c, SECOND + 99 * SECOND / 10));
    assert_true(client_may_guess(&l, c, SECOND + 101 * SECOND / 10));
    client_guessed_wrong(&l, c, SECOND + 101 * SECOND / 10);
    assert_false(client_may_guess(&l, c, SECOND + 101 * SECOND / 10));
    for (int k = 1; k <= 4; k += 3) { /* after a quarter of an hour or an hour the bucket holds no more than ten */
        for (int i = 0; i < 10; i++) {
            assert_true(client_may_guess(&l, c, k * 1000 * SECOND));
            client_guessed_wrong(&l, c, k * 1000 * SECOND);
        }
        assert_false(client_may_guess(&l, c, k * 1000 * SECOND));
    }
    limits_finish(&l);
}

static struct client *of_group(struct limits *l, bool named, int i, int64_t now_us)
{
    char text[32];

    snprintf(text, sizeof(text), named ? "10.1.%d.%d" : "127.1.%d.%d", i / 250, i % 250);
    return named ? client_forwarded(l, text, now_us) : find(l, text, now_us);
}

/* A proxy may invent addresses, and this machine has 127.0.0.0/8: sixty wrong tokens of all of a group together, one
 * more each second; not those from which a right one came. */
static void addresses_that_one_person_may_have_share_a_limit(void **state)
{
    (void)state;
    for (int named = 0; named < 2; named++) {
        struct limits l = { 0 };
        assert_true(limits_init(&l, 8));
        struct client *late = of_group(&l, named, 5000, 1);
        late->guessed = true;
        for (int i = 0; i < 60; i++) {
            struct client *c = of_group(&l, named, i / 8, 1);
            assert_true(client_may_guess(&l, c, 1));
            client_guessed_wrong(&l, c, 1);
        }
        assert_false(client_may_guess(&l, late, 1));
        assert_true(client_may_guess(&l, find(&l, "192.0.2.1", 1), 1));
        assert_true(client_may_guess(&l, of_group(&l, !named, 1, 1), 1)); /* groups do not lock out each other */
        late->known = true;
        assert_true(client_may_guess(&l, late, 1));
        late->known = false;
        assert_false(client_may_guess(&l, late, 9 * SECOND / 10));
        assert_true(client_may_guess(&l, late, 102 * SECOND / 100)); /* looking takes nothing */
        client_guessed_wrong(&l, late, 102 * SECOND / 100);
        assert_false(client_may_guess(&l, late, 102 * SECOND / 100));
        assert_false(client_may_guess(&l, late, 199 * SECOND / 100));
        assert_true(client_may_guess(&l, late, 201 * SECOND / 100)); /* the 0.02 left were kept */
        limits_finish(&l);
    }
}

/* Sixteen addresses that guess as often as they may do not lock out those that never guessed wrong; and those, of which
 * there may be any number, get no more than twenty and one in two seconds among them. */
static void newcomers_are_heard_while_others_guess(void **state)
{
    struct limits l = { 0 };
    int checked = 0;
    (void)state;

    assert_true(limits_init(&l, 8));
    for (int64_t t = 1; t < 300 * SECOND; t += SECOND / 2)
        for (int i = 0; i < 16; i++) {
            struct client *c = of_group(&l, true, i, t);
            if (client_may_guess(&l, c, t))
                client_guessed_wrong(&l, c, t);
            if (i == 15 && !client_may_guess(&l, of_group(&l, true, 100 + (int)(t / SECOND), t), t))
                fail_msg("a newcomer is locked out after %g s", 1e-6 * (double)t);
        }
    for (int i = 0; i < 10000; i++) {
        const int64_t t = 300 * SECOND + i * SECOND / 100;
        struct client *c = of_group(&l, true, 1000 + i, t);
        if (!client_may_guess(&l, c, t))
            continue;
        client_guessed_wrong(&l, c, t);
        checked++;
    }
    assert_in_range(checked, 100, 100 * 1.5 + 62 + 22);
    limits_finish(&l);
}

static void who_has_most_places_gives_way(void **state)
{
    struct client a = { .used = true }, b = a, c = a;
    const struct client *const two[] = { &a, &a, &b }, *const three[] = { &a, NULL, &b, &b, &b, NULL };
    (void)state;

    assert_int_equal(client_crowds(two, 3, &c), 1);
    assert_int_equal(client_crowds(two, 3, &b), -1);
    assert_int_equal(client_crowds(two, 3, &a), -1);
    assert_int_equal(client_crowds(two + 1, 2, &c), -1); /* one each */
    assert_int_equal(client_crowds(three, 6, &a), 4);
    assert_int_equal(client_crowds(three, 6, &b), -1);
    assert_int_equal(client_crowds(three, 0, &a), -1);
}

/* A new client takes a free row, else that of the oldest guess without a connection. */
static void rows_without_connections_are_taken_again(void **state)
{
    struct limits l = { 0 };
    char name[32];
    (void)state;

    assert_true(limits_init(&l, 2));
    assert_int_equal(l.count, 2 + CLIENTS_REMEMBERED);
    for (uint32_t i = 0; i < l.count; i++) {
        snprintf(name, sizeof(name), "10.%u.%u.1", i / 250, i % 250);
        find(&l, name, 1000 + (int64_t)(i == 7 ? 0 : i))->connections[i % CONNECTION_STATES] = i < 7;
    }
    struct client *taken = &l.clients[7];
    assert_ptr_equal(find(&l, "192.0.2.1", 5000), taken);
    assert_int_equal(taken->guesses.at_us, 5000);
    assert_true(taken->guesses.left == CLIENT_GUESSES);
    assert_ptr_equal(find(&l, "192.0.2.2", 5000), &l.clients[8]);
    for (uint32_t i = 0; i < l.count; i++)
        l.clients[i].connections[i % CONNECTION_STATES] = 1;
    assert_null(find(&l, "192.0.2.3", 5000));
    assert_ptr_equal(find(&l, "192.0.2.1", 5000), taken);
    limits_finish(&l);
}

static void who_guessed_longest_ago_is_forgotten_and_who_is_connected_never(void **state)
{
    struct limits l = { 0 };
    char text[32];
    (void)state;

    assert_true(limits_init(&l, 1));
    struct client *here = find(&l, "203.0.113.1", 1);
    here->connections[CONNECTION_ARRIVING] = 1;
    struct client *guessing = find(&l, "203.0.113.2", 2);
    for (int i = 0; i < 5000; i++) { /* more addresses than rows, one after another */
        snprintf(text, sizeof(text), "10.0.%d.%d", i / 250, i % 250);
        client_guessed_wrong(&l, guessing, 10 + i);
        assert_non_null(find(&l, text, 10 + i));
    }
    assert_ptr_equal(find(&l, "203.0.113.1", 9000), here);
    assert_ptr_equal(find(&l, "203.0.113.2", 9000), guessing);
    for (uint32_t i = 0; i < l.count; i++)
        l.clients[i].connections[CONNECTION_ARRIVING] = 1;
    assert_null(find(&l, "192.0.2.77", 9001)); /* all rows hold a connection */
    limits_finish(&l);
}

/* Full at first; what is taken comes back at the rate, and never more than the most. */
static void buckets_refill_up_to_their_most(void **state)
{
    struct bucket b = { 0 };
    (void)state;

    assert_true(bucket_fill(&b, 3.0, 2.0, SECOND) == 3.0);
    for (int i = 0; i < 3; i++)
        assert_true(bucket_take(&b, 3.0, 2.0, SECOND));
    assert_false(bucket_take(&b, 3.0, 2.0, SECOND));
    assert_true(b.left == 0.0);
    assert_true(bucket_fill(&b, 3.0, 2.0, 2 * SECOND) == 2.0);
    assert_true(bucket_fill(&b, 3.0, 2.0, 60 * SECOND) == 3.0);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(addresses_are_told_apart_as_far_as_one_client_has_them),
    cmocka_unit_test(addresses_of_sockets_are_those_of_their_texts),
    cmocka_unit_test(a_proxy_is_believed_in_its_last_word_only),
    cmocka_unit_test(wrong_tokens_are_limited_by_address),
    cmocka_unit_test(addresses_that_one_person_may_have_share_a_limit),
    cmocka_unit_test(newcomers_are_heard_while_others_guess),
    cmocka_unit_test(who_has_most_places_gives_way),
    cmocka_unit_test(rows_without_connections_are_taken_again),
    cmocka_unit_test(who_guessed_longest_ago_is_forgotten_and_who_is_connected_never),
    cmocka_unit_test(buckets_refill_up_to_their_most),
};
UNIT_MAIN(tests)
