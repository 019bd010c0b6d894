/* What a source consists of. Private to this room. Thread: one per source. */
#pragma once

#include "sky/between/between.h"
#include "sky/daylight/sky.h"
#include "sky/source/files.h"
#include "sky/source/footage.h"
#include "sky/source/source.h"

struct source {
    struct source_desc desc;
    enum source_kind kind;
    struct setting_frames frames;
    bool loop;
    int wait_ms;            /* at most, for what comes by itself */
    bool repeats;           /* SOURCE_FILES: its one file is every frame of the range */
    struct file_list files; /* SOURCE_FILES: only files within the range */
    struct watch watch;     /* SOURCE_WATCH */
    struct sky_desc sky;    /* SOURCE_SKY */
    uint64_t sky_frame;     /* of the next frame */
    uint64_t position;      /* of the last frame returned */
    bool sky_ended;
    struct daylight *daylight; /* SOURCE_DAYLIGHT */
    size_t daylight_first;     /* of its frames, the first in the range, */
    size_t daylight_count;     /* how many of them are, */
    size_t daylight_next;      /* and the next, from 0 */
    struct footage *footage;   /* SOURCE_VIDEO */
    struct live *live;         /* SOURCE_LIVE */
    uint64_t picture;          /* SOURCE_VIDEO: number of the next; SOURCE_LIVE: of the next to be taken */
    uint64_t length;           /* SOURCE_VIDEO: images in a pass, once one is over; 0: not yet known */
    bool video_ended;          /* the pass is over, or the video broke off */
    struct held *held;         /* NULL: each frame is one image */
};

/* ---- Frames as they are, one for each sky ---- */

MUST_CHECK enum err source_next_sky(struct source *s, struct frame *f, struct reason *why); /* as source_next */
uint64_t source_count_skies(const struct source *s);                                        /* as source_count */
bool source_seek_sky(struct source *s, uint64_t position);                                  /* as source_seek */
uint64_t source_first_number(const struct source *s); /* of the frame at position 0 */

/* ---- Several images from one frame to the next (held.c) ---- */

/* Of an open source that can be sought in. ERR_NOMEM. */
MUST_CHECK enum err held_create(struct source *s, const struct between_desc *desc, struct reason *why);
void held_destroy(struct held *h); /* NULL is allowed */

/* As the source's functions of these names, in images. */
MUST_CHECK enum err held_next(struct source *s, struct frame *f, struct reason *why);
uint64_t held_count(const struct source *s);
uint64_t held_position(const struct source *s);
bool held_seek(struct source *s, uint64_t position);

const struct sky_desc *held_sky(const struct source *s); /* whose numbers are those of images */

/* The frames at these positions are others from now on. */
void held_restart(struct source *s);
