/* One shade point a pixel, of those that the G-buffer has. */
#include "unit.h"

#include "gbuffer.h"
#include "mem.h"

#include <string.h>

enum { WIDTH = 157, HEIGHT = 91, PIXELS = WIDTH * HEIGHT };

static struct gbuffer *make(const struct scene *s, const struct rays *r, uint32_t interleave, bool every_pixel)
{
    const struct gbuffer_desc d = {
        .camera = scene_camera(s, NULL),
        .width = WIDTH,
        .height = HEIGHT,
        .interleave = interleave,
        .every_pixel = every_pixel,
    };
    struct reason why = { "" };
    struct gbuffer *g = NULL;

    if (gbuffer_create(s, r, &d, &g, &why))
        fail_msg("%s", why.text);
    return g;
}

/* The place of a point. */
static void place(const struct gbuffer *g, uint32_t point, float out[7])
{
    const struct shade_packet *p = &g->packets[point / PACKET];
    const uint32_t l = point % PACKET;
    const float values[7] = { p->x[l], p->y[l], p->z[l], p->ns_x[l], p->wo_z[l], p->diffuse[1][l], p->gloss[l] };

    memcpy(out, values, sizeof(values));
}

/* Each pixel keeps the point of its heaviest entry, with the weight of all, and its escapes; a pixel that had one entry
 * keeps that. */
static void check_pixels(const struct gbuffer *g, const struct gbuffer *thin)
{
    for (uint32_t i = 0; i < PIXELS; i++) {
        const uint32_t count = g->entry_first[i + 1] - g->entry_first[i], first = thin->entry_first[i];
        double sum[3] = { 0.0, 0.0, 0.0 }, most = -1.0;
        float kept[7], one[7];
        bool found = false;
        assert_int_equal(thin->entry_first[i + 1] - first, count > 0);
        assert_int_equal(thin->escape_first[i], g->escape_first[i]);
        if (count == 0)
            continue;
        const struct gbuffer_entry *e = &thin->entries[first];
        place(thin, e->point, kept);
        for (uint32_t k = g->entry_first[i]; k < g->entry_first[i + 1]; k++) {
            const float *w = g->entries[k].weight;
            most = fmax(most, w[0] + w[1] + w[2]);
            for (int c = 0; c < 3; c++)
                sum[c] += w[c];
        }
        for (uint32_t k = g->entry_first[i]; k < g->entry_first[i + 1]; k++) {
            const float *w = g->entries[k].weight;
            place(g, g->entries[k].point, one);
            found |= memcmp(one, kept, sizeof(one)) == 0 && w[0] + w[1] + w[2] == (float)most;
        }
        assert_true(found);
        for (int c = 0; c < 3; c++)
            assert_float_equal(e->weight[c], sum[c], 1e-5);
        if (count == 1)
            assert_memory_equal(e->weight, g->entries[g->entry_first[i]].weight, sizeof(e->weight));
    }
}

/* Full but for the last of each kind and set, kinds and sets unmixed, no point twice, padding invalid. */
static void check_packets(const struct gbuffer *g)
{
    uint8_t *used = mem_alloc((size_t)g->packet_count * PACKET, 1);
    uint64_t points = 0;
    uint32_t short_ones = 0;

    for (uint32_t i = 0; i < PIXELS; i++)
        for (uint32_t k = g->entry_first[i]; k < g->entry_first[i + 1]; k++)
            assert_int_equal(used[g->entries[k].point]++, 0);
    for (uint32_t k = 0; k < g->packet_count; k++) {
        const struct shade_packet *p = &g->packets[k];
        assert_in_range(p->count, 1, PACKET);
        for (uint32_t l = 0; l < PACKET; l++)
            assert_int_equal(p->valid[l], l < p->count ? -1 : 0);
        points += p->count;
        short_ones += p->count < PACKET;
    }
    assert_int_equal(points, g->point_count);
    assert_true(short_ones <= 2 * g->interleave * g->interleave);
    mem_free(used);
}

static void each_pixel_keeps_its_heaviest_point(void **state)
{
    struct scene *s = scene_create_builtin();
    struct rays *r = rays_create(s);
    (void)state;

    for (int k = 0; k < 3; k++) {
        struct gbuffer *g = make(s, r, k == 1 ? 4 : 1, k == 2), *thin = NULL;
        assert_int_equal(gbuffer_thin(g, &thin), ERR_OK);
        check_pixels(g, thin);
        check_packets(thin);
        assert_true(thin->point_count < g->point_count && thin->bytes < g->bytes);
        assert_int_equal(thin->interleave, g->interleave);
        gbuffer_destroy(thin);
        gbuffer_destroy(g);
    }
    rays_destroy(r);
    scene_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(each_pixel_keeps_its_heaviest_point),
};
UNIT_MAIN(tests)
