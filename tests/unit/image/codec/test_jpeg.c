#include "image/codec/encode.h"

#include "support/unit.h"

#include <math.h>
#include <turbojpeg.h>

#define WIDTH 161 /* odd: not whole blocks */
#define HEIGHT 93

static uint8_t picture[HEIGHT][WIDTH][3], decoded[HEIGHT][WIDTH][3];

/* Smooth, as skies are, with one hard edge. */
static void paint(void)
{
    for (int y = 0; y < HEIGHT; y++) {
        for (int x = 0; x < WIDTH; x++) {
            picture[y][x][0] = (uint8_t)(120.0 + 100.0 * sin(x * 0.05));
            picture[y][x][1] = (uint8_t)(x > y ? 200 : 90);
            picture[y][x][2] = (uint8_t)(y * 2);
        }
    }
}

/* Decodes into `decoded`, returns the chroma sampling. */
static int decode(const uint8_t *bytes, size_t size)
{
    int width, height, sampling, space;
    tjhandle h = tjInitDecompress();

    assert_int_equal(tjDecompressHeader3(h, bytes, size, &width, &height, &sampling, &space), 0);
    assert_int_equal(width, WIDTH);
    assert_int_equal(height, HEIGHT);
    assert_int_equal(tjDecompress2(h, bytes, size, &decoded[0][0][0], width, 0, height, TJPF_RGB, 0), 0);
    tjDestroy(h);
    return sampling;
}

static double rms_error(void)
{
    double sum = 0.0;
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++)
            for (int k = 0; k < 3; k++)
                sum += pow((double)decoded[y][x][k] - picture[y][x][k], 2.0);
    return sqrt(sum / (WIDTH * HEIGHT * 3));
}

static void decoded_image_is_the_image(void **state)
{
    /* 4:2:0 smears the coloured edge; the bounds would be missed at once by swapped channels or rows (> 60) */
    static const struct {
        int quality;
        double most;
    } rows[] = { { 60, 9.0 }, { 85, 7.0 }, { 90, 2.5 }, { 100, 1.0 } };
    struct jpeg_encoder *j = jpeg_encoder_create();
    const uint8_t *bytes;
    size_t size;
    (void)state;

    paint();
    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        assert_int_equal(jpeg_encode(j, &picture[0][0][0], WIDTH, HEIGHT, rows[i].quality, &bytes, &size), ERR_OK);
        decode(bytes, size);
        print_message("quality %d: %zu bytes, error %.2f\n", rows[i].quality, size, rms_error());
        assert_true(rms_error() < rows[i].most);
    }
    jpeg_encoder_destroy(j);
}

static void chroma_is_whole_from_quality_90(void **state)
{
    struct jpeg_encoder *j = jpeg_encoder_create();
    const uint8_t *bytes;
    size_t size;
    (void)state;

    paint();
    assert_int_equal(jpeg_encode(j, &picture[0][0][0], WIDTH, HEIGHT, 89, &bytes, &size), ERR_OK);
    assert_int_equal(decode(bytes, size), TJSAMP_420);
    assert_int_equal(jpeg_encode(j, &picture[0][0][0], WIDTH, HEIGHT, 90, &bytes, &size), ERR_OK);
    assert_int_equal(decode(bytes, size), TJSAMP_444);
    jpeg_encoder_destroy(j);
}

static void memory_and_bytes_are_the_same_again(void **state)
{
    static uint8_t first[WIDTH * HEIGHT * 4];
    struct jpeg_encoder *j = jpeg_encoder_create();
    const uint8_t *a, *b;
    size_t size_a, size_b;
    (void)state;

    paint();
    assert_int_equal(jpeg_encode(j, &picture[0][0][0], WIDTH, HEIGHT, 85, &a, &size_a), ERR_OK);
    assert_true(size_a < sizeof(first));
    memcpy(first, a, size_a);
    assert_int_equal(jpeg_encode(j, &picture[0][0][0], 16, 16, 85, &b, &size_b), ERR_OK);
    assert_int_equal(jpeg_encode(j, &picture[0][0][0], WIDTH, HEIGHT, 85, &b, &size_b), ERR_OK);
    assert_ptr_equal(a, b);
    assert_int_equal(size_a, size_b);
    assert_memory_equal(first, b, size_b);
    jpeg_encoder_destroy(j);
}

/* The library's own all-in-one call, which jpeg_encode takes apart so that its memory can stay. */
static void bytes_are_those_of_the_librarys_own_call(void **state)
{
    enum { SIDE = 70 };
    static const int qualities[] = { 1, 40, 85, 89, 90, 96, 100 };
    static uint8_t noise[SIDE * SIDE * 3];
    struct jpeg_encoder *j = jpeg_encoder_create();
    tjhandle h = tjInitCompress();
    const uint8_t *bytes;
    size_t size;
    (void)state;

    for (size_t i = 0; i < sizeof(noise); i++)
        noise[i] = (uint8_t)(i * 2654435761u >> 13);
    paint();
    for (size_t q = 0; q < sizeof(qualities) / sizeof(qualities[0]); q++)
        for (int width = 1; width <= SIDE; width += width % 2 ? 4 : 5)
            for (int height = 1; height <= SIDE; height += 9)
                for (int kind = 0; kind < 2; kind++) {
                    const int sampling = qualities[q] >= 90 ? TJSAMP_444 : TJSAMP_420;
                    const uint8_t *rgb = kind ? &picture[0][0][0] : noise; /* rows are as wide as they are taken */
                    unsigned char *want = NULL;
                    unsigned long want_size = 0;
                    assert_int_equal(tjCompress2(h, rgb, width, 0, height, TJPF_RGB, &want, &want_size, sampling,
                                                 qualities[q], TJFLAG_ACCURATEDCT),
                                     0);
                    assert_int_equal(
                        jpeg_encode(j, rgb, (uint32_t)width, (uint32_t)height, qualities[q], &bytes, &size), ERR_OK);
                    assert_int_equal(size, want_size);
                    assert_memory_equal(bytes, want, size);
                    tjFree(want);
                }
    tjDestroy(h);
    jpeg_encoder_destroy(j);
}

static void sides_that_the_format_cannot_hold_are_refused(void **state)
{
    static uint8_t line[65536 * 3];
    static const uint32_t sides[][2] = { { 0, 1 }, { 1, 0 }, { 65501, 1 }, { 1, 65501 }, { UINT32_MAX, UINT32_MAX } };
    struct jpeg_encoder *j = jpeg_encoder_create();
    const uint8_t *bytes = line;
    size_t size = 1;
    (void)state;

    for (size_t i = 0; i < sizeof(sides) / sizeof(sides[0]); i++) {
        assert_int_equal(jpeg_encode(j, line, sides[i][0], sides[i][1], 85, &bytes, &size), ERR_RANGE);
        assert_null(bytes);
        assert_int_equal(size, 0);
    }
    assert_int_equal(jpeg_encode(j, line, 65500, 1, 85, &bytes, &size), ERR_OK);
    assert_int_equal(jpeg_encode(j, line, 1, 1, 100, &bytes, &size), ERR_OK);
    assert_true(size > 0);
    jpeg_encoder_destroy(j);
}

static void destroying_nothing_is_allowed(void **state)
{
    (void)state;
    jpeg_encoder_destroy(NULL);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(decoded_image_is_the_image),
    cmocka_unit_test(chroma_is_whole_from_quality_90),
    cmocka_unit_test(memory_and_bytes_are_the_same_again),
    cmocka_unit_test(bytes_are_those_of_the_librarys_own_call),
    cmocka_unit_test(sides_that_the_format_cannot_hold_are_refused),
    cmocka_unit_test(destroying_nothing_is_allowed),
};

UNIT_MAIN(tests)
