/* The settings that controllers may change while relightd runs, and their requests to move within the source. Any
 * thread; the store locks. */
#pragma once

#include "base/err.h"
#include "relightd/settings/settings.h"
#include "sky/source/source.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct daemon_config;
struct server;
struct server_control;

/* A controller's request to seek or step in the source. */
struct source_request {
    bool has_seek, has_hour, has_day;
    uint64_t seek; /* position */
    double hour;   /* solar time, 0..24; of weather: local standard time */
    uint32_t day;  /* of the year, of weather */
    int64_t step;  /* frames from there, or from the current frame */
};

/* A view that a controller saved under a name. */
#define SAVED_VIEWS 16
struct saved_view {
    char name[64], view[FREE_VIEW_TEXT];
};

struct settings_store {
    /* Set before other threads start, then constant. */
    const struct daemon_config *config;
    struct server *server;
    const struct scene *scene;                                /* whose cameras controllers may choose */
    double (*estimate)(void *user, const struct settings *s); /* seconds of an image, 0: unknown; NULL: no limit */
    void *estimate_user;

    atomic_int source_kind;              /* enum source_kind, */
    atomic_uint_least64_t source_length; /* frames in a pass, 0: unknown or endless. The ingest thread sets both */

    pthread_mutex_t lock;
    struct settings now;                  /* {lock} */
    struct source_request request;        /* {lock} */
    struct saved_view views[SAVED_VIEWS]; /* {lock} in the order of saving */
    unsigned view_count;                  /* {lock} */
    atomic_bool views_changed;            /* since the shade thread has last looked */
    atomic_bool request_waiting;
    atomic_uint_least64_t proven; /* the latest light_version with a finished image; others are not saved */
    atomic_int jpeg_quality;      /* 1..100, for viewers that do not choose one */
};

/* config must outlive the store. The initial settings take effect. */
void settings_init(struct settings_store *store, const struct daemon_config *config);
void settings_finish(struct settings_store *store);

/* A copy of the current settings. */
struct settings settings_now(struct settings_store *store);

/* Applies all requests from controllers since the last call; sends the result to everyone, or an error to its
 * requester. */
void settings_take_control(struct settings_store *store);

/* Sets the camera that is in use, at startup or after a failed change of camera. Sends everyone the settings. */
void settings_set_camera(struct settings_store *store, const char *camera);

/* ---- Cameras: those of the scene, saved and free views (views.c) ---- */

/* Finds a camera by name, or parses a free view. ERR_USAGE: neither. */
MUST_CHECK enum err settings_find_camera(struct settings_store *store, const char *name, struct camera *out,
                                         struct reason *why);
/* Saves a view under a name, or deletes that name. ERR_USAGE: *why explains it. */
MUST_CHECK enum err settings_save_view(struct settings_store *store, const char *name, const char *view,
                                       struct reason *why);
MUST_CHECK enum err settings_forget_view(struct settings_store *store, const char *name, struct reason *why);
/* Copies the saved views to out[SAVED_VIEWS] and returns their number. */
unsigned settings_views(struct settings_store *store, struct saved_view *out);

/* Whether an image with `s` would exceed the limit (--max-picture-seconds) and take longer than with the current
 * settings; *why then explains it. Thread: that of the estimate. */
bool settings_cost_too_much(struct settings_store *store, const struct settings *s, struct reason *why);

/* Sends everyone the current settings. */
void settings_send(struct settings_store *store);

/* Replaces all settings, raises both versions and sends everyone the result. */
void settings_replace(struct settings_store *store, const struct settings *to);

/* Returns and clears the pending request to move within the source. */
struct source_request settings_take_source_request(struct settings_store *store);

/* Applies one control message without sending anything. ERR_USAGE: *why explains it; the settings are unchanged. */
MUST_CHECK enum err settings_apply(struct settings_store *store, const struct server_control *asked,
                                   struct reason *why);

/* ---- Settings on disk ---- */

/* Saves controllers' settings in a file (--state DIR) and restores them after a crash or restart. */

/* Zero it first. Main thread, except state_save: the housekeeping thread while that runs. */
struct state_file {
    const struct daemon_config *config; /* NULL: not open */
    struct settings_store *settings;
    char default_camera[64]; /* if the command line names none */
    char path[4096];
    char *text;     /* the file's contents */
    double retry_s; /* no write before this time (clock_seconds) */
};

/* Whether the folder is writable, or can be created; removes what it creates for the test. ERR_IO. */
MUST_CHECK enum err state_check(const char *folder, struct reason *why);

/* Applies the settings in the file. Problems with the file are logged as warnings. config and settings must outlive
 * f. */
void state_open(struct state_file *f, const struct daemon_config *config, struct settings_store *settings,
                const char *default_camera);
/* Writes the file if the settings have changed and an image with them was finished. */
void state_save(struct state_file *f);
void state_close(struct state_file *f);
