#include "year/annual_internal.h"

#include "base/vec.h"
#include "image/film/false_colour.h"
#include "sky/daylight/sun.h"

#include <math.h>

#define TOP 22 /* pixels above a map, for its title */
#define LEFT 34

static const uint8_t black[3] = { 20, 20, 20 }, grey[3] = { 226, 226, 230 }, line[3] = { 250, 250, 250 };

static enum err begin(struct canvas *c, uint32_t width, uint32_t height, const char *title, struct reason *why)
{
    if (canvas_init(c, width, height))
        return err_say(why, ERR_NOMEM, "no memory for a map of %u x %u pixels", width, height);
    paint_text(c, LEFT, 5, 2, title, black);
    return ERR_OK;
}

static enum err end(struct canvas *c, const char *path, struct reason *why)
{
    const enum err e = canvas_write(c, path, why);

    canvas_finish(c);
    return e;
}

/* ---- Days and hours ---- */

#define DAY 3   /* pixels */
#define HOUR 14 /* pixels */

static void label_year(struct canvas *c)
{
    static const char *const months[12] = { "JAN", "FEB", "MAR", "APR", "MAY", "JUN",
                                            "JUL", "AUG", "SEP", "OCT", "NOV", "DEC" };
    char text[8];

    for (int m = 0; m < 12; m++) {
        const int x = LEFT + DAY * (day_of_year(m + 1, 1) - 1);
        paint_text(c, x + 32, TOP + 24 * HOUR + 6, 2, months[m], black);
        if (m > 0)
            paint_box(c, x, TOP, 1, 24 * HOUR + 6, line);
    }
    for (int h = 0; h <= 24; h += 3) {
        snprintf(text, sizeof(text), "%d", h);
        paint_text(c, LEFT - 6 - paint_text_width(text, 2), TOP + h * HOUR - 4, 2, text, black);
        paint_box(c, LEFT - 4, TOP + h * HOUR, 4, 1, black);
    }
}

enum err map_year(const struct ledger *l, enum ledger_column column, double span, const char *title,
                  const struct paint_scale *scale, const char *path, struct reason *why)
{
    struct canvas c;
    uint8_t rgb[3];
    const enum err e = begin(&c, LEFT + 365 * DAY + 12 + PAINT_LEGEND_WIDTH, TOP + 24 * HOUR + 24, title, why);

    if (e)
        return e;
    paint_box(&c, LEFT, TOP, 365 * DAY, 24 * HOUR, grey);
    for (size_t i = 0; i < l->count; i++) {
        const double *v = l->rows[i].value;
        const int day = day_of_year((int)v[LEDGER_MONTH], (int)v[LEDGER_DAY]);
        const int from = (int)lround((v[LEDGER_CLOCK] - 0.5 * span) * HOUR);
        const int until = (int)lround((v[LEDGER_CLOCK] + 0.5 * span) * HOUR);
        false_colour(paint_share(scale, v[column]), rgb);
        paint_box(&c, LEFT + DAY * (day - 1), TOP + from, DAY, until > from ? until - from : 1, rgb);
    }
    label_year(&c);
    paint_legend(&c, LEFT + 365 * DAY + 12, TOP, 24 * HOUR, scale);
    return end(&c, path, why);
}

/* ---- Sensors ---- */

/* Axes of the plan: x to the right and z downwards for a floor seen from above. */
static void axes(struct vec3 n, struct vec3 *right, struct vec3 *down)
{
    if (fabsf(n.y) > 0.9f) {
        *right = vec3_make(1.0f, 0.0f, 0.0f);
        *down = vec3_make(0.0f, 0.0f, 1.0f);
        return;
    }
    *right = vec3_normalize(vec3_cross(vec3_make(0.0f, 1.0f, 0.0f), n));
    *down = vec3_cross(*right, n);
}

static void find_box(const struct points *p, struct vec3 right, struct vec3 down, double low[2], double high[2])
{
    low[0] = low[1] = INFINITY;
    high[0] = high[1] = -INFINITY;
    for (size_t i = 0; i < p->count; i++) {
        const double at[2] = { vec3_dot(p->at[i].position, right), vec3_dot(p->at[i].position, down) };
        for (int a = 0; a < 2; a++) {
            low[a] = fmin(low[a], at[a]);
            high[a] = fmax(high[a], at[a]);
        }
    }
}

#define PLAN 560.0 /* pixels of its longer side */

enum err map_sensors(const struct points *points, const double *value, const char *title,
                     const struct paint_scale *scale, const char *path, struct reason *why)
{
    const double cell = points->spacing > 0.0 ? points->spacing : 1.0;
    struct vec3 right, down;
    double low[2], high[2];
    struct canvas c;
    uint8_t rgb[3];

    axes(points->at[0].normal, &right, &down);
    find_box(points, right, down, low, high);
    const double size[2] = { high[0] - low[0] + cell, high[1] - low[1] + cell };
    const double zoom = fmin(PLAN / fmax(size[0], size[1]), 60.0 / cell);
    const int width = (int)ceil(zoom * size[0]), height = (int)ceil(zoom * size[1]);
    const int least_width = paint_text_width(title, 2) + LEFT, tall = height > 180 ? height : 180;
    const int wide = LEFT + width + 12 + PAINT_LEGEND_WIDTH;
    const enum err e =
        begin(&c, (uint32_t)(wide > least_width ? wide : least_width), (uint32_t)(TOP + tall + 8), title, why);
    if (e)
        return e;
    paint_box(&c, LEFT, TOP, width, height, grey);
    for (size_t i = 0; i < points->count; i++) {
        const double x = zoom * ((double)vec3_dot(points->at[i].position, right) - low[0]);
        const double y = zoom * ((double)vec3_dot(points->at[i].position, down) - low[1]);
        const int left = (int)lround(x), top = (int)lround(y);
        false_colour(paint_share(scale, value[i]), rgb);
        paint_box(&c, LEFT + left, TOP + top, (int)lround(x + zoom * cell) - left, (int)lround(y + zoom * cell) - top,
                  rgb);
    }
    paint_legend(&c, LEFT + width + 12, TOP, tall, scale);
    return end(&c, path, why);
}

/* ---- Luminance ---- */

static int step_of(const struct paint_scale *s, float v)
{
    return (int)floor(paint_share(s, (double)v) * paint_steps(s));
}

enum err map_luminance(const float *cdm2, uint32_t width, uint32_t height, const char *title,
                       const struct paint_scale *scale, const char *path, struct reason *why)
{
    struct canvas c;
    uint8_t rgb[3];
    const int least_width = paint_text_width(title, 2) + LEFT, wide = (int)width + 12 + PAINT_LEGEND_WIDTH;
    const uint32_t tall = height > 180 ? height : 180;
    const enum err e = begin(&c, (uint32_t)(wide > least_width ? wide : least_width), TOP + tall + 8, title, why);

    if (e)
        return e;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const float *v = cdm2 + (size_t)y * width + x;
            const int step = step_of(scale, *v);
            const bool edge =
                (x + 1 < width && step_of(scale, v[1]) != step) || (y + 1 < height && step_of(scale, v[width]) != step);
            false_colour(paint_share(scale, (double)*v), rgb);
            for (int k = 0; k < 3 && edge; k++)
                rgb[k] = rgb[k] / 3;
            paint_box(&c, (int)x, TOP + (int)y, 1, 1, rgb);
        }
    paint_legend(&c, (int)width + 12, TOP, (int)tall, scale);
    return end(&c, path, why);
}
