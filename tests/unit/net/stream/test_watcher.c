/* Images by plain HTTP: single ones and streams, their access, limits and renditions. */
#include "base/log.h"
#include "net/stream/client.h"

#include <errno.h>
#include <stdatomic.h>

#define HEAD_END "\r\n\r\n"

struct answer {
    int status;
    char head[4096];
    uint8_t body[65536];
    size_t size;
};

/* One request with these further header lines, and the whole answer. */
static void ask(const struct server *s, const char *method, const char *path, const char *lines, struct answer *a)
{
    struct test_client c;
    char request[1024];

    snprintf(request, sizeof(request), "%s %s HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n%s\r\n", method, path,
             lines ? lines : "");
    client_open(&c, s);
    a->status = client_request(&c, request);
    snprintf(a->head, sizeof(a->head), "%s", (char *)c.message);
    client_rest(&c);
    assert_true(c.in_size < sizeof(a->body));
    memcpy(a->body, c.in, c.in_size);
    a->size = c.in_size;
    a->body[a->size] = 0;
    client_shut(&c);
}

static int status_of(const struct server *s, const char *path, const char *lines)
{
    struct answer a;

    ask(s, "GET", path, lines, &a);
    return a.status;
}

/* The byte at i of the image that publish() makes of this frame. */
static uint8_t byte_of(uint64_t frame, size_t i)
{
    return (uint8_t)(frame * 31 + i * 7);
}

static void snapshot_is_the_newest_image(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct answer a;

    publish(s, 1, 1000);
    publish(s, 2, 30001);
    ask(s, "GET", "/snapshot.jpg", NULL, &a);
    assert_int_equal(a.status, 200);
    assert_non_null(strstr(a.head, "content-type: image/jpeg\r\n"));
    assert_non_null(strstr(a.head, "content-length: 30001\r\n"));
    assert_non_null(strstr(a.head, "cache-control: no-store\r\n"));
    assert_non_null(strstr(a.head, "cross-origin-resource-policy: same-origin\r\n"));
    assert_int_equal(a.size, 30001);
    for (size_t i = 0; i < a.size; i++)
        assert_int_equal(a.body[i], byte_of(2, i));
    ask(s, "HEAD", "/snapshot.jpg", NULL, &a);
    assert_int_equal(a.status, 200);
    assert_non_null(strstr(a.head, "content-length: 30001\r\n"));
    assert_int_equal(a.size, 0);
    ask(s, "HEAD", "/stream.mjpeg", NULL, &a);
    assert_int_equal(a.status, 200);
    assert_non_null(strstr(a.head, "multipart/x-mixed-replace"));
    assert_int_equal(a.size, 0);
    server_destroy(s);
}

/* A format that nobody watched is of an older frame than the one being encoded. */
static void snapshot_waits_for_an_image_of_the_present_frame(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;

    publish(s, 1, 1000);
    server_begin_image(s);
    client_open(&c, s);
    client_write(&c, "GET /snapshot.jpg HTTP/1.1\r\nHost: localhost\r\n\r\n", 47);
    assert_false(client_fill(&c, 300));
    publish(s, 2, 2000);
    assert_int_equal(client_request(&c, ""), 200);
    assert_non_null(strstr((char *)c.message, "content-length: 2000\r\n"));
    client_shut(&c);
    server_destroy(s);
}

static void one_connection_may_ask_again(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;

    publish(s, 1, 500);
    client_open(&c, s);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(client_request(&c, "GET /snapshot.jpg HTTP/1.1\r\nHost: localhost\r\n\r\n"), 200);
        while (c.in_size < 500)
            assert_true(client_fill(&c, CLIENT_WAIT_MS));
        assert_int_equal(c.in_size, 500);
        client_drop(&c, 500);
    }
    client_shut(&c);
    server_destroy(s);
}

static void bad_requests_are_answered_in_a_line(void **state)
{
    (void)state;
    static const char *const widths[] = { "0", "15", "16385", "-5", "+20", "1e3", "64x", "", "99999999999999999999" };
    struct server *s = server_start(NULL);
    struct answer a;
    char path[128];

    ask(s, "GET", "/snapshot.jpg", NULL, &a);
    assert_int_equal(a.status, 503);
    assert_non_null(strstr((char *)a.body, "There is no image yet: "));
    assert_int_equal(status_of(s, "/stream.mjpeg", NULL), 503);
    publish(s, 1, 500);
    for (size_t i = 0; i < sizeof(widths) / sizeof(widths[0]); i++) {
        snprintf(path, sizeof(path), "/snapshot.png?width=%s", widths[i]);
        ask(s, "GET", path, NULL, &a);
        assert_int_equal(a.status, 400);
        assert_string_equal((char *)a.body,
                            "width must be an integer from 16 to 16384, as in /snapshot.png?width=640\n");
    }
    server_set_figures(s, &(struct server_figures){ .source = SERVER_LIVE, .width = 640, .height = 360 });
    assert_int_equal(status_of(s, "/snapshot.jpg?width=9000", NULL), 200); /* wider than it is: as it is */
    ask(s, "GET", "/snapshot.gif", NULL, &a);
    assert_int_equal(a.status, 404);
    assert_non_null(strstr((char *)a.body, "/snapshot.jpg"));
    assert_int_equal(status_of(s, "/snapshot.jpg", "Origin: http://evil.example\r\n"), 403);
    server_destroy(s);
}

/* Until the last viewer has gone, or is given up: this one takes no bytes, so that it cannot be sent away. */
static void a_server_that_leaves_says_so(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct server_counters before = { .bytes = 0 }, now;
    struct test_client viewer;
    struct answer a;

    publish(s, 1, 500);
    assert_int_equal(status_of(s, "/snapshot.jpg", NULL), 200);
    client_watch(&viewer, s);
    publish(s, 2, 30000000);
    for (int waited = 0; waited < CLIENT_WAIT_MS; waited += 100) {
        sleep_ms(100);
        server_counters(s, &now);
        if (now.bytes > 10000 && now.bytes == before.bytes)
            break;
        before = now;
    }
    server_drain(s);
    ask(s, "GET", "/snapshot.jpg", NULL, &a);
    assert_int_equal(a.status, 503);
    assert_string_equal((char *)a.body, "The server is shutting down.\n");
    client_shut(&viewer);
    server_destroy(s);
}

static void token_is_taken_as_bearer_or_password(void **state)
{
    (void)state;
    const struct server_desc desc = { .tokens = { [SERVER_VIEWER] = "a-secret" } };
    struct server *s = server_start(&desc);
    struct answer a;

    publish(s, 1, 500);
    ask(s, "GET", "/snapshot.jpg?token=a-secret", NULL, &a);
    assert_int_equal(a.status, 401);
    assert_non_null(strstr(a.head, "www-authenticate: Basic"));
    assert_non_null(strstr((char *)a.body, "Authorization: Bearer TOKEN"));
    assert_null(strstr((char *)a.body, "a-secret"));
    assert_int_equal(status_of(s, "/stream.mjpeg", NULL), 401);
    assert_int_equal(status_of(s, "/snapshot.jpg", "Authorization: Bearer a-secret\r\n"), 200);
    assert_int_equal(status_of(s, "/snapshot.jpg", "Authorization: Basic dmlld2VyOmEtc2VjcmV0\r\n"),
                     200); /* viewer:a-secret */
    static const char *const wrong[] = { "Bearer a-secre", "Basic dmlld2VyOmEtc2VjcmU=", "Basic !!!",
                                         "Basic YS1zZWNyZXQ=", "Digest a-secret" };
    for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
        char line[128];
        snprintf(line, sizeof(line), "Authorization: %s\r\n", wrong[i]);
        assert_int_equal(status_of(s, "/snapshot.jpg", line), 401);
    }
    for (int i = 0; i < 9; i++)
        status_of(s, "/snapshot.jpg", "Authorization: Bearer guess\r\n");
    assert_int_equal(status_of(s, "/snapshot.jpg", "Authorization: Bearer a-secret\r\n"), 429);
    server_destroy(s);
}

/* ---- Streams ---- */

static void open_stream(struct test_client *c, const struct server *s, const char *path)
{
    char request[256];

    client_open(c, s);
    snprintf(request, sizeof(request), "GET %s HTTP/1.1\r\nHost: localhost\r\n\r\n", path);
    assert_int_equal(client_request(c, request), 200);
    assert_non_null(strstr((char *)c->message, "multipart/x-mixed-replace; boundary=relightd\r\n"));
}

/* The end of the header of the next part, which stays in c->in; NULL: none came. */
static char *await_head(struct test_client *c)
{
    for (;;) {
        for (size_t i = 0; i + 4 <= c->in_size && i < 300; i++)
            if (memcmp(c->in + i, HEAD_END, 4) == 0)
                return (char *)c->in + i;
        if (!client_fill(c, CLIENT_WAIT_MS))
            return NULL;
    }
}

/* Takes a little of what has come. */
static void sip(struct test_client *c)
{
    const ssize_t n = recv(c->fd, c->in + c->in_size, 32768, MSG_DONTWAIT);

    c->in_size += n > 0 ? (size_t)n : 0;
}

/* The next part whole: its first byte, and its size in *size; -1: none came. */
static int next_part(struct test_client *c, size_t *size)
{
    static const char head[] = "--relightd\r\nContent-Type: image/jpeg\r\nContent-Length: ";
    const char *end = await_head(c);

    if (!end)
        return -1;
    assert_memory_equal(c->in, head, sizeof(head) - 1);
    *size = strtoul((char *)c->in + sizeof(head) - 1, NULL, 10);
    client_drop(c, (size_t)(end + 4 - (char *)c->in));
    /* With the part comes the boundary that shows its end. */
    while (c->in_size < *size + 14)
        if (!client_fill(c, CLIENT_WAIT_MS))
            return -1;
    assert_memory_equal(c->in + *size, "\r\n--relightd\r\n", 14);
    const int first = c->in[0];
    client_drop(c, *size + 2);
    return first;
}

static void stream_brings_every_image_to_who_reads(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;
    size_t size;

    publish(s, 1, 100000);
    open_stream(&c, s, "/stream.mjpeg");
    for (uint64_t i = 1; i <= 20; i++) {
        assert_int_equal(next_part(&c, &size), byte_of(i, 0));
        assert_int_equal(size, 100000 + i - 1);
        publish(s, i + 1, 100000 + i);
    }
    client_shut(&c);
    server_destroy(s);
}

static void a_slow_stream_skips_to_the_newest_and_delays_nobody(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct server_counters counters;
    struct test_client slow, healthy;
    long before = 0;
    size_t size;
    int parts = 0;

    publish(s, 1, 1000000);
    open_stream(&slow, s, "/stream.mjpeg");
    open_stream(&healthy, s, "/stream.mjpeg");
    for (uint64_t i = 1; i <= 100; i++) {
        assert_int_equal(next_part(&healthy, &size), byte_of(i, 0));
        sip(&slow); /* one that takes nothing at all is given up */
        if (i == 20)
            before = resident_kib();
        if (i < 100)
            publish(s, i + 1, 1000000);
    }
    assert_true(resident_kib() - before < 8192); /* 80 MB went by */
    int first = 0;
    while (first != byte_of(100, 0)) {
        first = next_part(&slow, &size);
        assert_true(first >= 0 && ++parts < 30);
    }
    server_counters(s, &counters);
    assert_true(counters.skipped > 50);
    client_shut(&slow);
    client_shut(&healthy);
    server_destroy(s);
}

static void what_a_stream_sends_is_not_kept(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    static uint8_t junk[1 << 16];
    struct test_client c;
    size_t size;

    publish(s, 1, 1000);
    open_stream(&c, s, "/stream.mjpeg");
    assert_int_equal(next_part(&c, &size), byte_of(1, 0));
    const long before = resident_kib();
    for (int i = 0; i < 1000; i++)
        if (send(c.fd, junk, sizeof(junk), MSG_NOSIGNAL | MSG_DONTWAIT) < 0)
            sleep_ms(1);
    assert_true(resident_kib() - before < 4096);
    for (int i = 0; i < 3 && client_fill(&c, CLIENT_WAIT_MS); i++)
        c.in_size = 0;
    char byte; /* it was cut off */
    assert_true(recv(c.fd, &byte, 1, MSG_DONTWAIT) <= 0 && errno != EAGAIN);
    assert_int_equal(status_of(s, "/snapshot.jpg", NULL), 200);
    client_shut(&c);
    server_destroy(s);
}

static uint32_t watching(struct server *s)
{
    struct server_demand d;

    server_demand(s, &d);
    return d.viewers;
}

static void await_viewers(struct server *s, uint32_t count)
{
    for (int i = 0; i < CLIENT_WAIT_MS && watching(s) != count; i++)
        sleep_ms(1);
    assert_int_equal(watching(s), count);
}

static void streams_count_as_viewers_until_they_close(void **state)
{
    (void)state;
    const struct server_desc desc = { .max_connections = 3, .max_per_address = 2 };
    struct server *s = server_start(&desc);
    struct test_client c[2], viewer;
    struct answer a;

    publish(s, 1, 1000);
    for (int i = 0; i < 2; i++)
        open_stream(&c[i], s, "/stream.mjpeg");
    await_viewers(s, 2);
    ask(s, "GET", "/snapshot.jpg", NULL, &a);
    assert_int_equal(a.status, 503);
    assert_non_null(strstr((char *)a.body, "one address has at most 2 connections"));
    client_open(&viewer, s);
    assert_int_equal(client_handshake(&viewer, NULL), 101);
    assert_int_equal(client_close_code(&viewer), 4007);
    client_shut(&viewer);
    client_shut(&c[0]);
    await_viewers(s, 1); /* although no image is sent meanwhile */
    assert_int_equal(status_of(s, "/snapshot.jpg", NULL), 200);
    client_shut(&c[1]);
    server_destroy(s);
}

static void streams_end_with_the_server(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;
    size_t size;

    publish(s, 1, 1000);
    open_stream(&c, s, "/stream.mjpeg");
    assert_int_equal(next_part(&c, &size), byte_of(1, 0));
    server_destroy(s);
    client_rest(&c); /* comes back */
    client_shut(&c);
}

/* ---- Renditions ---- */

static void publish_rendition(struct server *s, unsigned slot, uint64_t serial, const char *bytes)
{
    const struct protocol_picture header = { .format = PROTOCOL_JPEG, .frame = 1, .width = 32, .height = 18 };
    struct sent_image *p = image_create(&header, (const uint8_t *)bytes, strlen(bytes));

    assert_non_null(p);
    image_set_rendition(p, slot, serial);
    server_publish(s, p);
}

/* Sends a request and waits until its rendition is wanted, in a slot other than `not`. */
static unsigned open_rendition(struct test_client *c, struct server *s, const char *path, uint32_t width, unsigned not,
                               struct server_rendition *out)
{
    struct server_demand d = { 0 };
    char request[256];

    client_open(c, s);
    snprintf(request, sizeof(request), "GET %s HTTP/1.1\r\nHost: localhost\r\n\r\n", path);
    client_write(c, request, strlen(request));
    for (int i = 0; i < CLIENT_WAIT_MS; i++) {
        server_demand(s, &d);
        for (unsigned k = 0; k < SERVER_RENDITIONS; k++)
            if (k != not &&d.renditions[k].image != SERVER_NO_IMAGE && d.renditions[k].width == width) {
                *out = d.renditions[k];
                return k;
            }
        sleep_ms(1);
    }
    fail_msg("%s is not wanted", path);
    return 0;
}

static void other_formats_and_widths_are_asked_of_the_encoder(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct server_rendition png, small;
    struct server_demand d;
    struct test_client c, w;

    publish(s, 1, 1000);
    const unsigned slot = open_rendition(&c, s, "/snapshot.png", 0, SERVER_RENDITIONS, &png);
    assert_int_equal(png.image, SERVER_PNG);
    const unsigned other = open_rendition(&w, s, "/stream.mjpeg?width=32", 32, slot, &small);
    assert_int_equal(small.image, SERVER_JPEG);
    assert_true(png.owner > 0 && small.owner == png.owner);
    assert_true(other != slot && small.serial != png.serial);
    publish_rendition(s, slot, png.serial - 1, "of an earlier use");
    publish_rendition(s, slot, png.serial, "the picture");
    assert_int_equal(client_request(&c, ""), 200);
    assert_non_null(strstr((char *)c.message, "image/png"));
    while (c.in_size < 11)
        assert_true(client_fill(&c, CLIENT_WAIT_MS));
    assert_memory_equal(c.in, "the picture", 11);
    await_viewers(s, 1);
    server_demand(s, &d);
    assert_int_equal(d.renditions[slot].image, SERVER_NO_IMAGE);
    assert_int_equal(d.renditions[other].serial, small.serial);
    client_shut(&c);
    client_shut(&w);
    server_destroy(s);
}

static void widths_at_once_are_limited_and_come_free(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct server_rendition r[SERVER_RENDITIONS];
    struct test_client c[SERVER_RENDITIONS], same;
    struct answer a;
    char path[64];

    publish(s, 1, 1000);
    for (uint32_t i = 0; i < SERVER_RENDITIONS; i++) {
        snprintf(path, sizeof(path), "/stream.mjpeg?width=%u", 20 + i);
        open_rendition(&c[i], s, path, 20 + i, SERVER_RENDITIONS, &r[i]);
    }
    ask(s, "GET", "/snapshot.png", NULL, &a);
    assert_int_equal(a.status, 503);
    assert_non_null(strstr((char *)a.body, "Too many different widths"));
    assert_int_equal(status_of(s, "/snapshot.jpg", NULL), 200);                       /* needs none */
    open_rendition(&same, s, "/stream.mjpeg?width=21", 21, SERVER_RENDITIONS, &r[0]); /* shares one */
    client_shut(&same);
    client_shut(&c[0]);
    await_viewers(s, SERVER_RENDITIONS - 1);
    open_rendition(&c[0], s, "/snapshot.png", 0, SERVER_RENDITIONS, &r[0]);
    assert_int_equal(r[0].image, SERVER_PNG);
    for (int i = 0; i < SERVER_RENDITIONS; i++)
        client_shut(&c[i]);
    server_destroy(s);
}

/* ---- Frames of other pages ---- */

static void only_named_origins_may_embed_and_only_embed(void **state)
{
    (void)state;
    const struct server_desc desc = { .embed_from = "https://a.example,http://[::1]:81" };
    struct server *s = server_start(&desc), *plain = server_start(NULL);
    struct answer a;

    ask(s, "GET", "/embed", NULL, &a);
    assert_int_equal(a.status, 200);
    assert_non_null(strstr(a.head, "frame-ancestors https://a.example http://[::1]:81\r\n"));
    assert_null(strstr(a.head, "'none'\r\n"));
    assert_null(strstr(a.head, "x-frame-options"));
    assert_non_null(strstr(a.head, "x-content-type-options: nosniff\r\n"));
    assert_non_null(strstr(a.head, "content-security-policy: default-src 'none'; script-src 'self'; "));
    assert_non_null(strstr((char *)a.body, "embed.js"));
    ask(s, "GET", "/", NULL, &a);
    assert_non_null(strstr(a.head, "frame-ancestors 'none'\r\n"));
    assert_non_null(strstr(a.head, "x-frame-options: DENY\r\n"));
    ask(plain, "GET", "/embed", NULL, &a);
    assert_int_equal(a.status, 200);
    assert_non_null(strstr(a.head, "frame-ancestors 'none'\r\n"));
    server_destroy(s);
    server_destroy(plain);
}

static void what_is_no_origin_is_refused(void **state)
{
    (void)state;
    static const char *const bad[] = { "example.org", "https://",          "https://a/b", "https://a;script-src *",
                                       "*",           "https://a,ftp://b", "https://a b", "'self'",
                                       "https://*" };

    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        const struct server_desc desc = { .embed_from = bad[i] };
        struct reason why = { "" };
        struct server *s;
        assert_int_equal(server_create(&desc, &s, &why), ERR_USAGE);
        assert_non_null(strstr(why.text, "--embed-from"));
        assert_non_null(strstr(why.text, "not an origin"));
    }
}

/* Lines of the log about connections that were given up. */
static atomic_int given_up;
static char lines[2][512];

static void keep_line(enum log_level level, const char *text)
{
    const int at = atomic_load(&given_up);

    if (level == LOG_WARNING && strstr(text, "took no bytes") && at < 2) {
        snprintf(lines[at], sizeof(lines[at]), "%s", text);
        atomic_store(&given_up, at + 1);
    }
}

static bool begins(const char *text, const char *with)
{
    return strncmp(text, with, strlen(with)) == 0;
}

/* A viewer and an HTTP client, for ten seconds in which the kernel takes no byte for them. */
static void who_takes_no_bytes_is_given_up_by_name(void **state)
{
    (void)state;
    struct server_counters counters;
    struct test_client viewer, watcher;

    log_divert(keep_line);
    struct server *s = server_start(NULL);
    publish(s, 1, 1000);
    client_watch(&viewer, s);
    client_open(&watcher, s);
    assert_int_equal(client_request(&watcher, "GET /stream.mjpeg HTTP/1.1\r\nHost: localhost\r\n\r\n"), 200);
    publish(s, 2, 30000000);
    for (int waited = 0; waited < CLIENT_WAIT_MS && atomic_load(&given_up) < 2; waited += 100)
        sleep_ms(100);
    assert_int_equal(atomic_load(&given_up), 2);
    server_counters(s, &counters);
    assert_int_equal(counters.stalled, 2);
    const int of_watcher = strstr(lines[0], "stream.mjpeg") ? 0 : 1;
    assert_true(begins(lines[of_watcher], "127.0.0.1: /stream.mjpeg closed: it took no bytes for 10 s; "));
    assert_true(begins(lines[!of_watcher], "127.0.0.1: closed: it took no bytes for 10 s; "));
    client_shut(&viewer);
    client_shut(&watcher);
    server_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(snapshot_is_the_newest_image),
    cmocka_unit_test(snapshot_waits_for_an_image_of_the_present_frame),
    cmocka_unit_test(one_connection_may_ask_again),
    cmocka_unit_test(bad_requests_are_answered_in_a_line),
    cmocka_unit_test(token_is_taken_as_bearer_or_password),
    cmocka_unit_test(stream_brings_every_image_to_who_reads),
    cmocka_unit_test(a_slow_stream_skips_to_the_newest_and_delays_nobody),
    cmocka_unit_test(what_a_stream_sends_is_not_kept),
    cmocka_unit_test(streams_count_as_viewers_until_they_close),
    cmocka_unit_test(streams_end_with_the_server),
    cmocka_unit_test(other_formats_and_widths_are_asked_of_the_encoder),
    cmocka_unit_test(widths_at_once_are_limited_and_come_free),
    cmocka_unit_test(only_named_origins_may_embed_and_only_embed),
    cmocka_unit_test(what_is_no_origin_is_refused),
    cmocka_unit_test(a_server_that_leaves_says_so),
    cmocka_unit_test(who_takes_no_bytes_is_given_up_by_name),
};
UNIT_MAIN(tests)
