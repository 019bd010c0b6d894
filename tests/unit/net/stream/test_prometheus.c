/* /metrics, /healthz and /readyz: what they count is what happened, and who may ask. */
#include "net/stream/client.h"
#include "net/stream/internal.h"

#include <pthread.h>
#include <semaphore.h>
#include <stdatomic.h>

/* The body of an answer, or NULL where the status is another than wanted. Freed by the caller. */
static char *get(const struct server *s, const char *path, const char *extra, int wanted)
{
    char request[512];
    struct test_client c;
    char *body = NULL;

    client_open(&c, s);
    snprintf(request, sizeof(request), "GET %s HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n%s\r\n", path,
             extra);
    if (client_request(&c, request) == wanted)
        body = strdup(client_rest(&c));
    client_shut(&c);
    return body;
}

/* Of one sample, named with its labels; fails where there is none. */
static double sample(const char *text, const char *name)
{
    const size_t length = strlen(name);

    for (const char *at = text; at && *at; at = strchr(at, '\n') ? strchr(at, '\n') + 1 : NULL)
        if (strncmp(at, name, length) == 0 && at[length] == ' ')
            return strtod(at + length, NULL);
    fail_msg("no %s in:\n%.2000s", name, text);
    return 0.0;
}

static double metric(const struct server *s, const char *name)
{
    char *text = get(s, "/metrics", "", 200);
    assert_non_null(text);
    const double value = sample(text, name);
    free(text);
    return value;
}

/* Until it is `wanted`, or at most CLIENT_WAIT_MS: counters follow the wire by a moment. */
static void expect_metric(const struct server *s, const char *name, double wanted)
{
    double is = metric(s, name);

    for (int i = 0; i < CLIENT_WAIT_MS / 20 && is != wanted; i++) {
        sleep_ms(20);
        is = metric(s, name);
    }
    if (is != wanted)
        fail_msg("%s is %g instead of %g", name, is, wanted);
}

static void metrics_count_what_was_sent(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct server_counters counters;
    struct protocol_picture h;
    struct test_client c, silent;

    client_watch(&c, s);
    client_open(&silent, s);
    assert_int_equal(client_handshake(&silent, NULL), 101);
    for (uint64_t frame = 1; frame <= 5; frame++) {
        publish(s, frame, 1000);
        const uint64_t sequence = client_picture(&c, &h, CLIENT_WAIT_MS);
        assert_int_equal(sequence, frame);
        client_ack(&c, sequence);
    }
    client_say(&c, "{\"op\":\"nonsense\"}");
    expect_metric(s, "relightd_pictures_acknowledged_total", 5);
    expect_metric(s, "relightd_protocol_errors_total{code=\"unknown_op\"}", 1);
    char *text = get(s, "/metrics", "", 200);
    assert_non_null(text);
    server_counters(s, &counters);
    assert_true(sample(text, "relightd_pictures_published_total{format=\"jpeg\",size=\"whole\"}") == 5);
    assert_true(sample(text, "relightd_pictures_sent_total{format=\"jpeg\",size=\"whole\"}") == 5);
    assert_true(sample(text, "relightd_sent_bytes_total") == 5 * (1000 + PROTOCOL_PICTURE_BYTES));
    assert_true(sample(text, "relightd_sent_bytes_total") == (double)counters.bytes);
    assert_true(sample(text, "relightd_connections_total") == (double)counters.connections);
    assert_true(sample(text, "relightd_connections{role=\"viewer\"}") == 1);
    assert_true(sample(text, "relightd_connections{role=\"none\"}") == 1);
    assert_true(sample(text, "relightd_viewers{format=\"jpeg\",size=\"whole\"}") == 1);
    assert_true(sample(text, "relightd_pictures_unacknowledged") == 0);
    assert_true(sample(text, "relightd_latency_seconds_count{part=\"published_to_sent\"}") == 5);
    assert_true(sample(text, "relightd_latency_seconds_count{part=\"published_to_displayed\"}") == 5);
    assert_true(sample(text, "relightd_encode_seconds_count{format=\"jpeg\",size=\"whole\"}") == 5);
    assert_true(sample(text, "process_open_fds") > 3);
    free(text);
    client_shut(&c);
    client_shut(&silent);
    server_destroy(s);
}

static void what_a_slow_viewer_skips_is_counted_as_such(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct protocol_picture h;
    struct test_client c;

    client_watch(&c, s);
    for (uint64_t frame = 1; frame <= 2; frame++) {
        publish(s, frame, 1000);
        assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), frame);
    }
    for (uint64_t frame = 3; frame <= 9; frame++) /* its credit is used up */
        publish(s, frame, 1000);
    client_ack(&c, 2);
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 9);
    expect_metric(s, "relightd_pictures_skipped_total{reason=\"slow\"}", 6);
    expect_metric(s, "relightd_pictures_skipped_total{reason=\"rate\"}", 0);
    client_shut(&c);
    server_destroy(s);
}

static void targets_of_publishing_have_labels_and_counts(void **state)
{
    struct server *s = server_start(NULL);
    const struct server_figures f = { .publish = { { .to = "rtmp://a.example",
                                                     .state = SERVER_PUBLISH_RETRYING,
                                                     .frames = 7,
                                                     .bytes = 8000,
                                                     .dropped = 3,
                                                     .retries = 2 },
                                                   { .to = "hls:folder", .state = SERVER_PUBLISH_LIVE } },
                                      .publish_count = 2 };
    (void)state;

    char *text = get(s, "/metrics", "", 200);
    assert_non_null(text);
    assert_null(strstr(text, "relightd_publish"));
    free(text);
    server_set_figures(s, &f);
    text = get(s, "/metrics", "", 200);
    assert_non_null(text);
    assert_true(sample(text, "relightd_publish_state{target=\"1\",to=\"rtmp://a.example\",state=\"retrying\"}") == 1);
    assert_true(sample(text, "relightd_publish_state{target=\"1\",to=\"rtmp://a.example\",state=\"live\"}") == 0);
    assert_true(sample(text, "relightd_publish_frames_total{target=\"1\",to=\"rtmp://a.example\"}") == 7);
    assert_true(sample(text, "relightd_publish_bytes_total{target=\"1\",to=\"rtmp://a.example\"}") == 8000);
    assert_true(sample(text, "relightd_publish_dropped_total{target=\"1\",to=\"rtmp://a.example\"}") == 3);
    assert_true(sample(text, "relightd_publish_retries_total{target=\"1\",to=\"rtmp://a.example\"}") == 2);
    assert_true(sample(text, "relightd_publish_state{target=\"2\",to=\"hls:folder\",state=\"live\"}") == 1);
    free(text);
    server_destroy(s);
}

static void figures_and_times_appear_as_they_were_said(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    const struct server_figures f = { .received = 10,
                                      .used = 6,
                                      .dropped = 3,
                                      .refused = 1,
                                      .unreadable = 1,
                                      .direct_rays = 123456789012,
                                      .error = 1e-4 };

    server_set_figures(s, &f);
    server_observe(s, SERVER_SHADE, 0.015);
    server_observe(s, SERVER_SHADE, 0.02); /* on a bound: it belongs below it */
    server_observe(s, SERVER_SHADE, 100.0);
    server_observe(s, SERVER_SHADE, -1.0);
    char *text = get(s, "/metrics", "", 200);
    assert_non_null(text);
    assert_true(sample(text, "relightd_frames_total{fate=\"shaded\",reason=\"\"}") == 6);
    assert_true(sample(text, "relightd_frames_total{fate=\"dropped\",reason=\"superseded\"}") == 3);
    assert_true(sample(text, "relightd_frames_total{fate=\"refused\",reason=\"unreadable\"}") == 1);
    assert_true(sample(text, "relightd_rays_total{part=\"direct\"}") == 123456789012);
    assert_true(sample(text, "relightd_picture_error_ratio") == 1e-4);
    assert_true(sample(text, "relightd_stage_seconds_bucket{stage=\"shade\",le=\"0.0005\"}") == 1);
    assert_true(sample(text, "relightd_stage_seconds_bucket{stage=\"shade\",le=\"0.01\"}") == 1);
    assert_true(sample(text, "relightd_stage_seconds_bucket{stage=\"shade\",le=\"0.02\"}") == 3);
    assert_true(sample(text, "relightd_stage_seconds_bucket{stage=\"shade\",le=\"5\"}") == 3);
    assert_true(sample(text, "relightd_stage_seconds_bucket{stage=\"shade\",le=\"+Inf\"}") == 4);
    assert_true(sample(text, "relightd_stage_seconds_count{stage=\"shade\"}") == 4);
    assert_float_equal(sample(text, "relightd_stage_seconds_sum{stage=\"shade\"}"), 100.035, 1e-6);
    free(text);
    server_destroy(s);
}

/* Longer than any piece of work here, so that nothing replaces them meanwhile. */
static void the_networks_times_are_in_seconds(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);

    atomic_store(&s->metrics.loop_most_us, 7500000000);
    atomic_store(&s->metrics.loop_late_us, 8500000000);
    char *text = get(s, "/metrics", "", 200);
    assert_non_null(text);
    assert_non_null(strstr(text, "# HELP relightd_loop_max_seconds Longest single task of the network thread.\n"
                                 "# TYPE relightd_loop_max_seconds gauge\nrelightd_loop_max_seconds 7500\n"));
    assert_non_null(strstr(text, "# TYPE relightd_sent_bytes_total counter\n"));
    assert_non_null(strstr(text, "\nrelightd_loop_tick_delay_max_seconds 8500\n"));
    free(text);
    server_destroy(s);
}

static void metrics_ask_for_their_token(void **state)
{
    (void)state;
    const struct server_desc desc = { .token_metrics = "open sesame" };
    struct server *s = server_start(&desc);
    static const char *const wrong[] = { "", "Authorization: Bearer open sesam\r\n", "Authorization: Bearer \r\n",
                                         "Authorization: Basic open sesame\r\n",
                                         "Authorization: Bearer open sesame!\r\n" };

    for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
        char *text = get(s, "/metrics", wrong[i], 401);
        assert_non_null(text);
        assert_null(strstr(text, "relightd_"));
        assert_null(strstr(text, "sesame"));
        free(text);
    }
    char *text = get(s, "/metrics", "Authorization: bearer open sesame\r\n", 200);
    assert_non_null(text);
    assert_non_null(strstr(text, "relightd_build_info"));
    free(text);
    text = get(s, "/healthz", "", 200); /* says nothing worth a token */
    assert_non_null(text);
    free(text);
    server_destroy(s);
}

/* On loopback they are open; where the world can reach them the viewers' token is asked for. */
static void metrics_for_the_world_ask_for_the_viewers_token(void **state)
{
    (void)state;
    const struct server_desc desc = { .address = "0.0.0.0", .allow_remote = true, .tokens = { "v", "c", "p" } };
    struct server *s = server_start(&desc);

    char *text = get(s, "/metrics", "", 401);
    assert_non_null(text);
    free(text);
    text = get(s, "/metrics", "Authorization: Bearer v\r\n", 200);
    assert_non_null(text);
    free(text);
    server_destroy(s);
}

static void ready_when_the_scene_and_an_image_are_there(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct server_figures f = { 0 };

    char *text = get(s, "/readyz", "", 503);
    assert_non_null(text);
    assert_non_null(strstr(text, "the scene is being prepared"));
    free(text);
    f.loaded = true;
    server_set_figures(s, &f);
    text = get(s, "/readyz", "", 503);
    assert_non_null(text);
    assert_non_null(strstr(text, "the first image is being made"));
    free(text);
    publish(s, 1, 100);
    text = get(s, "/readyz", "", 200);
    assert_non_null(text);
    free(text);
    server_destroy(s);
}

/* A producer can only come to a server that says it can be used. */
static void ready_for_producers_without_an_image(void **state)
{
    (void)state;
    const struct server_desc desc = { .push = true };
    const struct server_figures f = { .loaded = true };
    struct server *s = server_start(&desc);

    server_set_figures(s, &f);
    char *text = get(s, "/readyz", "", 200);
    assert_non_null(text);
    free(text);
    server_destroy(s);
}

struct maker {
    struct server *server;
    atomic_bool works;
    sem_t end; /* waited for without using a processor */
};

/* One beat, and then work, or none. */
static void *make(void *arg)
{
    struct maker *m = arg;

    server_beat(m->server);
    while (atomic_load(&m->works)) {
    }
    sem_wait(&m->end);
    return NULL;
}

static void long_work_is_life_and_sleep_is_not(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct maker m = { .server = s, .works = true };
    struct server_health h;
    pthread_t thread;

    sem_init(&m.end, 0, 0);
    assert_int_equal(pthread_create(&thread, NULL, make, &m), 0);
    for (int i = 0; i < 35; i++) {
        sleep_ms(100);
        server_health(s, &h);
        assert_true(h.alive);
    }
    assert_true(h.beat_ms > SERVER_BEAT_MS);
    atomic_store(&m.works, false); /* now it sleeps */
    for (int i = 0; i < CLIENT_WAIT_MS / 100 && h.alive; i++) {
        sleep_ms(100);
        server_health(s, &h);
    }
    assert_false(h.alive);
    char *text = get(s, "/healthz", "", 503);
    assert_non_null(text);
    assert_non_null(strstr(text, "the rendering thread does not respond"));
    free(text);
    sem_post(&m.end);
    pthread_join(thread, NULL);
    sem_destroy(&m.end);
    server_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(metrics_count_what_was_sent),
    cmocka_unit_test(what_a_slow_viewer_skips_is_counted_as_such),
    cmocka_unit_test(targets_of_publishing_have_labels_and_counts),
    cmocka_unit_test(figures_and_times_appear_as_they_were_said),
    cmocka_unit_test(the_networks_times_are_in_seconds),
    cmocka_unit_test(metrics_ask_for_their_token),
    cmocka_unit_test(metrics_for_the_world_ask_for_the_viewers_token),
    cmocka_unit_test(ready_when_the_scene_and_an_image_are_there),
    cmocka_unit_test(ready_for_producers_without_an_image),
    cmocka_unit_test(long_work_is_life_and_sleep_is_not),
};

UNIT_MAIN(tests)
