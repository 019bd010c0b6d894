/* The encode thread: applies exposure and tone curve, then encodes each image in every format that has viewers: JPEG,
 * H.264, EXR. */
#pragma once

#include "base/err.h"

struct encode_thread;
struct shaded;
struct shared;

/* shared must outlive the thread. ERR_NOMEM: *out is NULL. Main thread. */
MUST_CHECK enum err encode_thread_create(struct shared *shared, struct encode_thread **out, struct reason *why);

/* Starts to encode images from shared->images. ERR_NOMEM: no thread. Main thread. */
MUST_CHECK enum err encode_thread_start(struct encode_thread *t, struct reason *why);

/* Encodes and publishes one image and completes its header. Thread: encode; tests may call it instead. */
void encode_image(struct encode_thread *t, struct shaded *in);

/* Waits for the thread, which ends when the images' handoff is closed. Main thread. NULL is allowed. */
void encode_thread_destroy(struct encode_thread *t);
