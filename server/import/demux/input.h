/* Where relight-demux's bytes come from: memory that maps a file, or the protocols that a URL may use. Thread: main. */
#pragma once

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct AVIOContext;

/* A file in memory. */
struct input_file {
    const uint8_t *bytes;
    size_t size, at;
};

/* Reads and seeks in *f, which must outlive it. NULL: out of memory. */
struct AVIOContext *input_from_file(struct input_file *f);
void input_finish(struct AVIOContext **io);

/* The protocols that this URL needs, for libavformat's protocol_whitelist; NULL: no network source. Never file: a
 * playlist or a redirection must not reach local files. */
const char *input_protocols(const char *url);

/* The containers that this program reads, for libavformat's format_whitelist: none that refers to further files by
 * name, except playlists of network sources. */
const char *input_formats(bool is_file);
