/* The encode thread's own data. Only encode*.c include this. */
#ifndef DAEMON_ENCODE_PARTS_H
#define DAEMON_ENCODE_PARTS_H

#include "daemon/encode.h"
#include "daemon/shared.h"

#include "codec/jpeg.h"
#include "film/film.h"
#include "film/scale.h"
#include "video/h264.h"

#include <pthread.h>

/* H.264 pictures of one size and rate (stream/server.h). */
struct video_track {
    struct h264_encoder *encoder; /* NULL: nobody watches */
    double key_s;                 /* time of the last key picture (clock_seconds) */
    double due_s;                 /* no picture before this time */
    double coded_s;               /* time of the last picture */
    bool behind;                  /* the current picture was left out */
};

struct encode_thread {
    struct shared *shared;
    struct jpeg_encoder *jpeg;
    struct exposure exposure;
    uint64_t exposed; /* number of the last frame that exposure has seen */
    bool held;        /* the last picture was under EXPOSURE_AUTO */
    float gain;       /* automatic exposure's, without the bias */
    struct video_track video[SERVER_TRACKS];
    bool h264_failed; /* and this was logged */

    /* The current picture, uint8_t[height][width][3] sRGB, at full, half and quarter size. */
    uint8_t *display[SERVER_SCALES];
    unsigned display_valid;          /* bits 1 << scale */
    struct protocol_picture current; /* header of the full size; format 0: no picture yet */
    unsigned sent_jpeg;              /* bits 1 << scale: published as JPEG */
    unsigned sent_exr;               /* bits 1 << enum protocol_format: published as EXR */
    float *small;                    /* scratch, float[height / 2][width / 2][3] */

    struct scaler *scaler;
    uint64_t rendered[SERVER_RENDITIONS]; /* serials of the renditions published of the current picture */
    double still_due_s;                   /* none for single pictures before this time (clock_seconds) */

    pthread_t thread;
    bool running;
};

/* Encode thread, all of what follows. */

/* Publishes an encoded picture; in->header says what it is. track: of H.264, else 0. bytes are copied. */
void encode_publish(struct encode_thread *t, struct shaded *in, unsigned track, const uint8_t *bytes, size_t size);

/* ---- encode_rendition.c ---- */

/* Publishes the wanted renditions of the current picture that are missing. in->rgb NULL: the linear picture is gone.
 * False: one needs it. */
bool renditions_encode(struct encode_thread *t, const struct shaded *in, const struct server_demand *demand,
                       int quality);

/* ---- encode_video.c ---- */

/* Destroys the encoders of tracks that nobody watches. A new viewer needs a key picture, which a new encoder makes. */
void video_drop_unwatched(struct encode_thread *t, const struct server_demand *demand);
/* Encodes the new picture in t->display[scale] for each watched track of that scale. tone_ms: time spent on the tone
 * curve. Returns the milliseconds spent. */
double video_encode(struct encode_thread *t, const struct shaded *in, unsigned scale, double tone_ms,
                    const struct server_demand *demand);
/* While no newer picture comes: encodes the current one for tracks that left it out or need a key picture. */
void video_encode_again(struct encode_thread *t, const struct shaded *in, unsigned scale,
                        const struct server_demand *demand);
/* Milliseconds until a track that left out the current picture may have it; most_ms at most, 1 at least. */
int video_wait_ms(struct encode_thread *t, int most_ms);
void video_finish(struct encode_thread *t);

#endif
