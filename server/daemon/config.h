/* What the command line, the configuration file and the token files ask relightd to do. Main thread writes it once at
 * the start; after that every thread may read it without a lock. */
#ifndef DAEMON_CONFIG_H
#define DAEMON_CONFIG_H

#include "daemon/settings.h"

#include "base/log.h"
#include "decoder/decoder.h"
#include "env/environment.h"
#include "light/relight.h"
#include "light/still.h"
#include "publish/target.h"
#include "source/sky.h"
#include "source/source.h"
#include "stream/server.h"

#include <stdbool.h>
#include <stdint.h>

/* How ranks of a job send the light of shade points, and whether one process rounds it likewise. */
enum part_floats { PART_AUTO, PART_HALF, PART_FLOAT };

/* Strings belong to struct config_readings. */
struct daemon_config {
    struct setup setup; /* `initial`: of lockstep sequences, too, since controllers cannot change it. Method, samples,
                           classes, rotation and scale come from the settings of the moment instead */
    int part_floats;    /* enum part_floats */
    struct still_wish converge; /* error 0: still images are not refined */
    double picture_s;           /* what controllers ask for must let a picture be made within this time */
    double rate;                /* frames per second from the source; 0: as fast as they are lit */
    double h264_bits;           /* maximum bits per second of the full-size track; 0: chosen by size and rate */
    struct setting_texts publish_urls;
    struct publish_target publish[SETTING_TEXTS_MAX]; /* these, taken apart */
    struct server_desc server_desc;
    struct log_desc log;
    const char *state_dir; /* NULL: settings are not kept across restarts */
    bool push;             /* producers send the frames */
    bool no_sandbox;       /* decode producers' files in this process */
    uint32_t max_side;     /* limit on a producer's picture, in texels; 0: no limit, the source is local */
    struct decoder_desc decoder_desc;
    double decode_seconds; /* its time limit for one file */
    bool computed_sky;
    struct sky_desc sky; /* where computed_sky */
};

/* The readings behind a config: the one at the start, whose strings stay in use, and the latest reload. Zeroed at
 * first. Main thread. */
struct config_reading;
struct config_readings {
    struct config_reading *first, *latest;
};

/* Reads flags, configuration file and tokens into *c. *done: --help, --version or the answer to --check-config was
 * printed, and the program should exit. ERR_USAGE names the flag, or file, line and key. ERR_NOMEM. Call
 * config_readings_finish afterwards in every case. */
MUST_CHECK enum err daemon_config_read(struct daemon_config *c, struct config_readings *r, int argc, char **argv,
                                       bool *done, struct reason *why);
void config_readings_finish(struct config_readings *r);

/* Reads everything again (SIGHUP). Applies what can change at run time and logs what needs a restart; a fault leaves
 * everything as it was and is logged. */
void daemon_config_reload(struct config_readings *r, struct settings_store *settings, struct server *server);

#endif
