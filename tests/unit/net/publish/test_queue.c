#include "net/publish/queue.h"

#include "net/stream/server.h"
#include "support/unit.h"

#include <time.h>

/* The payload of image n is `size` bytes; its time is n. */
static void push(struct publish_queue *q, int n, bool key, size_t size)
{
    static const uint8_t bytes[PUBLISH_QUEUE_BYTES];
    const struct protocol_picture header = { .format = PROTOCOL_H264 };
    struct sent_image *p = image_create(&header, bytes, size);

    assert_non_null(p);
    publish_queue_push(q, &(struct publish_entry){ p, n, key });
    image_unref(p); /* the queue has a reference of its own */
}

/* The number of the next image; -1: none. */
static int take(struct publish_queue *q, bool *key)
{
    struct publish_entry e;

    if (!publish_queue_take(q, &e, 0))
        return -1;
    image_unref(e.image);
    *key = e.key;
    return (int)e.time_us;
}

static struct publish_queue *begin(struct publish_queue *q)
{
    memset(q, 0, sizeof(*q));
    publish_queue_init(q);
    publish_queue_open(q, true);
    return q;
}

/* Takes all: each follows the one before, or is a key image. Returns how many there were. */
static int drain(struct publish_queue *q, int *last)
{
    int count = 0, n;
    bool key;

    for (; (n = take(q, &key)) >= 0; count++) {
        if (n != *last + 1 && !key)
            fail_msg("picture %d follows %d and is no key picture", n, *last);
        *last = n;
    }
    return count;
}

static void nothing_is_taken_before_a_key_image(void **state)
{
    static struct publish_queue q;
    bool key, wants_key;
    (void)state;

    begin(&q);
    assert_true(publish_queue_wants(&q, &wants_key) && wants_key);
    push(&q, 0, false, 10);
    assert_int_equal(take(&q, &key), -1);
    push(&q, 1, true, 10);
    assert_true(publish_queue_wants(&q, &wants_key) && !wants_key);
    push(&q, 2, false, 10);
    assert_int_equal(take(&q, &key), 1);
    assert_int_equal(take(&q, &key), 2);
    assert_int_equal(publish_queue_dropped(&q), 0);
    publish_queue_finish(&q);
}

static void full_queue_drops_up_to_the_next_key_image(void **state)
{
    static struct publish_queue q;
    const int keys = 50; /* a key image every so many */
    int last = -1;
    (void)state;

    begin(&q);
    for (int n = 0; n <= PUBLISH_QUEUE; n++)
        push(&q, n, n % keys == 0, 10);
    assert_int_equal(publish_queue_dropped(&q), keys);
    assert_int_equal(q.entries[q.first].time_us, keys);
    assert_int_equal(drain(&q, &last), PUBLISH_QUEUE + 1 - keys);
    assert_int_equal(last, PUBLISH_QUEUE); /* the newest is there */
    publish_queue_finish(&q);
}

static void without_a_key_image_all_is_dropped_until_one_comes(void **state)
{
    static struct publish_queue q;
    bool key, wants_key;
    int last = -1;
    (void)state;

    begin(&q);
    for (int n = 0; n <= PUBLISH_QUEUE; n++)
        push(&q, n, n == 0, 10);
    assert_int_equal(publish_queue_dropped(&q), PUBLISH_QUEUE + 1);
    assert_true(publish_queue_wants(&q, &wants_key) && wants_key);
    assert_int_equal(take(&q, &key), -1);
    push(&q, 1000, false, 10);
    assert_int_equal(publish_queue_dropped(&q), PUBLISH_QUEUE + 2);
    push(&q, 1001, true, 10);
    push(&q, 1002, false, 10);
    assert_int_equal(drain(&q, &last), 2);
    assert_int_equal(publish_queue_dropped(&q), PUBLISH_QUEUE + 2);
    publish_queue_finish(&q);
}

static void bytes_are_bounded_but_one_large_image_is_taken(void **state)
{
    static struct publish_queue q;
    const size_t third = PUBLISH_QUEUE_BYTES / 3;
    int last = -1;
    (void)state;

    begin(&q);
    push(&q, 0, true, PUBLISH_QUEUE_BYTES);
    assert_int_equal(drain(&q, &last), 1);
    push(&q, 1, true, third);
    push(&q, 2, true, third);
    push(&q, 3, false, third); /* with its header beyond the bound */
    assert_int_equal(publish_queue_dropped(&q), 1);
    assert_true(q.bytes <= PUBLISH_QUEUE_BYTES);
    assert_int_equal(drain(&q, &last), 2);
    assert_int_equal(q.bytes, 0);
    publish_queue_finish(&q);
}

/* Readers and writers at any pace: nothing that comes out lacks what it needs, and all is counted. */
static void any_order_of_pushes_and_takes_keeps_chains_whole(void **state)
{
    static struct publish_queue q;
    uint64_t r = 1, taken = 0;
    int last = -1, next = 0, n;
    bool key;
    (void)state;

    begin(&q);
    for (int turn = 0; turn < 3000; turn++) {
        r = r * 6364136223846793005u + 1442695040888963407u;
        const bool writes = turn / 300 % 2 == 0; /* in turns, the one or the other is faster */
        for (unsigned k = 0; k < (r >> 33) % (writes ? 9 : 3); k++, next++)
            push(&q, next, (r >> 40) % 40 == k || next == 0, 1 + (r >> 50));
        for (unsigned k = 0; k < (r >> 36) % (writes ? 3 : 9) && (n = take(&q, &key)) >= 0; k++, taken++) {
            if (n != last + 1 && !key)
                fail_msg("picture %d follows %d and is no key picture", n, last);
            last = n;
        }
    }
    taken += (uint64_t)drain(&q, &last);
    assert_true(publish_queue_dropped(&q) > 0);
    assert_int_equal(taken + publish_queue_dropped(&q), next);
    publish_queue_finish(&q);
}

static void closed_queue_wakes_its_reader_and_takes_nothing(void **state)
{
    static struct publish_queue q;
    bool key;
    (void)state;

    begin(&q);
    push(&q, 0, true, 10);
    assert_false(publish_queue_wait_closed(&q, 0));
    publish_queue_close(&q);
    assert_true(publish_queue_wait_closed(&q, 60000)); /* at once */
    assert_int_equal(take(&q, &key), -1);
    assert_false(publish_queue_wants(&q, &key));
    push(&q, 1, true, 10);
    assert_int_equal(q.count, 1);
    publish_queue_finish(&q); /* frees what it holds, as the leak checker sees */
}

static void stopped_queue_holds_nothing(void **state)
{
    static struct publish_queue q;
    bool key;
    (void)state;

    begin(&q);
    push(&q, 0, true, 10);
    publish_queue_open(&q, false);
    assert_false(publish_queue_wants(&q, &key));
    push(&q, 1, true, 10);
    assert_int_equal(take(&q, &key), -1);
    publish_queue_open(&q, true);
    push(&q, 2, false, 10); /* a new reader starts at a key image */
    assert_int_equal(take(&q, &key), -1);
    assert_int_equal(publish_queue_dropped(&q), 0);
    publish_queue_finish(&q);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(nothing_is_taken_before_a_key_image),
    cmocka_unit_test(full_queue_drops_up_to_the_next_key_image),
    cmocka_unit_test(without_a_key_image_all_is_dropped_until_one_comes),
    cmocka_unit_test(bytes_are_bounded_but_one_large_image_is_taken),
    cmocka_unit_test(any_order_of_pushes_and_takes_keeps_chains_whole),
    cmocka_unit_test(closed_queue_wakes_its_reader_and_takes_nothing),
    cmocka_unit_test(stopped_queue_holds_nothing),
};
UNIT_MAIN(tests)
