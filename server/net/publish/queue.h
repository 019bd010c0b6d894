/* Queues images for one target, from the encode thread, which never blocks, to the target's thread. A full queue
 * drops the oldest images up to the next keyframe, because a predicted image is useless without the one before. If
 * it holds no keyframe, it drops all new images until one arrives. The queue locks. Thread: any. */
#pragma once

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct sent_image;

#define PUBLISH_QUEUE 128                      /* images: four seconds at 30 per second */
#define PUBLISH_QUEUE_BYTES ((size_t)32 << 20) /* a single larger image is accepted even so */

struct publish_entry {
    struct sent_image *image; /* one access unit as payload, with a reference */
    int64_t time_us;          /* any monotonic clock */
    bool key;
};

struct publish_queue {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    struct publish_entry entries[PUBLISH_QUEUE]; /* {lock} a ring that begins at `first` */
    unsigned first, count;                       /* {lock} */
    size_t bytes;                                /* {lock} */
    bool open;                                   /* {lock} accepts images */
    bool needs_key;                              /* {lock} the next image must be a keyframe, */
    bool broken;                                 /* {lock} because images were dropped */
    bool closed;                                 /* {lock} permanently */
    uint64_t dropped;                            /* {lock} images since the start */
};

/* Initialises an empty queue that accepts no images. */
void publish_queue_init(struct publish_queue *q);
void publish_queue_finish(struct publish_queue *q); /* releases all images; no other call may follow */

/* Starts to accept images, beginning with a keyframe; or stops, and releases the queued ones, which do not count as
 * dropped. */
void publish_queue_open(struct publish_queue *q, bool open);

/* Adds an image and takes a reference to it, if the queue is open. */
void publish_queue_push(struct publish_queue *q, const struct publish_entry *entry);

/* Removes the oldest image; the caller owns its reference. False: none arrived within timeout_ms, or the queue is
 * closed. */
bool publish_queue_take(struct publish_queue *q, struct publish_entry *out, int timeout_ms);

/* Whether the queue is open; *key: the next image must be a keyframe. */
bool publish_queue_wants(struct publish_queue *q, bool *key);
uint64_t publish_queue_dropped(struct publish_queue *q);

/* Waits up to timeout_ms for the queue to close. Returns whether it is closed. */
bool publish_queue_wait_closed(struct publish_queue *q, int64_t timeout_ms);
void publish_queue_close(struct publish_queue *q); /* wakes all waiting threads; the queue accepts and returns no more
                                                      images */
