/* PROTOCOL.md 4.13: controllers, and who is told what. */
#include "net/stream/producing.h"

#include "net/stream/internal.h"
#include "relightd/settings/settings.h"

#include <math.h>

static void control_in(struct test_client *c, const struct server *s)
{
    json_decref(hello(c, s, "\"role\":\"controller\""));
}

/* What a controller asked for, by name. */
struct asked {
    struct server_control control;
    struct settings settings;
};

static struct server *control_server(void)
{
    const struct server_desc desc = { .controls = settings_table };
    return server_start(&desc);
}

static bool take_asked(struct server *s, struct asked *a)
{
    const bool any = server_take_control(s, &a->control);
    memcpy(&a->settings, a->control.values, sizeof(a->settings));
    return any;
}

static struct asked taken(struct server *s)
{
    struct asked a;

    for (int i = 0; i < CLIENT_WAIT_MS / 20; i++) {
        if (take_asked(s, &a))
            return a;
        sleep_ms(20);
    }
    fail_msg("nothing was asked for");
    return a;
}

static bool has(const struct asked *a, const char *key)
{
    uint32_t k = 0;

    while (settings_table[k].key && strcmp(settings_table[k].key, key) != 0)
        k++;
    assert_non_null(settings_table[k].key);
    return a->control.asked >> k & 1;
}

/* All of the keys, parted by blanks. */
static bool has_all(const struct asked *a, const char *keys)
{
    char copy[200];

    snprintf(copy, sizeof(copy), "%s", keys);
    for (char *key = strtok(copy, " "); key; key = strtok(NULL, " "))
        if (!has(a, key))
            return false;
    return true;
}

static bool has_any(const struct asked *a, const char *keys)
{
    char copy[200];

    snprintf(copy, sizeof(copy), "%s", keys);
    for (char *key = strtok(copy, " "); key; key = strtok(NULL, " "))
        if (has(a, key))
            return true;
    return false;
}

static void expect_control(struct test_client *c, uint64_t by, int request, const char *words)
{
    json_t *m = client_await(c, "control");
    char id[24];

    assert_non_null(m);
    snprintf(id, sizeof(id), "%llu", (unsigned long long)by);
    assert_string_equal(json_string_value(json_object_get(m, "by")), id);
    assert_int_equal(json_integer_value(json_object_get(m, "request")), request);
    if (!strstr((char *)c->message, words))
        fail_msg("no %s in %s", words, (char *)c->message);
    json_decref(m);
}

static const struct settings in_force = {
    .rotation_degrees = 12.5,
    .method = METHOD_MIS,
    .tone = TONE_FILMIC,
    .samples = 64,
    .classes = PATH_ALL,
};

static void all_that_can_be_asked_for_arrives(void **state)
{
    (void)state;
    struct server *s = control_server();
    struct test_client c;

    control_in(&c, s);
    client_say(&c, "{\"op\":\"control\",\"request\":3,\"rotate_degrees\":-90.5,\"scale_stops\":2,\"method\":\"mis\","
                   "\"samples\":128,\"tone\":\"linear\",\"paused\":true}");
    const struct asked a = taken(s);
    assert_true(has_all(&a, "rotate_degrees scale_stops method samples tone paused"));
    assert_true(a.settings.rotation_degrees == -90.5 && a.settings.scale_stops == 2.0);
    assert_true(a.settings.samples == 128 && a.settings.paused);
    assert_int_equal(a.settings.method, METHOD_MIS);
    assert_int_equal(a.settings.tone, TONE_LINEAR);
    assert_int_equal(a.control.request, 3);
    client_say(&c, "{\"op\":\"control\",\"samples\":7}");
    const struct asked b = taken(s);
    assert_true(has(&b, "samples") && !has_any(&b, "rotate_degrees scale_stops method tone paused"));
    client_shut(&c);
    server_destroy(s);
}

static void all_of_minor_1_arrives(void **state)
{
    (void)state;
    struct server *s = control_server();
    struct test_client c;

    control_in(&c, s);
    client_say(&c,
               "{\"op\":\"control\",\"request\":4,\"exposure_stops\":-2.5,\"bias_stops\":1,\"error\":0.01,\"fps\":12,"
               "\"paths\":\"all\",\"camera\":\"roof\",\"step\":-3,\"seek\":17}");
    const struct asked a = taken(s);
    assert_true(has_all(&a, "exposure_stops bias_stops error fps paths camera step seek"));
    assert_false(has_any(&a, "hour samples"));
    assert_true(a.settings.exposure_stops == -2.5 && a.settings.bias_stops == 1.0 && a.settings.error == 0.01);
    assert_true(a.settings.fps == 12.0 && a.settings.step == -3 && a.settings.seek == 17);
    assert_int_equal(a.settings.classes, PATH_ALL);
    assert_string_equal(a.settings.camera, "roof");
    client_say(&c, "{\"op\":\"control\",\"exposure_stops\":null,\"error\":null,\"samples\":null,\"hour\":24}");
    const struct asked b = taken(s);
    assert_true(has_all(&b, "exposure_stops error samples hour") && !has_any(&b, "bias_stops seek"));
    assert_true(b.settings.exposure_stops == EXPOSURE_FOLLOW && b.settings.error == 0.0);
    assert_true(b.settings.samples == 0 && b.settings.hour == 24.0);
    client_shut(&c);
    server_destroy(s);
}

/* Several messages that were not taken yet are as one: as if they had been obeyed one after another. */
static void what_is_joined_is_what_was_said_in_turn(void **state)
{
    (void)state;
    struct server *s = control_server();
    struct asked a;
    struct test_client c;

    control_in(&c, s);
    static const char *const said[] = {
        "\"step\":2,\"samples\":8",         "\"seek\":5,\"error\":0.5", "\"step\":1",
        "\"step\":-4,\"exposure_stops\":3", "\"exposure_stops\":null",
    };
    char text[200];
    for (size_t i = 0; i < sizeof(said) / sizeof(said[0]); i++) {
        snprintf(text, sizeof(text), "{\"op\":\"control\",\"request\":%zu,%s}", i + 1, said[i]);
        client_say(&c, text);
    }
    client_say(&c, "{\"op\":\"ping\",\"id\":1}");
    client_expect(&c, "pong");
    a = taken(s);
    assert_int_equal(a.control.request, 5);
    assert_true(has_all(&a, "seek step error exposure_stops") && !has(&a, "samples"));
    assert_true(a.settings.seek == 5 && a.settings.step == -3); /* the steps before the place are void */
    assert_true(a.settings.error == 0.5);                       /* the last of two wishes for one thing */
    assert_true(a.settings.exposure_stops == EXPOSURE_FOLLOW);
    client_say(&c, "{\"op\":\"control\",\"error\":0.5,\"hour\":3,\"step\":1}");
    client_say(&c, "{\"op\":\"control\",\"samples\":8,\"seek\":2}");
    client_say(&c, "{\"op\":\"ping\",\"id\":1}");
    client_expect(&c, "pong");
    a = taken(s);
    assert_true(has_all(&a, "samples seek") && !has_any(&a, "error hour step"));
    assert_true(a.settings.samples == 8 && a.settings.seek == 2);
    client_shut(&c);
    server_destroy(s);
}

static void who_cannot_do_it_says_by_which_clause(void **state)
{
    (void)state;
    struct server *s = control_server();
    struct test_client c;

    control_in(&c, s);
    client_say(&c, "{\"op\":\"control\",\"request\":2,\"camera\":\"moon\"}");
    struct asked a = taken(s);
    a.control.clause = "4.13.15";
    server_set_control(s, &in_force, &a.control, "there is no camera 'moon'");
    json_t *error = client_await(&c, "error");
    assert_non_null(error);
    assert_string_equal(json_string_value(json_object_get(error, "clause")), "4.13.15");
    json_decref(error);
    client_shut(&c);
    server_destroy(s);
}

static void the_last_word_wins_and_all_are_told(void **state)
{
    (void)state;
    struct server *s = control_server();
    struct settings now = in_force;
    struct asked a;
    struct test_client one, two, viewer, late;

    client_greet(&viewer, s);
    control_in(&one, s);
    control_in(&two, s);
    client_say(&one, "{\"op\":\"control\",\"request\":1,\"rotate_degrees\":10}");
    a = taken(s);
    const uint64_t first = a.control.by;
    now.rotation_degrees = 10;
    server_set_control(s, &now, &a.control, NULL);
    expect_control(&one, first, 1, "\"rotate_degrees\":10.0");
    expect_control(&two, first, 1, "\"rotate_degrees\":10.0");
    expect_control(&viewer, first, 1, "\"samples\":64");
    client_say(&two, "{\"op\":\"control\",\"request\":9,\"rotate_degrees\":20}");
    a = taken(s);
    assert_true(a.control.by != first);
    now.rotation_degrees = 20;
    server_set_control(s, &now, &a.control, NULL);
    expect_control(&one, a.control.by, 9, "\"rotate_degrees\":20.0");
    expect_control(&two, a.control.by, 9, "\"rotate_degrees\":20.0");
    client_greet(&late, s); /* and who comes later */
    expect_control(&late, a.control.by, 9, "\"rotate_degrees\":20.0");
    client_shut(&one);
    client_shut(&two);
    client_shut(&viewer);
    client_shut(&late);
    server_destroy(s);
}

static void words_in_a_row_are_one_change_and_between_two_the_order_stands(void **state)
{
    (void)state;
    struct server *s = control_server();
    struct asked a;
    struct test_client one, two;

    control_in(&one, s);
    control_in(&two, s);
    client_say(&one, "{\"op\":\"control\",\"request\":1,\"rotate_degrees\":1,\"tone\":\"linear\"}");
    client_say(&one, "{\"op\":\"control\",\"request\":2,\"rotate_degrees\":2,\"samples\":5}");
    client_say(&one, "{\"op\":\"ping\",\"id\":1}");
    client_expect(&one, "pong");
    client_say(&two, "{\"op\":\"control\",\"request\":8,\"rotate_degrees\":8}");
    client_say(&two, "{\"op\":\"ping\",\"id\":1}");
    client_expect(&two, "pong");
    client_say(&one, "{\"op\":\"control\",\"request\":3,\"rotate_degrees\":3}");
    client_say(&one, "{\"op\":\"ping\",\"id\":1}");
    client_expect(&one, "pong");
    a = taken(s);
    assert_true(a.control.request == 2 && a.settings.rotation_degrees == 2.0 && a.settings.samples == 5 &&
                has(&a, "tone"));
    assert_int_equal(a.settings.tone, TONE_LINEAR);
    a = taken(s);
    assert_true(a.control.request == 8 && a.settings.rotation_degrees == 8.0 && !has(&a, "tone"));
    a = taken(s);
    assert_true(a.control.request == 3 && a.settings.rotation_degrees == 3.0 && !has(&a, "samples"));
    assert_false(take_asked(s, &a));
    client_shut(&one);
    client_shut(&two);
    server_destroy(s);
}

static void an_answer_does_not_hide_what_another_has_said_since(void **state)
{
    (void)state;
    struct server *s = control_server();
    struct asked a, b;
    struct test_client one, two;
    char text[80];

    control_in(&one, s);
    control_in(&two, s);
    for (int i = 1; i <= 20; i++) {
        snprintf(text, sizeof(text), "{\"op\":\"control\",\"request\":%d,\"samples\":8}", i);
        client_say(&one, text);
        a = taken(s);
        client_say(&two, text);
        b = taken(s);
        server_set_control(s, &in_force, &a.control, NULL);
        server_set_control(s, &in_force, &b.control, NULL); /* most likely before the first was told */
        expect_control(&one, a.control.by, i, "\"samples\":64");
        expect_control(&one, b.control.by, i, "\"samples\":64");
    }
    client_shut(&one);
    client_shut(&two);
    server_destroy(s);
}

static void each_of_many_requests_is_answered(void **state)
{
    (void)state;
    struct server *s = control_server();
    struct asked a;
    struct test_client c[2];
    char text[80];

    control_in(&c[0], s);
    control_in(&c[1], s);
    for (int i = 1; i <= CONTROL_WAITING + 1; i++) {
        snprintf(text, sizeof(text), "{\"op\":\"control\",\"request\":%d,\"samples\":8}", i);
        client_say(&c[i % 2], text);
        client_say(&c[i % 2], "{\"op\":\"ping\",\"id\":1}");
        if (i > CONTROL_WAITING) {
            json_t *error = client_await(&c[i % 2], "error");
            assert_non_null(error);
            assert_string_equal(json_string_value(json_object_get(error, "code")), "busy");
            assert_string_equal(json_string_value(json_object_get(error, "clause")), "4.13.8");
            assert_true(json_is_false(json_object_get(error, "fatal")));
            assert_int_equal(json_integer_value(json_object_get(error, "request")), i);
            json_decref(error);
        }
        client_expect(&c[i % 2], "pong");
    }
    for (int i = 1; i <= CONTROL_WAITING; i++) {
        a = taken(s);
        assert_int_equal(a.control.request, i);
        server_set_control(s, &in_force, &a.control, NULL);
        for (int k = 0; k < 2; k++)
            expect_control(&c[k], a.control.by, i, "\"samples\":64");
    }
    assert_false(take_asked(s, &a));
    client_shut(&c[0]);
    client_shut(&c[1]);
    server_destroy(s);
}

static void what_cannot_be_done_is_told_to_who_asked_and_costs_nothing(void **state)
{
    (void)state;
    static const struct {
        const char *text, *clause;
    } bad[] = {
        { "\"rotate_degrees\":\"far\"", "4.13.2" },
        { "\"rotate_degrees\":1e9", "4.13.2" },
        { "\"scale_stops\":61", "4.13.3" },
        { "\"method\":\"\"", "4.13.4" },
        { "\"method\":5", "4.13.4" },
        { "\"method\":\"path\"", "4.13.4" }, /* a reference */
        { "\"samples\":0", "4.13.5" },
        { "\"samples\":1.5", "4.13.5" },
        { "\"tone\":\"a word much too long for a curve\"", "4.13.6" },
        { "\"paused\":1", "4.13.7" },
        { "\"exposure_stops\":\"bright\"", "4.13.10" },
        { "\"exposure_stops\":61", "4.13.10" },
        { "\"bias_stops\":-21", "4.13.11" },
        { "\"error\":0", "4.13.12" },
        { "\"error\":0.1,\"samples\":4", "4.13.12" },
        { "\"fps\":0", "4.13.13" },
        { "\"paths\":[]", "4.13.14" },
        { "\"paths\":\"most\"", "4.13.14" },
        { "\"camera\":\"\"", "4.13.15" },
        { "\"step\":1001", "4.13.16" },
        { "\"step\":0.5", "4.13.16" },
        { "\"seek\":-1", "4.13.17" },
        { "\"hour\":24.5", "4.13.18" },
        { "\"hour\":2,\"seek\":1", "4.13.18" },
    };
    struct server *s = control_server();
    struct asked a;
    struct test_client c, viewer;
    char text[200];

    control_in(&c, s);
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        snprintf(text, sizeof(text), "{\"op\":\"control\",\"request\":%zu,%s}", i + 1, bad[i].text);
        client_say(&c, text);
        json_t *error = client_await(&c, "error");
        assert_non_null(error);
        assert_string_equal(json_string_value(json_object_get(error, "code")), "bad_field");
        assert_string_equal(json_string_value(json_object_get(error, "clause")), bad[i].clause);
        assert_true(json_is_false(json_object_get(error, "fatal")));
        assert_int_equal(json_integer_value(json_object_get(error, "request")), i + 1);
        json_decref(error);
    }
    assert_false(take_asked(s, &a));
    client_say(&c, "{\"op\":\"control\",\"request\":40,\"camera\":\"magic\"}");
    a = taken(s);
    server_set_control(s, &in_force, &a.control, "there is no camera 'magic'");
    json_t *error = client_await(&c, "error");
    assert_non_null(error);
    assert_non_null(strstr(json_string_value(json_object_get(error, "message")), "magic"));
    assert_int_equal(json_integer_value(json_object_get(error, "request")), 40);
    assert_true(json_is_false(json_object_get(error, "fatal")));
    json_decref(error);
    client_say(&c, "{\"op\":\"control\",\"request\":41,\"samples\":4}"); /* no answer but the error has number 40 */
    a = taken(s);
    server_set_control(s, &in_force, &a.control, NULL);
    json_t *answer = client_await(&c, "control");
    assert_non_null(answer);
    assert_int_equal(json_integer_value(json_object_get(answer, "request")), 41);
    json_decref(answer);
    client_greet(&viewer, s);
    client_say(&viewer, "{\"op\":\"control\",\"samples\":4}");
    assert_int_equal(client_close_code(&viewer), 4004);
    client_shut(&viewer);
    client_shut(&c);
    server_destroy(s);
}

static void a_slider_does_not_cost_slow_viewers_their_connection(void **state)
{
    (void)state;
    struct server *s = control_server();
    struct settings now = in_force;
    struct protocol_picture h;
    struct test_client stuck;

    client_watch(&stuck, s);
    publish(s, 1, 8000000); /* in transmission for as long as nobody reads */
    for (int i = 0; i < 500; i++) {
        now.samples = (uint32_t)i + 1;
        server_set_control(s, &now, NULL, NULL);
        if (i % 100 == 0)
            sleep_ms(20);
    }
    assert_int_equal(client_picture(&stuck, &h, CLIENT_WAIT_MS), 1);
    expect_control(&stuck, 0, 0, "\"samples\":500"); /* the newest, and only that */
    client_shut(&stuck);
    server_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(all_that_can_be_asked_for_arrives),
    cmocka_unit_test(all_of_minor_1_arrives),
    cmocka_unit_test(what_is_joined_is_what_was_said_in_turn),
    cmocka_unit_test(who_cannot_do_it_says_by_which_clause),
    cmocka_unit_test(the_last_word_wins_and_all_are_told),
    cmocka_unit_test(words_in_a_row_are_one_change_and_between_two_the_order_stands),
    cmocka_unit_test(an_answer_does_not_hide_what_another_has_said_since),
    cmocka_unit_test(each_of_many_requests_is_answered),
    cmocka_unit_test(what_cannot_be_done_is_told_to_who_asked_and_costs_nothing),
    cmocka_unit_test(a_slider_does_not_cost_slow_viewers_their_connection),
};
UNIT_MAIN(tests)
