/* What valid OpenEXR files decode to, and which are refused by name. */
#include "image/codec/decoding.h"

#include "image/codec/primaries.h"
#include "image/codec/make_exr.h"

#define HALF EXR_PIXEL_HALF
#define FLOAT EXR_PIXEL_FLOAT
#define UINT EXR_PIXEL_UINT

static const struct made_channel half_rgb[] = { { "B", HALF }, { "G", HALF }, { "R", HALF }, { NULL, HALF } };
static const struct made_channel float_rgb[] = { { "B", FLOAT }, { "G", FLOAT }, { "R", FLOAT }, { NULL, HALF } };
static const struct made_channel half_rgba[] = {
    { "A", HALF }, { "B", HALF }, { "G", HALF }, { "R", HALF }, { NULL, HALF }
};
static const struct made_channel float_rgba[] = {
    { "A", FLOAT }, { "B", FLOAT }, { "G", FLOAT }, { "R", FLOAT }, { NULL, HALF }
};
static const struct made_channel mixed[] = { { "A", UINT },  { "B", HALF },  { "G", FLOAT },    { "R", HALF },
                                             { "Z", FLOAT }, { "id", UINT }, { "sky.R", HALF }, { NULL, HALF } };
static const struct made_channel layered[] = { { "a.R", FLOAT },  { "sky.B", HALF }, { "sky.G", FLOAT },
                                               { "sky.R", HALF }, { "sun.B", HALF }, { "sun.G", HALF },
                                               { "sun.R", HALF }, { NULL, HALF } };
static const struct made_channel half_y[] = { { "A", HALF }, { "Y", HALF }, { NULL, HALF } };
static const struct made_channel y_of_three[] = { { "B", HALF }, { "R", HALF }, { "Y", HALF }, { NULL, HALF } };
static const struct made_channel float_y[] = { { "Y", FLOAT }, { NULL, HALF } };

static const struct {
    const struct made_channel *channels;
    int r, g, b; /* their places in the list */
} sets[] = {
    { half_rgb, 2, 1, 0 }, { float_rgb, 2, 1, 0 }, { half_rgba, 3, 2, 1 }, { float_rgba, 3, 2, 1 }, { mixed, 3, 2, 1 },
    { layered, 3, 2, 1 },  { half_y, 1, 1, 1 },    { float_y, 0, 0, 0 },   { y_of_three, 2, 2, 2 },
};

#define SETS (sizeof(sets) / sizeof(sets[0]))

static const exr_compression_t compressions[] = {
    EXR_COMPRESSION_NONE, EXR_COMPRESSION_RLE,   EXR_COMPRESSION_ZIPS, EXR_COMPRESSION_ZIP,
    EXR_COMPRESSION_PIZ,  EXR_COMPRESSION_PXR24, EXR_COMPRESSION_B44,  EXR_COMPRESSION_B44A,
};

#define COMPRESSIONS (sizeof(compressions) / sizeof(compressions[0]))

/* Even enough for B44, which keeps six bits of what texels of a block differ by. */
static float even_value(int c, int32_t x, int32_t y)
{
    return 2.0f + (float)c + (float)x / 64.0f + (float)y / 128.0f;
}

static bool is_lossy(exr_compression_t c)
{
    return c == EXR_COMPRESSION_B44 || c == EXR_COMPRESSION_B44A;
}

/* Writes, decodes and compares with what was written: exactly, or to 2 % where the compression is lossy. */
static void check_recipe(const struct exr_recipe *recipe, size_t set, struct image *im)
{
    struct exr_recipe r = *recipe;
    const int place[3] = { sets[set].r, sets[set].g, sets[set].b };
    const bool lossy = is_lossy(r.compression);
    size_t size;

    r.channels = sets[set].channels;
    if (lossy)
        r.value = even_value;
    float (*const value)(int, int32_t, int32_t) = r.value ? r.value : recipe_value;
    uint8_t *bytes = exr_make(&r, &size);
    must_decode(bytes, size, im);
    free(bytes);
    assert_int_equal(im->width, r.width);
    assert_int_equal(im->height, r.height);
    for (int32_t y = 0; y < r.height; y++) {
        for (int32_t x = 0; x < r.width; x++) {
            for (int c = 0; c < 3; c++) {
                const float got = im->rgb[3 * ((size_t)y * im->width + (size_t)x) + (size_t)c];
                const float want = value(place[c], x, y);
                if (fabsf(got - want) > (lossy ? 0.02f * want : 0.0f))
                    fail_msg("compression %d, set %zu, texel %d, %d, channel %d: %g, not %g", (int)r.compression, set,
                             x, y, c, (double)got, (double)want);
            }
        }
    }
}

static void scanlines_decode_with_each_compression_and_set_of_channels(void **state)
{
    struct image im = { 0 };
    (void)state;

    for (size_t c = 0; c < COMPRESSIONS; c++)
        for (size_t s = 0; s < SETS; s++)
            check_recipe(&(struct exr_recipe){ .compression = compressions[c], .width = 37, .height = 41 }, s, &im);
    image_finish(&im);
}

static void tiles_decode_with_each_compression_and_set_of_channels(void **state)
{
    struct image im = { 0 };
    (void)state;

    for (size_t c = 0; c < COMPRESSIONS; c++)
        for (size_t s = 0; s < SETS; s++)
            check_recipe(
                &(struct exr_recipe){
                    .compression = compressions[c], .width = 37, .height = 41, .tile_w = 16, .tile_h = 12 },
                s, &im);
    image_finish(&im);
}

static void of_mip_and_rip_maps_the_largest_level_is_read(void **state)
{
    struct image im = { 0 };
    (void)state;

    for (size_t c = 0; c < COMPRESSIONS; c++) {
        struct exr_recipe r = { .compression = compressions[c], .width = 40, .height = 20, .tile_w = 8, .tile_h = 16 };
        for (size_t s = 0; s < 4; s++) {
            r.levels = EXR_TILE_MIPMAP_LEVELS;
            r.height = 20;
            check_recipe(&r, s, &im);
            r.levels = EXR_TILE_RIPMAP_LEVELS;
            r.height = 1;
            check_recipe(&r, s, &im);
        }
    }
    image_finish(&im);
}

static void the_data_window_is_the_image_wherever_it_lies(void **state)
{
    static const int32_t corners[][2] = { { -5, -300 }, { 7, 11 }, { 100000, -100000 } };
    struct image im = { 0 };
    (void)state;

    for (size_t c = 0; c < COMPRESSIONS; c++) {
        for (size_t i = 0; i < 3; i++) {
            struct exr_recipe r = {
                .compression = compressions[c], .width = 19, .height = 35, .left = corners[i][0], .top = corners[i][1]
            };
            check_recipe(&r, 0, &im);
            check_recipe(&r, 3, &im);
            r.tile_w = r.tile_h = 16;
            check_recipe(&r, 0, &im);
        }
    }
    image_finish(&im);
}

static void rows_stored_from_the_bottom_up_come_out_top_first(void **state)
{
    struct image im = { 0 };
    (void)state;

    for (size_t c = 0; c < COMPRESSIONS; c++)
        check_recipe(
            &(struct exr_recipe){ .compression = compressions[c], .width = 12, .height = 70, .decreasing = true }, 0,
            &im);
    image_finish(&im);
}

static void the_smallest_image_decodes(void **state)
{
    struct image im = { 0 };
    (void)state;

    for (size_t c = 0; c < COMPRESSIONS; c++)
        for (size_t s = 0; s < SETS; s++)
            check_recipe(&(struct exr_recipe){ .compression = compressions[c], .width = 1, .height = 1 }, s, &im);
    image_finish(&im);
}

static void memory_is_reused_for_images_that_fit(void **state)
{
    struct image im = { 0 };
    (void)state;

    check_recipe(&(struct exr_recipe){ .width = 32, .height = 16 }, 0, &im);
    const float *before = im.rgb;
    im.faults.nan = 7;
    im.layout = LAYOUT_CUBE;
    check_recipe(&(struct exr_recipe){ .width = 16, .height = 32 }, 1, &im);
    assert_ptr_equal(im.rgb, before);
    assert_int_equal(im.faults.nan, 0);
    assert_int_equal(im.layout, LAYOUT_AUTO);
    image_finish(&im);
}

static float odd_value(int c, int32_t x, int32_t y)
{
    static const float row[8] = { 1.0f, -2.0f, NAN, INFINITY, -INFINITY, 65504.0f, 0.0f, 3.0f };

    (void)c;
    return y == 0 ? row[x] : 1.0f;
}

static void odd_values_are_put_right_and_counted(void **state)
{
    static const float want[8] = { 1.0f, 0.0f, 1.0f, 65504.0f, 0.0f, 65504.0f, 0.0f, 3.0f };
    struct image im = { 0 };
    (void)state;

    for (size_t s = 0; s < 2; s++) {
        const struct exr_recipe r = { .channels = sets[s].channels,
                                      .compression = EXR_COMPRESSION_ZIP,
                                      .width = 8,
                                      .height = 3,
                                      .value = odd_value };
        size_t size;
        uint8_t *bytes = exr_make(&r, &size);
        must_decode(bytes, size, &im);
        free(bytes);
        for (size_t i = 0; i < 24; i++)
            assert_true(im.rgb[i] == want[i / 3]);
        assert_int_equal(im.faults.negative, 3);
        assert_int_equal(im.faults.nan, 3);
        assert_int_equal(im.faults.infinite, 6);
        assert_int_equal(im.faults.clipped, 3);
    }
    image_finish(&im);
}

/* The half float of bits 256 y + x, from the format's definition. */
static float half_pattern(int c, int32_t x, int32_t y)
{
    const int bits = 256 * y + x, exponent = bits >> 10 & 31, mantissa = bits & 1023;
    const float magnitude = exponent == 31  ? (mantissa ? NAN : INFINITY)
                            : exponent == 0 ? ldexpf((float)mantissa, -24)
                                            : ldexpf((float)(1024 + mantissa), exponent - 25);

    (void)c;
    return bits & 0x8000 ? -magnitude : magnitude;
}

static void every_half_float_has_its_value(void **state)
{
    const struct exr_recipe r = { .channels = half_y, .width = 256, .height = 256, .value = half_pattern };
    struct image im = { 0 };
    size_t size;
    uint8_t *bytes = exr_make(&r, &size);
    (void)state;

    must_decode(bytes, size, &im);
    free(bytes);
    for (int32_t i = 0; i < 0x7c00; i++)
        assert_true(im.rgb[3 * i] == half_pattern(0, i % 256, i / 256));
    assert_int_equal(im.faults.nan, 3 * 2 * 1023);
    assert_int_equal(im.faults.infinite, 3 * 2);
    assert_int_equal(im.faults.negative, 3 * (0x7c00 - 1)); /* -0 is none */
    assert_int_equal(im.faults.clipped, 3);
    image_finish(&im);
}

/* Texel 0 is white, texel 1 pure green, texel 2 pure red. */
static float primary_value(int c, int32_t x, int32_t y)
{
    (void)y;
    return x == 0 || (x == 1 && c == 1) || (x == 2 && c == 2) ? 1.0f : 0.0f;
}

static void decode_primaries(const float *chromaticities, const struct made_channel *channels, struct image *im)
{
    const struct exr_recipe r = {
        .channels = channels, .width = 3, .height = 2, .chromaticities = chromaticities, .value = primary_value
    };
    size_t size;
    uint8_t *bytes = exr_make(&r, &size);

    must_decode(bytes, size, im);
    free(bytes);
}

static void chromaticities_are_brought_to_rec709(void **state)
{
    /* [ITU-R BT.2020] shares Rec.709's white; its columns in Rec.709 are [ITU-R BT.2087-0, inverse of M2]'s */
    static const float rec2020[8] = { 0.708f, 0.292f, 0.170f, 0.797f, 0.131f, 0.046f, 0.3127f, 0.3290f };
    static const float want[3][3] = { { 1.0f, 1.0f, 1.0f }, { 0.0f, 1.1329f, 0.0f }, { 1.6605f, 0.0f, 0.0f } };
    struct image im = { 0 };
    (void)state;

    decode_primaries(rec2020, float_rgb, &im);
    for (size_t i = 0; i < 9; i++)
        assert_true(fabsf(im.rgb[i] - want[i / 3][i % 3]) < 2e-4f);
    assert_int_equal(im.faults.negative, 8); /* two in each of green and red, in two rows: out of Rec.709's reach */
    image_finish(&im);
}

static void chromaticities_of_rec709_change_no_bit(void **state)
{
    static const float rec709[8] = { 0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.31271f, 0.32902f };
    struct image im = { 0 };
    (void)state;

    decode_primaries(rec709, float_rgb, &im);
    for (int32_t i = 0; i < 9; i++)
        assert_true(im.rgb[i] == primary_value(2 - i % 3, i / 3, 0));
    image_finish(&im);
}

static void grey_stays_grey_under_any_chromaticities(void **state)
{
    static const float warm[8] = { 0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.44757f, 0.40745f };
    struct image im = { 0 };
    (void)state;

    decode_primaries(warm, float_y, &im);
    for (size_t i = 0; i < 3; i++)
        assert_true(im.rgb[i] == 1.0f);
    image_finish(&im);
}

static void chromaticities_on_a_line_are_refused(void **state)
{
    static const float line[8] = { 0.1f, 0.1f, 0.2f, 0.2f, 0.3f, 0.3f, 0.3127f, 0.3290f };
    const struct exr_recipe r = { .channels = half_rgb, .width = 3, .height = 2, .chromaticities = line };
    size_t size;
    uint8_t *bytes = exr_make(&r, &size);
    (void)state;

    must_refuse(bytes, size, ERR_FORMAT, "chromaticities");
    free(bytes);
}

static void the_envmap_attribute_becomes_the_layout(void **state)
{
    static const struct {
        int envmap;
        enum layout layout;
    } rows[] = { { 0, LAYOUT_AUTO }, { 1 + EXR_ENVMAP_LATLONG, LAYOUT_LATLONG }, { 1 + EXR_ENVMAP_CUBE, LAYOUT_CUBE } };
    struct image im = { 0 };
    (void)state;

    for (size_t i = 0; i < 3; i++) {
        check_recipe(&(struct exr_recipe){ .width = 4, .height = 24, .envmap = rows[i].envmap }, 0, &im);
        assert_int_equal(im.layout, rows[i].layout);
    }
    image_finish(&im);
}

static void of_several_parts_the_first_with_colour_is_read(void **state)
{
    static const struct made_channel depth[] = { { "Z", FLOAT }, { NULL, HALF } };
    static const struct made_channel other[] = { { "B", HALF }, { "G", HALF }, { "R", HALF }, { NULL, HALF } };
    const struct exr_recipe parts[] = {
        { .channels = depth, .width = 5, .height = 4 },
        { .channels = half_rgb, .width = 6, .height = 3, .deep = true },
        { .channels = half_rgba, .width = 20, .height = 10, .compression = EXR_COMPRESSION_ZIP, .left = 3, .top = -4 },
        { .channels = other, .width = 7, .height = 7 },
    };
    struct image im = { 0 };
    size_t size;
    uint8_t *bytes = exr_make_parts(parts, 4, &size);
    (void)state;

    must_decode(bytes, size, &im);
    free(bytes);
    assert_int_equal(im.width, 20);
    assert_int_equal(im.height, 10);
    for (int32_t i = 0; i < 200; i++)
        for (int c = 0; c < 3; c++)
            assert_true(im.rgb[3 * i + c] == recipe_value(3 - c, i % 20, i / 20));
    image_finish(&im);
}

/* The value of channel c everywhere. */
static float channel_value(int c, int32_t x, int32_t y)
{
    (void)x;
    (void)y;
    return (float)(1 + c);
}

static void check_layer(const struct exr_recipe *parts, int count, const char *wanted, int red, const char *said)
{
    struct image im = { .layer = wanted };
    size_t size;
    uint8_t *bytes = exr_make_parts(parts, count, &size);

    must_decode(bytes, size, &im);
    if (im.rgb[0] != (float)(1 + red))
        fail_msg("%s: channel %g is red, not %d", wanted ? wanted : "by meaning", (double)im.rgb[0] - 1.0, red);
    if (said ? !strstr(im.note, said) : im.note[0] != 0)
        fail_msg("'%s' does not say '%s'", im.note, said ? said : "nothing");
    free(bytes);
    image_finish(&im);
}

/* What renderers write beside the image must not light a scene because its name comes first. */
static void the_layer_that_is_named_like_an_image_is_read_and_the_choice_is_said(void **state)
{
    static const struct made_channel blender[] = { { "V.AO.B", HALF },       { "V.AO.G", HALF },
                                                   { "V.AO.R", HALF },       { "V.Combined.A", HALF },
                                                   { "V.Combined.B", HALF }, { "V.Combined.G", HALF },
                                                   { "V.Combined.R", HALF }, { NULL, HALF } };
    static const struct made_channel arnold[] = { { "albedo.B", HALF },   { "albedo.G", HALF },
                                                  { "albedo.R", HALF },   { "backdrop.B", HALF },
                                                  { "backdrop.G", HALF }, { "backdrop.R", HALF },
                                                  { NULL, HALF } };
    static const struct made_channel root[] = { { "B", HALF },        { "G", HALF },        { "R", HALF },
                                                { "beauty.B", HALF }, { "beauty.G", HALF }, { "beauty.R", HALF },
                                                { NULL, HALF } };
    static const struct made_channel words[] = { { "N.X", HALF },    { "N.Y", HALF },     { "N.Z", HALF },
                                                 { "c.blue", HALF }, { "c.green", HALF }, { "c.red", HALF },
                                                 { NULL, HALF } };
    static const struct made_channel eyes[] = { { "V.AO.left.B", HALF },
                                                { "V.AO.left.G", HALF },
                                                { "V.AO.left.R", HALF },
                                                { "V.Combined.left.B", HALF },
                                                { "V.Combined.left.G", HALF },
                                                { "V.Combined.left.R", HALF },
                                                { NULL, HALF } };
    static const struct made_channel joined[] = { { "Ambient_Occlusion.B", HALF },
                                                  { "Ambient_Occlusion.G", HALF },
                                                  { "Ambient_Occlusion.R", HALF },
                                                  { "beautyPass.B", HALF },
                                                  { "beautyPass.G", HALF },
                                                  { "beautyPass.R", HALF },
                                                  { NULL, HALF } };
    static const struct made_channel vray[] = { { ".B", HALF }, { ".G", HALF }, { ".R", HALF }, { NULL, HALF } };
    const struct exr_recipe rows[] = { { .channels = blender, .width = 4, .height = 2, .value = channel_value },
                                       { .channels = arnold, .width = 4, .height = 2, .value = channel_value },
                                       { .channels = root, .width = 4, .height = 2, .value = channel_value },
                                       { .channels = words, .width = 4, .height = 2, .value = channel_value },
                                       { .channels = vray, .width = 4, .height = 2, .value = channel_value },
                                       { .channels = eyes, .width = 4, .height = 2, .value = channel_value },
                                       { .channels = joined, .width = 4, .height = 2, .value = channel_value } };
    const struct exr_recipe parts[] = {
        { .channels = half_rgb, .name = "ao", .width = 4, .height = 2, .value = even_value },
        { .channels = half_rgba, .name = "beauty", .width = 4, .height = 2, .value = channel_value },
    };
    (void)state;

    check_layer(&rows[0], 1, NULL, 6, "layer V.Combined is read, of V.AO, V.Combined");
    check_layer(&rows[0], 1, "ao", 2, NULL);
    check_layer(&rows[0], 1, "V.AO", 2, NULL);
    check_layer(&rows[1], 1, NULL, 5, "layer backdrop");
    check_layer(&rows[2], 1, NULL, 2, "layer RGB");
    check_layer(&rows[2], 1, "beauty", 5, NULL);
    check_layer(&rows[3], 1, NULL, 5, NULL);
    check_layer(&rows[4], 1, NULL, 2, NULL);
    check_layer(&rows[5], 1, NULL, 5, "layer V.Combined.left");
    check_layer(&rows[6], 1, NULL, 5, "layer beautyPass");
    check_layer(parts, 2, NULL, 3, "layer beauty is read, of ao, beauty");
    check_layer(parts, 1, NULL, 3, NULL); /* a single part, by even_value */
}

static void a_layer_that_is_not_there_is_refused_with_the_names_of_those_that_are(void **state)
{
    const struct exr_recipe r = { .channels = layered, .width = 4, .height = 2 };
    struct image im = { .layer = "moon" };
    struct reason why;
    size_t size;
    uint8_t *bytes = exr_make(&r, &size);
    (void)state;

    assert_int_equal(decode_image(bytes, size, NAME, &im, &why), ERR_USAGE);
    assert_string_equal(why.text, NAME ": it has no layer 'moon'; its layers are sky, sun");
    free(bytes);
    image_finish(&im);
}

/* A crop and an overscan, which must not change where a direction's light comes from. */
static void the_display_window_is_the_frame_of_the_image(void **state)
{
    static const int32_t wide[4] = { 0, 0, 15, 7 }, small[4] = { 2, 1, 9, 4 }, aside[4] = { 100, 100, 115, 107 };
    struct exr_recipe r = { .channels = float_rgb, .width = 6, .height = 5, .left = 4, .top = 2, .display = wide };
    struct image im = { 0 };
    (void)state;

    for (int tiles = 0; tiles < 2; tiles++) {
        size_t size;
        r.tile_w = r.tile_h = tiles ? 16 : 0;
        r.display = wide;
        uint8_t *bytes = exr_make(&r, &size);
        must_decode(bytes, size, &im);
        free(bytes);
        assert_true(im.width == 16 && im.height == 8);
        for (int32_t y = 0; y < 8; y++)
            for (int32_t x = 0; x < 16; x++) {
                const bool inside = x >= 4 && x < 10 && y >= 2 && y < 7;
                assert_true(im.rgb[3 * (16 * y + x)] == (inside ? recipe_value(2, x - 4, y - 2) : 0.0f));
            }
        assert_non_null(strstr(im.note, "display window of 16x8"));
        r.display = small;
        bytes = exr_make(&r, &size);
        must_decode(bytes, size, &im);
        free(bytes);
        assert_true(im.width == 8 && im.height == 4);
        assert_true(im.rgb[0] == 0.0f && im.rgb[3 * (8 * 1 + 2)] == recipe_value(2, 0, 0));
        r.display = aside;
        bytes = exr_make(&r, &size);
        must_decode(bytes, size, &im);
        free(bytes);
        assert_true(im.width == 6 && im.height == 5);
        assert_non_null(strstr(im.note, "ignored"));
    }
    image_finish(&im);
}

static void what_is_not_modelled_is_refused_by_name(void **state)
{
    static const struct made_channel integers[] = { { "B", HALF }, { "G", UINT }, { "R", HALF }, { NULL, HALF } };
    static const struct made_channel chroma[] = { { "BY", HALF }, { "RY", HALF }, { "Y", HALF }, { NULL, HALF } };
    static const struct made_channel two[] = { { "G", HALF }, { "R", HALF }, { NULL, HALF } };
    static const struct made_channel split[] = { { "a.B", HALF }, { "a.G", HALF }, { "b.R", HALF }, { NULL, HALF } };
    static const struct {
        struct exr_recipe recipe;
        const char *about;
    } rows[] = {
        { { .channels = integers, .width = 4, .height = 4 }, "channel G holds integers" },
        { { .channels = chroma, .width = 4, .height = 4 }, "luminance with chroma" },
        { { .channels = two, .width = 4, .height = 4 }, "neither channels R, G, B" },
        { { .channels = split, .width = 4, .height = 4 }, "neither channels R, G, B" },
        { { .channels = half_rgb, .width = 4, .height = 4, .subsampling = 2 }, "channel B is subsampled 2x2" },
        { { .channels = half_rgb, .width = 4, .height = 4, .deep = true }, "deep" },
    };
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        size_t size;
        uint8_t *bytes = exr_make(&rows[i].recipe, &size);
        must_refuse(bytes, size, ERR_UNSUPPORTED, rows[i].about);
        free(bytes);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(scanlines_decode_with_each_compression_and_set_of_channels),
    cmocka_unit_test(tiles_decode_with_each_compression_and_set_of_channels),
    cmocka_unit_test(of_mip_and_rip_maps_the_largest_level_is_read),
    cmocka_unit_test(the_data_window_is_the_image_wherever_it_lies),
    cmocka_unit_test(rows_stored_from_the_bottom_up_come_out_top_first),
    cmocka_unit_test(the_smallest_image_decodes),
    cmocka_unit_test(memory_is_reused_for_images_that_fit),
    cmocka_unit_test(odd_values_are_put_right_and_counted),
    cmocka_unit_test(every_half_float_has_its_value),
    cmocka_unit_test(chromaticities_are_brought_to_rec709),
    cmocka_unit_test(chromaticities_of_rec709_change_no_bit),
    cmocka_unit_test(grey_stays_grey_under_any_chromaticities),
    cmocka_unit_test(chromaticities_on_a_line_are_refused),
    cmocka_unit_test(the_envmap_attribute_becomes_the_layout),
    cmocka_unit_test(of_several_parts_the_first_with_colour_is_read),
    cmocka_unit_test(the_layer_that_is_named_like_an_image_is_read_and_the_choice_is_said),
    cmocka_unit_test(a_layer_that_is_not_there_is_refused_with_the_names_of_those_that_are),
    cmocka_unit_test(the_display_window_is_the_frame_of_the_image),
    cmocka_unit_test(what_is_not_modelled_is_refused_by_name),
};

UNIT_MAIN(tests)
