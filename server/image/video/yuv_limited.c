#include "image/video/yuv.h"

#include <stddef.h>

/* Luma's coefficients; differences are scaled to -0.5..0.5. */
struct matrix {
    float r, g, b;
};

struct scale { /* from 0..65535 to codes */
    float luma, difference, black, grey;
};

static void store(uint8_t *row, uint32_t x, bool deep, float code)
{
    const unsigned v = (unsigned)(code + 0.5f);

    if (deep)
        ((uint16_t *)(void *)row)[x] = (uint16_t)v;
    else
        row[x] = (uint8_t)v;
}

static uint32_t least(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

/* Chroma lies on even columns and between two rows (location "left"): weights 1, 2, 1 across and 1, 1 down. */
static void chroma(const uint16_t *const rows[2], uint32_t x, uint32_t width, float mean[3])
{
    const uint32_t at[3] = { x > 0 ? x - 1 : 0, x, least(x + 1, width - 1) };
    static const float weight[3] = { 0.125f, 0.25f, 0.125f };

    for (int c = 0; c < 3; c++) {
        mean[c] = 0.0f;
        for (int k = 0; k < 3; k++)
            for (int j = 0; j < 2; j++)
                mean[c] += weight[k] * (float)rows[j][3 * (size_t)at[k] + (size_t)c];
    }
}

void yuv_limited_from_rgb(const uint16_t *rgb, uint32_t width, uint32_t height, bool pq, const struct yuv_planes *out)
{
    const struct matrix m =
        pq ? (struct matrix){ 0.2627f, 0.6780f, 0.0593f } : (struct matrix){ 0.2126f, 0.7152f, 0.0722f };
    const float step = pq ? 4.0f : 1.0f;
    const struct scale s = { 219.0f * step / 65535.0f, 224.0f * step / 65535.0f, 16.0f * step, 128.0f * step };

    for (uint32_t y = 0; y < height; y += 2) {
        const uint16_t *const rows[2] = { rgb + 3 * (size_t)width * y,
                                          rgb + 3 * (size_t)width * least(y + 1, height - 1) };
        uint8_t *cb = out->cb + (ptrdiff_t)(y / 2) * out->cb_pitch, *cr = out->cr + (ptrdiff_t)(y / 2) * out->cr_pitch;
        for (int j = 0; j < 2; j++) {
            uint8_t *luma = out->y + (ptrdiff_t)(y + (uint32_t)j) * out->y_pitch;
            for (uint32_t x = 0; x < width + width % 2; x++) {
                const uint16_t *p = rows[j] + 3 * (size_t)least(x, width - 1);
                store(luma, x, pq, s.black + s.luma * (m.r * (float)p[0] + m.g * (float)p[1] + m.b * (float)p[2]));
            }
        }
        for (uint32_t x = 0; x < width; x += 2) {
            float p[3];
            chroma(rows, x, width, p);
            const float l = m.r * p[0] + m.g * p[1] + m.b * p[2];
            store(cb, x / 2, pq, s.grey + s.difference * (p[2] - l) / (2.0f * (1.0f - m.b)));
            store(cr, x / 2, pq, s.grey + s.difference * (p[0] - l) / (2.0f * (1.0f - m.r)));
        }
    }
}
