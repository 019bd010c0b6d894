/* Saves controllers' settings in a file (--state DIR) and restores them after a crash or restart. */
#pragma once

#include "relightd/daemon/settings.h"

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
