/* Interleaved light samples: the points of a packet belong to pixels of one place in the K x K pattern. */
#include "support/gbuffers.h"
#include "support/unit.h"

#include "base/mem.h"
#include "import/reader/builtin.h"
#include "scene/geometry/gbuffer.h"

static struct gbuffer *make(const struct scene *s, const struct rays *r, uint32_t interleave)
{
    const struct gbuffer_desc d = {
        .camera = scene_camera(s, NULL),
        .width = 157,
        .height = 91,
        .interleave = interleave,
    };

    return gbuffer_of(s, r, &d);
}

static void packets_hold_the_pixels_of_one_set(void **state)
{
    struct scene *s = scene_create_builtin();
    struct rays *r = rays_create_for(s, cpu_best());
    struct gbuffer *plain = make(s, r, 0);
    (void)state;

    assert_int_equal(plain->interleave, 1);
    for (uint32_t i = 0; i < plain->packet_count; i++)
        assert_int_equal(plain->packets[i].sample_set, 0);
    for (uint32_t k = 2; k <= 4; k *= 2) {
        struct gbuffer *g = make(s, r, k);
        uint8_t *used = mem_alloc((size_t)g->packet_count * PACKET, 1);
        assert_int_equal(g->interleave, k);
        assert_int_equal(g->point_count, plain->point_count);
        /* two kinds of lobes, each with at most one packet that is not full in each set */
        assert_true(g->packet_count <= plain->packet_count + 2 * k * k);
        for (uint32_t pixel = 0; pixel < g->width * g->height; pixel++) {
            const uint32_t x = pixel % g->width, y = pixel / g->width;
            for (uint32_t e = g->entry_first[pixel]; e < g->entry_first[pixel + 1]; e++) {
                const uint32_t point = g->entries[e].point;
                assert_int_equal(g->packets[point / PACKET].sample_set, y % k * k + x % k);
                assert_true(g->packets[point / PACKET].valid[point % PACKET]);
                assert_int_equal(used[point]++, 0);
            }
        }
        mem_free(used);
        gbuffer_destroy(g);
    }
    gbuffer_destroy(plain);
    rays_destroy(r);
    scene_destroy(s);
}

static void one_asked_for_is_the_same_as_none(void **state)
{
    struct scene *s = scene_create_builtin();
    struct rays *r = rays_create_for(s, cpu_best());
    struct gbuffer *none = make(s, r, 0), *one = make(s, r, 1);
    (void)state;

    assert_int_equal(none->packet_count, one->packet_count);
    assert_memory_equal(none->packets, one->packets, one->packet_count * sizeof(*one->packets));
    assert_memory_equal(none->entries, one->entries, one->point_count * sizeof(*one->entries));
    gbuffer_destroy(none);
    gbuffer_destroy(one);
    rays_destroy(r);
    scene_destroy(s);
}

static void other_patterns_are_refused(void **state)
{
    struct scene *s = scene_create_builtin();
    struct rays *r = rays_create_for(s, cpu_best());
    static const uint32_t bad[] = { 3, 5, 8 };
    (void)state;

    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        const struct gbuffer_desc d = {
            .camera = scene_camera(s, NULL), .width = 8, .height = 8, .interleave = bad[i]
        };
        struct gbuffer *g;
        assert_int_equal(gbuffer_create(s, r, &d, &g, NULL), ERR_RANGE);
        assert_null(g);
    }
    rays_destroy(r);
    scene_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(packets_hold_the_pixels_of_one_set),
    cmocka_unit_test(one_asked_for_is_the_same_as_none),
    cmocka_unit_test(other_patterns_are_refused),
};
UNIT_MAIN(tests)
