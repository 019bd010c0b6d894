/* Keeps what controllers set in a file (--state DIR), so that it is back after a crash or restart. */
#ifndef DAEMON_STATE_H
#define DAEMON_STATE_H

#include "daemon/settings.h"

/* Zeroed at first. Main thread, except state_save: housekeeping thread while that runs. */
struct state_file {
    const struct daemon_config *config; /* NULL: not open */
    struct settings_store *settings;
    char default_camera[64]; /* where the command line names none */
    char path[4096];
    char *text;     /* what the file contains */
    double retry_s; /* no write before this time (clock_seconds) */
};

/* Whether the folder can be written, or be made; what is made for that is removed. ERR_IO. */
MUST_CHECK enum err state_check(const char *folder, struct reason *why);

/* Applies the settings in the file. Problems with the file are logged as warnings. config and settings must outlive
 * f. */
void state_open(struct state_file *f, const struct daemon_config *config, struct settings_store *settings,
                const char *default_camera);
/* Writes the file if the settings have changed, and a picture was finished by them. */
void state_save(struct state_file *f);
void state_close(struct state_file *f);

#endif
