/* PROTOCOL.md 5.8 to 5.10: each frame of a lockstep sequence yields one image, whoever is killed and when. */
#include "net/stream/producing.h"

#include "net/stream/ingest.h"

static void a_producer_has_no_credit_before_a_recorder_has_come(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client p, r;
    struct server_demand demand;
    int64_t after;

    assert_int_equal(produce_lockstep(&p, s, "a", &after), 0);
    assert_int_equal(after, -1);
    assert_true(nothing_comes(&p, "credit", 300));
    server_demand(s, &demand);
    assert_false(demand.recorder);
    assert_int_equal(demand.recorder_format, 0);
    assert_int_equal(record(&r, s, "a", "exr_float"), -1);
    assert_int_equal(credit_comes(&p), 1);
    server_demand(s, &demand);
    assert_true(demand.recorder);
    assert_int_equal(demand.recorder_format, PROTOCOL_EXR_FLOAT);
    assert_int_equal(demand.viewers, 0); /* it watches nothing but its sequence */
    client_shut(&p);
    client_shut(&r);
    server_destroy(s);
}

static void credit_returns_when_the_image_is_stored_and_not_before(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client p, r, viewer;
    struct server_ticket t;
    struct frame f = { 0 };
    struct protocol_picture h = { 0 };
    int64_t after;

    record(&r, s, "a", "exr_half");
    client_greet(&viewer, s);
    client_say(&viewer, "{\"op\":\"subscribe\",\"format\":\"exr_half\"}");
    client_expect(&viewer, "subscribed");
    assert_int_equal(produce_lockstep(&p, s, "a", &after), 1);
    for (uint64_t number = 3; number <= 9; number += 3) {
        frame_send(&p, number);
        take(s, &f, &t, number);
        assert_true(t.lockstep);
        publish_for(s, PROTOCOL_JPEG, number, &t); /* only shown */
        publish_for(s, PROTOCOL_EXR_HALF, number, &t);
        expect_fate(&p, number, "used");
        assert_true(client_picture(&r, &h, CLIENT_WAIT_MS) > 0);
        assert_int_equal(h.frame, number);
        assert_int_equal(h.capture_us, number * 1000);
        assert_int_equal(h.flags, PROTOCOL_PICTURE_LOCKSTEP);
        assert_true(client_picture(&viewer, &h, CLIENT_WAIT_MS) > 0); /* sees it, and its ack counts for nothing */
        client_ack(&viewer, h.sequence);
        if (number == 3)
            assert_true(nothing_comes(&p, "credit", 300));
        if (number == 6) { /* to acknowledge the one before again is not to store this one */
            store(&r, h.sequence - 1);
            assert_true(nothing_comes(&p, "credit", 300));
        }
        store(&r, h.sequence);
        assert_int_equal(credit_comes(&p), 1);
    }
    assert_int_equal(h.sequence, 3);
    client_shut(&p);
    client_shut(&r);
    client_shut(&viewer);
    frame_finish(&f);
    server_destroy(s);
}

static void a_recorder_must_say_that_it_has_stored(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client p, r;
    struct server_ticket t;
    struct frame f = { 0 };
    struct protocol_picture h = { 0 };
    int64_t after;

    record(&r, s, "a", "jpeg");
    produce_lockstep(&p, s, "a", &after);
    publish(s, 1, 500); /* of no sequence: not for a recorder */
    frame_send(&p, 1);
    take(s, &f, &t, 1);
    publish_for(s, PROTOCOL_JPEG, 1, &t);
    assert_int_equal(client_picture(&r, &h, CLIENT_WAIT_MS), 2);
    client_ack(&r, 2);
    json_t *error = client_await(&r, "error");
    assert_non_null(error);
    assert_string_equal(json_string_value(json_object_get(error, "clause")), "4.5.3");
    json_decref(error);
    assert_int_equal(client_close_code(&r), 4002);
    client_shut(&r);
    client_shut(&p);
    frame_finish(&f);
    server_destroy(s);
}

static void an_image_comes_again_until_it_is_stored(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client p, r;
    struct server_ticket t;
    struct frame f = { 0 };
    struct protocol_picture h = { 0 };
    int64_t after;

    record(&r, s, "a", "jpeg");
    produce_lockstep(&p, s, "a", &after);
    frame_send(&p, 1);
    take(s, &f, &t, 1);
    client_shut(&r); /* killed while the image is made */
    COUNTER_BECOMES(s, open, 1);
    publish_for(s, PROTOCOL_JPEG, 1, &t);
    expect_fate(&p, 1, "used");
    for (int i = 0; i < 3; i++) { /* and again while it is being stored */
        assert_int_equal(record(&r, s, "a", "jpeg"), -1);
        assert_int_equal(client_picture(&r, &h, CLIENT_WAIT_MS), 1);
        assert_int_equal(h.frame, 1);
        assert_int_equal(h.flags, PROTOCOL_PICTURE_LOCKSTEP | PROTOCOL_PICTURE_REPEAT);
        client_shut(&r);
    }
    assert_true(nothing_comes(&p, "credit", 200));
    assert_int_equal(record(&r, s, "a", "jpeg"), -1);
    assert_int_equal(client_picture(&r, &h, CLIENT_WAIT_MS), 1);
    store(&r, 1);
    assert_int_equal(credit_comes(&p), 1);
    client_shut(&r); /* killed after its ack: it does not come again */
    assert_int_equal(record(&r, s, "a", "jpeg"), 1);
    assert_int_equal(client_picture(&r, &h, 300), 0);
    client_shut(&r);
    client_shut(&p);
    frame_finish(&f);
    server_destroy(s);
}

static void a_producer_goes_on_after_what_was_accepted(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client p, r;
    struct server_ticket t;
    struct frame f = { 0 };
    struct protocol_picture h = { 0 };
    uint8_t bytes[FRAME_SIZE];
    int64_t after;

    record(&r, s, "a", "jpeg");
    assert_int_equal(produce_lockstep(&p, s, "a", &after), 1);
    frame_make(7, bytes); /* killed in the middle of a frame: it was not accepted */
    client_frame(&p, OP_BINARY, false, bytes, FRAME_SIZE - 1);
    client_shut(&p);
    COUNTER_BECOMES(s, frames_cut, 1);
    assert_int_equal(produce_lockstep(&p, s, "a", &after), 1);
    assert_int_equal(after, -1);
    frame_send(&p, 7);
    COUNTER_BECOMES(s, frames_received, 1);
    client_shut(&p); /* killed while its frame waits */
    COUNTER_BECOMES(s, open, 1);
    assert_int_equal(produce_lockstep(&p, s, "a", &after), 0);
    assert_int_equal(after, 7);
    take(s, &f, &t, 7);
    client_shut(&p); /* killed while it is worked on */
    COUNTER_BECOMES(s, open, 1);
    assert_int_equal(produce_lockstep(&p, s, "a", &after), 0);
    assert_int_equal(after, 7);
    publish_for(s, PROTOCOL_JPEG, 7, &t);
    expect_fate(&p, 7, "used"); /* told to whoever makes the sequence now */
    client_shut(&p);            /* killed while the image waits */
    COUNTER_BECOMES(s, open, 1);
    assert_int_equal(produce_lockstep(&p, s, "a", &after), 0);
    assert_int_equal(after, 7);
    assert_int_equal(client_picture(&r, &h, CLIENT_WAIT_MS), 1);
    store(&r, 1);
    assert_int_equal(credit_comes(&p), 1);
    frame_send(&p, 7); /* a feeder that does not listen */
    json_t *fate = client_await(&p, "frame");
    assert_non_null(fate);
    assert_string_equal(json_string_value(json_object_get(fate, "fate")), "used");
    assert_int_equal(json_integer_value(json_object_get(fate, "sequence")), 1); /* 4.11.1, here too */
    json_decref(fate);
    assert_int_equal(credit_comes(&p), 1);
    assert_false(server_take_frame(s, &f, &t, true, 20));
    COUNTER_BECOMES(s, frames_repeated, 1);
    frame_send(&p, 8);
    take(s, &f, &t, 8);
    client_shut(&p);
    client_shut(&r);
    frame_finish(&f);
    server_destroy(s);
}

static void a_refused_frame_returns_its_credit_and_is_remembered(void **state)
{
    (void)state;
    static const char not_radiance[] = "no";
    const struct protocol_environment file = { .encoding = PROTOCOL_FILE_HDR, .payload = 2, .frame = 2 };
    struct server *s = push_server();
    struct test_client p, r;
    struct server_ticket t;
    struct frame f = { 0 };
    int64_t after;

    record(&r, s, "a", "jpeg");
    produce_lockstep(&p, s, "a", &after);
    frame_send(&p, 1);
    take(s, &f, &t, 1);
    server_frame_fate(s, &t, SERVER_REFUSED, "no sky");
    expect_fate(&p, 1, "refused");
    assert_int_equal(credit_comes(&p), 1);
    payload_send(&p, file, not_radiance); /* refused before it is taken */
    expect_fate(&p, 2, "refused");
    assert_int_equal(credit_comes(&p), 1);
    frame_send(&p, 2);
    expect_fate(&p, 2, "refused");
    assert_int_equal(credit_comes(&p), 1);
    frame_send(&p, 3);
    take(s, &f, &t, 3);
    server_frame_fate(s, &t, SERVER_SUPERSEDED, NULL); /* may not be: then it was refused */
    expect_fate(&p, 3, "refused");
    client_shut(&p);
    assert_int_equal(produce_lockstep(&p, s, "a", &after), 1);
    assert_int_equal(after, 3);
    client_shut(&p);
    client_shut(&r);
    frame_finish(&f);
    server_destroy(s);
}

/* Refuses frames from `first` to `last`. */
static void refuse_frames(struct test_client *p, struct server *s, uint64_t first, uint64_t last)
{
    struct server_ticket t;
    struct frame f = { 0 };

    for (uint64_t number = first; number <= last; number++) {
        frame_send(p, number);
        take(s, &f, &t, number);
        server_frame_fate(s, &t, SERVER_REFUSED, "no sky");
        expect_fate(p, number, "refused");
        assert_int_equal(credit_comes(p), 1);
    }
    frame_finish(&f);
}

static void late_frames_are_told_their_own_fate(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client p, r;
    struct server_ticket t;
    struct frame f = { 0 };
    struct protocol_picture h;
    int64_t after;

    record(&r, s, "a", "jpeg");
    produce_lockstep(&p, s, "a", &after);
    refuse_frames(&p, s, 5, 5);
    for (uint64_t number = 6; number <= 8; number += 2) {
        frame_send(&p, number);
        take(s, &f, &t, number);
        publish_for(s, PROTOCOL_JPEG, number, &t);
        expect_fate(&p, number, "used");
        assert_int_equal(client_picture(&r, &h, CLIENT_WAIT_MS), number / 2 - 2);
        store(&r, number / 2 - 2);
        assert_int_equal(credit_comes(&p), 1);
    }
    for (uint64_t number = 4; number <= 8; number++) { /* 4 and 7 were never sent */
        frame_send(&p, number);
        json_t *fate = client_await(&p, "frame");
        assert_non_null(fate);
        assert_int_equal(json_integer_value(json_object_get(fate, "number")), number);
        const char *clause = json_string_value(json_object_get(fate, "clause"));
        const char *want = number == 5 ? "7.10" : number % 2 == 0 && number > 4 ? "used" : "5.8";
        assert_string_equal(clause ? clause : json_string_value(json_object_get(fate, "fate")), want);
        if (!clause)
            assert_int_equal(json_integer_value(json_object_get(fate, "sequence")), number / 2 - 2);
        json_decref(fate);
        assert_int_equal(credit_comes(&p), 1);
    }
    refuse_frames(&p, s, 9, 9 + INGEST_FATES - 1); /* after so many, 8 is forgotten */
    frame_send(&p, 8);
    json_t *fate = client_await(&p, "frame");
    assert_non_null(fate);
    assert_string_equal(json_string_value(json_object_get(fate, "clause")), "5.8");
    json_decref(fate);
    client_shut(&p);
    client_shut(&r);
    frame_finish(&f);
    server_destroy(s);
}

static void a_second_producer_takes_over_and_a_second_recorder_waits(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client p[2], r[2], other;
    int64_t after;

    record(&r[0], s, "a", "jpeg");
    assert_int_equal(produce_lockstep(&p[0], s, "a", &after), 1);
    assert_int_equal(produce_lockstep(&p[1], s, "a", &after), 1);
    assert_int_equal(client_close_code(&p[0]), 4011);
    client_open(&r[1], s);
    assert_int_equal(client_handshake(&r[1], NULL), 101);
    client_say(&r[1], "{\"op\":\"hello\",\"role\":\"recorder\",\"version\":{\"major\":1},\"recorder\":\"a\"}");
    assert_int_equal(client_close_code(&r[1]), 4012);
    client_shut(&r[1]);
    client_shut(&r[0]);
    record(&r[1], s, "a", "jpeg"); /* the name is free for its address as soon as the connection has ended */
    client_open(&other, s);
    assert_int_equal(client_handshake(&other, NULL), 101);
    client_say(&other, "{\"op\":\"hello\",\"role\":\"producer\",\"version\":{\"major\":1},\"pace\":\"lockstep\","
                       "\"sequence\":\"b\"}");
    assert_int_equal(client_close_code(&other), 4012);
    client_shut(&other);
    client_shut(&p[0]);
    frame_send(&p[1], 1);
    COUNTER_BECOMES(s, frames_received, 1);
    client_shut(&p[1]);
    client_shut(&r[1]);
    server_destroy(s);
}

static void the_end_is_told_when_all_is_stored(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client p, r;
    struct server_ticket t;
    struct frame f = { 0 };
    struct protocol_picture h = { 0 };
    int64_t after;

    record(&r, s, "a", "jpeg");
    produce_lockstep(&p, s, "a", &after);
    frame_send(&p, 1);
    client_say(&p, "{\"op\":\"end\"}");
    take(s, &f, &t, 1);
    publish_for(s, PROTOCOL_JPEG, 1, &t);
    assert_int_equal(client_picture(&r, &h, CLIENT_WAIT_MS), 1);
    assert_true(nothing_comes(&r, "sequence", 200));
    store(&r, 1);
    for (int i = 0; i < 2; i++) { /* again to who has been away */
        json_t *m = client_await(&r, "sequence");
        assert_non_null(m);
        assert_string_equal(json_string_value(json_object_get(m, "name")), "a");
        assert_string_equal(json_string_value(json_object_get(m, "state")), "ended");
        assert_int_equal(json_integer_value(json_object_get(m, "stored")), 1);
        json_decref(m);
        client_shut(&r);
        record(&r, s, "a", "jpeg");
    }
    client_shut(&r);
    client_shut(&p);
    COUNTER_BECOMES(s, open, 0);
    assert_int_equal(produce_lockstep(&p, s, "a", &after), 1); /* also without a recorder it knows that all is done */
    client_shut(&p);
    frame_finish(&f);
    server_destroy(s);
}

static void the_format_stands_while_a_frame_is_under_way(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client p, r;
    struct server_ticket t;
    struct frame f = { 0 };
    struct protocol_picture h = { 0 };
    int64_t after;

    record(&r, s, "a", "jpeg");
    client_say(&r, "{\"op\":\"subscribe\",\"format\":\"exr_float\"}"); /* nothing is under way yet */
    client_expect(&r, "subscribed");
    produce_lockstep(&p, s, "a", &after);
    frame_send(&p, 1);
    take(s, &f, &t, 1);
    client_say(&r, "{\"op\":\"subscribe\",\"format\":\"jpeg\"}");
    json_t *error = client_await(&r, "error");
    assert_non_null(error);
    assert_string_equal(json_string_value(json_object_get(error, "clause")), "4.3.6");
    assert_true(json_is_false(json_object_get(error, "fatal")));
    json_decref(error);
    publish_for(s, PROTOCOL_EXR_FLOAT, 1, &t);
    assert_int_equal(client_picture(&r, &h, CLIENT_WAIT_MS), 1);
    assert_int_equal(h.format, PROTOCOL_EXR_FLOAT);
    store(&r, 1);
    assert_int_equal(credit_comes(&p), 1);
    client_say(&r, "{\"op\":\"subscribe\",\"format\":\"jpeg\"}");
    client_expect(&r, "subscribed");
    client_shut(&r);
    client_shut(&p);
    frame_finish(&f);
    server_destroy(s);
}

static void a_live_frame_never_overtakes_one_in_lockstep(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client live, p, r;
    struct server_ticket t;
    struct frame f = { 0 };
    int64_t after;

    produce_live(&live, s);
    frame_send(&live, 100);
    COUNTER_BECOMES(s, frames_received, 1);
    client_shut(&live);
    COUNTER_BECOMES(s, open, 0);
    record(&r, s, "a", "jpeg");
    assert_int_equal(produce_lockstep(&p, s, "a", &after), 1);
    frame_send(&p, 1);
    COUNTER_BECOMES(s, frames_received, 2);
    take(s, &f, &t, 1);
    struct server_ticket none;
    assert_false(server_take_frame(s, &f, &none, true, 50));
    publish_for(s, PROTOCOL_JPEG, 1, &t);
    take(s, &f, &none, 100);
    assert_false(none.lockstep);
    client_shut(&r);
    client_shut(&p);
    frame_finish(&f);
    server_destroy(s);
}

static void another_sequence_waits_until_the_frame_under_way_has_its_image(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client a, b, ra, rb;
    struct server_ticket t;
    struct frame f = { 0 };
    int64_t after;

    record(&ra, s, "a", "jpeg");
    record(&rb, s, "b", "exr_half");
    assert_int_equal(produce_lockstep(&a, s, "a", &after), 1);
    frame_send(&a, 1);
    COUNTER_BECOMES(s, frames_received, 1);
    client_shut(&a);
    COUNTER_BECOMES(s, open, 2);
    assert_int_equal(produce_lockstep(&b, s, "b", &after), 0); /* one waits to be taken */
    take(s, &f, &t, 1);
    assert_true(nothing_comes(&b, "credit", 200)); /* and is worked on */
    struct server_demand demand;
    server_demand(s, &demand);
    assert_int_equal(demand.recorder_format, PROTOCOL_JPEG); /* its own, not that of the producer there is */
    publish_for(s, PROTOCOL_JPEG, 1, &t);
    assert_int_equal(credit_comes(&b), 1);
    client_shut(&b);
    client_shut(&ra);
    client_shut(&rb);
    frame_finish(&f);
    server_destroy(s);
}

static void sixteen_names_are_remembered(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client p, r[17];
    struct server_ticket t;
    struct frame f = { 0 };
    char name[20];
    int64_t after;

    for (int i = 0; i < 40; i++) { /* names that are done with make way */
        snprintf(name, sizeof(name), "n%d", i);
        record(&r[0], s, name, "jpeg");
        client_shut(&r[0]);
        COUNTER_BECOMES(s, open, 0);
    }
    for (int i = 0; i < 16; i++) {
        snprintf(name, sizeof(name), "m%d", i);
        record(&r[i], s, name, "jpeg");
    }
    client_open(&r[16], s);
    assert_int_equal(client_handshake(&r[16], NULL), 101);
    client_say(&r[16],
               "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1},\"recorder\":\"one.too.many\"}");
    assert_int_equal(client_close_code(&r[16]), 4012);
    client_shut(&r[16]);
    /* One that still owes an image does not make way, though nobody is there. */
    assert_int_equal(produce_lockstep(&p, s, "m0", &after), 1);
    frame_send(&p, 1);
    take(s, &f, &t, 1);
    publish_for(s, PROTOCOL_JPEG, 1, &t);
    expect_fate(&p, 1, "used");
    client_shut(&p);
    for (int i = 0; i < 16; i++)
        client_shut(&r[i]);
    COUNTER_BECOMES(s, open, 0);
    for (int i = 0; i < 40; i++) {
        snprintf(name, sizeof(name), "o%d", i);
        record(&r[0], s, name, "jpeg");
        client_shut(&r[0]);
        COUNTER_BECOMES(s, open, 0);
    }
    for (int i = 1; i < 16; i++) { /* nor do sixteen of them */
        snprintf(name, sizeof(name), "k%d", i);
        record(&r[0], s, name, "jpeg");
        assert_int_equal(produce_lockstep(&p, s, name, &after), 1);
        frame_send(&p, 1);
        take(s, &f, &t, 1);
        publish_for(s, PROTOCOL_JPEG, 1, &t);
        expect_fate(&p, 1, "used");
        client_shut(&p);
        client_shut(&r[0]);
        COUNTER_BECOMES(s, open, 0);
    }
    client_open(&r[0], s);
    assert_int_equal(client_handshake(&r[0], NULL), 101);
    client_say(&r[0], "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1},\"recorder\":\"one.too.many\"}");
    assert_int_equal(client_close_code(&r[0]), 4012);
    client_shut(&r[0]);
    struct protocol_picture h;
    for (int i = 0; i < 16; i++) {
        snprintf(name, sizeof(name), i ? "k%d" : "m%d", i);
        record(&r[0], s, name, "jpeg");
        assert_true(client_picture(&r[0], &h, CLIENT_WAIT_MS) > 0);
        client_shut(&r[0]);
    }
    frame_finish(&f);
    server_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_producer_has_no_credit_before_a_recorder_has_come),
    cmocka_unit_test(credit_returns_when_the_image_is_stored_and_not_before),
    cmocka_unit_test(a_recorder_must_say_that_it_has_stored),
    cmocka_unit_test(an_image_comes_again_until_it_is_stored),
    cmocka_unit_test(a_producer_goes_on_after_what_was_accepted),
    cmocka_unit_test(a_refused_frame_returns_its_credit_and_is_remembered),
    cmocka_unit_test(late_frames_are_told_their_own_fate),
    cmocka_unit_test(a_second_producer_takes_over_and_a_second_recorder_waits),
    cmocka_unit_test(the_end_is_told_when_all_is_stored),
    cmocka_unit_test(the_format_stands_while_a_frame_is_under_way),
    cmocka_unit_test(a_live_frame_never_overtakes_one_in_lockstep),
    cmocka_unit_test(another_sequence_waits_until_the_frame_under_way_has_its_image),
    cmocka_unit_test(sixteen_names_are_remembered),
};
UNIT_MAIN(tests)
