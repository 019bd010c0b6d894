/* The encode thread: exposure and tone curve, then each picture in every format that someone watches: JPEG, H.264,
 * EXR. */
#ifndef DAEMON_ENCODE_H
#define DAEMON_ENCODE_H

#include "base/err.h"

struct encode_thread;
struct shaded;
struct shared;

/* shared must outlive the thread. ERR_NOMEM: *out is NULL. Main thread. */
MUST_CHECK enum err encode_thread_create(struct shared *shared, struct encode_thread **out, struct reason *why);

/* Starts encoding what arrives in shared->pictures. ERR_NOMEM: no thread. Main thread. */
MUST_CHECK enum err encode_thread_start(struct encode_thread *t, struct reason *why);

/* Encodes and publishes one picture, whose header it completes. Encode thread; a test may call it instead. */
void encode_picture(struct encode_thread *t, struct shaded *in);

/* Waits for the thread, which ends when the pictures' handoff is closed. Main thread; NULL is allowed. */
void encode_thread_destroy(struct encode_thread *t);

#endif
