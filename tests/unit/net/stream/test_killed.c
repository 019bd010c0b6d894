/* PROTOCOL.md 5.10: a lockstep sequence whose producer and recorder are both killed at random, again and again. */
#include "net/stream/producing.h"

#include <pthread.h>
#include <stdatomic.h>

enum { FRAMES = 120 };

struct play {
    struct server *s;
    atomic_bool over;
    unsigned seed;
    int files[FRAMES + 2]; /* how often the image of each frame was stored, in the recorder's "folder" */
    int stored_last;       /* as the recorder knows across its lives: nothing but its folder */
    atomic_int deaths;
};

static unsigned dice(unsigned *seed, unsigned sides)
{
    *seed = *seed * 1664525u + 1013904223u;
    return (*seed >> 16) % sides;
}

/* The renderer: takes, sometimes slowly, and publishes. */
static void *render(void *arg)
{
    struct play *play = arg;
    struct frame f = { 0 };
    struct server_ticket t;

    while (!atomic_load(&play->over)) {
        if (!server_take_frame(play->s, &f, &t, true, 20))
            continue;
        assert_true(f.rgb[0] == (float)f.number);
        if (f.number % 7 == 0)
            sleep_ms(3);
        publish_for(play->s, PROTOCOL_JPEG, f.number, &t);
        publish_for(play->s, PROTOCOL_EXR_FLOAT, f.number, &t);
    }
    frame_finish(&f);
    return NULL;
}

/* Connects, feeds from where the server says, and dies at some message or in the middle of a frame; until all is sent
 * and the credit is back. */
static void *feed(void *arg)
{
    struct play *play = arg;
    unsigned seed = play->seed;

    for (bool done = false; !done;) {
        struct test_client c;
        int64_t after;
        int credit = produce_lockstep(&c, play->s, "play", &after);
        uint64_t next = after < 0 ? 1 : (uint64_t)after + 1;
        for (;;) {
            const bool dies = dice(&seed, 12) == 0;
            if (credit > 0 && next > FRAMES) {
                client_say(&c, "{\"op\":\"end\"}");
                done = true;
            } else if (credit > 0) {
                uint8_t bytes[FRAME_SIZE];
                frame_make(next, bytes);
                client_frame(&c, OP_BINARY, !dies, bytes, dies ? dice(&seed, FRAME_SIZE) : FRAME_SIZE);
                next++;
                credit--;
            }
            if (done || dies)
                break;
            const int got = client_next(&c, 100);
            if (got == OP_TEXT && strstr((char *)c.message, "\"op\":\"credit\""))
                credit++;
        }
        if (done)
            client_next(&c, 200);
        client_shut(&c);
        atomic_fetch_add(&play->deaths, 1);
    }
    return NULL;
}

/* Stores, and dies before the store, between store and ack, or after. */
static void *keep(void *arg)
{
    struct play *play = arg;
    unsigned seed = play->seed + 77;

    for (bool done = false; !done;) {
        struct test_client c;
        record(&c, play->s, "play", "exr_float");
        for (bool dies = false; !dies && !done;) {
            const int got = client_next(&c, 200);
            if (got == OP_TEXT)
                done = strstr((char *)c.message, "\"op\":\"sequence\"") != NULL;
            if (got != OP_BINARY)
                continue;
            struct protocol_picture h;
            size_t offset;
            assert_int_equal(protocol_picture_decode(c.message, c.size, &h, &offset), PROTOCOL_OK);
            assert_int_equal(h.format, PROTOCOL_EXR_FLOAT);
            const unsigned death = dice(&seed, 30);
            dies = death < 3;
            if (death == 0)
                break;
            /* In order; and again only what it could not acknowledge. */
            assert_true((int)h.frame == play->stored_last + 1 || (int)h.frame == play->stored_last);
            play->files[h.frame] = 1;
            play->stored_last = (int)h.frame;
            if (death != 1)
                store(&c, h.sequence);
        }
        client_shut(&c);
        atomic_fetch_add(&play->deaths, 1);
    }
    return NULL;
}

static void no_frame_is_lost_or_doubled_whoever_is_killed(void **state)
{
    (void)state;
    for (unsigned seed = 1; seed <= 4; seed++) {
        struct play play = { .s = push_server(), .seed = seed };
        struct server_counters counters;
        struct test_client viewer;
        pthread_t renderer, feeder, keeper;

        client_watch(&viewer, play.s); /* never reads: delays nobody */
        assert_int_equal(pthread_create(&renderer, NULL, render, &play), 0);
        assert_int_equal(pthread_create(&keeper, NULL, keep, &play), 0);
        assert_int_equal(pthread_create(&feeder, NULL, feed, &play), 0);
        pthread_join(feeder, NULL);
        pthread_join(keeper, NULL);
        atomic_store(&play.over, true);
        pthread_join(renderer, NULL);
        for (int i = 1; i <= FRAMES; i++)
            if (!play.files[i])
                fail_msg("seed %u: the image of frame %d is missing", seed, i);
        server_counters(play.s, &counters);
        /* Each frame was accepted once and rendered once, in two formats. */
        assert_int_equal(counters.frames_received - counters.frames_repeated, FRAMES);
        assert_int_equal(counters.published, 2 * FRAMES);
        assert_int_equal(counters.frames_refused, 0);
        assert_true(atomic_load(&play.deaths) > 10);
        client_shut(&viewer);
        server_destroy(play.s);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(no_frame_is_lost_or_doubled_whoever_is_killed),
};
UNIT_MAIN(tests)
