/* A live stream or a camera: a thread decodes it and converts the newest frame on request. A lost
 * connection is retried with growing delays. Private to this room. Thread: one per live, beside its own. */
#pragma once

#include "sky/source/footage.h"

struct live;

/* Whether the first video from a web server has a length, and so is a file and not a live stream. The thread has then
 * ended: the video can be opened as a file. */
bool live_is_recording(struct live *l);

/* Starts the thread, which connects. first: an open footage that it takes over, or NULL. tries: it gives up after
 * this many connections without a single frame; 0: never. ERR_NOMEM: then `first` still belongs to the caller. */
MUST_CHECK enum err live_start(const struct footage_desc *desc, struct footage *first, unsigned tries,
                               struct live **out, struct reason *why);
void live_stop(struct live *l); /* waits for the thread; NULL is allowed */

/* The newest image that was not returned before, waiting up to wait_ms for one; else f->kind is FRAME_NONE. Sets
 * everything but the number. capture_us: from the time stamps and the sender's clock if the stream states it, else from
 * when they arrived. Errors of footage_convert; ERR_IO, each time: the thread gave up (live_gave_up). */
MUST_CHECK enum err live_next(struct live *l, int wait_ms, struct frame *f, struct reason *why);

/* Whether the thread has ended because it gave up. */
bool live_gave_up(struct live *l);

/* Whether images come; else *why says what is wrong, or that it is connecting. */
bool live_is_connected(struct live *l, struct reason *why);
