/* server/publish/queue.h */
/* Pictures on their way to one target: from the encode thread, which never waits, to the target's thread. A full queue
 * drops what is oldest up to the next key picture, because a picture of a chain is useless without the one before; if
 * it holds none, it drops all that comes until one does. Any thread; the queue locks. */
#ifndef PUBLISH_QUEUE_H
#define PUBLISH_QUEUE_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct picture;

#define PUBLISH_QUEUE 128                      /* pictures: four seconds at 30 per second */
#define PUBLISH_QUEUE_BYTES ((size_t)32 << 20) /* a single larger picture is taken all the same */

struct publish_entry {
    struct picture *picture; /* one access unit as payload, with a reference */
    int64_t time_us;         /* any monotonic clock */
    bool key;
};

struct publish_queue {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    struct publish_entry entries[PUBLISH_QUEUE]; /* {lock} from first on, in a ring */
    unsigned first, count;                       /* {lock} */
    size_t bytes;                                /* {lock} */
    bool open;                                   /* {lock} it takes pictures */
    bool needs_key;                              /* {lock} nothing can follow but a key picture, */
    bool broken;                                 /* {lock} because pictures were dropped */
    bool closed;                                 /* {lock} for good */
    uint64_t dropped;                            /* {lock} pictures since the start */
};

/* Zeroed memory becomes an empty queue that takes no pictures. */
void publish_queue_init(struct publish_queue *q);
void publish_queue_finish(struct publish_queue *q); /* lets go of all pictures; no other call may follow */

/* Begins to take pictures, the first of which will be a key picture; or stops, and lets go of those it holds, which do
 * not count as dropped. */
void publish_queue_open(struct publish_queue *q, bool open);

/* Adds a picture, with a reference of its own, if the queue is open. */
void publish_queue_push(struct publish_queue *q, const struct publish_entry *entry);

/* Takes the oldest picture, whose reference the caller then owns. False: none came within timeout_ms, or the queue is
 * closed. */
bool publish_queue_take(struct publish_queue *q, struct publish_entry *out, int timeout_ms);

/* Whether it is open; *key: and only a key picture is of use. */
bool publish_queue_wants(struct publish_queue *q, bool *key);
uint64_t publish_queue_dropped(struct publish_queue *q);

/* Waits until the queue is closed, timeout_ms at most. Returns whether it is. */
bool publish_queue_wait_closed(struct publish_queue *q, int64_t timeout_ms);
void publish_queue_close(struct publish_queue *q); /* wakes all that wait; it takes and gives no pictures any more */

#endif
