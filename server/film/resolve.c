#include "resolve.h"

static void resolve_pixel(const struct gbuffer *g, const float *lo, const struct environment *e, size_t pixel,
                          float rgb[3])
{
    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *entry = &g->entries[k];
        const float *point = lo + (size_t)(entry->point / PACKET) * 3 * PACKET + entry->point % PACKET;
        for (int c = 0; c < 3; c++)
            rgb[c] += entry->weight[c] * point[c * PACKET];
    }
    for (uint32_t k = g->escape_first[pixel]; e && k < g->escape_first[pixel + 1]; k++) {
        float seen[3];
        environment_look_wide(e, g->escapes[k].direction, g->escapes[k].width, seen);
        for (int c = 0; c < 3; c++)
            rgb[c] += g->escapes[k].weight[c] * seen[c];
    }
}

void resolve_pixels(const struct gbuffer *g, const float *lo, const struct environment *e, float *rgb)
{
#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t y = 0; y < g->height; y++)
        for (uint32_t x = 0; x < g->width; x++) {
            const size_t pixel = (size_t)y * g->width + x;
            resolve_pixel(g, lo, e, pixel, rgb + 3 * pixel);
        }
}

void resolve_mask(const struct gbuffer *g, uint8_t *mask)
{
    for (size_t pixel = 0; pixel < (size_t)g->width * g->height; pixel++)
        mask[pixel] = g->entry_first[pixel + 1] > g->entry_first[pixel];
}
