#include "image/film/scale.h"

#include "base/mem.h"
#include "base/srgb.h"
#include "image/film/film.h"

#include <math.h>

#define CODES                                                                                                          \
    16384 /* of linear light 0..1: the steepest part of the curve passes 0.2 code values from one to the next */

struct scaler {
    float linear[256];
    uint8_t code[CODES + 1];
};

/* One image on its way to a smaller one. */
struct scaling {
    const struct scaler *tables; /* of bytes; NULL: floats */
    const uint8_t *bytes;
    const float *floats;
    uint32_t width, height;
    uint8_t *to_bytes;
    float *to_floats;
    uint32_t to_width, to_height;
};

struct scaler *scaler_create(void)
{
    struct scaler *s = mem_alloc(1, sizeof(*s));

    if (!s)
        return NULL;
    for (int i = 0; i < 256; i++)
        s->linear[i] = (float)srgb_decode(i / 255.0);
    for (int i = 0; i <= CODES; i++)
        s->code[i] = (uint8_t)lround(255.0 * srgb_encode((double)i / CODES));
    return s;
}

void scaler_destroy(struct scaler *s)
{
    mem_free(s);
}

uint32_t scale_height(uint32_t width, uint32_t height, uint32_t to_width)
{
    const uint64_t rounded = ((uint64_t)height * to_width + width / 2) / width;

    return rounded > 0 ? (uint32_t)rounded : 1;
}

static float value(const struct scaling *s, size_t at)
{
    return s->tables ? s->tables->linear[s->bytes[at]] : s->floats[at];
}

/* The mean over columns `from` to `to`, fractions included, of one channel of row y. */
static float mean_of_columns(const struct scaling *s, uint32_t y, unsigned channel, double from, double to)
{
    double sum = 0.0;

    for (uint32_t x = (uint32_t)from; x < s->width && (double)x < to; x++) {
        const double share = fmin(to, x + 1.0) - fmax(from, x);
        sum += share * (double)value(s, 3 * ((size_t)s->width * y + x) + channel);
    }
    return (float)(sum / (to - from));
}

static void store(const struct scaling *s, size_t at, double mean)
{
    if (s->tables)
        s->to_bytes[at] = s->tables->code[lround(CODES * fmin(fmax(mean, 0.0), 1.0))];
    else
        s->to_floats[at] = (float)mean;
}

static void scale(const struct scaling *s)
{
    const double step_x = (double)s->width / s->to_width, step_y = (double)s->height / s->to_height;

    for (uint32_t y = 0; y < s->to_height; y++)
        for (uint32_t x = 0; x < 3 * s->to_width; x++) {
            const double from = y * step_y, to = (y + 1) * step_y;
            double sum = 0.0;
            for (uint32_t row = (uint32_t)from; row < s->height && (double)row < to; row++)
                sum += (fmin(to, row + 1.0) - fmax(from, row)) *
                       (double)mean_of_columns(s, row, x % 3, x / 3 * step_x, (x / 3 + 1) * step_x);
            store(s, 3 * (size_t)s->to_width * y + x, sum / (to - from));
        }
}

void scale_srgb(struct scaler *s, const uint8_t *from, uint32_t width, uint32_t height, uint8_t *to, uint32_t to_width,
                uint32_t to_height)
{
    scale(&(struct scaling){ .tables = s,
                             .bytes = from,
                             .width = width,
                             .height = height,
                             .to_bytes = to,
                             .to_width = to_width,
                             .to_height = to_height });
}

void scale_linear(const float *from, uint32_t width, uint32_t height, float *to, uint32_t to_width, uint32_t to_height)
{
    scale(&(struct scaling){ .floats = from,
                             .width = width,
                             .height = height,
                             .to_floats = to,
                             .to_width = to_width,
                             .to_height = to_height });
}
