#include "measure/chart/judge.h"

#include "base/mem.h"
#include "base/text.h"
#include "image/codec/encode.h"
#include "image/film/film.h"
#include "measure/compare/error_map.h"

#include <math.h>
#include <string.h>

#define LEAST_LOG10 (-3.0) /* relative error of the darkest colour */
#define COLOURS 256        /* of the ramp */
#define GREY 96            /* of pixels that are not compared */

/* Frees the image. */
static json_t *address(const struct judge *j, uint8_t *rgb)
{
    struct jpeg_encoder *jpeg = jpeg_encoder_create();
    struct text t = { .bytes = NULL };
    const uint8_t *bytes;
    size_t size;

    text_add(&t, "data:image/jpeg;base64,");
    const bool good = jpeg && rgb && jpeg_encode(jpeg, rgb, j->width, j->height, 85, &bytes, &size) == ERR_OK;
    if (good)
        text_add_base64(&t, bytes, size);
    json_t *out = good && !t.failed ? json_string(t.bytes) : NULL;
    text_finish(&t);
    jpeg_encoder_destroy(jpeg);
    mem_free(rgb);
    return out;
}

json_t *thumb_image(const struct judge *j, double gain, const float *rgb)
{
    uint8_t *display = mem_alloc((size_t)j->width * j->height, 3);

    if (display)
        tone_map(rgb, j->width, j->height, &(struct tone_desc){ gain, TONE_FILMIC, NULL }, display);
    return address(j, display);
}

json_t *thumb_errors(const struct judge *j, const float *rgb)
{
    const size_t pixels = (size_t)j->width * j->height;
    uint8_t *display = mem_alloc(pixels, 3), colours[COLOURS][3];
    float *map = mem_alloc(pixels, sizeof(*map));

    for (int k = 0; k < COLOURS; k++)
        ramp_colour(k / (COLOURS - 1.0), colours[k]);
    if (map)
        judge_map(j, rgb, map);
    for (size_t i = 0; i < pixels && display && map; i++) {
        /* 0 gives minus infinity, which is the dark end */
        const double place = fmin(fmax(1.0 - 0.5 * log10((double)map[i]) / LEAST_LOG10, 0.0), 1.0);
        if (j->weight[3 * i] == 0.0f)
            memset(display + 3 * i, GREY, 3);
        else
            memcpy(display + 3 * i, colours[(int)(place * (COLOURS - 1) + 0.5)], 3);
    }
    mem_free(map);
    return address(j, display);
}
