#include "measure/compare/error_map.h"

#include "base/mem.h"

#include <math.h>
#include <png.h>
#include <stdbool.h>
#include <string.h>

#define COLOURS 256        /* of the ramp */
#define LEAST_LOG10 (-3.0) /* relative error of the darkest colour: 0.1 % */
#define MOST_LOG10 0.0     /* of the palest: 100 % */
#define MASKED_GREY 96

/* The scale below the image, in pixels; images too narrow for its labels go without. */
#define SCALE_HEIGHT 34
#define SCALE_LEAST_WIDTH 160
#define MARGIN 20
#define BAR_TOP 7
#define BAR_HEIGHT 10
#define TICK_HEIGHT 3
#define LABEL_TOP 22
#define FONT_ZOOM 2

struct canvas {
    uint8_t *rgb; /* [height][width][3] */
    uint32_t width, height;
};

struct colour {
    uint8_t c[3];
};

/* Place of a squared relative error on the ramp; 0 and what is below the scale are its start. */
static int place(float squared)
{
    if (!(squared > 0.0f))
        return 0;
    const double t = (0.5 * log10((double)squared) - LEAST_LOG10) / (MOST_LOG10 - LEAST_LOG10);
    return (int)lround(fmin(fmax(t, 0.0), 1.0) * (COLOURS - 1));
}

static void put(struct canvas *v, uint32_t x, uint32_t y, struct colour c)
{
    if (x < v->width && y < v->height)
        memcpy(v->rgb + ((size_t)y * v->width + x) * 3, c.c, 3);
}

static void fill(struct canvas *v, uint32_t x, uint32_t y, uint32_t width, uint32_t height, struct colour c)
{
    for (uint32_t j = 0; j < height; j++)
        for (uint32_t i = 0; i < width; i++)
            put(v, x + i, y + j, c);
}

/* The few characters of the labels, 3 x 5 dots, rows of 3 bits from the top. */
static const struct glyph {
    char character;
    uint8_t row[5];
} glyphs[] = {
    { '0', { 7, 5, 5, 5, 7 } },
    { '1', { 2, 6, 2, 2, 7 } },
    { '.', { 0, 0, 0, 0, 2 } },
    { '%', { 5, 1, 2, 4, 5 } },
};

static void write_text(struct canvas *v, uint32_t centre, uint32_t y, const char *text, struct colour c)
{
    const uint32_t advance = 4 * FONT_ZOOM;
    uint32_t x = centre - (uint32_t)strlen(text) * advance / 2;

    for (; *text; text++, x += advance)
        for (size_t g = 0; g < sizeof(glyphs) / sizeof(glyphs[0]); g++)
            for (uint32_t dot = 0; glyphs[g].character == *text && dot < 15; dot++)
                if (glyphs[g].row[dot / 3] >> (2 - dot % 3) & 1)
                    fill(v, x + dot % 3 * FONT_ZOOM, y + dot / 3 * FONT_ZOOM, FONT_ZOOM, FONT_ZOOM, c);
}

static void draw_scale(struct canvas *v, uint32_t top, const struct colour ramp_colours[COLOURS])
{
    static const char *const labels[] = { "0.1 %", "1 %", "10 %", "100 %" };
    const struct colour paper = { { 24, 24, 26 } }, ink = { { 205, 205, 205 } };
    const uint32_t length = v->width - 2 * MARGIN;

    fill(v, 0, top, v->width, SCALE_HEIGHT, paper);
    for (uint32_t i = 0; i < length; i++)
        fill(v, MARGIN + i, top + BAR_TOP, 1, BAR_HEIGHT, ramp_colours[i * (COLOURS - 1) / (length - 1)]);
    for (uint32_t i = 0; i < 4; i++) {
        const uint32_t x = MARGIN + i * (length - 1) / 3;
        fill(v, x, top + BAR_TOP + BAR_HEIGHT, 1, TICK_HEIGHT, ink);
        write_text(v, x + 1, top + LABEL_TOP, labels[i], ink);
    }
}

static enum err write_png(const struct canvas *v, const char *path, struct reason *why)
{
    png_image image = { .version = PNG_IMAGE_VERSION, .width = v->width, .height = v->height };

    image.format = PNG_FORMAT_RGB;
    if (!png_image_write_to_file(&image, path, 0, v->rgb, 0, NULL))
        return err_say(why, ERR_IO, "%s: cannot write the error map: %s", path, image.message);
    return ERR_OK;
}

enum err error_map_write(const float *squared, const uint8_t *mask, uint32_t width, uint32_t height, const char *path,
                         struct reason *why)
{
    const bool scaled = width >= SCALE_LEAST_WIDTH;
    const struct colour masked = { { MASKED_GREY, MASKED_GREY, MASKED_GREY } };
    struct canvas v = { .width = width, .height = height + (scaled ? SCALE_HEIGHT : 0) };
    struct colour colours[COLOURS];

    v.rgb = mem_alloc((size_t)v.width * v.height, 3);
    if (!v.rgb)
        return err_say(why, ERR_NOMEM, "%s: no memory for the error map", path);
    for (int i = 0; i < COLOURS; i++)
        ramp_colour(i / (COLOURS - 1.0), colours[i].c);
    for (uint32_t y = 0; y < height; y++) {
        for (uint32_t x = 0; x < width; x++) {
            const size_t i = (size_t)y * width + x;
            put(&v, x, y, mask && !mask[i] ? masked : colours[place(squared[i])]);
        }
    }
    if (scaled)
        draw_scale(&v, height, colours);
    const enum err e = write_png(&v, path, why);
    mem_free(v.rgb);
    return e;
}
