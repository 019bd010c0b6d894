/* A destination of the live stream: one parsed --publish of relightd. Pure functions. Thread: any.
 */
#pragma once

#include "base/err.h"

#include <stdbool.h>

#define PUBLISH_NAME 128  /* for the log; longer ones are cut */
#define PUBLISH_PATH 1024 /* bounds paths of folders */

enum publish_kind {
    PUBLISH_RTMP,
    PUBLISH_RTSP,
    PUBLISH_SRT,
    PUBLISH_HLS,    /* a folder for a web server to serve */
    PUBLISH_RECORD, /* a folder of recordings */
};

struct publish_target {
    enum publish_kind kind;
    const char *url;           /* as given; borrowed. It may contain keys: display `name` instead */
    char name[PUBLISH_NAME];   /* scheme and host, or scheme and folder; truncated if long, with quotes, control
                                  characters and what is not UTF-8 replaced by '?' */
    char folder[PUBLISH_PATH]; /* of PUBLISH_HLS and PUBLISH_RECORD */
    double file_s;             /* of PUBLISH_RECORD: length of a file */
    bool listens;              /* of PUBLISH_SRT: listens for a receiver's call */
};

/* ERR_USAGE: states the valid form, without secrets. */
MUST_CHECK enum err publish_target_parse(const char *url, struct publish_target *out, struct reason *why);

/* Whether a target's folder, if any, is writable or can be created. ERR_IO: the reason names it. */
MUST_CHECK enum err publish_target_check(const struct publish_target *target, struct reason *why);
