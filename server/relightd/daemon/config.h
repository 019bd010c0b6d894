/* The configuration of relightd, from the command line, the configuration file and the token files. The main thread
 * writes it once at startup; then every thread may read it without a lock. */
#pragma once

#include "base/command.h"
#include "base/log.h"
#include "import/decoder/decoder.h"
#include "light/frame/refine.h"
#include "light/frame/relight.h"
#include "net/publish/publish.h"
#include "net/stream/server.h"
#include "relightd/daemon/settings.h"
#include "sky/daylight/sky.h"
#include "sky/source/source.h"
#include "sky/tables/environment.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

/* How the ranks of a job send the light of shade points, and whether a single process rounds it in the same way. */
enum part_floats { PART_AUTO, PART_HALF, PART_FLOAT };

/* Strings belong to struct config_readings. */
struct daemon_config {
    struct setup setup; /* `initial` also configures lockstep sequences, since controllers cannot change it. Method,
                           samples, classes, rotation and scale come from the current settings instead */
    int part_floats;    /* enum part_floats */
    struct refiner_wish converge; /* error 0: still images are not refined */
    double image_s;               /* limit on the time per image for controllers' settings */
    double between_delay;         /* s that images between skies are behind; below 0: one interval */
    double rate;                  /* frames per second from the source; 0: as fast as they are rendered */
    double h264_bits;             /* maximum bits per second of the full-size track; 0: by size and rate */
    struct setting_texts publish_urls;
    struct publish_target publish[SETTING_TEXTS_MAX]; /* the parsed publish targets */
    struct server_desc server_desc;
    struct log_desc log;
    bool tells_links;      /* prints them once it listens */
    const char *state_dir; /* NULL: settings do not survive a restart */
    bool push;             /* producers send the frames */
    bool no_sandbox;       /* decode producers' files in this process */
    uint32_t max_side;     /* limit on a producer's image, in texels; 0: no limit, because the source is local */
    struct decoder_desc decoder_desc;
    double decode_seconds; /* time limit for a producer's file */
    bool computed_sky;
    struct sky_desc sky; /* where computed_sky */
};

/* The inputs of a config: those at startup, whose strings stay in use, and the latest reload. Zero it first. Thread:
 * main. */
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

/* Reloads everything (SIGHUP). Applies changes that are possible at run time and logs those that need a restart; on a
 * fault, logs it and changes nothing. */
void daemon_config_reload(struct config_readings *r, struct settings_store *settings, struct server *server);

/* ---- Links for people ---- */

/* relightd --show-link: the server's URLs for people and programs, with their tokens. */

/* Prints the URLs; codes: with QR codes for the page's. ERR_USAGE: the port is not known in advance. Main thread. */
MUST_CHECK enum err links_print(const struct server_desc *desc, FILE *out, bool codes, struct reason *why);

/* Writes the address at which a browser can open the page, by name where there is one, for a server on this port. */
void links_page(const struct server_desc *desc, uint16_t port, char *out, size_t size);

/* ---- share.c: other machines ---- */

/* The path of the token `name` in the folder of --share; make: folder and token are made if they are not there.
 * ERR_USAGE: others may write to the folder. ERR_IO. Main thread. */
MUST_CHECK enum err share_token(const char *dir, const char *name, bool make, char *path, size_t size,
                                struct reason *why);
/* Warns about tokens that are short or equal, and about a lack of TLS, where other machines reach the server. */
void share_warn(const struct server_desc *d);

/* ---- Flags ---- */

/* The flags of relightd, which are also the keys of a configuration file. Main thread. */

/* All flags and their values. */
struct daemon_flags {
    struct command command; /* contains pointers into itself: do not copy */
};

/* Sets every flag to its default. */
void daemon_flags_init(struct daemon_flags *f);

/* Translates the flags into *c, which must be zeroed. The table keeps the ownership of strings. ERR_USAGE names the
 * flag. */
MUST_CHECK enum err daemon_config_from_flags(struct daemon_flags *f, struct daemon_config *c, struct reason *why);
