/* server/base/handoff.h */
/* Three slots between one writer and one reader, so that neither ever waits for the other's copy: the writer fills a
 * free slot and publishes it, the reader takes the newest published one; what was published and not taken is dropped by
 * the next. The slots' contents are the caller's: index 0..2 names them. One writer thread, one reader thread. */
#ifndef BASE_HANDOFF_H
#define BASE_HANDOFF_H

#include <pthread.h>
#include <stdbool.h>

#define HANDOFF_SLOTS 3
#define HANDOFF_NONE (-1)

struct handoff {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    int ready;   /* {lock} published and not taken, or HANDOFF_NONE */
    int taken;   /* {lock} in the reader's hands, or HANDOFF_NONE */
    bool closed; /* {lock} */
};

void handoff_init(struct handoff *h);
void handoff_finish(struct handoff *h);

/* Writer: a slot that nobody reads and that is not waiting to be read. */
int handoff_begin(struct handoff *h);

/* Writer: whether that slot is in nobody's hands, and so the writer's to touch until it publishes the next one. */
bool handoff_is_idle(struct handoff *h, int slot);

/* Writer: makes the slot the newest. Returns the slot that this dropped because it had not been taken, or HANDOFF_NONE.
 */
int handoff_publish(struct handoff *h, int slot);

/* Writer: waits until what was published has been taken, at most timeout_ms. True when it has; false also when closed.
 */
bool handoff_wait_taken(struct handoff *h, int timeout_ms);

/* Reader: waits until there is something to take, at most timeout_ms; what it has in its hands it may keep meanwhile.
 * True when there is; false also when closed. */
bool handoff_wait_newer(struct handoff *h, int timeout_ms);

/* Reader: the newest slot, which stays the reader's until handoff_release; HANDOFF_NONE after timeout_ms or when
 * closed. */
int handoff_take(struct handoff *h, int timeout_ms);
void handoff_release(struct handoff *h, int slot);

/* Wakes both sides for good. Any thread. */
void handoff_close(struct handoff *h);
bool handoff_is_closed(struct handoff *h);

#endif
