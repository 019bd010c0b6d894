/* The ingest thread: reads frames from the source or from producers in order, at the source's rate, decodes them and
 * builds their sampling tables. It pauses, steps and seeks on controllers' requests. */
#pragma once

#include "base/err.h"

struct ingest_thread;
struct shared;

/* Opens the source, or starts the process that decodes producers' files. shared must outlive the thread. On any error
 * *out is NULL and *why explains it. Errors are those of source_open and decoder_create. Main thread. */
MUST_CHECK enum err ingest_thread_create(struct shared *shared, struct ingest_thread **out, struct reason *why);

/* Starts reading: of a source only the first frame, so that its tables are built while the scene loads, until
 * ingest_thread_go_on. ERR_NOMEM: no thread. Main thread. */
MUST_CHECK enum err ingest_thread_start(struct ingest_thread *t, struct reason *why);

/* The scene is prepared, and the settings are restored: all frames are read from here on. Main thread, once. */
void ingest_thread_go_on(struct ingest_thread *t);

/* Waits for the thread, which ends when shared_is_stopping. Main thread. NULL is allowed. */
void ingest_thread_destroy(struct ingest_thread *t);
