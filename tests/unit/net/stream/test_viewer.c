/* PROTOCOL.md section 5: which images a viewer gets, and when. */
#include "net/stream/client.h"
#include "net/stream/ingest.h"
#include "net/stream/internal.h"

static void an_image_arrives_bit_for_bit(void **state)
{
    (void)state;
    static const size_t sizes[] = { 1, 100, 65456, 65536, 65537, 200000, 3000000 };
    struct server *s = server_start(NULL);
    struct test_client c;

    client_watch(&c, s);
    for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
        struct protocol_picture h = { 0 };
        publish(s, i + 40, sizes[i]);
        assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), i + 1);
        assert_int_equal(h.frame, i + 40);
        assert_int_equal(h.payload, sizes[i]);
        assert_true(h.published_us > 1500000000000000);
        assert_int_equal(h.flags, 0);
        for (size_t k = 0; k < sizes[i]; k++)
            if (c.message[PROTOCOL_PICTURE_BYTES + k] != (uint8_t)((i + 40) * 31 + k * 7))
                fail_msg("byte %zu of %zu differs", k, sizes[i]);
        client_ack(&c, h.sequence);
    }
    client_shut(&c);
    server_destroy(s);
}

static void who_comes_late_gets_the_last_image_at_once(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;
    struct protocol_picture h = { 0 };

    publish(s, 1, 1000);
    publish(s, 2, 1000);
    client_watch(&c, s);
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 2);
    assert_int_equal(h.flags, PROTOCOL_PICTURE_REPEAT);
    publish(s, 3, 1000);
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 3);
    assert_int_equal(h.flags, 0);
    client_shut(&c);
    server_destroy(s);
}

static void no_more_than_two_images_are_under_way(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;
    struct protocol_picture h = { 0 };
    struct server_counters counters;

    client_watch(&c, s);
    for (uint64_t i = 1; i <= 2; i++) {
        publish(s, i, 500);
        assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), i);
    }
    for (uint64_t i = 3; i <= 10; i++)
        publish(s, i, 500);
    assert_int_equal(client_picture(&c, &h, 700), 0); /* statuses only */
    client_ack(&c, 2);
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 10); /* the newest, and the last is never lost */
    client_ack(&c, 10);
    assert_int_equal(client_picture(&c, &h, 700), 0);
    server_counters(s, &counters);
    assert_int_equal(counters.published, 10);
    assert_int_equal(counters.sent, 3);
    assert_int_equal(counters.skipped, 7);
    assert_int_equal(counters.acked, 3);
    client_shut(&c);
    server_destroy(s);
}

static void an_ack_returns_the_credit_of_all_before_it(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;
    struct protocol_picture h = { 0 };

    client_watch(&c, s);
    publish(s, 1, 500);
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 1);
    publish(s, 2, 500);
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 2);
    client_ack(&c, 1);
    client_ack(&c, 1); /* again: ignored */
    publish(s, 3, 500);
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 3);
    client_ack(&c, 3); /* 2 and 3 */
    publish(s, 4, 500);
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 4);
    publish(s, 5, 500);
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 5);
    client_shut(&c);
    server_destroy(s);
}

static void acks_of_a_former_format_are_passed_over(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;
    struct protocol_picture h = { 0 };

    client_watch(&c, s);
    for (uint64_t i = 1; i <= 3; i++) {
        publish(s, i, 500);
        assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), i);
        if (i < 3)
            client_ack(&c, i);
    }
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"exr_half\"}");
    client_expect(&c, "subscribed");
    client_ack(&c, 3); /* on its way when the format changed */
    client_ack(&c, 2);
    client_say(&c, "{\"op\":\"ping\",\"id\":1}");
    client_expect(&c, "pong");
    client_ack(&c, 4); /* of neither format */
    json_t *error = client_await(&c, "error");
    assert_non_null(error);
    assert_string_equal(json_string_value(json_object_get(error, "clause")), "4.5.1");
    json_decref(error);
    assert_int_equal(client_close_code(&c), 4003);
    client_shut(&c);
    server_destroy(s);
}

static void a_paused_viewer_gets_no_image_until_it_resumes(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;
    struct protocol_picture h = { 0 };
    struct server_counters counters;
    struct server_demand demand;

    client_greet(&c, s);
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"paused\":true,\"request\":4,\"quality\":70}");
    json_t *answer = client_await(&c, "subscribed");
    assert_non_null(answer);
    assert_true(json_is_true(json_object_get(answer, "paused")));
    assert_int_equal(json_integer_value(json_object_get(answer, "request")), 4);
    json_decref(answer);
    server_demand(s, &demand);
    assert_int_equal(demand.viewers, 0);
    for (int i = 1; i <= 5; i++)
        publish(s, (uint64_t)i, 500);
    assert_int_equal(client_picture(&c, &h, 600), 0);
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"quality\":70,\"max_rate\":5}");
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 5);
    assert_int_equal(h.flags, PROTOCOL_PICTURE_REPEAT);
    server_counters(s, &counters);
    assert_int_equal(counters.skipped, 0); /* a pause is no slowness */
    server_demand(s, &demand);
    assert_int_equal(demand.viewers, 1);
    assert_int_equal(demand.formats, 1 << PROTOCOL_JPEG);
    assert_int_equal(demand.jpeg_quality, 70);
    assert_true(demand.max_rate == 5.0);
    client_shut(&c);
    server_destroy(s);
}

static void a_viewer_gets_images_at_the_rate_it_asked_for(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;
    struct protocol_picture h = { 0 };
    int got = 0;

    client_greet(&c, s);
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"max_rate\":10}");
    client_expect(&c, "subscribed");
    /* 100 images in a second or more: 10 a second is about 11 for each second that it takes */
    for (int i = 1; i <= 100; i++) {
        publish(s, (uint64_t)i, 500);
        sleep_ms(10);
        while (client_picture(&c, &h, 0)) {
            client_ack(&c, h.sequence);
            got++;
        }
    }
    assert_true(got >= 2 && got < 60);
    /* and the last one comes, though nothing follows it */
    while (h.frame != 100) {
        assert_true(client_picture(&c, &h, CLIENT_WAIT_MS) > 0);
        client_ack(&c, h.sequence);
    }
    client_shut(&c);
    server_destroy(s);
}

static void a_pause_after_watching_counts_as_no_skip(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;
    struct protocol_picture h = { 0 };
    struct server_counters counters;

    client_watch(&c, s);
    publish(s, 1, 500);
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 1);
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"paused\":true}");
    client_expect(&c, "subscribed");
    for (uint64_t i = 2; i <= 9; i++)
        publish(s, i, 500);
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"jpeg\"}");
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 9);
    server_counters(s, &counters);
    assert_int_equal(counters.skipped, 0);
    client_shut(&c);
    server_destroy(s);
}

/* Statuses come twice a second, and each makes the server look at a viewer again. What need not wait for that comes
 * before the next one; a busy machine may spoil a round, not all of them. */
enum { ROUNDS = 8 };

static void an_ack_brings_the_next_image_without_waiting_for_a_status(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;
    struct protocol_picture h = { 0 };
    uint64_t last = 0;
    int at_once = 0;

    client_watch(&c, s);
    for (int i = 0; i < ROUNDS; i++) {
        for (int k = 0; k < PROTOCOL_CREDIT; k++) {
            publish(s, ++last, 500);
            assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), last);
        }
        publish(s, ++last, 500);
        client_expect(&c, "status");
        client_ack(&c, last - 1);
        at_once += client_next(&c, CLIENT_WAIT_MS) == OP_BINARY;
        while (c.op != OP_BINARY)
            assert_int_not_equal(client_next(&c, CLIENT_WAIT_MS), 0);
        client_ack(&c, last);
    }
    assert_true(at_once >= 2);
    client_shut(&c);
    server_destroy(s);
}

static void an_image_held_back_by_its_rate_comes_without_waiting_for_a_status(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;
    struct protocol_picture h = { 0 };
    uint64_t last = 0;
    int at_once = 0;

    client_greet(&c, s);
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"max_rate\":20}");
    client_expect(&c, "subscribed");
    for (int i = 0; i < ROUNDS; i++) {
        client_expect(&c, "status");
        publish(s, ++last, 500);
        assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), last);
        client_ack(&c, last);
        publish(s, ++last, 500); /* 50 ms too early */
        at_once += client_next(&c, CLIENT_WAIT_MS) == OP_BINARY;
        while (c.op != OP_BINARY)
            assert_int_not_equal(client_next(&c, CLIENT_WAIT_MS), 0);
        client_ack(&c, last);
    }
    assert_true(at_once >= 2);
    client_shut(&c);
    server_destroy(s);
}

static void who_has_not_subscribed_gets_words_only(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;

    client_greet(&c, s);
    publish(s, 1, 500);
    for (int i = 0; i < 3; i++)
        assert_int_equal(client_next(&c, CLIENT_WAIT_MS), OP_TEXT);
    client_shut(&c);
    server_destroy(s);
}

static void status_carries_what_it_was_given(void **state)
{
    (void)state;
    struct server_figures status = {
        .scene = "a scene of \"words\"",
        .sky = "a sky",
        .method = "mis",
        .samples = 64,
        .width = 640,
        .height = 360,
        .source = SERVER_FAILED,
        .detail = "sky.0007.exr: byte 12: torn",
        .frame = 6,
        .fps = 29.5,
        .shaded_ms = 20.25,
        .received = 9,
        .used = 6,
        .dropped = 2,
        .refused = 1,
        .last_refusal = "sky.0007.exr",
        .repaired = 3,
        .has_sun = true,
        .sun_elevation = 31.5,
        .sun_azimuth = 214.0,
        .sky_time = "14:35",
    };
    struct server *s = server_start(NULL);
    struct test_client c;

    client_greet(&c, s);
    server_set_figures(s, &status);
    memset(status.scene, 'x', sizeof(status.scene)); /* it was copied */
    json_t *got = NULL, *source = NULL;
    for (int i = 0; i < 10 && !source; i++) {
        json_decref(got);
        got = client_await(&c, "status");
        assert_non_null(got);
        if (strcmp(json_string_value(json_object_get(json_object_get(got, "source"), "state")), "failed") == 0)
            source = json_object_get(got, "source");
    }
    assert_non_null(source);
    assert_string_equal(json_string_value(json_object_get(source, "detail")), status.detail);
    assert_string_equal(json_string_value(json_object_get(got, "scene")), "a scene of \"words\"");
    assert_int_equal(json_integer_value(json_object_get(got, "samples")), 64);
    assert_true(json_real_value(json_object_get(got, "fps")) == 29.5);
    const json_t *frames = json_object_get(got, "frames");
    assert_int_equal(json_integer_value(json_object_get(frames, "received")), 9);
    assert_int_equal(json_integer_value(json_object_get(frames, "dropped")), 2);
    const json_t *sun = json_object_get(json_object_get(got, "light"), "sun");
    assert_true(json_real_value(json_object_get(sun, "azimuth")) == 214.0);
    json_decref(got);
    client_shut(&c);
    server_destroy(s);
}

static void a_new_state_is_told_without_waiting_for_the_next_turn(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;
    struct server_figures status = { .source = SERVER_LIVE };
    int at_once = 0;

    client_greet(&c, s);
    client_expect(&c, "status");
    for (int i = 0; i < 20; i++) {
        const char *want = i % 2 ? "\"paused\"" : "\"live\"";
        bool told = false;
        status.source = i % 2 ? SERVER_PAUSED : SERVER_LIVE;
        server_set_figures(s, &status);
        /* Three round trips take much less than the half second between two turns. */
        for (int pings = 0; pings < 3;) {
            client_say(&c, "{\"op\":\"ping\",\"id\":1}");
            do {
                assert_int_equal(client_next(&c, CLIENT_WAIT_MS), OP_TEXT);
                told = told || strstr((char *)c.message, want);
            } while (!strstr((char *)c.message, "pong"));
            pings++;
        }
        at_once += told;
    }
    assert_true(at_once >= 15);
    client_shut(&c);
    server_destroy(s);
}

static void all_are_told_when_the_server_goes(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c[8];

    for (int i = 0; i < 8; i++) {
        if (i % 3 == 0)
            client_watch(&c[i], s);
        else if (i % 3 == 1)
            client_greet(&c[i], s);
        else {
            client_open(&c[i], s);
            assert_int_equal(client_handshake(&c[i], NULL), 101);
        }
    }
    publish(s, 1, 30000); /* fits what the kernel takes for them, since nobody reads until the end */
    server_destroy(s);
    for (int i = 0; i < 8; i++) {
        assert_int_equal(client_close_code(&c[i]), 1001);
        client_shut(&c[i]);
    }
}

/* Every two seconds at a rate of a half; half a second late the next comes half a second earlier; after a pause there
 * is nothing to make up for. */
static void a_rate_says_when_the_next_image_is_due(void **state)
{
    (void)state;

    assert_int_equal(websocket_due(0, 10000000, 0.5), 12000000);
    assert_int_equal(websocket_due(12000000, 12000000, 0.5), 14000000);
    assert_int_equal(websocket_due(12000000, 12500000, 0.5), 14000000);
    assert_int_equal(websocket_due(12000000, 14000000, 0.5), 16000000);
    assert_int_equal(websocket_due(12000000, 13999999, 0.5), 14000000);
    assert_int_equal(websocket_due(7, 12000000, 0.0), 7); /* any rate */
    assert_int_equal(websocket_due(0, 1000000, 100.0), 1010000);
}

/* As many at once as the bucket holds; then one for each part of a second, and after a long pause no more than at
 * first. */
static void messages_beyond_the_rate_are_too_fast(void **state)
{
    struct bucket messages = { STREAM_BURST, 5000000 };
    int64_t now = 5000000;
    (void)state;

    for (int turn = 0; turn < 2; turn++, now += 1000000000) {
        for (int i = 0; i < (int)STREAM_BURST; i++)
            assert_true(bucket_take(&messages, STREAM_BURST, STREAM_RATE, now));
        assert_false(bucket_take(&messages, STREAM_BURST, STREAM_RATE, now));
        now += (int64_t)(1e6 / STREAM_RATE) - 1000;
        assert_false(bucket_take(&messages, STREAM_BURST, STREAM_RATE, now));
        now += 1001;
        assert_true(bucket_take(&messages, STREAM_BURST, STREAM_RATE, now));
        assert_false(bucket_take(&messages, STREAM_BURST, STREAM_RATE, now));
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(an_image_arrives_bit_for_bit),
    cmocka_unit_test(who_comes_late_gets_the_last_image_at_once),
    cmocka_unit_test(no_more_than_two_images_are_under_way),
    cmocka_unit_test(an_ack_returns_the_credit_of_all_before_it),
    cmocka_unit_test(acks_of_a_former_format_are_passed_over),
    cmocka_unit_test(a_paused_viewer_gets_no_image_until_it_resumes),
    cmocka_unit_test(a_viewer_gets_images_at_the_rate_it_asked_for),
    cmocka_unit_test(a_pause_after_watching_counts_as_no_skip),
    cmocka_unit_test(an_ack_brings_the_next_image_without_waiting_for_a_status),
    cmocka_unit_test(an_image_held_back_by_its_rate_comes_without_waiting_for_a_status),
    cmocka_unit_test(who_has_not_subscribed_gets_words_only),
    cmocka_unit_test(status_carries_what_it_was_given),
    cmocka_unit_test(a_new_state_is_told_without_waiting_for_the_next_turn),
    cmocka_unit_test(all_are_told_when_the_server_goes),
    cmocka_unit_test(a_rate_says_when_the_next_image_is_due),
    cmocka_unit_test(messages_beyond_the_rate_are_too_fast),
};
UNIT_MAIN(tests)
