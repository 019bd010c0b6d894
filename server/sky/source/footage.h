/* The frames of a video, one after another: packets from relight-demux (demux/), decoded in relight-video (decoder/).
 * Private to this room. Thread: one per footage. */
#pragma once

#include "image/codec/frame.h"
#include "import/decoder/decoder.h"
#include "import/demux/demux.h"

#define FOOTAGE_RATE_MAX 240.0 /* frames per second; a stream that claims more is played at FOOTAGE_RATE */
#define FOOTAGE_RATE 30.0

struct footage_desc {
    const char *spec; /* must outlive the footage */
    struct video_colour colour;
    const char *ca;          /* see demux.h; must outlive it too */
    const atomic_bool *stop; /* when set, calls return soon; may be NULL */
};

struct footage;

/* Connects and starts the decoder. The caller owns *out, NULL on error. Errors of demux_open and decoder_create. */
MUST_CHECK enum err footage_open(const struct footage_desc *desc, struct footage **out, struct reason *why);
void footage_close(struct footage *f); /* NULL is allowed */

/* Decodes until there is another image (*ready) or for wait_ms. A damaged packet is passed over, with one line in the
 * log. ERR_END: no image is left. Other errors: the stream broke off; only footage_restart and footage_close are
 * allowed then. */
MUST_CHECK enum err footage_next(struct footage *f, int wait_ms, bool *ready, struct reason *why);

/* The last image's time stamp in microseconds, or VIDEO_NO_TIME. */
int64_t footage_time_us(const struct footage *f);
/* What the stream says about itself, until the next call. */
const struct stream_format *footage_format(const struct footage *f);
/* Its rate, if it is credible, else FOOTAGE_RATE. */
double footage_rate(const struct footage *f);

/* The last image as FRAME_TEXELS, with name and layout; number and capture time are the caller's. Errors of
 * video_convert. */
MUST_CHECK enum err footage_convert(struct footage *f, struct frame *out, struct reason *why);

/* Begins again: connects again unless the stream can be read from its start. Errors of footage_open. */
MUST_CHECK enum err footage_restart(struct footage *f, struct reason *why);
/* The next image is the first at or after time_us, counted from the stream's first time stamp. ERR_UNSUPPORTED: the
 * stream cannot be read from another place; then, and after other errors, use footage_restart. */
MUST_CHECK enum err footage_seek(struct footage *f, int64_t time_us, struct reason *why);

/* ---- Live streams ---- */

/* A live stream or a camera: a thread decodes it and converts the newest frame on request. A lost
 * connection is retried with growing delays. Private to this room. Thread: one per live, beside its own. */

struct live;

/* Whether the first video from a web server has a length, and so is a file and not a live stream. The thread has then
 * ended: the video can be opened as a file. */
bool live_is_recording(struct live *l);

/* Starts the thread, which connects. first: an open footage that it takes over, or NULL. tries: it gives up after
 * this many connections without a single frame; 0: never. ERR_NOMEM: then `first` still belongs to the caller. */
MUST_CHECK enum err live_start(const struct footage_desc *desc, struct footage *first, unsigned tries,
                               struct live **out, struct reason *why);
void live_stop(struct live *l); /* waits for the thread; NULL is allowed */

/* The newest image that was not returned before, waiting up to wait_ms for one; else f->kind is FRAME_NONE. Sets
 * everything but the number. capture_us: from the time stamps and the sender's clock if the stream states it, else from
 * when they arrived. Errors of footage_convert; ERR_IO, each time: the thread gave up (live_gave_up). */
MUST_CHECK enum err live_next(struct live *l, int wait_ms, struct frame *f, struct reason *why);

/* Whether the thread has ended because it gave up. */
bool live_gave_up(struct live *l);

/* Whether images come; else *why says what is wrong, or that it is connecting. */
bool live_is_connected(struct live *l, struct reason *why);
