/* Decodes untrusted image files in a separate, sandboxed process (relight-decoder) without access to files, the network
 * or new processes, and with limited memory. If a file crashes, hangs or compromises that process, only its frame is
 * lost: it is refused with a reason, and the process is restarted. If the process ended before it had a file, or was
 * killed from outside, a new one gets the file. The result is untrusted too: sizes are checked, text is made printable,
 * and each texel is sanitised while it is copied out of shared memory, so that it cannot change afterwards. The texels
 * are identical to decode_image's. Thread: one at a time, except decoder_counts. */
#pragma once

#include "image/codec/decode.h"

#include <stdatomic.h>
#include <stdbool.h>

struct decoder;

/* Zero means the default. */
struct decoder_desc {
    const char *program;     /* default: relight-decoder beside this program, or in ../lib/relightd relative to it */
    size_t file_bytes;       /* limit of a file; default 256 MiB */
    size_t memory_bytes;     /* memory for decoding besides the file and the image; default 512 MiB */
    uint32_t timeout_ms;     /* per file; default 10 s */
    bool video;              /* start relight-video, which decodes video too (video.h) */
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
