/* What decoder.c and video.c share. Private to this room. Thread: one per decoder. */
#pragma once

#include "import/decoder/decoder.h"
#include "import/decoder/wire.h"
#include "import/sandbox/child.h"

/* Memory mapped by both processes. */
struct shared {
    int fd; /* -1: none */
    void *at;
    size_t bytes;
    size_t used; /* bytes that may be backed by pages */
};

struct decoder {
    char program[4096];
    size_t file_bytes, memory_bytes;
    uint32_t timeout_ms;
    const atomic_bool *stop;
    struct shared file, picture;

    struct child child;
    bool video;     /* it is relight-video */
    bool streaming; /* the process has a video stream */
    bool confined;
    unsigned crashes_in_row; /* consecutive crashes */
    int64_t restart_ms;      /* earliest restart */
    atomic_uint_fast64_t files, crashed, timed_out, invalid, refused, starts;
};

/* A running process, started if necessary; `name` is what it is for. ERR_IO, ERR_NOMEM. */
MUST_CHECK enum err decoder_ready(struct decoder *d, const char *name, struct reason *why);

/* Sends a request and waits for the answer. *idle: the process had ended before it had the request, or was killed from
 * outside: neither is the request's fault. Without an answer the process has ended, and *status is waitpid's. */
enum child_receipt decoder_ask(struct decoder *d, const struct wire_request *q, struct wire_answer *a, int *status,
                               bool *idle);

/* No valid answer came: count that, delay the restart and say why. */
enum err decoder_report_crash(struct decoder *d, enum child_receipt receipt, int status, const char *name,
                              struct reason *why);
enum err decoder_report_invalid(struct decoder *d, const char *name, struct reason *why);

/* Copies the shared texels into im->rgb, which has room for them. */
void decoder_take_texels(const struct decoder *d, struct image *im);

/* Returns memory to the system that only much larger contents than `bytes` needed. */
void decoder_trim(struct shared *s, size_t bytes);
