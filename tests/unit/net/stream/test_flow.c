/* Slow viewers, many threads and much traffic: what one viewer does must not reach another, nor fill the memory. */
#include "net/stream/client.h"

#include <pthread.h>
#include <stdatomic.h>

static void a_viewer_that_reads_nothing_neither_delays_others_nor_grows_the_server(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client stuck[4], healthy;
    struct protocol_picture h = { 0 };
    struct server_counters counters;
    long before = 0;

    for (int i = 0; i < 4; i++)
        client_watch(&stuck[i], s);
    client_watch(&healthy, s);
    for (int i = 1; i <= 200; i++) {
        publish(s, (uint64_t)i, 1000000);
        /* the healthy one gets every single image */
        assert_int_equal(client_picture(&healthy, &h, CLIENT_WAIT_MS), i);
        client_ack(&healthy, h.sequence);
        if (i == 40)
            before = resident_kib();
    }
    /* 160 MB went by; a queue per viewer would show */
    assert_true(resident_kib() - before < 8192);
    do /* an image is counted after its last byte, which the client may read before */
        server_counters(s, &counters);
    while (counters.sent < 200);
    assert_true(counters.sent <= 208);
    for (int i = 0; i < 4; i++)
        client_shut(&stuck[i]);
    client_shut(&healthy);
    server_destroy(s);
}

static void a_viewer_that_wakes_up_is_at_the_newest_image_at_once(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;
    struct protocol_picture h = { 0 };
    uint64_t last = 0;
    int stale = 0;

    client_watch(&c, s);
    for (int i = 1; i <= 100; i++)
        publish(s, (uint64_t)i, 400000);
    sleep_ms(100);
    while (last != 100) {
        assert_true(client_picture(&c, &h, CLIENT_WAIT_MS) > last);
        last = h.sequence;
        client_ack(&c, last);
        stale += last != 100;
    }
    assert_true(stale <= PROTOCOL_CREDIT); /* what was under way, no more */
    client_shut(&c);
    server_destroy(s);
}

static void a_viewer_that_takes_nothing_holds_little_and_does_not_stop_the_end(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct server_counters counters;
    struct test_client c;

    client_watch(&c, s);
    publish(s, 1, 30000000);
    sleep_ms(300);
    server_counters(s, &counters);
    /* What the kernel has taken can be neither replaced nor skipped; left to itself it takes 2.9 MB. */
    assert_true(counters.bytes < 1000000);
    server_destroy(s); /* comes back: the test's own time limit would tell */
    client_shut(&c);
}

struct many {
    struct server *s;
    int id;
};

enum { MANY_PUBLISHERS = 3, MANY_IMAGES = 300 * MANY_PUBLISHERS };

static void *publish_many(void *arg)
{
    struct many *m = arg;
    struct server_figures figures = { .scene = "s", .source = SERVER_LIVE };

    snprintf(figures.detail, sizeof(figures.detail), "%s", m->id % 2 ? "odd" : "even");
    for (int i = 0; i < 300; i++) {
        publish(m->s, (uint64_t)i, 20000);
        server_set_figures(m->s, &figures);
        sleep_ms(1);
    }
    return NULL;
}

/* Everybody ends at the last image. */
static void *watch_many(void *arg)
{
    struct many *m = arg;
    struct protocol_picture h = { 0 };
    struct test_client c;

    client_watch(&c, m->s);
    for (uint64_t last = 0; last < MANY_IMAGES; last = h.sequence) {
        assert_true(client_picture(&c, &h, CLIENT_WAIT_MS) > last);
        client_ack(&c, h.sequence);
    }
    client_shut(&c);
    return NULL;
}

static void threads_publish_while_viewers_come_and_go(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct many publishers[MANY_PUBLISHERS] = { 0 }, watchers[8] = { 0 };
    pthread_t p[MANY_PUBLISHERS], w[8];
    struct server_counters counters;

    for (int i = 0; i < 8; i++) {
        watchers[i].s = s;
        assert_int_equal(pthread_create(&w[i], NULL, watch_many, &watchers[i]), 0);
    }
    for (int i = 0; i < MANY_PUBLISHERS; i++) {
        publishers[i].s = s;
        publishers[i].id = i;
        assert_int_equal(pthread_create(&p[i], NULL, publish_many, &publishers[i]), 0);
    }
    for (int i = 0; i < 30; i++) { /* passers-by, some of whom leave in the middle of things */
        struct test_client c;
        client_watch(&c, s);
        if (i % 2)
            client_say(&c, "{\"op\":\"ping\",\"id\":1}");
        client_shut(&c);
    }
    for (int i = 0; i < MANY_PUBLISHERS; i++)
        pthread_join(p[i], NULL);
    for (int i = 0; i < 8; i++)
        pthread_join(w[i], NULL);
    server_counters(s, &counters);
    assert_int_equal(counters.published, MANY_IMAGES);
    assert_int_equal(counters.connections, 38);
    server_destroy(s);
}

static void connections_that_come_and_go_leave_nothing_behind(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct server_counters counters;
    long before = 0;

    publish(s, 1, 100000);
    for (int i = 0; i < 600; i++) {
        struct test_client c;
        if (i % 3 == 0) {
            client_watch(&c, s);
        } else {
            client_open(&c, s);
            if (i % 3 == 1)
                client_handshake(&c, NULL);
            else
                client_write(&c, "GET / HT", 8);
        }
        client_shut(&c);
        if (i == 200)
            before = resident_kib();
    }
    for (int i = 0; i < CLIENT_WAIT_MS / 20; i++) {
        server_counters(s, &counters);
        if (counters.open == 0)
            break;
        sleep_ms(20);
    }
    assert_int_equal(counters.open, 0);
    assert_true(resident_kib() - before < 4096);
    server_destroy(s);
}

static void an_image_lives_as_long_as_it_is_held(void **state)
{
    (void)state;
    const struct protocol_picture header = { .format = PROTOCOL_JPEG, .width = 1, .height = 1 };
    struct sent_image *p = image_create(&header, (const uint8_t *)"abc", 3);
    size_t size = 0;

    assert_non_null(p);
    assert_ptr_equal(image_ref(p), p);
    image_unref(p);
    assert_memory_equal(image_message(p, &size) + PROTOCOL_PICTURE_BYTES, "abc", 3);
    assert_int_equal(size, PROTOCOL_PICTURE_BYTES + 3);
    assert_int_equal(image_header(p)->payload, 3);
    image_unref(p);
    image_unref(NULL);
    assert_null(image_create(&header, (const uint8_t *)"", 0));
    assert_null(image_create(&header, (const uint8_t *)"", IMAGE_BYTES_MAX + 1));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_viewer_that_reads_nothing_neither_delays_others_nor_grows_the_server),
    cmocka_unit_test(a_viewer_that_wakes_up_is_at_the_newest_image_at_once),
    cmocka_unit_test(a_viewer_that_takes_nothing_holds_little_and_does_not_stop_the_end),
    cmocka_unit_test(threads_publish_while_viewers_come_and_go),
    cmocka_unit_test(connections_that_come_and_go_leave_nothing_behind),
    cmocka_unit_test(an_image_lives_as_long_as_it_is_held),
};
UNIT_MAIN(tests)
