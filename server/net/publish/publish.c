#include "net/publish/publish.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "image/video/h264.h"
#include "net/publish/queue.h"
#include "net/publish/sink.h"
#include "net/stream/server.h"
#include "protocol/relight_protocol.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

#define RETRY_FIRST_MS 500 /* doubles up to */
#define RETRY_MOST_MS 10000
#define LIVED_MS 5000 /* an output that lasted so long was no failed attempt */
#define OPEN_MS 10000 /* limits on one call */
#define WRITE_MS 5000
#define CLOSE_MS 1000
#define GRACE_MS 400 /* to say goodbye, once the program ends */
#define STOP_MS 1000
#define TAKE_MS 500  /* at most, until a stop is noticed */
#define RATE_MS 1000 /* over which the bit rate is measured */

/* One target and its thread. */
struct outlet {
    struct publisher *publisher;
    struct publish_target target;
    struct publish_queue queue;
    pthread_t thread;
    bool running;

    /* The thread's own. */
    uint8_t *header; /* parameter sets of the last keyframe; NULL: none came yet */
    size_t header_size;
    uint32_t width, height;
    bool opening;
    int64_t deadline_ms;              /* of the call under way */
    int64_t live_ms;                  /* since when the output takes images; 0: it has taken none */
    char told[sizeof(struct reason)]; /* the last failure that was logged */

    atomic_int_least64_t stop_ms; /* clock_ms when the program began to end; 0: it runs */

    pthread_mutex_t lock;
    struct server_publish figures; /* {lock} */
    int64_t marked_ms;             /* {lock} since when bits are counted for the rate */
    uint64_t marked_bytes;         /* {lock} */
};

struct publisher {
    uint32_t count;
    struct outlet outlets[SERVER_PUBLISH_MAX];

    pthread_mutex_t lock;
    pthread_cond_t ended;
    uint32_t active; /* {lock} threads that have not ended */
};

enum err publish_available(struct reason *why)
{
    return h264_available() ? ERR_OK
                            : err_say(why, ERR_UNSUPPORTED, "--publish: libavcodec has no libx264 on this machine");
}

/* ---- Reports ---- */

static void set_state(struct outlet *o, enum server_publish_state state, const char *detail)
{
    pthread_mutex_lock(&o->lock);
    o->figures.state = state;
    snprintf(o->figures.detail, sizeof(o->figures.detail), "%s", detail);
    pthread_mutex_unlock(&o->lock);
}

static void count_unit(struct outlet *o, size_t size)
{
    if (o->live_ms == 0) {
        set_state(o, SERVER_PUBLISH_LIVE, "");
        log_info("publishing to %s", o->target.name);
        o->live_ms = clock_ms();
        o->told[0] = '\0';
    }
    pthread_mutex_lock(&o->lock);
    o->figures.frames++;
    o->figures.bytes += size;
    pthread_mutex_unlock(&o->lock);
}

/* {lock} */
static void measure_rate(struct outlet *o)
{
    const int64_t now_ms = clock_ms(), passed_ms = now_ms - o->marked_ms;

    if (passed_ms < RATE_MS)
        return;
    o->figures.bits_per_second = 8e3 * (double)(o->figures.bytes - o->marked_bytes) / (double)passed_ms;
    o->marked_ms = now_ms;
    o->marked_bytes = o->figures.bytes;
}

uint32_t publisher_report(struct publisher *p, struct server_publish out[SERVER_PUBLISH_MAX])
{
    for (uint32_t i = 0; p && i < p->count; i++) {
        struct outlet *o = &p->outlets[i];
        pthread_mutex_lock(&o->lock);
        measure_rate(o);
        out[i] = o->figures;
        pthread_mutex_unlock(&o->lock);
        out[i].dropped = publish_queue_dropped(&o->queue);
    }
    return p ? p->count : 0;
}

/* ---- One target ---- */

/* Asked by libavformat while it waits for the network. */
static bool is_cancelled(void *user)
{
    struct outlet *o = user;
    const int64_t stop_ms = atomic_load(&o->stop_ms), now_ms = clock_ms();

    if (stop_ms)
        return o->opening || now_ms > stop_ms + GRACE_MS;
    return now_ms > o->deadline_ms;
}

/* Keeps the parameter sets of a keyframe. *news: they differ from those before. */
static enum err learn(struct outlet *o, const struct publish_entry *entry, const struct sink_unit *unit, bool *news,
                      struct reason *why)
{
    const struct protocol_picture *header = image_header(entry->image);
    const size_t size = annexb_header_size(unit->bytes, unit->size);

    *news = size != o->header_size || (size > 0 && memcmp(o->header, unit->bytes, size) != 0);
    if (!*news)
        return ERR_OK;
    uint8_t *copy = mem_alloc(size, 1);
    if (!copy)
        return err_say(why, ERR_NOMEM, "out of memory");
    memcpy(copy, unit->bytes, size);
    mem_free(o->header);
    o->header = copy;
    o->header_size = size;
    o->width = header->width + header->width % 2; /* as h264.h pads */
    o->height = header->height + header->height % 2;
    return ERR_OK;
}

static struct sink_unit unit_of(const struct publish_entry *entry)
{
    size_t size;
    const uint8_t *message = image_message(entry->image, &size);

    return (struct sink_unit){ message + PROTOCOL_PICTURE_BYTES, size - PROTOCOL_PICTURE_BYTES, entry->time_us,
                               entry->key };
}

/* Waits for the first keyframe, which describes the stream. */
static enum err learn_first(struct outlet *o, struct reason *why)
{
    struct publish_entry entry;
    enum err e = ERR_END;

    if (o->header)
        return ERR_OK;
    set_state(o, SERVER_PUBLISH_WAITING, "no image has been made yet");
    publish_queue_open(&o->queue, true);
    while (e == ERR_END && !atomic_load(&o->stop_ms)) {
        if (!publish_queue_take(&o->queue, &entry, TAKE_MS))
            continue;
        const struct sink_unit unit = unit_of(&entry);
        bool news;
        e = learn(o, &entry, &unit, &news, why);
        image_unref(entry.image);
    }
    publish_queue_open(&o->queue, false);
    return e;
}

/* ERR_END: the stream changed, and the output must be opened again. */
static enum err write_entry(struct outlet *o, struct sink *sink, const struct publish_entry *entry, struct reason *why)
{
    const struct sink_unit unit = unit_of(entry);
    bool news = false;
    enum err e = unit.key ? learn(o, entry, &unit, &news, why) : ERR_OK;

    if (!e && news)
        e = ERR_END;
    o->deadline_ms = clock_ms() + WRITE_MS;
    if (!e)
        e = sink_write(sink, &unit, why);
    if (!e)
        count_unit(o, unit.size);
    else if (e == ERR_IO && clock_ms() > o->deadline_ms)
        (void)err_say(why, e, "it took no data for %d s", WRITE_MS / 1000);
    return e;
}

static enum err open_sink(struct outlet *o, struct sink **out, struct reason *why)
{
    const struct sink_desc desc = {
        .target = &o->target,
        .header = o->header,
        .header_size = o->header_size,
        .width = o->width,
        .height = o->height,
        .cancelled = is_cancelled,
        .user = o,
    };

    if (o->target.listens)
        set_state(o, SERVER_PUBLISH_WAITING, "no receiver has connected yet");
    else
        set_state(o, SERVER_PUBLISH_CONNECTING, "");
    o->deadline_ms = o->target.listens ? INT64_MAX : clock_ms() + OPEN_MS;
    o->live_ms = 0;
    o->opening = true;
    enum err e = sink_open(&desc, out, why);
    o->opening = false;
    if (e == ERR_IO && clock_ms() > o->deadline_ms)
        e = err_say(why, e, "no answer within %d s", OPEN_MS / 1000);
    return e;
}

/* Until the output fails, the stream changes or the program ends. */
static enum err serve(struct outlet *o, struct reason *why)
{
    struct publish_entry entry;
    struct sink *sink;
    enum err e = open_sink(o, &sink, why);

    if (e)
        return e;
    publish_queue_open(&o->queue, true);
    while (!e && !atomic_load(&o->stop_ms))
        if (publish_queue_take(&o->queue, &entry, TAKE_MS)) {
            e = write_entry(o, sink, &entry, why);
            image_unref(entry.image);
        }
    publish_queue_open(&o->queue, false);
    o->deadline_ms = clock_ms() + CLOSE_MS;
    sink_close(sink);
    return e;
}

/* Each cause is logged once, until the target is live again. */
static void report_failure(struct outlet *o, const struct reason *why)
{
    if (strcmp(o->told, why->text) != 0)
        log_warning("publishing to %s: %s; trying again", o->target.name, why->text);
    snprintf(o->told, sizeof(o->told), "%s", why->text);
    set_state(o, SERVER_PUBLISH_RETRYING, why->text);
    pthread_mutex_lock(&o->lock);
    o->figures.retries++;
    pthread_mutex_unlock(&o->lock);
}

static void end(struct outlet *o)
{
    struct publisher *p = o->publisher;

    pthread_mutex_lock(&p->lock);
    p->active--;
    pthread_cond_broadcast(&p->ended);
    pthread_mutex_unlock(&p->lock);
}

static void *run(void *arg)
{
    struct outlet *o = arg;
    int64_t retry_ms = RETRY_FIRST_MS;

    while (!atomic_load(&o->stop_ms)) {
        struct reason why = { "" };
        enum err e = learn_first(o, &why);
        if (!e)
            e = serve(o, &why);
        if (!e || e == ERR_END || atomic_load(&o->stop_ms))
            continue;
        report_failure(o, &why);
        if (o->live_ms > 0 && clock_ms() - o->live_ms > LIVED_MS)
            retry_ms = RETRY_FIRST_MS;
        publish_queue_wait_closed(&o->queue, retry_ms);
        retry_ms = 2 * retry_ms < RETRY_MOST_MS ? 2 * retry_ms : RETRY_MOST_MS;
    }
    end(o);
    return NULL;
}

/* ---- All targets ---- */

static bool start(struct publisher *p, const struct publish_target *target)
{
    struct outlet *o = &p->outlets[p->count];

    *o = (struct outlet){ .publisher = p, .target = *target, .marked_ms = clock_ms() };
    snprintf(o->figures.to, sizeof(o->figures.to), "%s", target->name);
    pthread_mutex_init(&o->lock, NULL);
    publish_queue_init(&o->queue);
    p->count++;
    p->active++;
    o->running = pthread_create(&o->thread, NULL, run, o) == 0;
    p->active -= !o->running;
    return o->running;
}

enum err publisher_create(const struct publish_target *targets, uint32_t count, struct publisher **out,
                          struct reason *why)
{
    *out = NULL;
    if (count == 0)
        return ERR_OK;
    struct publisher *p = mem_alloc(1, sizeof(*p));
    if (!p)
        return err_say(why, ERR_NOMEM, "out of memory");
    pthread_mutex_init(&p->lock, NULL);
    clock_condition(&p->ended);
    for (uint32_t i = 0; i < count; i++)
        if (!start(p, &targets[i])) {
            publisher_destroy(p);
            return err_say(why, ERR_NOMEM, "a thread could not be started");
        }
    *out = p;
    return ERR_OK;
}

bool publisher_wants(struct publisher *p, bool *key)
{
    bool any = false, one;

    *key = false;
    for (uint32_t i = 0; p && i < p->count; i++) {
        any |= publish_queue_wants(&p->outlets[i].queue, &one);
        *key |= one;
    }
    return any;
}

void publisher_push(struct publisher *p, struct sent_image *image, int64_t time_us)
{
    for (uint32_t i = 0; p && i < p->count; i++) {
        const bool key = image_header(image)->flags & PROTOCOL_PICTURE_KEY;
        publish_queue_push(&p->outlets[i].queue, &(struct publish_entry){ image, time_us, key });
    }
}

/* Waits until all threads have ended, until_ms at most. */
static bool wait_ended(struct publisher *p, int64_t until_ms)
{
    pthread_mutex_lock(&p->lock);
    while (p->active > 0 && clock_wait(&p->ended, &p->lock, until_ms))
        continue;
    const bool ended = p->active == 0;
    pthread_mutex_unlock(&p->lock);
    return ended;
}

bool publisher_destroy(struct publisher *p)
{
    const int64_t now_ms = clock_ms();

    if (!p)
        return true;
    for (uint32_t i = 0; i < p->count; i++) {
        atomic_store(&p->outlets[i].stop_ms, now_ms);
        publish_queue_close(&p->outlets[i].queue);
    }
    if (!wait_ended(p, now_ms + STOP_MS))
        return false;
    for (uint32_t i = 0; i < p->count; i++) {
        struct outlet *o = &p->outlets[i];
        if (o->running)
            pthread_join(o->thread, NULL);
        publish_queue_finish(&o->queue);
        pthread_mutex_destroy(&o->lock);
        mem_free(o->header);
    }
    pthread_cond_destroy(&p->ended);
    pthread_mutex_destroy(&p->lock);
    mem_free(p);
    return true;
}
