#include "support/unit.h"

#include "clients/common/address.h"

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
        { "ws://[fe80::1]", "fe80::1", "[fe80::1]:8080", "/ws", 8080, false },
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

static void nonsense_is_refused_by_name(void **state)
{
    static const char *const bad[] = {
        "",
        "localhost:8080",
        "ws://",
        "ws://:80",
        "ws://h:",
        "ws://h:0",
        "ws://h:65536",
        "ws://h:123456",
        "ws://h:8o",
        "ws://a b",
        "ws://u@h",
        "wss://",
        "wss:h",
        "https://h:8o",
        "[::1]:80",
        "ws://[::1",
        "ws://[]:1",
        "ws://[::1]x:80",
        "ws://h/a\nHost: x",
        "ftp://h",
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
};

UNIT_MAIN(tests)
