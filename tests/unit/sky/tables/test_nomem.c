/* Memory runs out while a frame is decoded, resampled and tabulated. */
#include "support/nomem.h"

#include "image/codec/decode.h"
#include "image/codec/make_exr.h"
#include "image/codec/make_hdr.h"
#include "sky/tables/environment.h"
#include "sky/tables/resample.h"
#include "sky/tables/samples.h"
#include "sky/tables/sky_table.h"

/* A frame to two environments that share a table, and to the first once more, as a server does it. */
struct sight {
    struct frame f;
    enum layout layout;
    bool lean;
};

static enum err see(void *context, struct reason *why)
{
    const struct sight *s = context;
    struct resample_tables *tables = resample_tables_create();
    const struct environment_desc desc = { .n = 8, .layout = s->layout, .lean = s->lean, .tables = tables };
    struct environment *one = tables ? environment_create(&desc) : NULL;
    const struct environment_desc other = {
        .n = 8, .layout = s->layout, .lean = s->lean, .tables = tables, .like = one
    };
    struct environment *two = one ? environment_create(&other) : NULL;
    enum err e = two ? environment_update(one, &s->f, why) : ERR_NOMEM;

    if (!e)
        e = environment_update(two, &s->f, why);
    if (!e) {
        environment_configure(one, &(struct environment_desc){ .layout = s->layout, .rotation_degrees = 30.0 });
        e = environment_rebuild(one, why);
    }
    if (e == ERR_NOMEM && two) { /* what has failed once can be used again */
        nomem_disarm();
        assert_int_equal(environment_update(one, &s->f, why), ERR_OK);
        assert_int_equal(environment_update(two, &s->f, why), ERR_OK);
    }
    if (!e)
        environment_complete(one);
    environment_destroy(one);
    environment_destroy(two);
    resample_tables_destroy(tables);
    return e;
}

static struct frame file_frame(uint8_t *bytes, size_t size)
{
    struct frame f = { .kind = FRAME_FILE, .bytes = bytes, .size = size };

    snprintf(f.name, sizeof(f.name), "a file");
    return f;
}

static void a_radiance_file_becomes_a_sky(void **state)
{
    size_t size;
    uint8_t *bytes = hdr_make(&(struct hdr_recipe){ .scanlines = 16, .length = 32, .encoding = HDR_NEW_RLE }, &size);
    struct sight s = { file_frame(bytes, size), LAYOUT_AUTO, false };
    (void)state;

    nomem_each("lat-long .hdr", see, &s);
    s.lean = true;
    nomem_each("lat-long .hdr, lean", see, &s);
    free(bytes);
}

static void an_exr_file_becomes_a_sky(void **state)
{
    static const struct made_channel half[] = {
        { "B", EXR_PIXEL_HALF }, { "G", EXR_PIXEL_HALF }, { "R", EXR_PIXEL_HALF }, { NULL, EXR_PIXEL_HALF }
    };
    static const exr_compression_t compressions[] = { EXR_COMPRESSION_NONE, EXR_COMPRESSION_ZIP, EXR_COMPRESSION_PIZ };
    (void)state;

    for (size_t k = 0; k < sizeof(compressions) / sizeof(compressions[0]); k++) {
        size_t size;
        uint8_t *bytes = exr_make(
            &(struct exr_recipe){ .channels = half, .compression = compressions[k], .width = 64, .height = 32 }, &size);
        struct sight s = { file_frame(bytes, size), LAYOUT_AUTO, false };
        char name[64];
        snprintf(name, sizeof(name), "lat-long .exr, compression %d", (int)compressions[k]);
        nomem_each(name, see, &s);
        free(bytes);
    }
}

static void other_layouts_become_a_sky(void **state)
{
    static const struct {
        enum layout layout;
        uint32_t length, scanlines;
    } kinds[] = {
        { LAYOUT_BALL, 24, 24 }, { LAYOUT_FISHEYE, 24, 24 }, { LAYOUT_HCROSS, 32, 24 }, { LAYOUT_CUBE, 8, 48 }
    };
    (void)state;

    for (size_t k = 0; k < sizeof(kinds) / sizeof(kinds[0]); k++) {
        size_t size;
        uint8_t *bytes = hdr_make(
            &(struct hdr_recipe){ .scanlines = kinds[k].scanlines, .length = kinds[k].length, .encoding = HDR_FLAT },
            &size);
        struct sight s = { file_frame(bytes, size), kinds[k].layout, false };
        char name[64];
        snprintf(name, sizeof(name), "layout %d", (int)kinds[k].layout);
        nomem_each(name, see, &s);
        free(bytes);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_radiance_file_becomes_a_sky),
    cmocka_unit_test(an_exr_file_becomes_a_sky),
    cmocka_unit_test(other_layouts_become_a_sky),
};

int main(int argc, char **argv)
{
    nomem_most = 12; /* each of them computes two tables */
    return unit_main(argc, argv, tests, sizeof(tests) / sizeof(tests[0]));
}
