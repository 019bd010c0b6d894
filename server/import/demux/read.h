/* The work of relight-demux: one container or network stream, through libavformat. Thread: main. */
#pragma once

#include "base/err.h"
#include "import/demux/wire.h"

#include <stddef.h>

struct reading;

struct reading_desc {
    const uint8_t *file; /* the whole file, or NULL: a URL */
    size_t file_bytes;
    const char *ca;     /* as struct demux_desc has it */
    const char *device; /* input format of a device ("v4l2"), or NULL */
    uint8_t *packet;    /* where packets go */
    size_t packet_bytes;
};

struct reading *reading_create(const struct reading_desc *desc); /* NULL: out of memory */
void reading_destroy(struct reading *r);                         /* NULL is allowed */

/* Each fills *a as its wire message says, and returns what goes to a->result. `url` is "" of a file. */
enum err reading_open(struct reading *r, const char *url, struct demux_answer *a);
enum err reading_next(struct reading *r, struct demux_answer *a);
enum err reading_seek(struct reading *r, int64_t time_us, struct demux_answer *a);
