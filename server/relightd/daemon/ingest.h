/* The ingest thread: reads frames from the source or from producers in order, at the source's rate, decodes them and
 * builds their sampling tables. It pauses, steps and seeks on controllers' requests. */
#pragma once

#include "base/err.h"
#include "relightd/daemon/shared.h"

#include <pthread.h>

struct ingest_thread;

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

/* The ingest thread's private data. Only ingest*.c use it. */

struct ingest_thread {
    struct shared *shared;
    struct source *source;   /* NULL: producers send the frames */
    struct decoder *decoder; /* NULL: files are decoded in this process */
    struct glide *glide;     /* NULL: no images between skies */
    unsigned said;           /* by environment_report */
    bool has_sun;            /* the map of sun_ms, which had */
    struct sun_place sun;    /* this one */
    int64_t sun_ms;          /* clock_ms; 0: none was looked at */
    pthread_t thread;
    bool running;
    atomic_bool prepared; /* ingest_thread_go_on was called */
};

/* Ingest thread, all of what follows. */

/* Decodes f into a free slot and publishes it to the shade thread. Errors are those of environment_update. Thread:
 * ingest, as for all functions below. */
MUST_CHECK enum err ingest_frame(struct ingest_thread *t, const struct frame *f, const struct server_ticket *ticket,
                                 struct reason *why);

/* If light settings changed since *seen, publishes the current frame again with the new settings. */
void ingest_relight(struct ingest_thread *t, const struct frame *f, uint64_t version, uint64_t *seen,
                    struct reason *why);

/* Waits for ingest_thread_go_on. */
void ingest_wait_prepared(struct ingest_thread *t);

bool ingest_is_watched(const struct ingest_thread *t); /* whether anyone takes images */

/* Sleeps for 0 to 999 milliseconds; a signal may end it early. */
void ingest_sleep_ms(int64_t ms);

/* Reads until the program stops: from t->source, or from producers. */
void ingest_from_source(struct ingest_thread *t, struct reason *why);
void ingest_from_producers(struct ingest_thread *t, struct reason *why);

/* ---- Images between skies (ingest_between.c) ---- */

struct glide;

/* *out NULL: --between off. ERR_NOMEM. */
MUST_CHECK enum err glide_create(const struct daemon_config *c, struct glide **out);
void glide_destroy(struct glide *g);        /* NULL is allowed */
void glide_forget(struct ingest_thread *t); /* what comes next follows nothing; there may be no glide */
void glide_end(struct ingest_thread *t);    /* likewise, but images go on to the last sky; there may be no glide */

/* Notes a sky that arrived; *shown: what its image shows, f itself or a sky made of it. Errors as those of
 * between_take: the sky cannot be used. */
MUST_CHECK enum err glide_take(struct ingest_thread *t, const struct frame *f, const struct frame **shown,
                               struct reason *why);
bool glide_is_moving(const struct ingest_thread *t);           /* whether more images are to come before the next sky */
int glide_wait_ms(const struct ingest_thread *t, int most_ms); /* until the next image, at most so long */
const struct frame *glide_step(struct ingest_thread *t);       /* the sky of the next image if it is due, else NULL */
