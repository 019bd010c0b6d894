/* What decoder.c and video.c share. Private to this room. Thread: one per decoder. */
#pragma once

#include "import/decoder/decoder.h"
#include "import/decoder/wire.h"
#include "import/sandbox/child.h"

struct decoder {
    char program[4096];
    size_t file_bytes, memory_bytes;
    uint32_t timeout_ms;
    const atomic_bool *stop;
    struct child_memory file, picture;

    struct child child;
    bool video;              /* it is relight-video */
    bool streaming;          /* the process has a video stream */
    unsigned crashes_in_row; /* consecutive crashes */
    int64_t restart_ms;      /* earliest restart */
    atomic_uint_fast64_t files, crashed, timed_out, invalid, refused, starts;
};

/* Sends a request with q->size bytes beside it, to a running process, started if necessary, and waits for the answer.
 * On ERR_OK *a is a valid one. Else counts what went wrong, if it was the process, and delays its restart. */
MUST_CHECK enum err decoder_exchange(struct decoder *d, const struct wire_request *q, const uint8_t *bytes,
                                     struct wire_answer *a, struct reason *why);

/* What the answer says is not valid: counts that, delays the restart and says so. */
enum err decoder_report_invalid(struct decoder *d, const char *name, struct reason *why);

/* Copies the shared texels into im->rgb, which has room for them, and counts what had to be corrected: nothing, unless
 * the process was taken over. */
void decoder_take_texels(const struct decoder *d, struct image *im);

/* Returns memory to the system that only much larger contents than `bytes` needed. */
void decoder_trim(struct child_memory *m, size_t bytes);
