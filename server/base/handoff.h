/* Triple buffering between one writer thread and one reader thread: neither waits while the other copies. The writer
 * fills a free slot and publishes it; the reader takes the newest published slot; publishing drops a slot that was not
 * taken. The reader may take the slot for its next turn early. The caller owns the contents of the slots, which are
 * numbered 0..2; a reader that takes slots early needs 0..3. */
#pragma once

#include <pthread.h>
#include <stdbool.h>

#define HANDOFF_SLOTS 3       /* one is written, one ready, one read */
#define HANDOFF_SLOTS_EARLY 4 /* and one taken before its turn */
#define HANDOFF_NONE (-1)

struct handoff {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    int ready;   /* {lock} published and not yet taken, or HANDOFF_NONE */
    int taken;   /* {lock} held by the reader, or HANDOFF_NONE */
    int next;    /* {lock} taken early, or HANDOFF_NONE */
    bool closed; /* {lock} */
};

void handoff_init(struct handoff *h);   /* before either thread starts */
void handoff_finish(struct handoff *h); /* after both threads have ended */

/* Writer: returns a free slot to fill. */
int handoff_begin(struct handoff *h);

/* Writer: whether `slot` is neither published nor held by the reader. It then stays idle until the next
 * handoff_publish. */
bool handoff_is_idle(struct handoff *h, int slot);

/* Writer: makes `slot` the newest. Returns the slot that was published but never taken and is now dropped, or
 * HANDOFF_NONE. */
int handoff_publish(struct handoff *h, int slot);

/* Writer: waits at most timeout_ms until the published slot has been taken. False: timeout or closed. */
bool handoff_wait_taken(struct handoff *h, int timeout_ms);

/* Reader: waits at most timeout_ms for a published slot, without releasing the one it holds. False: timeout or closed.
 */
bool handoff_wait_newer(struct handoff *h, int timeout_ms);

/* Reader: takes the newest published slot, which it holds until handoff_release. HANDOFF_NONE after timeout_ms or when
 * closed. */
int handoff_take(struct handoff *h, int timeout_ms);
/* Reader, while it holds a slot: takes the newest published one early, at most one. HANDOFF_NONE: there is none. */
int handoff_take_early(struct handoff *h);
/* Reader: gives the slot back. From then on it holds the one that it took early, if any. */
void handoff_release(struct handoff *h, int slot);

void handoff_close(struct handoff *h);     /* wakes both sides; every later wait fails at once. Thread: any. */
bool handoff_is_closed(struct handoff *h); /* thread: any */
