/* The encode thread: applies exposure and tone curve, then encodes each image in every format that has viewers: JPEG,
 * H.264, EXR. */
#pragma once

#include "base/err.h"
#include "image/codec/encode.h"
#include "image/film/film.h"
#include "image/video/h264.h"
#include "relightd/daemon/shared.h"

#include <pthread.h>

struct encode_thread;

/* shared must outlive the thread. ERR_NOMEM: *out is NULL. Main thread. */
MUST_CHECK enum err encode_thread_create(struct shared *shared, struct encode_thread **out, struct reason *why);

/* Starts to encode images from shared->images. ERR_NOMEM: no thread. Main thread. */
MUST_CHECK enum err encode_thread_start(struct encode_thread *t, struct reason *why);

/* Encodes and publishes one image and completes its header. Thread: encode; tests may call it instead. */
void encode_image(struct encode_thread *t, struct shaded *in);

/* Waits for the thread, which ends when the images' handoff is closed. Main thread. NULL is allowed. */
void encode_thread_destroy(struct encode_thread *t);

/* The encode thread's private data. Only encode*.c use it. */

/* An H.264 track of one size and rate (net/stream/server.h). */
struct video_track {
    struct h264_encoder *encoder; /* NULL: no viewers */
    double key_s;                 /* time of the last keyframe (clock_seconds) */
    double due_s;                 /* no image before this time */
    double coded_s;               /* time of the last image */
    bool behind;                  /* the current image was skipped */
};

struct encode_thread {
    struct shared *shared;
    struct jpeg_encoder *jpeg;
    struct exposure exposure;
    uint64_t exposed; /* number of the last frame that updated the exposure */
    bool held;        /* the last image used EXPOSURE_AUTO */
    float gain;       /* automatic exposure without the bias */
    struct video_track video[SERVER_TRACKS];
    bool h264_failed; /* H.264 failed, and that was logged */

    /* The current image, uint8_t[height][width][3] sRGB, at full, half and quarter size. */
    uint8_t *display[SERVER_SCALES];
    unsigned display_valid;          /* bits 1 << scale */
    struct protocol_picture current; /* header of the full size; format 0: no image yet */
    double current_s;                /* when it came (clock_seconds) */
    unsigned sent_jpeg;              /* bits 1 << scale: published as JPEG */
    unsigned sent_exr;               /* bits 1 << enum protocol_format: published as EXR */
    float *small;                    /* scratch, float[height / 2][width / 2][3] */

    uint64_t rendered[SERVER_RENDITIONS]; /* serials of the current image's published renditions */
    double renditions_due_s;              /* none before this time (clock_seconds) */
    struct {
        uint32_t owner;
        double at_s;
    } served[SERVER_RENDITIONS]; /* whose rendition was made last in this slot, and when */

    pthread_t thread;
    bool running;
};

/* Encode thread, all of what follows. */

/* Publishes an encoded image that in->header describes. track: of H.264, else 0. bytes are copied. Thread: encode, as
 * for all functions below. */
void encode_publish(struct encode_thread *t, struct shaded *in, unsigned track, const uint8_t *bytes, size_t size);

/* Makes the pixels to be shown of the image `in` from its linear ones, or from those of a smaller version. */
void encode_display(struct encode_thread *t, const struct shaded *in, const float *rgb, uint32_t width, uint32_t height,
                    uint8_t *display);

/* ---- encode_rendition.c ---- */

/* Publishes the missing renditions of the current image that are in demand. in->rgb NULL: the linear image is gone.
 * Returns false if a rendition needs it, of another width or as EXR. */
bool renditions_encode(struct encode_thread *t, const struct shaded *in, const struct server_demand *demand,
                       int quality);

/* ---- encode_video.c ---- */

/* Destroys the encoders of tracks without viewers. A new viewer needs a keyframe, with which a new encoder begins. */
void video_drop_unwatched(struct encode_thread *t, const struct server_demand *demand);
/* Encodes the new image in t->display[scale] for each track of that scale with viewers. tone_ms: time spent on the
 * tone curve. Returns the milliseconds spent. */
double video_encode(struct encode_thread *t, const struct shaded *in, unsigned scale, double tone_ms,
                    const struct server_demand *demand);
/* While no newer image arrives: encodes the current one for tracks that skipped it or need a keyframe. */
void video_encode_again(struct encode_thread *t, const struct shaded *in, unsigned scale,
                        const struct server_demand *demand);
/* Milliseconds until a track that skipped the current image may encode it; at most most_ms, at least 1. */
int video_wait_ms(struct encode_thread *t, int most_ms);
void video_finish(struct encode_thread *t);
