/* PROTOCOL.md 4.15 to 4.17: questions about a pixel, and pixels that are followed. */
#include "net/stream/producing.h"

static struct server_inspection asked(struct server *s)
{
    struct server_inspection q = { 0 };

    for (int i = 0; i < CLIENT_WAIT_MS / 20; i++) {
        if (server_take_inspection(s, &q))
            return q;
        sleep_ms(20);
    }
    fail_msg("nothing was asked");
    return q;
}

/* The next `error`, of that code, clause and request; the connection stays. */
static void expect_error(struct test_client *c, const char *code, const char *clause, int request)
{
    json_t *m = client_await(c, "error");

    assert_non_null(m);
    assert_string_equal(json_string_value(json_object_get(m, "code")), code);
    assert_string_equal(json_string_value(json_object_get(m, "clause")), clause);
    assert_int_equal(json_integer_value(json_object_get(m, "request")), request);
    assert_true(json_is_false(json_object_get(m, "fatal")));
    json_decref(m);
}

/* A server that has an image of 320x180. */
static struct server *server_with_image(void)
{
    struct server *s = push_server();
    const struct server_figures status = { .width = 320, .height = 180, .source = SERVER_LIVE };

    server_set_figures(s, &status);
    publish(s, 1, 1000);
    return s;
}

static void a_question_arrives_and_its_answer_returns(void **state)
{
    (void)state;
    struct server *s = server_with_image();
    struct test_client c;

    client_greet(&c, s);
    client_say(&c,
               "{\"op\":\"probe\",\"request\":9,\"x\":319,\"y\":179,\"samples\":256,\"preset\":\"fig1\",\"sky\":true}");
    const struct server_inspection q = asked(s);
    assert_true(q.x == 319 && q.y == 179 && q.samples == 256 && q.figure && q.sky && q.request == 9);
    server_answer_inspection(s, &q, "{\"x\":319,\"light\":[]}", NULL);
    json_t *m = client_await(&c, "probed");
    assert_non_null(m);
    assert_int_equal(json_integer_value(json_object_get(m, "request")), 9);
    assert_int_equal(json_integer_value(json_object_get(m, "x")), 319);
    json_decref(m);
    client_say(&c, "{\"op\":\"probe\",\"request\":4,\"x\":0,\"y\":0,\"preset\":null}");
    const struct server_inspection plain = asked(s);
    assert_true(plain.samples == 0 && !plain.figure && !plain.sky && plain.request == 4);
    server_answer_inspection(s, &plain, NULL, "no memory");
    expect_error(&c, "not_offered", "4.15.7", 4);
    client_say(&c, "{\"op\":\"ping\",\"id\":1}");
    client_expect(&c, "pong");
    client_shut(&c);
    server_destroy(s);
}

/* It waits for no question about a pixel, and hinders none. */
static void the_sky_alone_is_asked_for_beside_a_pixel(void **state)
{
    (void)state;
    struct server *s = server_with_image();
    struct test_client c;

    client_greet(&c, s);
    client_say(&c, "{\"op\":\"probe\",\"request\":1,\"x\":3,\"y\":4,\"sky\":true}");
    client_say(&c, "{\"op\":\"probe\",\"request\":2,\"sky\":true}");
    client_say(&c, "{\"op\":\"ping\",\"id\":1}");
    client_expect(&c, "pong");
    const struct server_inspection sky = asked(s), pixel = asked(s);
    assert_true(pixel.request == 1 && !pixel.sky_alone && pixel.sky);
    assert_true(sky.sky_alone);
    client_say(&c, "{\"op\":\"probe\",\"request\":3,\"sky\":true}");
    expect_error(&c, "busy", "4.15.6", 3);
    server_answer_inspection(s, &sky, "{\"frame\":8}", NULL);
    json_t *m = client_await(&c, "probed");
    assert_int_equal(json_integer_value(json_object_get(m, "request")), 2);
    assert_int_equal(json_integer_value(json_object_get(m, "frame")), 8);
    json_decref(m);
    client_say(&c, "{\"op\":\"probe\",\"request\":4,\"x\":3,\"y\":4}");
    expect_error(&c, "busy", "4.15.6", 4); /* the pixel is still under way */
    for (int i = 0; i < 20; i++) {         /* more than pixels may be asked about */
        client_say(&c, "{\"op\":\"probe\",\"request\":5,\"sky\":true}");
        const struct server_inspection again = asked(s);
        assert_true(again.sky_alone);
        server_answer_inspection(s, &again, "{\"frame\":9}", NULL);
        m = client_await(&c, "probed");
        assert_int_equal(json_integer_value(json_object_get(m, "request")), 5);
        json_decref(m);
    }
    client_shut(&c);
    server_destroy(s);
}

/* The largest answer that is made goes through whole. */
static void an_answer_of_60_kib_goes_through(void **state)
{
    (void)state;
    enum { SIZE = 60 << 10 };
    struct server *s = server_with_image();
    struct test_client c;
    char *text = malloc(SIZE + 1);

    memset(text, 'a', SIZE);
    memcpy(text, "{\"jpeg\":\"", 9);
    memcpy(text + SIZE - 2, "\"}", 3);
    client_greet(&c, s);
    client_say(&c, "{\"op\":\"probe\",\"x\":1,\"y\":1}");
    const struct server_inspection q = asked(s);
    server_answer_inspection(s, &q, text, NULL);
    json_t *m = client_await(&c, "probed");
    assert_non_null(m);
    assert_int_equal(json_string_length(json_object_get(m, "jpeg")), SIZE - 11);
    json_decref(m);
    free(text);
    client_shut(&c);
    server_destroy(s);
}

static void what_is_wrong_is_named_and_costs_nothing(void **state)
{
    static const struct {
        const char *fields, *code, *clause;
    } rows[] = {
        { "", "bad_field", "4.15.2" },
        { ",\"x\":1", "bad_field", "4.15.2" },
        { ",\"x\":-1,\"y\":0", "bad_field", "4.15.2" },
        { ",\"x\":1.5,\"y\":0", "bad_field", "4.15.2" },
        { ",\"x\":320,\"y\":0", "bad_field", "4.15.2" },
        { ",\"x\":0,\"y\":180", "bad_field", "4.15.2" },
        { ",\"x\":1,\"y\":1,\"samples\":0", "bad_field", "4.15.3" },
        { ",\"x\":1,\"y\":1,\"samples\":257", "bad_field", "4.15.3" },
        { ",\"x\":1,\"y\":1,\"preset\":\"fig9\"", "bad_field", "4.15.3" },
        { ",\"x\":1,\"y\":1,\"sky\":1", "bad_field", "4.15.4" },
        { ",\"x\":1,\"y\":1,\"follow\":\"yes\"", "bad_field", "4.15.5" },
        { ",\"follow\":true", "bad_field", "4.15.2" },
    };
    (void)state;
    struct server *s = server_with_image();
    struct server_inspection q;
    struct test_client c;

    client_greet(&c, s);
    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        char text[200];
        snprintf(text, sizeof(text), "{\"op\":\"probe\",\"request\":5%s}", rows[i].fields);
        client_say(&c, text);
        expect_error(&c, rows[i].code, rows[i].clause, 5);
    }
    assert_false(server_take_inspection(s, &q));
    client_say(&c, "{\"op\":\"probe\",\"request\":\"a\",\"x\":1,\"y\":1}");
    expect_error(&c, "bad_field", "4.15.1", 0);
    client_shut(&c);
    server_destroy(s);
}

static void before_the_first_image_nothing_can_be_asked(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client c;

    client_greet(&c, s);
    client_say(&c, "{\"op\":\"probe\",\"request\":2,\"x\":0,\"y\":0}");
    expect_error(&c, "not_offered", "4.15.7", 2);
    client_shut(&c);
    server_destroy(s);
}

static void a_producer_may_not_ask(void **state)
{
    (void)state;
    struct server *s = server_with_image();
    struct test_client c;

    produce_live(&c, s);
    client_say(&c, "{\"op\":\"probe\",\"x\":0,\"y\":0}");
    assert_int_equal(client_close_code(&c), 4004);
    client_shut(&c);
    server_destroy(s);
}

/* One under way per connection; when it is answered the next may come. */
static void a_second_question_waits_for_the_first(void **state)
{
    (void)state;
    struct server *s = server_with_image();
    struct test_client c, other;

    client_greet(&c, s);
    client_greet(&other, s);
    client_say(&c, "{\"op\":\"probe\",\"request\":1,\"x\":0,\"y\":0}");
    const struct server_inspection first = asked(s);
    client_say(&c, "{\"op\":\"probe\",\"request\":2,\"x\":0,\"y\":0}");
    expect_error(&c, "busy", "4.15.6", 2);
    client_say(&other, "{\"op\":\"probe\",\"request\":3,\"x\":0,\"y\":0}");
    const struct server_inspection second = asked(s);
    assert_int_equal(second.request, 3);
    server_answer_inspection(s, &first, "{\"a\":1}", NULL);
    client_expect(&c, "probed");
    client_say(&c, "{\"op\":\"probe\",\"request\":4,\"x\":0,\"y\":0}");
    assert_int_equal(asked(s).request, 4);
    client_shut(&c);
    client_shut(&other);
    server_destroy(s);
}

/* Eight at once, and after that as many as time allows: of twenty from as many connections, each taken as soon as it
 * comes, the others wait. */
static void the_server_answers_only_so_many(void **state)
{
    (void)state;
    enum { CLIENTS = 20 };
    struct server *s = server_with_image();
    struct test_client c[CLIENTS];
    struct server_inspection q;
    int taken = 0, busy = 0, first;
    struct timespec begun, now;

    for (int i = 0; i < CLIENTS; i++)
        client_greet(&c[i], s);
    clock_gettime(CLOCK_MONOTONIC, &begun);
    for (int i = 0; i < CLIENTS; i++) { /* each has been heard once its ping is answered */
        client_say(&c[i], "{\"op\":\"probe\",\"request\":1,\"x\":0,\"y\":0}");
        client_say(&c[i], "{\"op\":\"ping\",\"id\":1}");
        for (;;) {
            json_t *m = NULL;
            assert_int_equal(client_next(&c[i], CLIENT_WAIT_MS), OP_TEXT);
            m = json_loads((char *)c[i].message, 0, NULL);
            const char *op = json_string_value(json_object_get(m, "op"));
            const bool pong = strcmp(op, "pong") == 0;
            busy += strcmp(op, "error") == 0;
            json_decref(m);
            if (pong)
                break;
        }
        while (server_take_inspection(s, &q))
            taken++;
    }
    clock_gettime(CLOCK_MONOTONIC, &now);
    const double s_since = (double)(now.tv_sec - begun.tv_sec) + 1e-9 * (double)(now.tv_nsec - begun.tv_nsec);
    assert_true(taken >= 8 && taken <= 9 + 4.0 * s_since);
    assert_int_equal(busy, 0);
    for (first = taken; taken < CLIENTS; taken++)
        asked(s);
    clock_gettime(CLOCK_MONOTONIC, &now);
    const double all_s = (double)(now.tv_sec - begun.tv_sec) + 1e-9 * (double)(now.tv_nsec - begun.tv_nsec);
    assert_true(all_s >= (CLIENTS - 9) / 4.0 && first < CLIENTS);
    for (int i = 0; i < CLIENTS; i++)
        client_shut(&c[i]);
    server_destroy(s);
}

/* An answer for somebody who has gone is nobody's, and what he asked is not computed. */
static void who_leaves_is_forgotten(void **state)
{
    (void)state;
    struct server *s = server_with_image();
    struct server_follow f[SERVER_FOLLOWED_MAX];
    struct server_inspection q;
    struct test_client c;

    client_greet(&c, s);
    client_say(&c, "{\"op\":\"probe\",\"x\":0,\"y\":0,\"follow\":true}");
    const struct server_inspection first = asked(s);
    server_answer_inspection(s, &first, "{\"a\":1}", NULL);
    client_expect(&c, "probed");
    client_say(&c, "{\"op\":\"probe\",\"x\":0,\"y\":0}");
    client_say(&c, "{\"op\":\"ping\",\"id\":1}");
    client_expect(&c, "pong");
    client_shut(&c);
    struct server_counters n;
    for (int i = 0; i < CLIENT_WAIT_MS / 20; i++) {
        server_counters(s, &n);
        if (n.open == 0)
            break;
        sleep_ms(20);
    }
    assert_int_equal(n.open, 0);
    assert_false(server_take_inspection(s, &q));
    assert_int_equal(server_followed(s, f), 0);
    server_answer_inspection(s, &first, "{\"a\":1}", NULL); /* too late: it goes nowhere */
    sleep_ms(50);
    server_destroy(s);
}

/* A followed pixel is told with each image until it is followed no more; another pixel takes its place. */
static void a_followed_pixel_is_told(void **state)
{
    (void)state;
    struct server *s = server_with_image();
    struct server_follow f[SERVER_FOLLOWED_MAX];
    const struct server_radiance r = { .frame = 7, .capture_us = 12, .rgb = { 0.5f, 1.0f, 2.0f } };
    struct test_client c;

    client_greet(&c, s);
    client_say(&c, "{\"op\":\"probe\",\"request\":1,\"x\":5,\"y\":6,\"follow\":true}");
    struct server_inspection q = asked(s);
    server_answer_inspection(s, &q, "{\"a\":1}", NULL);
    client_expect(&c, "probed");
    assert_int_equal(server_followed(s, f), 1);
    assert_true(f[0].x == 5 && f[0].y == 6 && f[0].by == q.by);
    server_send_radiance(s, &f[0], &r);
    json_t *m = client_await(&c, "radiance");
    assert_non_null(m);
    assert_int_equal(json_integer_value(json_object_get(m, "x")), 5);
    assert_int_equal(json_integer_value(json_object_get(m, "y")), 6);
    assert_int_equal(json_integer_value(json_object_get(m, "frame")), 7);
    assert_true(json_number_value(json_array_get(json_object_get(m, "radiance"), 2)) == 2.0);
    json_decref(m);
    client_say(&c, "{\"op\":\"probe\",\"x\":8,\"y\":6,\"follow\":true}");
    q = asked(s);
    server_send_radiance(s, &f[0], &r); /* of the pixel before: not told */
    assert_int_equal(server_followed(s, f), 1);
    assert_int_equal(f[0].x, 8);
    server_answer_inspection(s, &q, "{\"a\":1}", NULL);
    client_expect(&c, "probed");
    client_say(&c, "{\"op\":\"probe\",\"follow\":false}");
    client_say(&c, "{\"op\":\"ping\",\"id\":1}");
    for (;;) { /* no radiance meanwhile */
        assert_int_equal(client_next(&c, CLIENT_WAIT_MS), OP_TEXT);
        assert_null(strstr((char *)c.message, "\"radiance\""));
        if (strstr((char *)c.message, "\"pong\""))
            break;
    }
    assert_int_equal(server_followed(s, f), 0);
    assert_false(server_take_inspection(s, &q)); /* it was no question */
    client_shut(&c);
    server_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_question_arrives_and_its_answer_returns),
    cmocka_unit_test(the_sky_alone_is_asked_for_beside_a_pixel),
    cmocka_unit_test(an_answer_of_60_kib_goes_through),
    cmocka_unit_test(what_is_wrong_is_named_and_costs_nothing),
    cmocka_unit_test(before_the_first_image_nothing_can_be_asked),
    cmocka_unit_test(a_producer_may_not_ask),
    cmocka_unit_test(a_second_question_waits_for_the_first),
    cmocka_unit_test(the_server_answers_only_so_many),
    cmocka_unit_test(who_leaves_is_forgotten),
    cmocka_unit_test(a_followed_pixel_is_told),
};

UNIT_MAIN(tests)
