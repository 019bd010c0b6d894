#include "base/handoff.h"

#include "base/clock.h"

#include <assert.h>

void handoff_init(struct handoff *h)
{
    pthread_mutex_init(&h->lock, NULL);
    clock_condition(&h->changed);
    h->ready = h->taken = h->next = HANDOFF_NONE;
    h->closed = false;
}

void handoff_finish(struct handoff *h)
{
    pthread_cond_destroy(&h->changed);
    pthread_mutex_destroy(&h->lock);
}

int handoff_begin(struct handoff *h)
{
    int slot = 0;

    pthread_mutex_lock(&h->lock);
    while (slot == h->ready || slot == h->taken || slot == h->next) /* one of the slots is free */
        slot++;
    pthread_mutex_unlock(&h->lock);
    return slot;
}

bool handoff_is_idle(struct handoff *h, int slot)
{
    pthread_mutex_lock(&h->lock);
    const bool idle = slot != h->ready && slot != h->taken && slot != h->next;
    pthread_mutex_unlock(&h->lock);
    return idle;
}

int handoff_publish(struct handoff *h, int slot)
{
    pthread_mutex_lock(&h->lock);
    assert(slot >= 0 && slot < HANDOFF_SLOTS_EARLY && slot != h->taken && slot != h->next);
    const int dropped = h->ready;
    h->ready = slot;
    pthread_cond_broadcast(&h->changed);
    pthread_mutex_unlock(&h->lock);
    return dropped;
}

bool handoff_wait_taken(struct handoff *h, int timeout_ms)
{
    const int64_t until_ms = clock_ms() + timeout_ms;

    pthread_mutex_lock(&h->lock);
    while (h->ready != HANDOFF_NONE && !h->closed)
        if (!clock_wait(&h->changed, &h->lock, until_ms))
            break;
    const bool taken = h->ready == HANDOFF_NONE && !h->closed;
    pthread_mutex_unlock(&h->lock);
    return taken;
}

bool handoff_wait_newer(struct handoff *h, int timeout_ms)
{
    const int64_t until_ms = clock_ms() + timeout_ms;

    pthread_mutex_lock(&h->lock);
    while (h->ready == HANDOFF_NONE && !h->closed)
        if (!clock_wait(&h->changed, &h->lock, until_ms))
            break;
    const bool newer = h->ready != HANDOFF_NONE && !h->closed;
    pthread_mutex_unlock(&h->lock);
    return newer;
}

/* Moves the newest published slot, if any, to h->taken or h->next. Under the lock. */
static int take_ready(struct handoff *h, int *to)
{
    const int slot = h->closed ? HANDOFF_NONE : h->ready;

    if (slot != HANDOFF_NONE) {
        *to = slot;
        h->ready = HANDOFF_NONE;
        pthread_cond_broadcast(&h->changed);
    }
    return slot;
}

int handoff_take(struct handoff *h, int timeout_ms)
{
    const int64_t until_ms = clock_ms() + timeout_ms;

    pthread_mutex_lock(&h->lock);
    assert(h->taken == HANDOFF_NONE);
    while (h->ready == HANDOFF_NONE && !h->closed)
        if (!clock_wait(&h->changed, &h->lock, until_ms))
            break;
    const int slot = take_ready(h, &h->taken);
    pthread_mutex_unlock(&h->lock);
    return slot;
}

int handoff_take_early(struct handoff *h)
{
    pthread_mutex_lock(&h->lock);
    assert(h->taken != HANDOFF_NONE && h->next == HANDOFF_NONE);
    const int slot = take_ready(h, &h->next);
    pthread_mutex_unlock(&h->lock);
    return slot;
}

void handoff_release(struct handoff *h, int slot)
{
    pthread_mutex_lock(&h->lock);
    assert(slot == h->taken);
    h->taken = h->next;
    h->next = HANDOFF_NONE;
    pthread_mutex_unlock(&h->lock);
}

void handoff_close(struct handoff *h)
{
    pthread_mutex_lock(&h->lock);
    h->closed = true;
    pthread_cond_broadcast(&h->changed);
    pthread_mutex_unlock(&h->lock);
}

bool handoff_is_closed(struct handoff *h)
{
    pthread_mutex_lock(&h->lock);
    const bool closed = h->closed;
    pthread_mutex_unlock(&h->lock);
    return closed;
}
