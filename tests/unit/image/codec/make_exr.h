/* OpenEXR files in memory, written by OpenEXRCore's own writer, for tests and for the corpus of the fuzzers. */
#pragma once

#include <openexr.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct made_channel {
    const char *name; /* NULL ends the list; in the order of the alphabet, as the format wants it */
    exr_pixel_type_t type;
};

struct made_attribute {
    const char *name; /* NULL ends the list */
    const char *text; /* NULL: a number */
    float number;
};

struct exr_recipe {
    const struct made_channel *channels;
    exr_compression_t compression;
    int32_t width, height;
    int32_t left, top;                 /* of the data window */
    const int32_t *display;            /* int32_t[4]: left, top, right, bottom; NULL: the data window */
    const char *name;                  /* of the part; NULL: a number */
    float aspect;                      /* of a pixel; 0: 1 */
    int32_t tile_w, tile_h;            /* 0: scanlines */
    exr_tile_level_mode_t levels;      /* of tiles; the writer manages rip maps of one row only */
    bool decreasing;                   /* rows from the bottom up in the file */
    bool deep;                         /* deep scanlines of one black sample a texel */
    int subsampling;                   /* of each channel, both ways; 0: none */
    const float *chromaticities;       /* float[8]: red, green, blue, white; NULL: none */
    const struct made_attribute *more; /* NULL: none */
    int envmap;                        /* 1 + exr_envmap_t; 0: none */
    /* Value of texel (x, y), counted from the data window's corner, in channel c of the list. NULL: recipe_value. */
    float (*value)(int c, int32_t x, int32_t y);
};

/* A pattern that half floats hold exactly, different in each channel: multiples of 1/16 below 16. */
float recipe_value(int c, int32_t x, int32_t y);

/* The file with `parts` parts; the caller frees it with free(). Ends the program when it cannot be written. */
uint8_t *exr_make_parts(const struct exr_recipe *recipes, int parts, size_t *size);
uint8_t *exr_make(const struct exr_recipe *recipe, size_t *size);
