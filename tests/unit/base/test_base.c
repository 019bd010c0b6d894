/* Pseudo-terminals are X/Open's, beyond POSIX. */
#define _XOPEN_SOURCE 700

#include "support/unit.h"

#include "base/clock.h"
#include "base/err.h"
#include "base/handoff.h"
#include "base/mem.h"
#include "base/precedence.h"
#include "base/progress.h"

#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <unistd.h>

/* ---- Memory ---- */

static void memory_is_aligned_and_zero(void **state)
{
    (void)state;
    for (size_t n = 0; n < 300; n++) {
        uint8_t *p = mem_alloc(n, 3);
        assert_non_null(p);
        assert_int_equal((uintptr_t)p % MEM_ALIGN, 0);
        for (size_t i = 0; i < 3 * n; i++)
            assert_int_equal(p[i], 0);
        memset(p, 0xff, 3 * n); /* the next one may get this block */
        mem_free(p);
    }
    mem_free(NULL);
}

static void a_block_is_outgrown_when_the_last_eight_were_far_smaller(void **state)
{
    const size_t large = (size_t)100 << 20;
    struct recent r = { .next = 0 };

    (void)state;
    recent_add(&r, large);
    for (int i = 0; i < RECENT_FRAMES; i++) {
        assert_false(recent_is_outgrown(&r, large));
        recent_add(&r, large / 4 - 1);
    }
    assert_true(recent_is_outgrown(&r, large));
    assert_false(recent_is_outgrown(&r, large - 4)); /* four times, and no more */
    recent_add(&r, 0);
    assert_true(recent_is_outgrown(&r, large));
    for (int i = 0; i < RECENT_FRAMES; i++)
        recent_add(&r, 0);
    assert_false(recent_is_outgrown(&r, RECENT_KEPT)); /* little may stay */
    assert_true(recent_is_outgrown(&r, RECENT_KEPT + 1));
    recent_add(&r, large);
    assert_false(recent_is_outgrown(&r, large));
}

/* Just below, at and above one large page. */
static void large_blocks_are_zero_and_on_large_pages(void **state)
{
    const size_t page = (size_t)2 << 20, sizes[] = { 0, 100, page - 1, page, page + 1, 3 * page + 17 };
    (void)state;

    for (size_t k = 0; k < sizeof(sizes) / sizeof(sizes[0]); k++)
        for (int again = 0; again < 2; again++) { /* then in memory that has been written */
            uint8_t *p = mem_alloc_large(1, sizes[k]);
            assert_non_null(p);
            assert_int_equal((uintptr_t)p % (sizes[k] < page ? MEM_ALIGN : page), 0);
            for (size_t i = 0; i < sizes[k]; i++)
                assert_true(p[i] == 0);
            memset(p, 0xa5, sizes[k]);
            mem_free(p);
        }
}

static void sizes_that_overflow_are_refused(void **state)
{
    (void)state;
    assert_null(mem_alloc(SIZE_MAX, 1));
    assert_null(mem_alloc(SIZE_MAX - MEM_ALIGN + 1, 1));
    assert_null(mem_alloc(SIZE_MAX / 2 + 1, 2));
    assert_null(mem_alloc(2, SIZE_MAX / 2 + 1));
    assert_null(mem_alloc((size_t)1 << 32, (size_t)1 << 32));
    assert_null(mem_alloc(SIZE_MAX / 16, 16));
    assert_null(mem_alloc_raw(SIZE_MAX / 16, 16));
    assert_null(mem_alloc_large(SIZE_MAX / 16, 16));
    assert_null(mem_alloc_large(SIZE_MAX, 1));
    assert_null(mem_alloc_large(SIZE_MAX - ((size_t)2 << 20) + 1, 1));
    void *p = mem_alloc(SIZE_MAX, 0); /* no bytes, whatever the count */
    assert_non_null(p);
    mem_free(p);
}

static void growing_keeps_what_was_there(void **state)
{
    int *a = mem_alloc(3, sizeof(int));

    (void)state;
    assert_non_null(a);
    for (int i = 0; i < 3; i++)
        a[i] = i + 1;
    int *b = mem_grow(a, 3, 100, sizeof(int));
    assert_non_null(b);
    for (int i = 0; i < 100; i++)
        assert_int_equal(b[i], i < 3 ? i + 1 : 0);
    assert_null(mem_grow(b, 100, SIZE_MAX / 2, sizeof(int))); /* refused: the old block is untouched */
    assert_int_equal(b[2], 3);
    mem_free(b);
    int *c = mem_grow(NULL, 0, 5, sizeof(int));
    assert_non_null(c);
    assert_int_equal(c[4], 0);
    mem_free(c);
}

/* ---- Errors ---- */

static void reason_is_one_line_that_is_cut_when_too_long(void **state)
{
    struct reason why;
    char text[1000];

    (void)state;
    memset(text, 'x', sizeof(text));
    text[sizeof(text) - 1] = '\0';
    assert_int_equal(err_say(&why, ERR_FORMAT, "%s", text), ERR_FORMAT);
    assert_int_equal(strlen(why.text), sizeof(why.text) - 1);
    assert_int_equal(err_say(NULL, ERR_IO, "nobody listens"), ERR_IO);
    assert_int_equal(err_say(&why, ERR_RANGE, "%d of %s", 3, "four"), ERR_RANGE);
    assert_string_equal(why.text, "3 of four");
}

static void every_code_has_its_own_words(void **state)
{
    (void)state;
    for (int a = ERR_OK; a <= ERR_END; a++) {
        assert_true(strlen(err_text((enum err)a)) > 0);
        for (int b = ERR_OK; b < a; b++)
            assert_string_not_equal(err_text((enum err)a), err_text((enum err)b));
    }
    assert_string_equal(err_text((enum err)99), "unknown error");
    assert_int_equal(err_exit_code(ERR_OK), 0);
    assert_int_equal(err_exit_code(ERR_USAGE), 2);
    assert_int_equal(err_exit_code(ERR_FORMAT), 1);
}

/* ---- Time left ---- */

static void the_time_left_never_rises(void **state)
{
    struct pace p = { .share = 0.0 };
    double left_s;
    (void)state;

    assert_true(pace_take(&p, 0.1, 1.0) == 0.0);
    assert_true(pace_take(&p, 0.12, 3.0) == 0.0); /* too little to tell */
    assert_true(fabs(pace_take(&p, 0.3, 5.0) - 14.0) < 1e-9);
    left_s = pace_take(&p, 0.5, 9.0);
    assert_true(fabs(left_s - 10.0) < 1e-9);
    for (int k = 1; k < 10; k++) /* a tenth of the pace, as on a machine that has got other work */
        assert_true(pace_take(&p, 0.5 + 0.005 * k, 9.0 + k) == left_s);
    assert_true(pace_take(&p, 0.95, 20.0) < left_s);
    assert_true(pace_take(&p, 0.2, 21.0) == 0.0); /* another cache */
    assert_true(fabs(pace_take(&p, 0.3, 28.0) - 49.0) < 1e-9);
}

/* ---- Precedence ---- */

struct long_work {
    struct precedence precedence;
    atomic_bool began, went_on;
};

static void *give_way(void *arg)
{
    struct long_work *w = arg;

    atomic_store(&w->began, true);
    precedence_give_way(&w->precedence);
    atomic_store(&w->went_on, true);
    return NULL;
}

/* Long work waits for urgent work, though no longer than it had run: also if urgent work never ends. */
static void long_work_gives_way_for_a_time(void **state)
{
    static struct long_work w;
    struct precedence *p = &w.precedence;
    pthread_t thread;
    (void)state;

    precedence_give_way(NULL);
    precedence_init(p, 1e6);
    precedence_give_way(p);
    precedence_begin(p);
    assert_true(atomic_load(&p->until_s) > clock_seconds() + 1e5);
    assert_int_equal(pthread_create(&thread, NULL, give_way, &w), 0);
    while (!atomic_load(&w.began))
        nanosleep(&(struct timespec){ .tv_nsec = 100000 }, NULL);
    nanosleep(&(struct timespec){ .tv_nsec = 20000000 }, NULL); /* in which work that does not wait would go on */
    assert_false(atomic_load(&w.went_on));
    precedence_end(p);
    pthread_join(thread, NULL);
    precedence_begin(p); /* at once again: it has run for next to no time */
    precedence_give_way(p);
    precedence_end(p);
}

/* ---- The progress line ---- */

/* Everything that can be read now. */
static size_t read_all(int fd, char *text, size_t size)
{
    size_t at = 0;

    fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK);
    for (ssize_t n = read(fd, text, size - 1); n > 0; n = read(fd, text + at, size - 1 - at))
        at += (size_t)n;
    text[at] = '\0';
    return at;
}

static void work(FILE *stream)
{
    struct progress p;

    progress_begin(&p, "rendering", 3, stream);
    for (int i = 0; i < 5; i++) /* more than announced does no harm */
        progress_step(&p, 1);
    progress_end(&p);
    progress_end(&p);
    progress_begin(&p, "waiting", 0, stream);
    progress_step(&p, 7);
    progress_end(&p);
    fflush(stream);
}

static void progress_is_silent_in_a_pipe(void **state)
{
    int ends[2];
    char text[256];

    (void)state;
    assert_int_equal(pipe(ends), 0);
    FILE *out = fdopen(ends[1], "w");
    assert_non_null(out);
    work(out);
    assert_string_equal(progress_wipe(out), "");
    assert_int_equal(read_all(ends[0], text, sizeof(text)), 0);
    fclose(out);
    close(ends[0]);
    struct progress p;
    progress_begin(&p, "nothing", 1, NULL);
    progress_step(&p, 1);
    progress_end(&p);
    progress_step(NULL, 1);
    progress_end(NULL);
}

static void progress_is_drawn_on_a_terminal_and_wiped(void **state)
{
    char text[4096];
    const int terminal = posix_openpt(O_RDWR | O_NOCTTY);

    (void)state;
    if (terminal < 0 || grantpt(terminal) || unlockpt(terminal))
        skip();
    FILE *out = fopen(ptsname(terminal), "w");
    assert_non_null(out);
    work(out);
    read_all(terminal, text, sizeof(text));
    assert_non_null(strstr(text, "rendering  0/3  0 %"));
    assert_non_null(strstr(text, "waiting  0"));
    assert_string_equal(text + strlen(text) - 4, "\r\033[K");
    struct progress p;
    struct progress_part part;
    progress_begin(&p, "lighting", 4, out);
    progress_step(&p, 1);
    progress_part_begin(&part, &p, 200);
    progress_part_step(&part, 60);
    nanosleep(&(struct timespec){ .tv_nsec = 120000000 }, NULL); /* until it is drawn again */
    progress_part_step(&part, 40);
    progress_part_end(&part);
    progress_part_step(NULL, 1);
    assert_null(p.part);
    progress_end(&p);
    read_all(terminal, text, sizeof(text));
    assert_non_null(strstr(text, "lighting  1/4  37 %")); /* a quarter, and half of the next one */
    progress_begin(&p, "standing", 2, out);
    assert_string_equal(progress_wipe(out), "\r\033[K"); /* another line goes first */
    assert_string_equal(progress_wipe(out), "");         /* once */
    progress_end(&p);
    fclose(out);
    close(terminal);
}

/* ---- Three slots ---- */

static void the_writer_has_what_nobody_holds(void **state)
{
    struct handoff h;

    (void)state;
    handoff_init(&h);
    for (int i = 0; i < HANDOFF_SLOTS; i++)
        assert_true(handoff_is_idle(&h, i));
    handoff_publish(&h, 2);
    assert_false(handoff_is_idle(&h, 2)); /* it may be taken at any time */
    assert_int_equal(handoff_take(&h, 0), 2);
    handoff_publish(&h, 0);
    assert_false(handoff_is_idle(&h, 2));
    assert_false(handoff_is_idle(&h, 0));
    assert_true(handoff_is_idle(&h, 1));
    handoff_release(&h, 2);
    assert_true(handoff_is_idle(&h, 2));
    handoff_finish(&h);
}

static void newest_frame_wins(void **state)
{
    struct handoff h;

    (void)state;
    handoff_init(&h);
    assert_int_equal(handoff_take(&h, 0), HANDOFF_NONE);
    const int a = handoff_begin(&h);
    assert_int_equal(handoff_publish(&h, a), HANDOFF_NONE);
    const int b = handoff_begin(&h);
    assert_int_not_equal(a, b);
    assert_int_equal(handoff_publish(&h, b), a); /* a was dropped */
    assert_false(handoff_wait_taken(&h, 0));
    assert_int_equal(handoff_take(&h, 0), b);
    assert_true(handoff_wait_taken(&h, 0));
    for (int i = 0, before = HANDOFF_NONE; i < 10; i++) { /* while b is being read, the writer never gets it */
        const int slot = handoff_begin(&h);
        assert_int_not_equal(slot, b);
        assert_int_equal(handoff_publish(&h, slot), before);
        before = slot;
    }
    handoff_release(&h, b);
    assert_int_not_equal(handoff_take(&h, 0), HANDOFF_NONE);
    handoff_close(&h);
    assert_true(handoff_is_closed(&h));
    handoff_finish(&h);
}

static void a_slot_taken_early_is_the_readers_next(void **state)
{
    struct handoff h;

    (void)state;
    handoff_init(&h);
    handoff_publish(&h, 0);
    assert_int_equal(handoff_take(&h, 0), 0);
    assert_int_equal(handoff_take_early(&h), HANDOFF_NONE);
    handoff_publish(&h, 1);
    assert_int_equal(handoff_take_early(&h), 1);
    assert_true(handoff_wait_taken(&h, 0));
    handoff_publish(&h, 2); /* newer, and yet not the next */
    assert_int_equal(handoff_begin(&h), 3);
    handoff_release(&h, 0);
    assert_true(handoff_is_idle(&h, 0) && !handoff_is_idle(&h, 1));
    handoff_release(&h, 1);
    assert_int_equal(handoff_take(&h, 0), 2);
    handoff_finish(&h);
}

#define FRAMES 20000

struct relay {
    struct handoff h;
    uint64_t first[HANDOFF_SLOTS], second[HANDOFF_SLOTS]; /* two halves of a frame: they must agree */
};

static void *write_frames(void *arg)
{
    struct relay *r = arg;

    for (uint64_t i = 1; i <= FRAMES; i++) {
        const int slot = handoff_begin(&r->h);
        r->first[slot] = i;
        r->second[slot] = i;
        handoff_publish(&r->h, slot);
    }
    return NULL;
}

static void frames_arrive_whole_and_in_order_between_threads(void **state)
{
    struct relay r = { .first = { 0 } };
    pthread_t writer;
    uint64_t last = 0;

    (void)state;
    handoff_init(&r.h);
    assert_int_equal(pthread_create(&writer, NULL, write_frames, &r), 0);
    while (last < FRAMES) {
        const int slot = handoff_take(&r.h, 5000);
        assert_int_not_equal(slot, HANDOFF_NONE);
        assert_true(r.first[slot] == r.second[slot] && r.first[slot] > last);
        last = r.first[slot];
        handoff_release(&r.h, slot);
    }
    assert_int_equal(pthread_join(writer, NULL), 0);
    handoff_finish(&r.h);
}

static void *close_handoff(void *arg)
{
    handoff_close(arg);
    return NULL;
}

static void closing_wakes_who_waits(void **state)
{
    struct handoff h;
    pthread_t closer;

    (void)state;
    handoff_init(&h);
    assert_int_equal(pthread_create(&closer, NULL, close_handoff, &h), 0);
    assert_int_equal(handoff_take(&h, 600000), HANDOFF_NONE); /* ten minutes, were it not closed */
    assert_false(handoff_wait_taken(&h, 600000));
    assert_int_equal(pthread_join(closer, NULL), 0);
    handoff_finish(&h);
}

static void a_condition_is_waited_for_until_a_time(void **state)
{
    pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
    pthread_cond_t c;
    (void)state;

    clock_condition(&c);
    pthread_mutex_lock(&lock);
    assert_false(clock_wait(&c, &lock, clock_ms()));
    const int64_t until_ms = clock_ms() + 3;
    while (clock_wait(&c, &lock, until_ms)) /* nobody signals, but systems may wake a wait */
        continue;
    assert_true(clock_ms() >= until_ms);
    pthread_mutex_unlock(&lock);
    pthread_cond_destroy(&c);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(the_time_left_never_rises),
    cmocka_unit_test(long_work_gives_way_for_a_time),
    cmocka_unit_test(memory_is_aligned_and_zero),
    cmocka_unit_test(large_blocks_are_zero_and_on_large_pages),
    cmocka_unit_test(sizes_that_overflow_are_refused),
    cmocka_unit_test(growing_keeps_what_was_there),
    cmocka_unit_test(reason_is_one_line_that_is_cut_when_too_long),
    cmocka_unit_test(every_code_has_its_own_words),
    cmocka_unit_test(progress_is_silent_in_a_pipe),
    cmocka_unit_test(progress_is_drawn_on_a_terminal_and_wiped),
    cmocka_unit_test(a_block_is_outgrown_when_the_last_eight_were_far_smaller),
    cmocka_unit_test(the_writer_has_what_nobody_holds),
    cmocka_unit_test(newest_frame_wins),
    cmocka_unit_test(a_slot_taken_early_is_the_readers_next),
    cmocka_unit_test(frames_arrive_whole_and_in_order_between_threads),
    cmocka_unit_test(closing_wakes_who_waits),
    cmocka_unit_test(a_condition_is_waited_for_until_a_time),
};

UNIT_MAIN(tests)
