#include "sky/between/latlong.h"

#include "base/mem.h"

struct sums { /* over an area */
    struct spot spot;
    double mean[3], centroid[3];
};

static void add_texel(const struct spot_area *a, uint32_t at, float level, bool excess, struct sums *s)
{
    const uint32_t y = at / a->width;
    const double o = texel_solid_angle(a->width, a->height, y);
    const double weight = excess ? o * (double)(texel_brightest(a->rgb, at) - level) : o;
    double w[3];

    texel_direction(a->width, a->height, at % a->width + 0.5, y + 0.5, w);
    s->spot.texels++;
    s->spot.solid_angle += o;
    s->spot.weight += weight;
    for (int c = 0; c < 3; c++) {
        s->mean[c] += o * w[c];
        s->centroid[c] += weight * w[c];
    }
}

static void flood(const struct spot_area *a, float level, bool excess, size_t first, uint8_t *seen, uint32_t *stack,
                  struct sums *out)
{
    size_t top = 0;

    stack[top++] = (uint32_t)first;
    seen[first] = 1;
    while (top) {
        const uint32_t at = stack[--top], y = at / a->width, x = at % a->width;
        add_texel(a, at, level, excess, out);
        for (uint32_t k = 0; k < 9; k++) {
            const uint32_t row = y + k / 3 - 1, column = (x + k % 3 + a->width - 1) % a->width; /* -1 is no row */
            const size_t next = (size_t)row * a->width + column;
            if (row >= a->rows || seen[next] || !(texel_brightest(a->rgb, next) >= level))
                continue;
            seen[next] = 1;
            stack[top++] = (uint32_t)next;
        }
    }
}

/* The mean direction of a disc of radius r has length 1 - r^2 / 4. */
static void shape(struct sums *s)
{
    const double mean = sqrt(dot3(s->mean, s->mean)) / s->spot.solid_angle;
    const double *from = s->spot.weight > 0.0 ? s->centroid : s->mean; /* all may be exactly at the level */
    const double length = sqrt(dot3(from, from));

    s->spot.radius = sqrt(s->spot.solid_angle / PI);
    s->spot.round = 0.25 * s->spot.radius * s->spot.radius / fmax(1.0 - mean, 1e-12);
    for (int c = 0; c < 3; c++)
        s->spot.w[c] = from[c] / length;
}

enum err spot_find(const struct spot_area *a, float level, bool excess, struct spot *out)
{
    const size_t count = (size_t)a->rows * a->width;
    uint8_t *seen = mem_alloc(count, 1);
    uint32_t *stack = mem_alloc_raw(count, sizeof(*stack));
    struct sums best = { .spot = { .texels = 0 } };

    for (size_t i = 0; seen && stack && i < count; i++) {
        if (seen[i] || !(texel_brightest(a->rgb, i) >= level))
            continue;
        struct sums s = { .spot = { .texels = 0 } };
        flood(a, level, excess, i, seen, stack, &s);
        if (!best.spot.texels || s.spot.weight > best.spot.weight)
            best = s;
    }
    const enum err result = seen && stack ? ERR_OK : ERR_NOMEM;
    mem_free(seen);
    mem_free(stack);
    if (best.spot.texels)
        shape(&best);
    *out = best.spot;
    return result;
}
