/* Writes images: a file per frame, or one video; the extension selects the format. A new kind of output is one row
 * of the table in output.c. One thread. */
#pragma once

#include "base/err.h"
#include "image/film/film.h"

#include <stdbool.h>
#include <stdint.h>

struct output_desc {
    const char *pattern;  /* a file name, with %d or %04d for the frame number; "-": standard output. Borrowed. */
    const char *format;   /* of standard output: "png" and so on; else NULL: as the name ends */
    bool alpha;           /* EXR, PNG: output_write gets a foreground with its alpha */
    bool deep;            /* PNG: 16 bits instead of 8 */
    bool layers;          /* EXR: output_set_layers will be called */
    bool half;            /* EXR: 16-bit floats instead of 32-bit */
    enum tone_curve tone; /* JPEG, PNG, video; TONE_PQ: video alone */
    int quality;          /* JPEG, video: 1 to 100 */
    double rate;          /* video: frames per second */
    const char *level;    /* CPU level of the tone curve, as kernels_select takes it; NULL: the best */
};

struct output;

/* ERR_USAGE: no such pattern, or an extension that no format has, or one without alpha, 16 bits or PQ that asks
 * for them; the reason lists those there are. Also if standard output is a terminal. ERR_UNSUPPORTED: no video in this
 * build, or not of this size. ERR_IO: the folder cannot be written. ERR_NOMEM. On ERR_OK the caller owns *out. */
MUST_CHECK enum err output_create(const struct output_desc *desc, uint32_t width, uint32_t height, struct output **out,
                                  struct reason *why);
void output_destroy(struct output *o); /* NULL is allowed */

bool output_has_movies(void); /* whether this build writes video files */

/* ERR_USAGE unless desc is one that output_create takes; needs no image size. Touches no file. */
MUST_CHECK enum err output_check(const struct output_desc *desc, struct reason *why);

/* Completes a video and gives the file its name; it accepts no more frames. Other files are complete already. Without
 * this call, or without a frame, there is no video. ERR_IO, ERR_NOMEM, ERR_UNSUPPORTED: the encoder failed. */
MUST_CHECK enum err output_finish(struct output *o, struct reason *why);

/* The extension of the format, such as ".png"; NULL: output_check refuses the desc. */
const char *output_extension(const struct output_desc *desc);

/* Whether many frames may go there; else all have one name, without a place for their number. */
bool output_is_numbered(const struct output *o);

/* Whether frames go one behind another into one file: a video, or standard output. */
bool output_is_stream(const struct output *o);
bool output_is_movie(const struct output *o); /* a video; NULL: none */

/* Whether the file of a frame is there: files appear whole. */
bool output_exists(const struct output *o, uint64_t frame);

/* The numbers of the frames whose files are there, ascending, to be freed with mem_free; of a numbered pattern. */
MUST_CHECK enum err output_numbers(const struct output *o, uint64_t **out, size_t *count);

/* Whether the format is tone-mapped, under an exposure. */
bool output_is_exposed(const struct output *o);

/* That of the last image, stops. */
double output_exposure(const struct output *o);

/* From now on the gain is 2^stops; without, exposure adapts from frame to frame, by rgb. */
void output_fix_exposure(struct output *o, double stops);

struct exr_channel;
struct exr_attribute;

/* EXR: every image gets these channels, with the values that they have then, and attributes. Borrowed. */
void output_set_layers(struct output *o, const struct exr_channel *channels, size_t channel_count,
                       const struct exr_attribute *attributes, size_t attribute_count);

/* Writes the image of a frame, float rgb[height][width][3], linear, whole or not at all. rgba: with desc.alpha its
 * foreground, float[height][width][4], premultiplied, which is written instead; else NULL. PNG has straight alpha:
 * light that its alpha does not cover is cut off. ERR_IO, ERR_NOMEM;
 * ERR_RANGE: the name becomes too long. */
MUST_CHECK enum err output_write(struct output *o, const float *rgb, const float *rgba, uint64_t frame,
                                 struct reason *why);
