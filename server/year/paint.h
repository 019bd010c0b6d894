/* An 8-bit sRGB canvas to paint on: rectangles, capital letters and digits, a colour scale, PNG files.
 * Thread: one per canvas. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stdint.h>

struct canvas {
    uint32_t width, height;
    uint8_t *rgb; /* [height][width][3] */
};

/* White. ERR_NOMEM. The caller frees it with canvas_finish. */
MUST_CHECK enum err canvas_init(struct canvas *c, uint32_t width, uint32_t height);
void canvas_finish(struct canvas *c); /* zeroed memory is allowed */

/* Clipped to the canvas. */
void paint_box(struct canvas *c, int x, int y, int width, int height, const uint8_t rgb[3]);

/* Letters are 4 x 6 times `scale` pixels, gaps included; small letters show as capitals, unknown ones as gaps. x, y:
 * top left of the first. */
void paint_text(struct canvas *c, int x, int y, int scale, const char *text, const uint8_t rgb[3]);
int paint_text_width(const char *text, int scale); /* pixels */

/* A scale of values, linear or logarithmic. */
struct paint_scale {
    double least, most; /* logarithmic: above 0 */
    bool logarithmic;
    const char *unit; /* "lx" */
};

double paint_share(const struct paint_scale *s, double value); /* 0..1; NaN stays NaN */

/* Steps between the labels of a legend. */
int paint_steps(const struct paint_scale *s);

/* The least number 1, 2 or 5 times a power of ten that is not below v > 0. */
double paint_round_up(double v);

#define PAINT_LEGEND_WIDTH 110 /* pixels */

/* A legend with labels, from the top left on, PAINT_LEGEND_WIDTH wide. */
void paint_legend(struct canvas *c, int x, int y, int height, const struct paint_scale *s);

/* Writes a PNG file, whole or not at all. Errors of png_encode and file_store. */
MUST_CHECK enum err canvas_write(const struct canvas *c, const char *path, struct reason *why);
