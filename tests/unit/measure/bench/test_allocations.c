/* That a stream which runs takes no memory from the system any more: calls of the C library's allocator, by whichever
 * library on whichever thread, in frames after the tenth. Delivery is not among them. Each case says how the sky comes
 * or how it lights. Skipped in builds with sanitizers, whose allocator cannot be counted. */
#include "support/unit.h"

#include "image/codec/make_exr.h"
#include "image/codec/make_hdr.h"
#include "light/estimators/kernels.h"
#include "light/frame/relight.h"
#include "measure/bench/bench.h"
#include "sky/tables/environment.h"
#include "support/sets.h"

#include <math.h>

enum { WARM = 10, COUNTED = 4, WIDTH = 64, HEIGHT = 32 };

static const struct made_channel half_rgb[] = {
    { "B", EXR_PIXEL_HALF }, { "G", EXR_PIXEL_HALF }, { "R", EXR_PIXEL_HALF }, { NULL, EXR_PIXEL_HALF }
};

static int frame; /* skies differ, and so do the bytes that they are packed to */

static float sky_value(int c, int32_t x, int32_t y)
{
    return (float)(2 + c) + sinf(0.1f * (float)(x * (frame + 3))) + cosf(0.3f * (float)y);
}

static void count_decoding(const struct frame *f, struct environment *e, uint64_t *calls)
{
    struct reason why = { "" };
    uint64_t before, after;

    allocations_count(&before);
    const enum err result = environment_update(e, f, &why);
    allocations_count(&after);
    if (result)
        fail_msg("%s", why.text);
    *calls = after - before;
}

/* Whatever OpenEXRCore unpacks with memory of its own hooks, and ZIP, which is unpacked here. PXR24 is inflated by the
 * library, with zlib's own memory, and DWA takes some for each chunk. */
static void skies_of_a_stream_take_no_memory_after_the_tenth(void **state)
{
    static const exr_compression_t compressions[] = { EXR_COMPRESSION_NONE, EXR_COMPRESSION_RLE, EXR_COMPRESSION_ZIPS,
                                                      EXR_COMPRESSION_ZIP,  EXR_COMPRESSION_PIZ, EXR_COMPRESSION_B44,
                                                      EXR_COMPRESSION_B44A };
    uint64_t calls;
    (void)state;

    if (!allocations_count(&calls))
        skip();
    for (size_t c = 0; c < 2 * sizeof(compressions) / sizeof(compressions[0]); c++) {
        struct environment *e = environment_create(&(struct environment_desc){ .n = 16 });
        struct exr_recipe recipe = { .channels = half_rgb,
                                     .compression = compressions[c / 2],
                                     .width = WIDTH,
                                     .height = HEIGHT,
                                     .tile_w = c % 2 ? 16 : 0,
                                     .tile_h = c % 2 ? 16 : 0,
                                     .value = sky_value };
        for (frame = 0; frame < WARM + COUNTED; frame++) {
            struct frame f = { .kind = FRAME_FILE, .name = "sky" };
            uint8_t *bytes = exr_make(&recipe, &f.size);
            f.bytes = bytes;
            count_decoding(&f, e, &calls);
            free(bytes);
            if (frame >= WARM && calls > 0)
                fail_msg("compression %d, %s: %llu allocations in frame %d", (int)recipe.compression,
                         c % 2 ? "tiles" : "scanlines", (unsigned long long)calls, frame);
        }
        environment_destroy(e);
    }
}

/* A sky of Radiance's, and one of six files, whose faces are decoded one after the other. */
static void radiance_and_six_faces_take_none_either(void **state)
{
    const struct hdr_recipe wide = { .scanlines = HEIGHT, .length = WIDTH, .encoding = HDR_NEW_RLE },
                            square = { .scanlines = HEIGHT, .length = HEIGHT, .encoding = HDR_NEW_RLE };
    uint64_t calls;
    (void)state;

    if (!allocations_count(&calls))
        skip();
    for (int six = 0; six < 2; six++) {
        struct environment *e = environment_create(&(struct environment_desc){ .n = 16 });
        struct frame f = { .kind = FRAME_FILE, .name = "sky" };
        size_t size;
        uint8_t *file = hdr_make(six ? &square : &wide, &size), *bytes = malloc(6 * size);
        assert_non_null(bytes);
        for (int k = 0; k < 6; k++) {
            memcpy(bytes + (size_t)k * size, file, size);
            f.faces[k] = six ? size : 0;
        }
        f.bytes = bytes;
        f.size = six ? 6 * size : size;
        for (frame = 0; frame < WARM + COUNTED; frame++) {
            count_decoding(&f, e, &calls);
            if (frame >= WARM && calls > 0)
                fail_msg("%s: %llu allocations in frame %d", six ? "six files" : "one file", (unsigned long long)calls,
                         frame);
        }
        free(file);
        free(bytes);
        environment_destroy(e);
    }
}

/* Whole frames, stage by stage as relightd does them. */
static enum err make_frame(struct environment *e, const struct frame *f, struct image_maker *m, uint64_t at[5])
{
    struct reason why;

    allocations_count(&at[0]);
    enum err result = environment_decode(e, f, &why);
    allocations_count(&at[1]);
    if (!result)
        result = environment_rebuild(e, &why);
    allocations_count(&at[2]);
    if (!result)
        result = image_maker_light(m);
    allocations_count(&at[3]);
    if (!result)
        result = image_maker_encode(m);
    allocations_count(&at[4]);
    return result;
}

static void no_stage_of_a_frame_takes_memory_after_the_tenth(void **state)
{
    static const struct relight_desc lights[] = {
        { .direct = { .method = METHOD_MIS, .samples = 16 } },
        { .direct = { .method = METHOD_AUTO, .samples = 9 } },
        { .direct = { .method = METHOD_FACES, .cells = 4, .sun = true, .samples = 12 } },
        { .direct = { .method = METHOD_MIS, .scatter = true, .samples = 16 } },
        { .direct = { .method = METHOD_LATLONG, .samples = 8 } },
        { .direct = { .method = METHOD_AUTO, .samples = 8 }, .classes = PATH_ALL },
        { .direct = { .method = METHOD_CACHED, .samples = 8 } },
    };
    static const char *const stages[] = { "decoding", "tables", "light", "exposure, tone curve and JPEG" };
    const struct prepared_scene_desc desc = { .width = 64, .height = 40 };
    struct reason why = { "" };
    struct bench_sky sky = { .environment = NULL };
    struct bench b = { .sky = &sky };
    struct prepared_scene *set = NULL;
    uint64_t at[5];
    (void)state;

    if (!allocations_count(at))
        skip();
    assert_int_equal(kernels_select(NULL, &b.kernels, &why), ERR_OK);
    set = set_of(&desc);
    for (size_t l = 0; l < sizeof(lights) / sizeof(lights[0]); l++) {
        struct environment *e = environment_create(&(struct environment_desc){ .n = 64 });
        struct image_maker m;
        assert_int_equal(image_maker_init(&m, &b, set), ERR_OK);
        sky.environment = e;
        m.light = &lights[l];
        for (frame = 0; frame < WARM + COUNTED; frame++) {
            const struct exr_recipe recipe = { .channels = half_rgb,
                                               .compression = EXR_COMPRESSION_ZIP,
                                               .width = WIDTH,
                                               .height = HEIGHT,
                                               .value = sky_value };
            struct frame f = { .kind = FRAME_FILE, .name = "sky" };
            f.bytes = exr_make(&recipe, &f.size);
            assert_int_equal(make_frame(e, &f, &m, at), ERR_OK);
            free(f.bytes);
            for (int k = 0; k < 4; k++)
                if (frame >= WARM && at[k + 1] != at[k])
                    fail_msg("lights %zu, frame %d, %s: %llu allocations", l, frame, stages[k],
                             (unsigned long long)(at[k + 1] - at[k]));
        }
        image_maker_finish(&m);
        environment_destroy(e);
    }
    set_destroy(set);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(skies_of_a_stream_take_no_memory_after_the_tenth),
    cmocka_unit_test(radiance_and_six_faces_take_none_either),
    cmocka_unit_test(no_stage_of_a_frame_takes_memory_after_the_tenth),
};
UNIT_MAIN(tests)
