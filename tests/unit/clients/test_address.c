#include "support/unit.h"

#include "clients/common/connection.h"

#include <arpa/inet.h>
#include <openssl/x509v3.h>

static void host_port_and_path_are_found(void **state)
{
    static const struct {
        const char *text, *host, *named, *path;
        int port;
        bool tls;
    } good[] = {
        { "ws://localhost:9000", "localhost", "localhost:9000", "/ws", 9000, false },
        { "ws://localhost:9000/", "localhost", "localhost:9000", "/ws", 9000, false },
        { "http://127.0.0.1:8123/", "127.0.0.1", "127.0.0.1:8123", "/ws", 8123, false },
        { "ws://example.org", "example.org", "example.org:8080", "/ws", 8080, false },
        { "ws://[::1]:81/behind/proxy", "::1", "[::1]:81", "/behind/proxy", 81, false },
        { "http://example.org:80/sky/", "example.org", "example.org:80", "/sky/ws", 80, false },
        { "ws://[fe80::1]", "fe80::1", "[fe80::1]:8080", "/ws", 8080, false },
        { "ws://[fe80::1%eth0]:90", "fe80::1%eth0", "[fe80::1]:90", "/ws", 90, false },
        { "wss://example.org", "example.org", "example.org:443", "/ws", 443, true },
        { "https://[::1]:443/a", "::1", "[::1]:443", "/a", 443, true },
    };

    (void)state;
    for (size_t i = 0; i < sizeof(good) / sizeof(good[0]); i++) {
        struct address a;
        struct reason why;
        assert_int_equal(address_parse(good[i].text, &a, &why), ERR_OK);
        assert_string_equal(a.host, good[i].host);
        assert_string_equal(a.named, good[i].named);
        assert_string_equal(a.path, good[i].path);
        assert_int_equal(a.port, good[i].port);
        assert_int_equal(a.tls, good[i].tls);
    }
}

/* Whatever way an address is written, the certificate must name it: never is none asked for. */
static void every_address_is_held_to_the_certificate(void **state)
{
    static const struct {
        const char *text, *expected;
    } rows[] = { { "wss://[::1]", "::1" },
                 { "wss://[::1%1]", "::1" },
                 { "wss://[fe80::1%eth0]", "fe80::1" },
                 { "wss://[0:0::0001]", "::1" },
                 { "wss://[::ffff:192.0.2.1]", "::ffff:192.0.2.1" } };
    static const char *const none[] = { "wss://[::g]", "wss://[a:b]", "wss://[%1:]", "wss://[::1]x", "wss://[1:2%]" };
    struct address a;
    struct reason why;
    SSL_CTX *c = NULL;

    (void)state;
    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        uint8_t wanted[16], got[16];
        assert_int_equal(address_parse(rows[i].text, &a, &why), ERR_OK);
        assert_int_equal(trust_create(NULL, &a, &c, &why), ERR_OK);
        char *text = X509_VERIFY_PARAM_get1_ip_asc(SSL_CTX_get0_param(c));
        if (!text)
            fail_msg("%s: no address is asked for", rows[i].text);
        assert_int_equal(inet_pton(AF_INET6, rows[i].expected, wanted), 1);
        assert_int_equal(inet_pton(AF_INET6, text, got), 1);
        assert_memory_equal(got, wanted, sizeof(got));
        OPENSSL_free(text);
        SSL_CTX_free(c);
    }
    for (size_t i = 0; i < sizeof(none) / sizeof(none[0]); i++)
        if (address_parse(none[i], &a, &why) == ERR_OK && trust_create(NULL, &a, &c, &why) != ERR_USAGE)
            fail_msg("%s: is taken", none[i]);
}

static void nonsense_is_refused_by_name(void **state)
{
    static const char *const bad[] = {
        "",          "localhost:8080", "ws://",          "ws://:80",          "ws://h:",
        "ws://h:0",  "ws://h:65536",   "ws://h:123456",  "ws://h:8o",         "ws://a b",
        "ws://u@h",  "wss://",         "wss:h",          "https://h:8o",      "[::1]:80",
        "ws://[::1", "ws://[]:1",      "ws://[::1]x:80", "ws://h/a\nHost: x", "ftp://h",
    };
    char longer[700] = "ws://";

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        struct address a;
        struct reason why = { "" };
        if (address_parse(bad[i], &a, &why) != ERR_USAGE)
            fail_msg("taken: %s", bad[i]);
        if (bad[i][0] && !strstr(why.text, bad[i]))
            fail_msg("not named: %s", why.text);
    }
    for (int part = 0; part < 2; part++) { /* a host, then a path, that no buffer holds */
        struct address a;
        struct reason why;
        memset(longer + 5, 'a', sizeof(longer) - 6);
        if (part)
            longer[6] = '/';
        assert_int_equal(address_parse(longer, &a, &why), ERR_USAGE);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(host_port_and_path_are_found),
    cmocka_unit_test(nonsense_is_refused_by_name),
    cmocka_unit_test(every_address_is_held_to_the_certificate),
};

UNIT_MAIN(tests)
