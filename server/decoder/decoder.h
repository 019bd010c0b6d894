/* server/decoder/decoder.h */
/* Decodes picture files that came from a stranger, in a process of its own (relight-decoder) that can do nothing else:
 * no files, no network, no new processes, so much memory and no more. Whatever a file makes of that process, dead, hung
 * or taken over, costs the frame it was in: it is refused with a reason, and the process started anew.
 * What comes back is data of a stranger still: sizes are checked, words made printable, and each texel is put right
 * while it is copied out of the memory that both see, so that nothing can change it afterwards. The bits are those of
 * decode_image. Thread: one at a time, but for decoder_counts. */
#ifndef DECODER_DECODER_H
#define DECODER_DECODER_H

#include "decode.h"

#include <stdatomic.h>
#include <stdbool.h>

struct decoder;

/* Zero means the default. */
struct decoder_desc {
    const char *program;     /* default: relight-decoder beside this program, or in ../lib/relightd from there */
    size_t file_bytes;       /* of the largest file; default 256 MiB */
    size_t memory_bytes;     /* that decoding may take beside the file and the picture; default 512 MiB */
    uint32_t patience_ms;    /* for one file; default 10 s */
    const atomic_bool *stop; /* set: whoever waits for a file gives up; may be NULL */
};

/* Starts the process. ERR_IO: it cannot be started: *why says why. ERR_NOMEM. On any error *out is NULL. */
MUST_CHECK enum err decoder_create(const struct decoder_desc *desc, struct decoder **out, struct reason *why);
void decoder_destroy(struct decoder *d); /* ends the process; NULL is allowed */

/* Whether the kernel holds the process to its few system calls; without seccomp the other limits stand alone. */
bool decoder_is_confined(const struct decoder *d);

/* As decode_image, with the decoder as context. ERR_FORMAT also when the process did not survive the file. */
MUST_CHECK enum err decoder_decode(void *context, const uint8_t *bytes, size_t size, const char *name, struct image *im,
                                   struct reason *why);

/* Since the start. Any thread. */
struct decoder_counts {
    uint64_t files;
    uint64_t died;   /* files that the process did not survive, */
    uint64_t hung;   /* that it was not done with in time, */
    uint64_t lied;   /* or that it answered with nonsense */
    uint64_t waited; /* refused unread, since the process had died too often of late */
    uint64_t starts;
};
void decoder_counts(const struct decoder *d, struct decoder_counts *out);

#endif
