#include "sky/source/footage.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"

#include <pthread.h>
#include <stdio.h>
#include <time.h>

#define STEP_MS 50         /* how soon the thread notices that an image is wanted */
#define RETRY_FIRST_MS 500 /* doubles up to */
#define RETRY_MOST_MS 10000
#define DRIFT 1e-4               /* by how much a sender's clock may be slower than ours */
#define CLOCKS_APART_US 60000000 /* a sender's clock further from ours is wrong */
#define IMAGELESS_MS 5000        /* then the state reports that there is no frame */

struct live {
    struct footage_desc desc;
    char name[200];
    bool web;                      /* it may turn out to be a recording */
    unsigned tries;                /* of live_start */
    struct footage *footage;       /* thread's */
    struct frame spare;            /* thread's */
    bool held;                     /* thread's: the footage has an image that was not converted */
    int64_t captured_us;           /* thread's: of that image */
    int64_t delay_us, delay_at_us; /* thread's: the least arrival minus time stamp, and when it was last raised */
    bool has_delay;
    atomic_bool stop;
    pthread_t thread;
    bool running;

    pthread_mutex_t lock;
    pthread_cond_t changed;
    struct frame ready;  /* {lock} valid if fresh and error is 0 */
    bool wanted, fresh;  /* {lock} */
    enum err error;      /* {lock} of the conversion */
    struct reason fault; /* {lock} likewise */
    bool connected;      /* {lock} */
    bool recording;      /* {lock} */
    bool gave_up;        /* {lock} for the reason in `fault` */
    struct reason state; /* {lock} */
};

/* ---- The thread ---- */

static void set_state(struct live *l, bool connected, const char *text)
{
    pthread_mutex_lock(&l->lock);
    l->connected = connected;
    snprintf(l->state.text, sizeof(l->state.text), "%s", text);
    pthread_cond_broadcast(&l->changed);
    pthread_mutex_unlock(&l->lock);
}

/* The time at which the packet of that time stamp would have arrived with the least delay seen: the fastest packet
 * gives the best estimate. The estimate may rise slowly, because clocks differ. */
static int64_t arrival_of(struct live *l, int64_t stamp, int64_t now)
{
    const int64_t risen = l->delay_us + (int64_t)(DRIFT * (double)(now - l->delay_at_us));
    const bool began_anew = l->has_delay && now - stamp > risen + CLOCKS_APART_US;

    l->delay_us = !l->has_delay || began_anew || now - stamp < risen ? now - stamp : risen;
    l->delay_at_us = now;
    l->has_delay = true;
    return stamp + l->delay_us;
}

/* When the image that has just been decoded was captured: by the sender's clock if it states it and it is not far
 * from ours, else by arrival. */
static int64_t capture_time(struct live *l)
{
    const int64_t stamp = footage_time_us(l->footage), now = clock_wall_us(),
                  realtime = footage_format(l->footage)->realtime_us;

    if (stamp == VIDEO_NO_TIME || stamp > FRAME_CAPTURE_MAX_US / 4 || stamp < -FRAME_CAPTURE_MAX_US / 4)
        return now;
    const int64_t arrival = arrival_of(l, stamp, now);
    const bool stated = realtime > 0 && realtime < FRAME_CAPTURE_MAX_US / 2;
    return stated && realtime + stamp <= now && realtime + stamp > arrival - CLOCKS_APART_US ? realtime + stamp
                                                                                             : arrival;
}

static bool is_wanted(struct live *l)
{
    pthread_mutex_lock(&l->lock);
    const bool wanted = l->wanted && !l->fresh;
    pthread_mutex_unlock(&l->lock);
    return wanted;
}

static void hand_over(struct live *l)
{
    struct reason why = { "" };
    const enum err e = footage_convert(l->footage, &l->spare, &why);

    l->spare.capture_us = l->captured_us;
    l->held = false;
    pthread_mutex_lock(&l->lock);
    const struct frame before = l->ready;
    l->ready = l->spare;
    l->spare = before;
    l->error = e;
    l->fault = why;
    l->fresh = true;
    pthread_cond_broadcast(&l->changed);
    pthread_mutex_unlock(&l->lock);
}

/* Until the stream breaks off. Returns whether an image came. */
static bool play(struct live *l, struct reason *why)
{
    const int64_t since_ms = clock_ms();
    bool any = false, ready = false, told = false;
    enum err e = ERR_OK;

    l->has_delay = l->held = false;
    while (!atomic_load(&l->stop)) {
        e = footage_next(l->footage, STEP_MS, &ready, why);
        if (e)
            break;
        if (ready) {
            l->held = true;
            l->captured_us = capture_time(l);
        }
        if (ready && !any) {
            set_state(l, true, "");
            any = true;
        }
        if (!any && !told && clock_ms() - since_ms > IMAGELESS_MS) {
            set_state(l, false, "connected, but no frame has been decoded yet (no keyframe)");
            told = true;
        }
        if (l->held && is_wanted(l))
            hand_over(l);
    }
    if (e == ERR_END)
        (void)err_say(why, e, "%s: the stream ended", l->name);
    return any;
}

static void wait_ms(struct live *l, int64_t ms)
{
    for (const int64_t until_ms = clock_ms() + ms; clock_ms() < until_ms && !atomic_load(&l->stop);)
        nanosleep(&(struct timespec){ .tv_nsec = 50000000 }, NULL);
}

static bool leave_recording(struct live *l, bool any)
{
    const bool recording = l->web && !any && footage_format(l->footage)->duration_us > 0;

    pthread_mutex_lock(&l->lock);
    l->recording = recording;
    pthread_mutex_unlock(&l->lock);
    return recording;
}

static void give_up(struct live *l, const struct reason *why)
{
    pthread_mutex_lock(&l->lock);
    (void)err_say(&l->fault, ERR_IO, "%.250s; no frame came in %u attempts", why->text, l->tries);
    l->gave_up = true;
    pthread_cond_broadcast(&l->changed);
    pthread_mutex_unlock(&l->lock);
}

static void *run(void *arg)
{
    struct live *l = arg;
    int64_t retry_ms = RETRY_FIRST_MS;
    bool any = l->footage != NULL;
    unsigned tries = 0;

    while (!atomic_load(&l->stop)) {
        struct reason why = { "" };
        char text[sizeof(why.text)];
        const bool open = l->footage || footage_open(&l->desc, &l->footage, &why) == ERR_OK;
        if (open && leave_recording(l, any))
            break;
        if (open && play(l, &why)) {
            retry_ms = RETRY_FIRST_MS;
            any = true;
        }
        footage_close(l->footage);
        l->footage = NULL;
        if (atomic_load(&l->stop))
            break;
        if (!any && ++tries == l->tries) {
            give_up(l, &why);
            break;
        }
        snprintf(text, sizeof(text), "%.280s; trying again", why.text);
        log_warning("%s in %.1f s", text, (double)retry_ms / 1e3);
        set_state(l, false, text);
        wait_ms(l, retry_ms);
        retry_ms = 2 * retry_ms < RETRY_MOST_MS ? 2 * retry_ms : RETRY_MOST_MS;
    }
    return NULL;
}

/* ---- The consumer ---- */

enum err live_start(const struct footage_desc *desc, struct footage *first, unsigned tries, struct live **out,
                    struct reason *why)
{
    struct live *l = mem_alloc(1, sizeof(*l));
    enum demux_kind kind;

    *out = NULL;
    if (!l)
        return err_say(why, ERR_NOMEM, "out of memory");
    l->desc = *desc;
    l->tries = tries;
    l->desc.stop = &l->stop;
    l->web = demux_kind_of(desc->spec, &kind, why) == ERR_OK && kind == DEMUX_WEB;
    demux_name(desc->spec, l->name, sizeof(l->name));
    snprintf(l->state.text, sizeof(l->state.text), "connecting to %s", l->name);
    pthread_mutex_init(&l->lock, NULL);
    clock_condition(&l->changed);
    l->footage = first;
    l->running = pthread_create(&l->thread, NULL, run, l) == 0;
    if (!l->running) {
        l->footage = NULL;
        live_stop(l);
        return err_say(why, ERR_NOMEM, "cannot start a thread");
    }
    *out = l;
    return ERR_OK;
}

void live_stop(struct live *l)
{
    if (!l)
        return;
    atomic_store(&l->stop, true);
    if (l->running)
        pthread_join(l->thread, NULL);
    footage_close(l->footage);
    frame_finish(&l->spare);
    frame_finish(&l->ready);
    pthread_cond_destroy(&l->changed);
    pthread_mutex_destroy(&l->lock);
    mem_free(l);
}

enum err live_next(struct live *l, int timeout_ms, struct frame *f, struct reason *why)
{
    const int64_t until_ms = clock_ms() + timeout_ms;
    enum err e = ERR_OK;

    f->kind = FRAME_NONE;
    pthread_mutex_lock(&l->lock);
    l->wanted = true;
    while (!l->fresh && !l->gave_up && clock_wait(&l->changed, &l->lock, until_ms))
        continue;
    if (l->fresh) {
        const struct frame before = *f;
        *f = l->ready;
        l->ready = before;
        l->fresh = l->wanted = false;
        e = l->error ? err_say(why, l->error, "%s", l->fault.text) : ERR_OK;
    } else if (l->gave_up) {
        e = err_say(why, ERR_IO, "%s", l->fault.text);
    }
    pthread_mutex_unlock(&l->lock);
    return e;
}

bool live_is_recording(struct live *l)
{
    pthread_mutex_lock(&l->lock);
    const bool recording = l->recording;
    pthread_mutex_unlock(&l->lock);
    return recording;
}

bool live_gave_up(struct live *l)
{
    pthread_mutex_lock(&l->lock);
    const bool gave_up = l->gave_up;
    pthread_mutex_unlock(&l->lock);
    return gave_up;
}

bool live_is_connected(struct live *l, struct reason *why)
{
    pthread_mutex_lock(&l->lock);
    const bool connected = l->connected;
    *why = l->state;
    pthread_mutex_unlock(&l->lock);
    return connected;
}
