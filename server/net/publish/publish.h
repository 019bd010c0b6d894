/* Publishes the live stream to other programs: H.264 over RTMP, RTSP and SRT, as HLS in a folder, and as recordings.
 * Each target has a thread and a bounded queue: a slow or dead target loses only its own images and is retried
 * after 0.5 to 10 s. All targets share the encoded images with the viewers. */
#pragma once

#include "base/err.h"
#include "net/access/figures.h"

#include <stdbool.h>
#include <stdint.h>

/* ---- Targets ---- */

/* A destination of the live stream: one parsed --publish of relightd. Pure functions. Thread: any.
 */

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

struct sent_image;
struct publisher;

/* Whether this build and this machine can publish. ERR_UNSUPPORTED: the reason says what is missing. Thread: any. */
MUST_CHECK enum err publish_available(struct reason *why);

/* Starts a thread for each target. The targets' strings must outlive the publisher. ERR_NOMEM: *out is NULL. */
MUST_CHECK enum err publisher_create(const struct publish_target *targets, uint32_t count, struct publisher **out,
                                     struct reason *why);

/* Whether a target accepts images now; *key: one of them needs a keyframe. p may be NULL: false. Thread: any. */
bool publisher_wants(struct publisher *p, bool *key);

/* Offers an image whose payload is an H.264 access unit in Annex B format to all targets; never blocks. Call it before
 * the image is published elsewhere. time_us: any monotonic clock. p may be NULL. One thread at a time. */
void publisher_push(struct publisher *p, struct sent_image *image, int64_t time_us);

/* Writes the status of each target. Returns their number. p may be NULL: 0. Thread: any. */
uint32_t publisher_report(struct publisher *p, struct server_publish out[SERVER_PUBLISH_MAX]);

/* Completes files, closes connections and ends the threads, within a second. False: a thread still waits for a name
 * server and keeps its memory, so the program should end with _exit. NULL is allowed. */
bool publisher_destroy(struct publisher *p);
