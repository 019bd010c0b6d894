#include "measure/chart/thumb.h"

#include "base/mem.h"
#include "image/film/film.h"
#include "measure/compare/ramp.h"

#include <math.h>
#include <string.h>

#define QUALITY 85
#define LEAST_LOG10 (-3.0) /* relative error of the darkest colour */
#define COLOURS 256
#define GREY 96

static enum err add_jpeg(struct text *t, struct jpeg_encoder *j, const struct panel *p, const uint8_t *rgb)
{
    const uint8_t *bytes;
    size_t size;

    const enum err e = jpeg_encode(j, rgb, p->width, p->height, QUALITY, &bytes, &size);
    if (e)
        return e;
    text_add(t, "data:image/jpeg;base64,");
    text_add_base64(t, bytes, size);
    return ERR_OK;
}

enum err thumb_image(struct text *t, struct jpeg_encoder *j, const struct panel *p, const float *rgb)
{
    uint8_t *display = mem_alloc((size_t)p->width * p->height, 3);

    if (!display)
        return ERR_NOMEM;
    tone_map(rgb, p->width, p->height, &(struct tone_desc){ 0.18 / exp2(p->gain_log2), TONE_FILMIC, NULL }, display);
    const enum err e = add_jpeg(t, j, p, display);
    mem_free(display);
    return e;
}

enum err thumb_errors(struct text *t, struct jpeg_encoder *j, const struct panel *p, const float *rgb)
{
    const size_t pixels = (size_t)p->width * p->height;
    uint8_t *display = mem_alloc(pixels, 3), colours[COLOURS][3];
    float *map = mem_alloc(pixels, sizeof(*map));
    enum err e = display && map ? ERR_OK : ERR_NOMEM;

    for (int k = 0; k < COLOURS; k++)
        ramp_colour(k / (COLOURS - 1.0), colours[k]);
    if (!e)
        judge_map(&p->judge, rgb, map);
    for (size_t i = 0; i < pixels && !e; i++) {
        /* 0 gives minus infinity, which is the dark end */
        const double place = fmin(fmax(1.0 - 0.5 * log10((double)map[i]) / LEAST_LOG10, 0.0), 1.0);
        if (!p->mask[i])
            memset(display + 3 * i, GREY, 3);
        else
            memcpy(display + 3 * i, colours[(int)(place * (COLOURS - 1) + 0.5)], 3);
    }
    if (!e)
        e = add_jpeg(t, j, p, display);
    mem_free(display);
    mem_free(map);
    return e;
}
