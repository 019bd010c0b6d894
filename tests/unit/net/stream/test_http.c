/* What the server answers to plain HTTP, and how it starts and ends. */
#include "net/stream/client.h"
#include "net/stream/internal.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/stat.h>

struct answer {
    int status;
    char head[4096];
    char body[65536];
};

static void ask(const struct server *s, const char *request, struct answer *a)
{
    struct test_client c;

    client_open(&c, s);
    a->status = client_request(&c, request);
    snprintf(a->head, sizeof(a->head), "%s", (char *)c.message);
    shutdown(c.fd, SHUT_WR);
    snprintf(a->body, sizeof(a->body), "%s", client_rest(&c));
    client_shut(&c);
}

static void page_is_served_with_its_security_headers(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct answer a;

    ask(s, "GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", &a);
    assert_int_equal(a.status, 200);
    assert_non_null(strstr(a.head, "text/html"));
    assert_non_null(strstr(a.head, "content-security-policy: default-src 'none'"));
    assert_non_null(strstr(a.body, "<title>relightd</title>"));
    ask(s, "GET /app.js HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", &a);
    assert_int_equal(a.status, 200);
    assert_non_null(strstr(a.head, "text/javascript"));
    server_destroy(s);
}

static void every_answer_carries_the_security_headers(void **state)
{
    (void)state;
    static const char *const requests[] = { "GET /",        "HEAD /app.js", "GET /worker.js", "GET /healthz",
                                            "GET /nothing", "POST /",       "GET /?host" };
    static const char *const headers[] = {
        "content-security-policy: default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; ",
        "frame-ancestors 'none'",
        "x-content-type-options: nosniff\r\n",
        "referrer-policy: no-referrer\r\n",
        "x-frame-options: DENY\r\n",
        "cross-origin-opener-policy: same-origin\r\n",
        "cross-origin-resource-policy: same-origin\r\n",
        "permissions-policy: camera=()",
    };
    struct server *s = server_start(NULL);
    struct answer a;
    char request[256];

    for (size_t i = 0; i < sizeof(requests) / sizeof(requests[0]); i++) {
        const bool foreign = strstr(requests[i], "?host") != NULL;
        snprintf(request, sizeof(request), "%s HTTP/1.1\r\nHost: %s\r\nConnection: close\r\n\r\n", requests[i],
                 foreign ? "evil.example" : "localhost");
        ask(s, request, &a);
        assert_true(a.status >= 200);
        for (size_t k = 0; k < sizeof(headers) / sizeof(headers[0]); k++)
            if (!strstr(a.head, headers[k]))
                fail_msg("%s (%d): no '%s'", requests[i], a.status, headers[k]);
        assert_null(strstr(a.head, "unsafe"));
    }
    server_destroy(s);
}

static void head_sends_no_body_and_etag_saves_one(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct answer a;
    char request[512];

    ask(s, "HEAD / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", &a);
    assert_int_equal(a.status, 200);
    assert_string_equal(a.body, "");
    const char *etag = strstr(a.head, "etag: ");
    assert_non_null(etag);
    snprintf(request, sizeof(request),
             "GET / HTTP/1.1\r\nHost: localhost\r\nIf-None-Match: %.18s\r\nConnection: close\r\n\r\n", etag + 6);
    ask(s, request, &a);
    assert_int_equal(a.status, 304);
    assert_string_equal(a.body, "");
    server_destroy(s);
}

static void health_names_the_protocol(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct answer a;

    ask(s, "GET /healthz HTTP/1.1\r\nHost: [::1]:80\r\nConnection: close\r\n\r\n", &a);
    assert_int_equal(a.status, 200);
    json_t *health = json_loads(a.body, 0, NULL);
    assert_non_null(health);
    assert_string_equal(json_string_value(json_object_get(health, "protocol")), PROTOCOL_NAME);
    assert_string_equal(json_string_value(json_object_get(health, "status")), "ok");
    json_decref(health);
    server_destroy(s);
}

static void paths_outside_the_page_find_nothing(void **state)
{
    (void)state;
    static const char *const paths[] = { "/../style.css",
                                         "/%2e%2e/protocol.js",
                                         "/..%2f..%2fLICENSE",
                                         "//etc/passwd",
                                         "/style.css%00.html",
                                         "/.gitignore",
                                         "/ws",
                                         "/style.css/",
                                         "/../../../etc/passwd",
                                         "/index.htm",
                                         "/./",
                                         "*" };
    struct server *s = server_start(NULL);
    struct answer a;
    char request[256];

    for (size_t i = 0; i < sizeof(paths) / sizeof(paths[0]); i++) {
        snprintf(request, sizeof(request), "GET %s HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", paths[i]);
        ask(s, request, &a);
        /* lws tidies some paths by itself; then it is the page or nothing, and never another file */
        if (a.status == 200)
            assert_true(strstr(a.body, "<title>relightd</title>") || strstr(a.body, "--ground") ||
                        strstr(a.body, "relight.v1"));
        assert_null(strstr(a.body, "root:x:")); /* of /etc/passwd; style.css has a :root: */
        assert_null(strstr(a.body, "Permission is hereby granted"));
    }
    ask(s, "GET /nothing HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", &a);
    assert_int_equal(a.status, 404);
    server_destroy(s);
}

/* What a proxy guards under one name has no other here; what proxies tidy themselves is tidied. */
static void a_path_has_one_name(void **state)
{
    (void)state;
    static const char *const paths[] = { "/metrics;x",   "/metrics;",   "/metrics&x",  "/metrics&",
                                         "/metrics%3bx", "/metrics%3B", "/metrics;?x", "/metrics%26x",
                                         "/metrics%3fx", "/healthz;a",  "/metrics/",   "/metrics%20",
                                         "/metrics%00",  "/METRICS",    "/;/metrics",  "/snapshot.jpg;width=64",
                                         "/app.js;x" };
    struct server *s = server_start(NULL);
    struct answer a;
    char request[256];

    for (size_t i = 0; i < sizeof(paths) / sizeof(paths[0]); i++) {
        snprintf(request, sizeof(request), "GET %s HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", paths[i]);
        ask(s, request, &a);
        if (a.status == 200 || a.status == 503)
            fail_msg("%s is answered with %d", paths[i], a.status);
    }
    ask(s, "GET /metrics?x=1;y HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", &a);
    assert_int_equal(a.status, 200);
    ask(s, "GET /%6detrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", &a);
    assert_int_equal(a.status, 200);
    server_destroy(s);
}

#define FETCH(site, mode, dest) "Sec-Fetch-Site: " site "\r\nSec-Fetch-Mode: " mode "\r\nSec-Fetch-Dest: " dest "\r\n"

static int status_of(const struct server *s, const char *path, const char *lines)
{
    struct answer a;
    char request[512];

    snprintf(request, sizeof(request), "GET %s HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n%s\r\n", path,
             lines);
    ask(s, request, &a);
    return a.status;
}

/* Pages of other sites get nothing, neither as images nor as frames; a link leads here. */
static void pages_of_other_sites_get_nothing_but_their_links_work(void **state)
{
    static const char *const paths[] = { "/snapshot.jpg", "/", "/healthz", "/app.js", "/embed", "/metrics" };
    static const char *const foreign[] = {
        FETCH("cross-site", "no-cors", "image"),
        FETCH("cross-site", "navigate", "iframe"),
        FETCH("cross-site", "navigate", "embed"),
        FETCH("cross-site", "navigate", "object"),
        FETCH("cross-site", "navigate", "frame"),
        FETCH("same-site", "navigate", "iframe"),
        FETCH("cross-site", "no-cors", "script"),
        FETCH("cross-site", "no-cors", "empty"),
        FETCH("cross-site", "cors", "document"),
        "Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: navigate\r\n",
        FETCH("cross-site", "navigate", "document") "Sec-Purpose: prefetch;prerender\r\n",
    };
    static const char *const good[] = {
        FETCH("cross-site", "navigate", "document"),
        FETCH("same-origin", "no-cors", "image"),
        FETCH("same-origin", "navigate", "iframe"),
        FETCH("none", "navigate", "document"),
    };
    const struct server_desc desc = { .embed_from = "https://a.example" };
    struct server *s = server_start(NULL), *embedded = server_start(&desc);
    (void)state;

    publish(s, 1, 1000);
    for (size_t i = 0; i < sizeof(paths) / sizeof(paths[0]); i++) {
        for (size_t k = 0; k < sizeof(foreign) / sizeof(foreign[0]); k++)
            if (status_of(s, paths[i], foreign[k]) != 403)
                fail_msg("%s is answered to %s", paths[i], foreign[k]);
        for (size_t k = 0; k < sizeof(good) / sizeof(good[0]); k++)
            if (status_of(s, paths[i], good[k]) != 200)
                fail_msg("%s is refused to %s", paths[i], good[k]);
    }
    assert_int_equal(status_of(embedded, "/embed", FETCH("cross-site", "navigate", "iframe")), 200);
    assert_int_equal(status_of(embedded, "/embed", FETCH("cross-site", "navigate", "object")), 403);
    assert_int_equal(status_of(embedded, "/", FETCH("cross-site", "navigate", "iframe")), 403);
    server_destroy(s);
    server_destroy(embedded);
}

static void other_methods_and_bodies_are_refused(void **state)
{
    (void)state;
    static const char *const requests[] = {
        "POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 3\r\n\r\na=b",
        "POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000000\r\n\r\n",
        "PUT / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 3\r\n\r\nabc",
        "DELETE / HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "OPTIONS / HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "TRACE / HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 3\r\n\r\nabc",
        "GET / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: -1\r\n\r\n",
        ("GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: h2c\r\nConnection: Upgrade, HTTP2-Settings\r\n"
         "HTTP2-Settings: AAMAAABkAAQCAAAAAAIAAAAA\r\n\r\n"),
        "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        "GET / HTTP/1.1\r\n\r\n",
        "\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n",
    };
    struct server *s = server_start(NULL);
    struct answer a;

    for (size_t i = 0; i < sizeof(requests) / sizeof(requests[0]); i++) {
        ask(s, requests[i], &a);
        if (a.status != 0 && a.status != 403 && a.status != 404 && a.status != 405 && a.status != 413)
            fail_msg("request %zu: status %d", i, a.status);
        assert_null(strstr(a.body, "<title>relightd</title>"));
    }
    ask(s, "GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", &a);
    assert_int_equal(a.status, 200); /* and it still stands */
    server_destroy(s);
}

static void foreign_host_names_are_refused(void **state)
{
    (void)state;
    static const char *const hosts[] = { "evil.example",
                                         "evil.example:80",
                                         "localhost.evil.example",
                                         "127.evil.example",
                                         "[localhost]evil.example",
                                         "[::1]evil.example",
                                         "[::1",
                                         "localhost:80evil.example",
                                         "localhost:80:evil.example",
                                         "" };
    struct server *s = server_start(NULL);
    struct answer a;
    char request[256];

    for (size_t i = 0; i < sizeof(hosts) / sizeof(hosts[0]); i++) {
        snprintf(request, sizeof(request), "GET / HTTP/1.1\r\nHost: %s\r\nConnection: close\r\n\r\n", hosts[i]);
        ask(s, request, &a);
        assert_true(a.status == 403 || a.status == 0);
        assert_null(strstr(a.body, "<title>"));
    }
    server_destroy(s);
}

static void oversized_headers_cost_only_their_connection(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct answer a;
    char *request = malloc(70000);

    assert_non_null(request);
    memset(request, 'x', 70000);
    memcpy(request, "GET /", 5);
    request[69999] = 0;
    ask(s, request, &a);
    assert_int_not_equal(a.status, 200);
    memcpy(request, "GET / HTTP/1.1\r\nHost: localhost\r\nX: ", 36);
    ask(s, request, &a);
    assert_int_not_equal(a.status, 200);
    free(request);
    ask(s, "GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", &a);
    assert_int_equal(a.status, 200);
    server_destroy(s);
}

static void several_requests_on_one_connection_are_answered_in_turn(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;

    client_open(&c, s);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(client_request(&c, "GET /style.css HTTP/1.1\r\nHost: localhost\r\n\r\n"), 200);
        const char *length = strstr((char *)c.message, "content-length: ");
        assert_non_null(length);
        const size_t size = (size_t)atol(length + 16);
        assert_true(size > 1000);
        while (c.in_size < size && client_fill(&c, CLIENT_WAIT_MS)) {
        }
        assert_int_equal(c.in_size, size);
        client_drop(&c, size);
    }
    client_shut(&c);
    server_destroy(s);
}

static void a_port_in_use_is_one_clear_line(void **state)
{
    (void)state;
    struct server *first = server_start(NULL), *second = NULL;
    const struct server_desc desc = { .port = server_port(first) };
    struct reason why = { { 0 } };
    char port[16];

    assert_int_equal(server_create(&desc, &second, &why), ERR_IO);
    assert_null(second);
    snprintf(port, sizeof(port), "port %u ", server_port(first));
    assert_non_null(strstr(why.text, port));
    assert_non_null(strstr(why.text, "in use"));
    assert_null(strchr(why.text, '\n'));
    server_destroy(first);
    /* and it is free at once when the first has gone */
    assert_int_equal(server_create(&desc, &second, &why), ERR_OK);
    assert_int_equal(server_port(second), desc.port);
    server_destroy(second);
}

static void only_loopback_is_bound_unless_remote_is_allowed(void **state)
{
    (void)state;
    struct server_desc desc = { .address = "0.0.0.0" };
    struct server *s = NULL;
    struct reason why = { { 0 } };
    struct answer a;

    assert_int_equal(server_create(&desc, &s, &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "0.0.0.0"));
    desc.allow_remote = true;
    assert_int_equal(server_create(&desc, &s, &why), ERR_USAGE); /* who comes from outside must show a token */
    assert_non_null(strstr(why.text, "--token-viewer"));
    desc.tokens[SERVER_VIEWER] = "v";
    desc.push = true;
    assert_int_equal(server_create(&desc, &s, &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "--token-producer"));
    desc.tokens[SERVER_PRODUCER] = "p";
    desc.public_names = "known.example";
    s = server_start(&desc);
    ask(s, "GET / HTTP/1.1\r\nHost: any.name.example\r\nConnection: close\r\n\r\n", &a);
    assert_int_equal(a.status, 403);
    ask(s, "GET / HTTP/1.1\r\nHost: known.example\r\nConnection: close\r\n\r\n", &a);
    assert_int_equal(a.status, 200);
    desc.public_names = NULL;
    server_destroy(s);
    desc.address = "localhost";
    s = server_start(&desc);
    assert_non_null(strstr(server_url(s), "http://127.0.0.1:"));
    server_destroy(s);
}

static void what_is_no_address_is_refused_by_name(void **state)
{
    (void)state;
    static const char *const bad[] = { "256.0.0.1", "example.org", "127.0.0.1:80", "lo" };
    struct server *s = NULL;
    struct reason why;

    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        const struct server_desc desc = { .address = bad[i] };
        assert_int_equal(server_create(&desc, &s, &why), ERR_USAGE);
        assert_non_null(strstr(why.text, bad[i]));
        assert_null(s);
    }
}

static void a_folder_without_a_page_is_refused_by_name(void **state)
{
    (void)state;
    char dir[] = "/tmp/relight-web-XXXXXX";
    struct server_desc desc = { .web_dir = "/nonexistent" };
    struct server *s = NULL;
    struct reason why;

    assert_int_equal(server_create(&desc, &s, &why), ERR_IO);
    assert_non_null(strstr(why.text, "/nonexistent"));
    assert_int_equal(server_check(&desc, &why), ERR_IO);
    assert_non_null(mkdtemp(dir));
    desc.web_dir = dir;
    assert_int_equal(server_create(&desc, &s, &why), ERR_IO);
    assert_non_null(strstr(why.text, "index.html"));
    snprintf(why.text, sizeof(why.text), "none");
    assert_int_equal(server_check(&desc, &why), ERR_IO);
    assert_non_null(strstr(why.text, "index.html"));
    desc.web_dir = NULL;
    assert_int_equal(server_check(&desc, &why), ERR_OK);
    desc.address = "0.0.0.0"; /* without a token */
    assert_int_equal(server_check(&desc, &why), ERR_USAGE);
    assert_int_equal(rmdir(dir), 0);
}

static void destroy_takes_nothing_and_what_was_never_used(void **state)
{
    (void)state;
    server_destroy(NULL);
    for (int i = 0; i < 5; i++)
        server_destroy(server_start(NULL));
}

/* A dual-stack socket has IPv4 as ::ffff:192.0.2.7; a name is never an address. */
static void a_number_is_the_sockets_own_or_none(void **state)
{
    static const struct {
        int family;
        const char *socket, *name;
        bool same;
    } cases[] = {
        { AF_INET, "192.0.2.7", "192.0.2.7", true },
        { AF_INET, "192.0.2.7", "192.0.2.8", false },
        { AF_INET, "192.0.2.7", "relight.example", false },
        { AF_INET, "192.0.2.7", "::ffff:192.0.2.7", false },
        { AF_INET6, "::ffff:192.0.2.7", "192.0.2.7", true },
        { AF_INET6, "::ffff:192.0.2.7", "192.0.2.8", false },
        { AF_INET6, "2001:db8::7", "2001:db8::7", true },
        { AF_INET6, "2001:db8::7", "2001:db8::8", false },
        { AF_INET6, "2001:db8::c000:207", "192.0.2.7", false },
        { AF_INET6, "::ffff:0.0.0.0", "0.0.0.0", true },
    };
    (void)state;

    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        struct sockaddr_storage local = { .ss_family = (sa_family_t)cases[k].family };
        void *at = cases[k].family == AF_INET ? (void *)&((struct sockaddr_in *)&local)->sin_addr
                                              : (void *)&((struct sockaddr_in6 *)&local)->sin6_addr;
        assert_int_equal(inet_pton(cases[k].family, cases[k].socket, at), 1);
        if (http_is_address(&local, cases[k].name) != cases[k].same)
            fail_msg("%s at %s", cases[k].name, cases[k].socket);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(page_is_served_with_its_security_headers),
    cmocka_unit_test(every_answer_carries_the_security_headers),
    cmocka_unit_test(head_sends_no_body_and_etag_saves_one),
    cmocka_unit_test(health_names_the_protocol),
    cmocka_unit_test(paths_outside_the_page_find_nothing),
    cmocka_unit_test(a_path_has_one_name),
    cmocka_unit_test(pages_of_other_sites_get_nothing_but_their_links_work),
    cmocka_unit_test(other_methods_and_bodies_are_refused),
    cmocka_unit_test(foreign_host_names_are_refused),
    cmocka_unit_test(oversized_headers_cost_only_their_connection),
    cmocka_unit_test(several_requests_on_one_connection_are_answered_in_turn),
    cmocka_unit_test(a_port_in_use_is_one_clear_line),
    cmocka_unit_test(only_loopback_is_bound_unless_remote_is_allowed),
    cmocka_unit_test(what_is_no_address_is_refused_by_name),
    cmocka_unit_test(a_folder_without_a_page_is_refused_by_name),
    cmocka_unit_test(destroy_takes_nothing_and_what_was_never_used),
    cmocka_unit_test(a_number_is_the_sockets_own_or_none),
};
UNIT_MAIN(tests)
