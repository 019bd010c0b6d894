#include "net/publish/queue.h"

#include "base/clock.h"
#include "net/stream/server.h"

void publish_queue_init(struct publish_queue *q)
{
    pthread_mutex_init(&q->lock, NULL);
    clock_condition(&q->changed);
}

static size_t size_of(const struct publish_entry *e)
{
    size_t size;

    image_message(e->image, &size);
    return size;
}

/* {lock} The oldest entry, whose reference goes to the caller. */
static struct publish_entry pop(struct publish_queue *q)
{
    const struct publish_entry e = q->entries[q->first];

    q->first = (q->first + 1) % PUBLISH_QUEUE;
    q->count--;
    q->bytes -= size_of(&e);
    return e;
}

/* {lock} */
static void clear(struct publish_queue *q)
{
    while (q->count > 0)
        image_unref(pop(q).image);
}

void publish_queue_finish(struct publish_queue *q)
{
    clear(q);
    pthread_cond_destroy(&q->changed);
    pthread_mutex_destroy(&q->lock);
}

void publish_queue_open(struct publish_queue *q, bool open)
{
    pthread_mutex_lock(&q->lock);
    clear(q);
    q->open = q->needs_key = open;
    q->broken = false;
    pthread_mutex_unlock(&q->lock);
}

/* {lock} Drops the oldest image and those that follow it, up to the next keyframe. */
static void drop_chain(struct publish_queue *q)
{
    do {
        image_unref(pop(q).image);
        q->dropped++;
    } while (q->count > 0 && !q->entries[q->first].key);
    q->needs_key = q->broken = q->count == 0;
}

static bool is_full(const struct publish_queue *q, size_t more)
{
    return q->count == PUBLISH_QUEUE || (q->count > 0 && q->bytes + more > PUBLISH_QUEUE_BYTES);
}

void publish_queue_push(struct publish_queue *q, const struct publish_entry *entry)
{
    const size_t size = size_of(entry);

    pthread_mutex_lock(&q->lock);
    while (q->open && is_full(q, size))
        drop_chain(q);
    if (q->open && q->needs_key && !entry->key) {
        q->dropped += q->broken; /* before the first keyframe none is missed */
    } else if (q->open && !q->closed) {
        q->needs_key = q->broken = false;
        q->entries[(q->first + q->count++) % PUBLISH_QUEUE] = *entry;
        q->bytes += size;
        image_ref(entry->image);
        pthread_cond_broadcast(&q->changed);
    }
    pthread_mutex_unlock(&q->lock);
}

/* {lock} Waits until there is an image, if `any`, or the queue is closed. */
static void wait_for(struct publish_queue *q, bool any, int64_t timeout_ms)
{
    const int64_t until_ms = clock_ms() + timeout_ms;

    while (!q->closed && !(any && q->count > 0) && clock_wait(&q->changed, &q->lock, until_ms))
        continue;
}

bool publish_queue_take(struct publish_queue *q, struct publish_entry *out, int timeout_ms)
{
    pthread_mutex_lock(&q->lock);
    wait_for(q, true, timeout_ms);
    const bool any = !q->closed && q->count > 0;
    if (any)
        *out = pop(q);
    pthread_mutex_unlock(&q->lock);
    return any;
}

bool publish_queue_wants(struct publish_queue *q, bool *key)
{
    pthread_mutex_lock(&q->lock);
    const bool open = q->open && !q->closed;
    *key = open && q->needs_key;
    pthread_mutex_unlock(&q->lock);
    return open;
}

uint64_t publish_queue_dropped(struct publish_queue *q)
{
    pthread_mutex_lock(&q->lock);
    const uint64_t dropped = q->dropped;
    pthread_mutex_unlock(&q->lock);
    return dropped;
}

bool publish_queue_wait_closed(struct publish_queue *q, int64_t timeout_ms)
{
    pthread_mutex_lock(&q->lock);
    wait_for(q, false, timeout_ms);
    const bool closed = q->closed;
    pthread_mutex_unlock(&q->lock);
    return closed;
}

void publish_queue_close(struct publish_queue *q)
{
    pthread_mutex_lock(&q->lock);
    q->closed = true;
    pthread_cond_broadcast(&q->changed);
    pthread_mutex_unlock(&q->lock);
}
