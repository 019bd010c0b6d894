/* Clips for tests, made by the program ffmpeg from raw images whose code values are known. */
#pragma once

#include "sky/source/folder.h"

#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

enum { CLIP_WIDTH = 256, CLIP_HEIGHT = 128, CLIP_BANDS = 16 };

/* Runs a shell command; skips the test if ffmpeg is not installed. */
static inline void clips_run(const char *format, ...)
{
    char command[4096];
    va_list arguments;

    if (system("command -v ffmpeg >/dev/null") != 0) {
        printf("skipped: ffmpeg is not installed\n");
        fflush(stdout);
        exit(UNIT_SKIPPED);
    }
    va_start(arguments, format);
    vsnprintf(command, sizeof(command), format, arguments);
    va_end(arguments);
    if (system(command) != 0)
        fail_msg("failed: %s", command);
}

/* The code value of band k of a grey ramp from black to white. */
static inline unsigned clips_code(unsigned depth, bool full, unsigned k)
{
    const double unit = 1u << (depth - 8), black = full ? 0.0 : 16.0 * unit,
                 white = full ? (double)((1u << depth) - 1u) : 235.0 * unit;

    return (unsigned)(black + (white - black) * k / (CLIP_BANDS - 1) + 0.5);
}

/* Writes `frames` raw images of yuv420p or yuv420p10le: the ramp across, without colour. */
static inline void clips_ramp(const char *path, unsigned depth, bool full, unsigned frames)
{
    const unsigned bytes = depth > 8 ? 2 : 1;
    FILE *f = fopen(path, "wb");

    assert_non_null(f);
    for (unsigned n = 0; n < frames; n++) {
        for (unsigned i = 0; i < CLIP_WIDTH * CLIP_HEIGHT; i++) {
            const unsigned v = clips_code(depth, full, i % CLIP_WIDTH / (CLIP_WIDTH / CLIP_BANDS));
            const uint8_t b[2] = { (uint8_t)v, (uint8_t)(v >> 8) };
            assert_int_equal(fwrite(b, bytes, 1, f), 1);
        }
        for (unsigned i = 0; i < CLIP_WIDTH * CLIP_HEIGHT / 2; i++) {
            const unsigned v = 128u << (depth - 8);
            const uint8_t b[2] = { (uint8_t)v, (uint8_t)(v >> 8) };
            assert_int_equal(fwrite(b, bytes, 1, f), 1);
        }
    }
    assert_int_equal(fclose(f), 0);
}

#define CLIP_RAW8 "ffmpeg -v error -y -f rawvideo -pix_fmt yuv420p -s 256x128 -r 25 -i %s "
#define CLIP_RAW10 "ffmpeg -v error -y -f rawvideo -pix_fmt yuv420p10le -s 256x128 -r 25 -i %s "
