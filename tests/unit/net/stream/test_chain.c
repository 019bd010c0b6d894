/* PROTOCOL.md 5.11: images of H.264, of which each but a key image needs the one before. What is inside them no
 * server looks at. */
#include "net/stream/client.h"

static struct server *start(void)
{
    return server_start(&(struct server_desc){ .h264 = true, .push = true });
}

static void publish_track(struct server *s, unsigned track, uint64_t frame, bool key, size_t size)
{
    const struct protocol_picture header = {
        .format = PROTOCOL_H264,
        .flags = key ? PROTOCOL_PICTURE_KEY : 0,
        .frame = frame,
        .width = 64,
        .height = 36,
        .gain = 1.0f,
    };
    uint8_t *bytes = calloc(size, 1);

    assert_non_null(bytes);
    struct sent_image *p = image_create(&header, bytes, size);
    free(bytes);
    assert_non_null(p);
    image_set_track(p, track);
    server_publish(s, p);
}

static void publish_h264(struct server *s, uint64_t frame, bool key, size_t size)
{
    publish_track(s, 0, frame, key, size);
}

static void watch_h264(struct test_client *c, const struct server *s)
{
    client_greet(c, s);
    client_say(c, "{\"op\":\"subscribe\",\"format\":\"h264\"}");
    client_expect(c, "subscribed");
}

static bool key_wanted(struct server *s)
{
    struct server_demand demand;

    server_demand(s, &demand);
    return demand.h264_keys & 1;
}

/* A wish is noted when its viewer is next looked at. */
static void await_wish(struct server *s)
{
    for (int i = 0; i < CLIENT_WAIT_MS && !key_wanted(s); i++)
        sleep_ms(1);
    assert_true(key_wanted(s));
}

static void expect(struct test_client *c, uint64_t sequence)
{
    struct protocol_picture h = { 0 };

    assert_int_equal(client_picture(c, &h, CLIENT_WAIT_MS), sequence);
    assert_int_equal(h.format, PROTOCOL_H264);
}

static void expect_nothing(struct test_client *c)
{
    struct protocol_picture h = { 0 };

    assert_int_equal(client_picture(c, &h, 300), 0);
}

static bool offers(const json_t *welcome, const char *format)
{
    const json_t *formats = json_object_get(welcome, "formats");

    for (size_t i = 0; i < json_array_size(formats); i++)
        if (strcmp(json_string_value(json_array_get(formats, i)), format) == 0)
            return true;
    return false;
}

static void h264_is_offered_where_it_is_made_and_only_there(void **state)
{
    (void)state;
    for (int made = 0; made < 2; made++) {
        struct server *s = server_start(&(struct server_desc){ .h264 = made });
        struct test_client c;
        client_open(&c, s);
        assert_int_equal(client_handshake(&c, NULL), 101);
        client_say(&c, "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1}}");
        json_t *welcome = client_await(&c, "welcome");
        assert_non_null(welcome);
        assert_true(offers(welcome, "jpeg") && offers(welcome, "exr_half") && offers(welcome, "exr_float"));
        assert_int_equal(offers(welcome, "h264"), made);
        json_decref(welcome);
        client_say(&c, "{\"op\":\"subscribe\",\"format\":\"h264\"}");
        json_t *answer = client_await(&c, made ? "subscribed" : "error");
        assert_non_null(answer);
        if (!made) { /* and the connection stays */
            assert_string_equal(json_string_value(json_object_get(answer, "code")), "not_offered");
            client_say(&c, "{\"op\":\"subscribe\",\"format\":\"jpeg\"}");
            client_expect(&c, "subscribed");
        }
        json_decref(answer);
        client_shut(&c);
        server_destroy(s);
    }
}

static void a_recorder_gets_no_h264(void **state)
{
    (void)state;
    struct server *s = start();
    struct test_client c;

    client_open(&c, s);
    assert_int_equal(client_handshake(&c, NULL), 101);
    client_say(&c, "{\"op\":\"hello\",\"role\":\"viewer\",\"recorder\":\"monday\",\"version\":{\"major\":1}}");
    client_expect(&c, "welcome");
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"h264\"}");
    json_t *answer = client_await(&c, "error");
    assert_non_null(answer);
    assert_string_equal(json_string_value(json_object_get(answer, "code")), "not_offered");
    assert_string_equal(json_string_value(json_object_get(answer, "clause")), "4.3.6");
    json_decref(answer);
    client_shut(&c);
    server_destroy(s);
}

static void a_viewer_begins_at_a_key_image_and_asks_for_it(void **state)
{
    (void)state;
    struct server *s = start();
    struct test_client c;

    assert_false(key_wanted(s));
    watch_h264(&c, s);
    await_wish(s);
    publish_h264(s, 10, false, 100);
    publish_h264(s, 11, false, 100);
    expect_nothing(&c);
    assert_true(key_wanted(s));
    publish_h264(s, 12, true, 100);
    expect(&c, 3);
    assert_false(key_wanted(s));
    publish_h264(s, 13, false, 100);
    expect(&c, 4);
    client_shut(&c);
    server_destroy(s);
}

static void a_viewer_that_is_a_little_behind_gets_every_image(void **state)
{
    (void)state;
    struct server *s = start();
    struct test_client c;

    watch_h264(&c, s);
    publish_h264(s, 1, true, 60000);
    expect(&c, 1);
    for (uint64_t n = 2; n <= PROTOCOL_CREDIT_H264; n++)
        publish_h264(s, n, false, 2000);
    for (uint64_t n = 2; n <= PROTOCOL_CREDIT_H264; n++)
        expect(&c, n); /* without a word from the viewer */
    for (uint64_t n = PROTOCOL_CREDIT_H264 + 1; n <= PROTOCOL_CREDIT_H264 + 10; n++)
        publish_h264(s, n, false, 2000);
    expect_nothing(&c);
    assert_false(key_wanted(s));
    client_ack(&c, PROTOCOL_CREDIT_H264);
    for (uint64_t n = PROTOCOL_CREDIT_H264 + 1; n <= PROTOCOL_CREDIT_H264 + 10; n++)
        expect(&c, n);
    client_shut(&c);
    server_destroy(s);
}

static void who_has_missed_one_goes_on_at_a_key_image_when_the_line_is_clear(void **state)
{
    (void)state;
    struct server *s = start();
    struct test_client c;
    uint64_t n = 1;

    watch_h264(&c, s);
    publish_h264(s, n, true, 1000);
    expect(&c, n);
    for (n = 2; n <= PROTOCOL_CREDIT_H264; n++)
        publish_h264(s, n, false, 1000);
    for (uint64_t k = 2; k <= PROTOCOL_CREDIT_H264; k++)
        expect(&c, k);
    for (; n <= 60; n++)
        publish_h264(s, n, false, 1000);
    client_ack(&c, 8); /* eight are still under way: a key image would have to wait behind them */
    expect_nothing(&c);
    assert_false(key_wanted(s));
    client_ack(&c, PROTOCOL_CREDIT_H264 - 1);
    await_wish(s);
    publish_h264(s, 61, false, 1000);
    expect_nothing(&c);
    publish_h264(s, 62, true, 1000);
    expect(&c, 62);
    publish_h264(s, 63, false, 1000);
    client_ack(&c, 62);
    expect(&c, 63);
    client_shut(&c);
    server_destroy(s);
}

static void images_that_are_late_are_not_added_to_those_under_way(void **state)
{
    (void)state;
    struct server *s = start();
    struct test_client c;

    watch_h264(&c, s);
    publish_h264(s, 1, true, 1000);
    for (uint64_t n = 2; n <= 4; n++)
        publish_h264(s, n, false, 1000);
    for (uint64_t n = 1; n <= 4; n++)
        expect(&c, n);
    sleep_ms(700); /* a line that needs so long must not be given more */
    publish_h264(s, 5, false, 1000);
    publish_h264(s, 6, false, 1000);
    expect_nothing(&c);
    client_ack(&c, 4);
    expect(&c, 5);
    expect(&c, 6);
    client_shut(&c);
    server_destroy(s);
}

static void who_comes_while_a_key_image_is_kept_asks_for_none(void **state)
{
    (void)state;
    struct server *s = start();
    struct test_client first, second;

    watch_h264(&first, s);
    publish_h264(s, 1, true, 1000);
    publish_h264(s, 2, false, 1000);
    publish_h264(s, 3, false, 1000);
    for (uint64_t n = 1; n <= 3; n++)
        expect(&first, n);
    client_ack(&first, 3);
    watch_h264(&second, s);
    for (uint64_t n = 1; n <= 3; n++)
        expect(&second, n);
    assert_false(key_wanted(s));
    publish_h264(s, 4, false, 1000);
    expect(&first, 4);
    expect(&second, 4);
    client_shut(&first);
    client_shut(&second);
    server_destroy(s);
}

static void who_subscribes_again_or_resumes_begins_anew(void **state)
{
    (void)state;
    struct server *s = start();
    struct server_counters counters;
    struct test_client c;

    watch_h264(&c, s);
    publish_h264(s, 1, true, 1000);
    expect(&c, 1);
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"h264\"}");
    client_expect(&c, "subscribed");
    await_wish(s);
    publish_h264(s, 2, false, 1000);
    expect_nothing(&c);
    publish_h264(s, 3, true, 1000);
    expect(&c, 3);
    client_ack(&c, 3);
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"h264\",\"paused\":true}");
    client_expect(&c, "subscribed");
    assert_false(key_wanted(s));
    publish_h264(s, 4, true, 1000);
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"h264\"}");
    client_expect(&c, "subscribed");
    await_wish(s); /* what was made while nobody watched is not kept */
    publish_h264(s, 5, true, 1000);
    expect(&c, 5);
    server_counters(s, &counters);
    assert_int_equal(counters.skipped, 1); /* 2, but not 4: a pause is no slowness */
    client_shut(&c);
    server_destroy(s);
}

static void the_kinds_of_image_do_not_mix(void **state)
{
    (void)state;
    struct server *s = start();
    struct protocol_picture h = { 0 };
    struct server_demand demand;
    struct test_client c;

    watch_h264(&c, s);
    server_demand(s, &demand);
    assert_int_equal(demand.formats, 1 << PROTOCOL_H264);
    publish(s, 1, 100);
    publish_h264(s, 1, true, 100);
    expect(&c, 1);
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"jpeg\"}");
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 1);
    assert_int_equal(h.format, PROTOCOL_JPEG);
    assert_false(key_wanted(s));
    client_ack(&c, 1);
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"h264\"}");
    client_expect(&c, "subscribed");
    await_wish(s);
    publish_h264(s, 2, true, 100);
    expect(&c, 2);
    client_shut(&c);
    server_destroy(s);
}

static uint32_t watched(struct server *s)
{
    struct server_demand demand;

    server_demand(s, &demand);
    return demand.h264;
}

static void tell_size(struct server *s, uint32_t width, uint32_t height)
{
    server_set_figures(s, &(struct server_figures){ .source = SERVER_LIVE, .width = width, .height = height });
}

static void a_wish_for_rate_and_size_comes_to_a_track(void **state)
{
    static const struct {
        const char *wish;
        unsigned scale;
        double rate;
    } wishes[] = {
        { "", 0, 0.0 },
        { ",\"max_rate\":1000", 0, 60.0 },
        { ",\"max_rate\":60", 0, 60.0 },
        { ",\"max_rate\":59.9", 0, 30.0 },
        { ",\"max_rate\":10", 0, 7.5 },
        { ",\"max_rate\":0.94", 0, 0.9375 },
        { ",\"max_rate\":0.1", 0, 0.9375 },
        { ",\"max_width\":640", 0, 0.0 },
        { ",\"max_width\":639", 1, 0.0 },
        { ",\"max_width\":320,\"max_rate\":30", 1, 30.0 },
        { ",\"max_height\":179", 2, 0.0 },
        { ",\"max_width\":1,\"max_rate\":2", 2, 1.875 },
    };
    struct server *s = start();
    struct test_client c;
    (void)state;

    tell_size(s, 640, 360);
    watch_h264(&c, s);
    for (size_t i = 0; i < sizeof(wishes) / sizeof(wishes[0]); i++) {
        char text[128];
        snprintf(text, sizeof(text), "{\"op\":\"subscribe\",\"format\":\"h264\"%s}", wishes[i].wish);
        client_say(&c, text);
        client_expect(&c, "subscribed");
        const uint32_t mask = watched(s);
        unsigned track = 0;
        while (track < SERVER_TRACKS && mask != 1u << track)
            track++;
        assert_true(track < SERVER_TRACKS); /* one, and not the one before */
        assert_int_equal(server_track_scale(track), wishes[i].scale);
        assert_true(server_track_rate(track) == wishes[i].rate);
        assert_true(SERVER_TRACKS_OF(wishes[i].scale) >> track & 1);
    }
    client_shut(&c);
    server_destroy(s);
}

static void each_track_is_a_chain_of_its_own(void **state)
{
    const unsigned slow = SERVER_RATES + 3; /* half the size, 15 a second */
    struct server *s = start();
    struct server_demand demand;
    struct test_client whole, small;
    (void)state;

    tell_size(s, 64, 36);
    watch_h264(&whole, s);
    client_greet(&small, s);
    client_say(&small, "{\"op\":\"subscribe\",\"format\":\"h264\",\"max_rate\":20,\"max_width\":32}");
    client_expect(&small, "subscribed");
    assert_int_equal(watched(s), 1u | 1u << slow);
    await_wish(s);
    publish_h264(s, 1, true, 1000);
    expect(&whole, 1);
    expect_nothing(&small);
    server_demand(s, &demand);
    assert_int_equal(demand.h264_keys, 1u << slow); /* the other one's key image is not its own */
    for (uint64_t n = 2; n <= 9; n++)
        publish_h264(s, n, false, 1000);
    publish_track(s, slow, 9, true, 500);
    for (uint64_t n = 2; n <= 9; n++)
        expect(&whole, n);
    expect(&small, 1);
    publish_track(s, slow, 12, false, 500);
    expect(&small, 2);
    expect_nothing(&whole);
    client_say(&small, "{\"op\":\"subscribe\",\"format\":\"h264\"}"); /* with the others: their key image is kept */
    client_expect(&small, "subscribed");
    for (uint64_t n = 1; n <= 9; n++)
        expect(&small, n);
    assert_int_equal(watched(s), 1);
    client_shut(&whole);
    client_shut(&small);
    server_destroy(s);
}

static void an_image_of_another_size_takes_its_viewers_along(void **state)
{
    struct server *s = start();
    struct test_client c;
    (void)state;

    client_greet(&c, s); /* before anybody knows how large images are */
    client_say(&c, "{\"op\":\"subscribe\",\"format\":\"h264\",\"max_width\":100}");
    client_expect(&c, "subscribed");
    assert_int_equal(watched(s), 1);
    publish_h264(s, 1, true, 1000);
    expect(&c, 1);
    tell_size(s, 128, 72);
    for (int i = 0; i < CLIENT_WAIT_MS && watched(s) == 1; i++)
        sleep_ms(1);
    assert_int_equal(watched(s), 1u << SERVER_RATES);
    publish_track(s, SERVER_RATES, 2, true, 1000);
    expect(&c, 1);
    client_ack(&c, 1); /* may mean either, and breaks nothing */
    publish_track(s, SERVER_RATES, 3, false, 1000);
    expect(&c, 2);
    client_shut(&c);
    server_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(h264_is_offered_where_it_is_made_and_only_there),
    cmocka_unit_test(a_recorder_gets_no_h264),
    cmocka_unit_test(a_viewer_begins_at_a_key_image_and_asks_for_it),
    cmocka_unit_test(a_viewer_that_is_a_little_behind_gets_every_image),
    cmocka_unit_test(who_has_missed_one_goes_on_at_a_key_image_when_the_line_is_clear),
    cmocka_unit_test(images_that_are_late_are_not_added_to_those_under_way),
    cmocka_unit_test(who_comes_while_a_key_image_is_kept_asks_for_none),
    cmocka_unit_test(who_subscribes_again_or_resumes_begins_anew),
    cmocka_unit_test(the_kinds_of_image_do_not_mix),
    cmocka_unit_test(a_wish_for_rate_and_size_comes_to_a_track),
    cmocka_unit_test(each_track_is_a_chain_of_its_own),
    cmocka_unit_test(an_image_of_another_size_takes_its_viewers_along),
};
UNIT_MAIN(tests)
