/* server/publish/target.h */
/* Where live pictures are published: one --publish of relightd, taken apart. Functions of their arguments, any thread.
 */
#ifndef PUBLISH_TARGET_H
#define PUBLISH_TARGET_H

#include "base/err.h"

#include <stdbool.h>

#define PUBLISH_NAME 128
#define PUBLISH_PATH 1024

enum publish_kind {
    PUBLISH_RTMP,
    PUBLISH_RTSP,
    PUBLISH_SRT,
    PUBLISH_HLS,    /* a folder that a web server serves */
    PUBLISH_RECORD, /* a folder of recordings */
};

struct publish_target {
    enum publish_kind kind;
    const char *url;         /* as given; borrowed. It may hold keys: show `name` instead */
    char name[PUBLISH_NAME]; /* scheme and host, or scheme and folder; a long one is cut, quotes and the like are '?' */
    char folder[PUBLISH_PATH]; /* of PUBLISH_HLS and PUBLISH_RECORD */
    double file_s;             /* of PUBLISH_RECORD: length of a file */
    bool listens;              /* of PUBLISH_SRT: it waits for a receiver's call */
};

/* ERR_USAGE: says what would be right, without what may be secret. */
MUST_CHECK enum err publish_target_parse(const char *url, struct publish_target *out, struct reason *why);

/* Whether the folder of a target that has one can be written to, or created. ERR_IO: the reason names it. */
MUST_CHECK enum err publish_target_check(const struct publish_target *target, struct reason *why);

#endif
