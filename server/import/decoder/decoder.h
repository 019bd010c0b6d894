/* Decodes untrusted image files in a separate, sandboxed process (relight-decoder) without access to files, the network
 * or new processes, and with limited memory. If a file crashes, hangs or compromises that process, only its frame is
 * lost: it is refused with a reason, and the process is restarted. If the process ended before it had a file, or was
 * killed from outside, a new one gets the file. The result is untrusted too: sizes are checked, text is made printable,
 * and each texel is sanitised while it is copied out of shared memory, so that it cannot change afterwards. The texels
 * are identical to decode_image's. Thread: one at a time, except decoder_counts. */
#pragma once

#include "image/codec/decode.h"
#include "image/codec/frame.h"
#include "image/codec/image.h"
#include "image/codec/signal.h"

#include <stdatomic.h>
#include <stdbool.h>

struct decoder;

/* Zero means the default. */
struct decoder_desc {
    const char *program;     /* default: relight-decoder beside this program, or in ../lib/relightd relative to it */
    size_t file_bytes;       /* limit of a file; default 256 MiB */
    size_t memory_bytes;     /* memory for decoding besides the file and the image; default 512 MiB */
    uint32_t timeout_ms;     /* per file; default 10 s */
    bool video;              /* start relight-video, which decodes video too (decoder.h) */
    const atomic_bool *stop; /* when set, a waiting call returns; may be NULL */
};

/* Starts the process. The caller owns *out, NULL on error. ERR_IO: cannot start, see *why. ERR_NOMEM. */
MUST_CHECK enum err decoder_create(const struct decoder_desc *desc, struct decoder **out, struct reason *why);
void decoder_destroy(struct decoder *d); /* ends the process; NULL is allowed */

/* Whether seccomp restricts the process's system calls; without it only the resource limits apply. */
bool decoder_is_confined(const struct decoder *d);

/* As decode_image; `context` is the decoder. Also ERR_FORMAT: the process crashed, timed out or sent an invalid answer.
 */
MUST_CHECK enum err decoder_decode(void *context, const uint8_t *bytes, size_t size, const char *name, struct image *im,
                                   struct reason *why);

/* Counts since the start. */
struct decoder_counts {
    uint64_t files;
    uint64_t crashed;   /* crashes of the process, on a file or while it was idle */
    uint64_t timed_out; /* files that exceeded the timeout */
    uint64_t invalid;   /* files for which it sent an invalid answer */
    uint64_t refused;   /* files refused unread after too many crashes */
    uint64_t starts;
};
void decoder_counts(const struct decoder *d, struct decoder_counts *out); /* thread: any */

/* ---- Video ---- */

/* Video streams decoded in the sandboxed process relight-video, packet by packet, to linear texels. The decoder
 * (decoder.h) must have been created with desc.video. If a packet crashes the process, the stream is lost:
 * video_is_open returns false, and the caller starts it again. Thread: one per decoder. */

#define VIDEO_NO_TIME INT64_MIN /* no time stamp */

/* Overrides what a stream says about its colours. */
struct video_colour {
    enum signal_transfer transfer; /* AUTO: as the stream says */
    double peak_cdm2;              /* as signal_desc.peak_cdm2; 0: default */
};

struct video_desc {
    const struct stream_format *format;
    const uint8_t *extra; /* of the codec; may be NULL */
    size_t extra_size;
    struct video_colour colour;
    uint32_t max_side; /* of images, texels; 0: IMAGE_MAX_SIDE */
    const char *name;  /* for messages */
};

/* Begins a stream; an earlier one is forgotten. ERR_UNSUPPORTED: no decoder for its codec. ERR_FORMAT, ERR_RANGE,
 * ERR_NOMEM, ERR_IO: no process. */
MUST_CHECK enum err video_open(struct decoder *d, const struct video_desc *desc, struct reason *why);
bool video_is_open(const struct decoder *d);

struct video_image {
    bool ready;      /* there is one; video_convert has its texels until there is another, or video_flush */
    int64_t time_us; /* its time stamp, or VIDEO_NO_TIME */
};

struct video_packet {
    const uint8_t *bytes;
    size_t size;
    int64_t time_us;
    bool hidden; /* its image is not wanted, except by later packets */
};

/* The packet's first image. Call video_next until it has none, before the next packet. ERR_FORMAT: the packet is
 * damaged; the stream continues if video_is_open. */
MUST_CHECK enum err video_packet(struct decoder *d, const struct video_desc *desc, const struct video_packet *packet,
                                 struct video_image *out, struct reason *why);
MUST_CHECK enum err video_next(struct decoder *d, const struct video_desc *desc, struct video_image *out,
                               struct reason *why);
/* After the last packet: the images held back, one a call. */
MUST_CHECK enum err video_drain(struct decoder *d, const struct video_desc *desc, struct video_image *out,
                                struct reason *why);
/* The next packet comes from elsewhere in the stream. */
MUST_CHECK enum err video_flush(struct decoder *d, const struct video_desc *desc, struct reason *why);

struct video_state {
    enum signal_transfer transfer; /* of the image */
    bool assumed;                  /* the stream does not state it */
    enum layout layout;            /* by the metadata; AUTO: none */
    char note[320];                /* as image.note */
};

/* The texels of the last image: linear Rec.709, cd/m^2, as FRAME_TEXELS. ERR_UNSUPPORTED: its pixel format or colour.
 * ERR_RANGE, ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err video_convert(struct decoder *d, const struct video_desc *desc, struct frame *f,
                                  struct video_state *out, struct reason *why);
