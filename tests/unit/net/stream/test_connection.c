/* What one client may take from the others, by their number, by their speed and by their slowness: nothing. */
#include "net/stream/producing.h"

#include <pthread.h>
#include <stdatomic.h>

static void open_from(struct test_client *c, const struct server *s, const char *address)
{
    client_address = address;
    client_open(c, s);
    client_address = "127.0.0.1";
}

/* Shakes hands and says hello with this token: 0, or the close code. */
static int greet(struct test_client *c, const struct handshake *h, const char *token)
{
    char text[400];

    assert_int_equal(client_handshake(c, h), 101);
    snprintf(text, sizeof(text), "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1},\"token\":\"%s\"}",
             token);
    client_say(c, text);
    json_t *welcome = client_await(c, "welcome");
    json_decref(welcome);
    return welcome ? 0 : client_close_code(c);
}

static int greet_from(const struct server *s, const char *address, const char *token)
{
    struct test_client c;

    open_from(&c, s, address);
    const int code = greet(&c, NULL, token);
    client_shut(&c);
    return code;
}

static void one_address_gets_no_more_than_its_share(void **state)
{
    (void)state;
    const struct server_desc desc = { .max_connections = 10, .max_per_address = 3 };
    struct server *s = server_start(&desc);
    struct server_counters counters;
    struct test_client c[3], more;

    for (int i = 0; i < 3; i++) {
        open_from(&c[i], s, "127.0.0.1");
        assert_int_equal(greet(&c[i], NULL, ""), 0);
    }
    open_from(&more, s, "127.0.0.1");
    assert_int_equal(client_handshake(&more, NULL), 101);
    assert_int_equal(client_close_code(&more), 4007);
    assert_non_null(strstr(more.reason, "2.4"));
    client_shut(&more);
    assert_int_equal(greet_from(s, "127.0.0.2", ""), 0);
    server_counters(s, &counters);
    assert_int_equal(counters.crowded, 1);
    /* a place that becomes free can be taken */
    client_shut(&c[0]);
    int code = 1;
    for (int i = 0; i < CLIENT_WAIT_MS / 20 && code; i++, sleep_ms(20))
        code = greet_from(s, "127.0.0.1", "");
    assert_int_equal(code, 0);
    client_shut(&c[1]);
    client_shut(&c[2]);
    server_destroy(s);
}

static void this_machines_own_address_is_spared_unless_a_number_was_said(void **state)
{
    (void)state;
    enum { MANY = 80 };
    struct server *s = server_start(NULL);
    int fd[MANY];

    for (int i = 0; i < MANY; i++) {
        struct test_client c;
        client_greet(&c, s);
        fd[i] = c.fd;
        free(c.in);
        free(c.message);
    }
    for (int i = 0; i < MANY; i++)
        close(fd[i]);
    server_destroy(s);
}

/* Connections that say nothing take no place from another address, are cut, and leave nothing counted behind. */
static void silent_connections_of_one_address_are_turned_away(void **state)
{
    (void)state;
    enum { LIMIT = 2, OTHERS = 16, MANY = 60 };
    const struct server_desc desc = { .max_per_address = LIMIT };
    struct server *s = server_start(&desc);
    struct server_counters counters;

    for (int round = 1; round <= 3; round++) {
        struct test_client c[MANY];
        int cut = 0;
        for (int i = 0; i < MANY; i++)
            open_from(&c[i], s, "127.0.0.3");
        assert_int_equal(greet_from(s, "127.0.0.4", ""), 0);
        for (int i = LIMIT + OTHERS; i < MANY; i++) { /* the ones before have their time to say something */
            struct pollfd p = { .fd = c[i].fd, .events = POLLIN };
            cut += poll(&p, 1, CLIENT_WAIT_MS) > 0 && recv(c[i].fd, c[i].in, 1, 0) <= 0;
        }
        assert_int_equal(cut, MANY - LIMIT - OTHERS);
        server_counters(s, &counters);
        assert_true(counters.crowded >= (uint64_t)(round * cut));
        for (int i = 0; i < MANY; i++)
            client_shut(&c[i]);
        /* The server notices one after another that they are gone: until then the address has its share. */
        bool refused = true;
        for (int i = 0; i < CLIENT_WAIT_MS / 20 && refused; i++, sleep_ms(20)) {
            open_from(&c[0], s, "127.0.0.3");
            struct pollfd p = { .fd = c[0].fd, .events = POLLIN };
            refused = poll(&p, 1, 300) > 0;
            client_shut(&c[0]);
        }
        assert_false(refused);
        for (int i = 0; i < CLIENT_WAIT_MS / 20; i++, sleep_ms(20)) {
            server_counters(s, &counters);
            if (counters.open == 0)
                break;
        }
        assert_int_equal(counters.open, 0);
    }
    server_destroy(s);
}

static void guessing_a_token_ends_for_its_address_alone(void **state)
{
    (void)state;
    const struct server_desc desc = { .tokens = { [SERVER_VIEWER] = "open sesame" } };
    struct server *s = server_start(&desc);
    struct server_counters counters;

    for (int i = 0; i < 20; i++) /* who has no token does not guess */
        assert_int_equal(greet_from(s, "127.0.0.5", ""), 4006);
    for (int i = 0; i < 10; i++)
        assert_int_equal(greet_from(s, "127.0.0.5", i % 2 ? "open" : "sesame"), 4006);
    assert_int_equal(greet_from(s, "127.0.0.5", "again"), 4010);
    assert_int_equal(greet_from(s, "127.0.0.5", "open sesame"), 4010); /* the right one tells nothing either */
    assert_int_equal(greet_from(s, "127.0.0.5", ""), 4006);
    assert_int_equal(greet_from(s, "127.0.0.6", "open sesame"), 0);
    server_counters(s, &counters);
    assert_int_equal(counters.wrong_tokens, 10);
    server_destroy(s);
}

static void behind_a_proxy_addresses_are_those_it_names(void **state)
{
    (void)state;
    const struct server_desc desc = { .max_per_address = 1,
                                      .behind_proxy = true,
                                      .tokens = { [SERVER_VIEWER] = "open sesame" } };
    const struct handshake one = { .extra = "X-Forwarded-For: 198.51.100.2, 203.0.113.9\r\n" };
    const struct handshake other = { .extra = "X-Forwarded-For: 203.0.113.9, 203.0.113.10\r\n" };
    const struct handshake nonsense = { .extra = "X-Forwarded-For: somebody\r\n" };
    struct server *s = server_start(&desc);
    struct test_client first, second, third;

    client_open(&first, s);
    assert_int_equal(greet(&first, &one, "open sesame"), 0);
    client_open(&second, s);
    assert_int_equal(client_handshake(&second, &one), 101);
    assert_int_equal(client_close_code(&second), 4007);
    client_shut(&second);
    client_open(&second, s);
    assert_int_equal(greet(&second, &other, "open sesame"), 0);
    client_open(&third, s);
    assert_int_equal(client_handshake(&third, &nonsense), 400);
    client_shut(&third);
    client_shut(&first);
    client_shut(&second);
    for (int i = 0; i <= 10; i++) { /* guesses too */
        int code = 4007;
        for (int k = 0; k < 100 && code == 4007; k++) { /* until the place of the one before is free */
            client_open(&third, s);
            code = greet(&third, &one, "sesame");
            client_shut(&third);
        }
        assert_int_equal(code, i < 10 ? 4006 : 4010);
    }
    client_open(&second, s);
    assert_int_equal(greet(&second, &other, "open sesame"), 0);
    client_shut(&second);
    server_destroy(s);
}

static void nobody_else_is_believed_who_he_is(void **state)
{
    (void)state;
    const struct server_desc desc = { .max_per_address = 1 };
    const struct handshake one = { .extra = "X-Forwarded-For: 203.0.113.9\r\n" };
    const struct handshake other = { .extra = "X-Forwarded-For: 203.0.113.10\r\n" };
    struct server *s = server_start(&desc);
    struct test_client first, second;

    client_open(&first, s);
    assert_int_equal(greet(&first, &one, ""), 0);
    client_open(&second, s);
    assert_int_equal(client_handshake(&second, &other), 101);
    assert_int_equal(client_close_code(&second), 4007);
    client_shut(&first);
    client_shut(&second);
    server_destroy(s);
}

static atomic_bool flooding;
static atomic_int floods;

/* Ten thousand control messages in one go, again and again from new connections. */
static void *flood(void *arg)
{
    const struct server *s = arg;
    static const char word[] = "{\"op\":\"control\",\"scale_stops\":1}";

    while (atomic_load(&flooding)) {
        struct test_client c;
        client_open(&c, s);
        if (client_handshake(&c, NULL) == 101) {
            client_say(&c, "{\"op\":\"hello\",\"role\":\"controller\",\"version\":{\"major\":1}}");
            for (int i = 0; i < 10000; i++)
                client_frame(&c, OP_TEXT, true, word, sizeof(word) - 1);
            atomic_fetch_add(&floods, client_close_code(&c) != 0);
        }
        client_shut(&c);
    }
    return NULL;
}

static void ten_thousand_control_messages_cost_their_sender_only(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct server_counters counters;
    struct protocol_picture h;
    struct test_client watching;
    pthread_t flooder;

    client_watch(&watching, s);
    atomic_store(&flooding, true);
    assert_int_equal(pthread_create(&flooder, NULL, flood, s), 0);
    for (uint64_t n = 1; n <= 50; n++) { /* each image arrives before the next is made: none is late or left out */
        publish(s, n, 20000);
        assert_int_equal(client_picture(&watching, &h, CLIENT_WAIT_MS), n);
        client_ack(&watching, n);
        sleep_ms(10);
    }
    atomic_store(&flooding, false);
    pthread_join(flooder, NULL);
    server_counters(s, &counters);
    assert_true(floods >= 1);
    assert_int_equal(counters.too_fast, floods);
    struct server_control asked;
    int changes = 0;
    while (server_take_control(s, &asked)) /* what came before the limit is one change for each who asked */
        changes++;
    assert_true(changes <= floods);
    client_shut(&watching);
    server_destroy(s);
}

static void who_gives_no_sign_of_life_is_given_up(void **state)
{
    (void)state;
    const struct server_desc desc = { .silent_s = 3 };
    struct server *s = server_start(&desc);
    struct server_counters counters = { .open = 2 };
    struct test_client silent, alive;

    client_greet(&silent, s); /* it never answers a ping */
    client_greet(&alive, s);
    for (int i = 0; i < CLIENT_WAIT_MS / 100 && counters.open > 1; i++) {
        client_say(&alive, "{\"op\":\"ping\",\"id\":1}");
        client_expect(&alive, "pong");
        sleep_ms(100);
        server_counters(s, &counters);
    }
    assert_int_equal(counters.open, 1);
    client_say(&alive, "{\"op\":\"ping\",\"id\":2}");
    client_expect(&alive, "pong");
    client_shut(&silent);
    client_shut(&alive);
    server_destroy(s);
}

/* Whoever does not get to a request in time is cut, however busy he looks. */
static void who_never_finishes_a_request_is_cut(void **state)
{
    (void)state;
    static const char line[] =
        "GET / HTTP/1.1\r\nHost: localhost\r\nX-Slow: aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa";
    struct server *s = server_start(NULL);
    struct test_client silent, slow;
    bool silent_cut = false, slow_cut = false;

    client_open(&silent, s);
    client_open(&slow, s);
    for (size_t i = 0; i < sizeof(line) - 1 && !(silent_cut && slow_cut); i++) {
        struct pollfd p[2] = { { .fd = silent.fd, .events = POLLIN }, { .fd = slow.fd, .events = POLLIN } };
        if (!slow_cut)
            client_write(&slow, line + i, 1);
        poll(p, 2, 0);
        silent_cut = silent_cut || (p[0].revents && recv(silent.fd, silent.in, 1, 0) <= 0);
        slow_cut = slow_cut || (p[1].revents && recv(slow.fd, slow.in, 1, 0) <= 0);
        sleep_ms(150);
    }
    assert_true(silent_cut);
    assert_true(slow_cut);
    client_shut(&silent);
    client_shut(&slow);
    client_greet(&slow, s); /* and others are served */
    client_shut(&slow);
    server_destroy(s);
}

static void a_token_that_cannot_be_one_is_refused_without_being_said(void **state)
{
    (void)state;
    char long_one[300];
    struct server *s = NULL;
    struct reason why;

    memset(long_one, 's', sizeof(long_one));
    long_one[256] = 0;
    const char *const bad[] = { "", long_one };
    for (size_t i = 0; i < 2; i++) {
        const struct server_desc desc = { .push = true, .tokens = { [SERVER_PRODUCER] = bad[i] } };
        assert_int_equal(server_create(&desc, &s, &why), ERR_USAGE);
        assert_non_null(strstr(why.text, "--token-producer"));
        assert_null(strstr(why.text, "sss"));
    }
}

static void other_names_are_answered_to_where_they_were_said(void **state)
{
    (void)state;
    const struct server_desc desc = { .public_names = "relight.example,other.example" };
    static const struct handshake good[] = {
        { .host = "relight.example", .origin = "https://relight.example" },
        { .host = "Other.Example:8443", .origin = "https://other.example:8443" },
        { .host = "localhost:80" },
    };
    static const struct handshake bad[] = {
        { .host = "relight.example.evil.example" },
        { .host = "example" },
        { .host = "relight.example,other.example" },
        { .host = "relight.example", .origin = "https://evil.example" },
        { .host = "127.evil.example" }, /* which begins as this machine's own */
        { .host = "127.0.0.1.evil.example" },
    };
    struct server *s = server_start(&desc);
    struct test_client c;

    for (size_t i = 0; i < sizeof(good) / sizeof(good[0]); i++) {
        client_open(&c, s);
        assert_int_equal(client_handshake(&c, &good[i]), 101);
        client_shut(&c);
    }
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        client_open(&c, s);
        assert_int_equal(client_handshake(&c, &bad[i]), 403);
        client_shut(&c);
    }
    server_destroy(s);
}

/* What one frame of 21 to 31 MB has taken, as bytes of a file and as raw texels, is not kept for small ones. */
static void memory_of_a_large_frame_goes_back_after_small_ones(void **state)
{
    static const enum protocol_encoding kinds[] = { PROTOCOL_FILE_HDR, PROTOCOL_RAW_FLOAT, PROTOCOL_RAW_HALF };
    const struct server_desc desc = { .push = true, .max_frame_bytes = 32 << 20 };
    const uint32_t width = 2048, height = 1280; /* halves too are more than what may always be kept */
    struct server *s = server_start(&desc);
    uint8_t *bytes = calloc(12, (size_t)width * height);
    struct frame f = { 0 };
    struct server_ticket t;
    struct test_client c;
    uint64_t number = 0;

    (void)state;
    assert_non_null(bytes);
    memcpy(bytes, "#?", 2);
    produce_live(&c, s);
    for (size_t k = 0; k < sizeof(kinds) / sizeof(kinds[0]); k++) {
        struct protocol_environment e = { .encoding = kinds[k], .payload = 12 * width * height, .frame = ++number };
        if (kinds[k] != PROTOCOL_FILE_HDR) {
            e.channels = kinds[k] == PROTOCOL_RAW_HALF ? 4 : 3;
            e.width = width;
            e.height = height;
            e.payload = kinds[k] == PROTOCOL_RAW_HALF ? 8 * width * height : e.payload;
        }
        payload_send(&c, e, bytes);
        take(s, &f, &t, number);
        assert_int_equal(credit_comes(&c), 1);
        assert_true(f.bytes_capacity + sizeof(float) * f.rgb_capacity >= 12 * width * height);
        for (int i = 0; i < 4 * RECENT_FRAMES; i++) {
            payload_send(&c, (struct protocol_environment){ PROTOCOL_FILE_HDR, .payload = 100, .frame = ++number },
                         bytes);
            take(s, &f, &t, number);
            assert_int_equal(credit_comes(&c), 1);
            if (i >= 3 * RECENT_FRAMES)
                assert_true(f.bytes_capacity + sizeof(float) * f.rgb_capacity < 1 << 20);
        }
    }
    client_shut(&c);
    free(bytes);
    frame_finish(&f);
    server_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(one_address_gets_no_more_than_its_share),
    cmocka_unit_test(this_machines_own_address_is_spared_unless_a_number_was_said),
    cmocka_unit_test(silent_connections_of_one_address_are_turned_away),
    cmocka_unit_test(guessing_a_token_ends_for_its_address_alone),
    cmocka_unit_test(behind_a_proxy_addresses_are_those_it_names),
    cmocka_unit_test(nobody_else_is_believed_who_he_is),
    cmocka_unit_test(ten_thousand_control_messages_cost_their_sender_only),
    cmocka_unit_test(who_gives_no_sign_of_life_is_given_up),
    cmocka_unit_test(who_never_finishes_a_request_is_cut),
    cmocka_unit_test(memory_of_a_large_frame_goes_back_after_small_ones),
    cmocka_unit_test(a_token_that_cannot_be_one_is_refused_without_being_said),
    cmocka_unit_test(other_names_are_answered_to_where_they_were_said),
};
UNIT_MAIN(tests)
