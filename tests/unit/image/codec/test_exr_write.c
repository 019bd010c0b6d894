#include "image/codec/encode.h"

#include "base/mem.h"
#include "base/rng.h"
#include "image/codec/decode.h"
#include "support/unit.h"

#include <dirent.h>
#include <math.h>
#include <omp.h>
#include <signal.h>
#include <stdbool.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#define SIDE_MOST 70
#define PATH_ROOM 256

/* A folder of the test's own, removed with its files by leave. */
struct folder {
    char path[PATH_ROOM];
    char file[PATH_ROOM + 16]; /* picture.exr in it */
};

static void enter(struct folder *f)
{
    const char *base = getenv("TMPDIR");
    snprintf(f->path, sizeof(f->path), "%s/relight-exr-XXXXXX", base && base[0] ? base : "/tmp");
    assert_non_null(mkdtemp(f->path));
    snprintf(f->file, sizeof(f->file), "%s/picture.exr", f->path);
}

/* How many names the folder holds. */
static int names_in(const struct folder *f)
{
    int count = 0;
    DIR *d = opendir(f->path);
    assert_non_null(d);
    for (const struct dirent *e = readdir(d); e; e = readdir(d))
        count += e->d_name[0] != '.';
    closedir(d);
    return count;
}

static void leave(struct folder *f)
{
    unlink(f->file);
    assert_int_equal(rmdir(f->path), 0); /* nothing else was left behind */
}

static void scatter(float *rgb, size_t count, double stops)
{
    struct rng r = { 11 };
    for (size_t i = 0; i < count; i++)
        rgb[i] = (float)exp2(stops * (rng_next(&r) - 0.5));
}

static enum err encode(const struct exr_desc *d, uint8_t **bytes, size_t *size)
{
    struct reason why = { "" };
    const enum err e = exr_encode(d, bytes, size, &why);
    if (e)
        print_message("%s\n", why.text);
    return e;
}

static void float_values_come_back_bit_for_bit(void **state)
{
    static float rgb[SIDE_MOST * SIDE_MOST * 3];
    static const uint32_t sizes[][2] = { { 1, 1 }, { 1, 17 }, { 16, 16 }, { 33, 15 }, { 70, 70 }, { 7, 64 } };
    (void)state;

    scatter(rgb, SIDE_MOST * SIDE_MOST * 3, 60.0);
    rgb[0] = 0.0f;
    rgb[1] = 0x1p-149f;
    rgb[2] = 1e11f;
    for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
        const struct exr_desc d = { .rgb = rgb, .width = sizes[i][0], .height = sizes[i][1] };
        struct image im = { 0 };
        struct reason why = { "" };
        uint8_t *bytes;
        size_t size;
        assert_int_equal(encode(&d, &bytes, &size), ERR_OK);
        assert_int_equal(decode_exr(bytes, size, "memory", &im, &why), ERR_OK);
        assert_int_equal(im.width, d.width);
        assert_int_equal(im.height, d.height);
        assert_memory_equal(im.rgb, rgb, (size_t)d.width * d.height * 3 * sizeof(float));
        image_finish(&im);
        mem_free(bytes);
    }
}

/* The fourth channel stands before the others in the file and leaves them as they are. */
static void alpha_is_a_channel_of_its_own(void **state)
{
    enum { W = 33, H = 19 };
    static const uint8_t head[] = "channels\0chlist\0\x49\0\0\0A"; /* 73 bytes about four channels */
    static float rgba[4 * W * H];
    struct image im = { 0 };
    struct reason why = { "" };
    uint8_t *bytes;
    size_t size;
    (void)state;

    scatter(rgba, 4 * W * H, 20.0);
    for (int depth = EXR_FLOAT; depth <= EXR_HALF; depth++) {
        const struct exr_desc d = { .rgb = rgba, .width = W, .height = H, .depth = depth, .alpha = true };
        assert_int_equal(encode(&d, &bytes, &size), ERR_OK);
        size_t at = 0;
        while (at + sizeof(head) < size && memcmp(bytes + at, head, sizeof(head)) != 0)
            at++;
        assert_true(at + sizeof(head) < size);
        assert_int_equal(decode_exr(bytes, size, "memory", &im, &why), ERR_OK);
        for (size_t i = 0; i < W * H; i++)
            for (size_t c = 0; c < 3; c++)
                assert_true(fabsf(im.rgb[3 * i + c] - rgba[4 * i + c]) <=
                            (depth == EXR_FLOAT ? 0.0f : 1e-3f * rgba[4 * i + c] + 1e-7f));
        image_finish(&im);
        mem_free(bytes);
    }
}

/* Small images of 8-bit noise, some of whose chunks come out of compression exactly as long as they went in. */
static void noise_that_does_not_compress_comes_back_bit_for_bit(void **state)
{
    (void)state;
    for (uint32_t k = 0; k < 2000; k++) {
        const uint32_t width = 1 + k % 7, height = 1 + k / 7 % 12;
        struct rng r = { rng_mix(99, k) };
        float rgb[3 * 7 * 12];
        struct reason why;
        struct image back = { 0 };
        uint8_t *bytes;
        size_t size;
        for (size_t i = 0; i < 3 * (size_t)width * height; i++)
            rgb[i] = (float)(int)(256.0 * rng_next(&r)) / 256.0f;
        const struct exr_desc d = { .rgb = rgb, .width = width, .height = height };
        assert_int_equal(exr_encode(&d, &bytes, &size, &why), ERR_OK);
        assert_int_equal(decode_exr(bytes, size, "noise.exr", &back, &why), ERR_OK);
        assert_memory_equal(back.rgb, rgb, 3 * (size_t)width * height * sizeof(float));
        image_finish(&back);
        mem_free(bytes);
    }
}

static void half_values_are_rounded_and_cut_at_65504(void **state)
{
    enum { W = 5, H = 40 };
    static float rgb[W * H * 3];
    const struct exr_desc d = { .rgb = rgb, .width = W, .height = H, .depth = EXR_HALF };
    struct image im = { 0 };
    struct reason why = { "" };
    uint8_t *bytes;
    size_t size;
    (void)state;

    scatter(rgb, W * H * 3, 20.0);
    rgb[0] = 65504.0f;
    rgb[1] = 65520.0f; /* would round to infinity */
    rgb[2] = INFINITY;
    rgb[W * H * 3 - 1] = 1e30f;
    assert_int_equal(encode(&d, &bytes, &size), ERR_OK);
    assert_int_equal(decode_exr(bytes, size, "memory", &im, &why), ERR_OK);
    assert_int_equal(im.faults.infinite, 0);
    for (size_t i = 0; i < W * H * 3; i++) {
        const float want = fminf(rgb[i], 65504.0f);
        assert_true(fabsf(im.rgb[i] - want) <= want * 0x1p-11f);
    }
    assert_true(im.rgb[2] == 65504.0f);
    image_finish(&im);
    mem_free(bytes);
}

static bool contains(const uint8_t *bytes, size_t size, const char *text)
{
    const size_t n = strlen(text);
    for (size_t i = 0; i + n <= size; i++)
        if (memcmp(bytes + i, text, n) == 0)
            return true;
    return false;
}

static void header_states_primaries_and_attributes(void **state)
{
    const float rgb[3] = { 1.0f, 2.0f, 3.0f };
    const struct exr_attribute attributes[] = { { "method", "mis" }, { "seed", "12345" } };
    const struct exr_desc d = { .rgb = rgb, .width = 1, .height = 1, .attributes = attributes, .attribute_count = 2 };
    uint8_t *bytes;
    size_t size;
    (void)state;

    assert_int_equal(encode(&d, &bytes, &size), ERR_OK);
    assert_true(contains(bytes, size, "chromaticities"));
    assert_true(contains(bytes, size, "method"));
    assert_true(contains(bytes, size, "mis"));
    assert_true(contains(bytes, size, "12345"));
    mem_free(bytes);
}

static void same_input_gives_the_same_bytes(void **state)
{
    static float rgb[SIDE_MOST * SIDE_MOST * 3];
    (void)state;

    scatter(rgb, SIDE_MOST * SIDE_MOST * 3, 10.0);
    for (int depth = EXR_FLOAT; depth <= EXR_HALF; depth++) {
        const struct exr_desc d = {
            .rgb = rgb, .width = SIDE_MOST, .height = SIDE_MOST, .depth = (enum exr_depth)depth
        };
        uint8_t *a, *b;
        size_t size_a, size_b;
        assert_int_equal(encode(&d, &a, &size_a), ERR_OK);
        assert_int_equal(encode(&d, &b, &size_b), ERR_OK);
        assert_int_equal(size_a, size_b);
        assert_memory_equal(a, b, size_a);
        mem_free(a);
        mem_free(b);
    }
}

/* 70 rows are five chunks: several threads share them, and the last is lower. */
static void any_number_of_threads_gives_the_same_bytes(void **state)
{
    static float rgb[SIDE_MOST * SIDE_MOST * 3];
    const struct exr_desc d = { .rgb = rgb, .width = SIDE_MOST, .height = SIDE_MOST };
    uint8_t *one, *many;
    size_t size, size_many;
    (void)state;

    scatter(rgb, SIDE_MOST * SIDE_MOST * 3, 10.0);
    omp_set_num_threads(1);
    assert_int_equal(encode(&d, &one, &size), ERR_OK);
    for (int threads = 2; threads <= 5; threads++) {
        omp_set_num_threads(threads);
        assert_int_equal(encode(&d, &many, &size_many), ERR_OK);
        assert_int_equal(size_many, size);
        assert_memory_equal(many, one, size);
        mem_free(many);
    }
    mem_free(one);
}

static void smooth_images_are_compressed(void **state)
{
    static float rgb[SIDE_MOST * SIDE_MOST * 3];
    const struct exr_desc d = { .rgb = rgb, .width = SIDE_MOST, .height = SIDE_MOST };
    uint8_t *bytes;
    size_t size;
    (void)state;

    assert_int_equal(encode(&d, &bytes, &size), ERR_OK);
    assert_true(size < sizeof(rgb) / 20);
    mem_free(bytes);
}

static void sizes_out_of_range_are_refused(void **state)
{
    static const uint32_t sizes[][2] = { { 0, 4 }, { 4, 0 }, { 65536, 1 }, { UINT32_MAX, UINT32_MAX } };
    const float rgb[3] = { 0.0f, 0.0f, 0.0f };
    (void)state;

    for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
        const struct exr_desc d = { .rgb = rgb, .width = sizes[i][0], .height = sizes[i][1] };
        uint8_t *bytes;
        size_t size;
        assert_int_equal(encode(&d, &bytes, &size), ERR_RANGE);
        assert_null(bytes);
    }
}

static void file_replaces_the_old_one_whole(void **state)
{
    static float rgb[30 * 30 * 3];
    struct exr_desc d = { .rgb = rgb, .width = 30, .height = 30 };
    struct image im = { 0 };
    struct reason why = { "" };
    struct folder f;
    (void)state;

    enter(&f);
    scatter(rgb, 30 * 30 * 3, 10.0);
    assert_int_equal(exr_write(&d, f.file, &why), ERR_OK);
    d.width = 3;
    d.height = 2; /* shorter than the old one */
    assert_int_equal(exr_write(&d, f.file, &why), ERR_OK);
    assert_int_equal(decode_file(f.file, &im, &why), ERR_OK);
    assert_int_equal(im.width, 3);
    assert_memory_equal(im.rgb, rgb, 3 * 2 * 3 * sizeof(float));
    assert_int_equal(names_in(&f), 1);
    image_finish(&im);
    leave(&f);
}

/* A limit on file size stands for a disk that fills up half-way. */
static void failed_write_keeps_the_old_file_and_nothing_else(void **state)
{
    static float rgb[SIDE_MOST * SIDE_MOST * 3];
    const struct exr_desc small = { .rgb = rgb, .width = 2, .height = 2 };
    const struct exr_desc large = { .rgb = rgb, .width = SIDE_MOST, .height = SIDE_MOST };
    struct rlimit old, limit;
    struct image im = { 0 };
    struct reason why = { "" };
    struct folder f;
    (void)state;

    enter(&f);
    scatter(rgb, SIDE_MOST * SIDE_MOST * 3, 30.0);
    assert_int_equal(exr_write(&small, f.file, &why), ERR_OK);
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &old), 0);
    limit = old;
    limit.rlim_cur = 1000;
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
    const enum err e = exr_write(&large, f.file, &why);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &old), 0);
    assert_int_equal(e, ERR_IO);
    assert_non_null(strstr(why.text, "picture.exr: cannot write"));
    assert_int_equal(names_in(&f), 1);
    assert_int_equal(decode_file(f.file, &im, &why), ERR_OK);
    assert_int_equal(im.width, 2);
    image_finish(&im);
    leave(&f);
}

static void full_disk_and_missing_folder_are_named(void **state)
{
    static const float rgb[3] = { 1.0f, 1.0f, 1.0f };
    const struct exr_desc d = { .rgb = rgb, .width = 1, .height = 1 };
    struct reason why = { "" };
    struct folder f;
    char path[PATH_ROOM + 32];
    struct stat st;
    (void)state;

    enter(&f);
    snprintf(path, sizeof(path), "%s/missing/a.exr", f.path);
    assert_int_equal(exr_write(&d, path, &why), ERR_IO);
    assert_non_null(strstr(why.text, path));
    assert_non_null(strstr(why.text, "No such file"));
    assert_int_equal(exr_write(&d, f.path, &why), ERR_IO);
    assert_non_null(strstr(why.text, "directory"));
    leave(&f);
    if (stat("/dev/full", &st) != 0 || !S_ISCHR(st.st_mode))
        return;
    assert_int_equal(exr_write(&d, "/dev/full", &why), ERR_IO);
    assert_non_null(strstr(why.text, "No space left"));
    /* written in place, not renamed over: a device stays a device */
    assert_int_equal(stat("/dev/full", &st), 0);
    assert_true(S_ISCHR(st.st_mode));
}

static void symbolic_link_stays_and_its_target_is_written(void **state)
{
    static const float rgb[3] = { 4.0f, 5.0f, 6.0f };
    const struct exr_desc d = { .rgb = rgb, .width = 1, .height = 1 };
    struct image im = { 0 };
    struct reason why = { "" };
    struct folder f;
    char target[PATH_ROOM + 16];
    struct stat st;
    (void)state;

    enter(&f);
    snprintf(target, sizeof(target), "%s/target.exr", f.path);
    assert_int_equal(symlink("target.exr", f.file), 0);
    assert_int_equal(exr_write(&d, f.file, &why), ERR_OK);
    assert_int_equal(lstat(f.file, &st), 0);
    assert_true(S_ISLNK(st.st_mode));
    assert_int_equal(decode_file(target, &im, &why), ERR_OK);
    assert_true(im.rgb[2] == 6.0f);
    image_finish(&im);
    unlink(target);
    leave(&f);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(float_values_come_back_bit_for_bit),
    cmocka_unit_test(alpha_is_a_channel_of_its_own),
    cmocka_unit_test(noise_that_does_not_compress_comes_back_bit_for_bit),
    cmocka_unit_test(half_values_are_rounded_and_cut_at_65504),
    cmocka_unit_test(header_states_primaries_and_attributes),
    cmocka_unit_test(same_input_gives_the_same_bytes),
    cmocka_unit_test(any_number_of_threads_gives_the_same_bytes),
    cmocka_unit_test(smooth_images_are_compressed),
    cmocka_unit_test(sizes_out_of_range_are_refused),
    cmocka_unit_test(file_replaces_the_old_one_whole),
    cmocka_unit_test(failed_write_keeps_the_old_file_and_nothing_else),
    cmocka_unit_test(full_disk_and_missing_folder_are_named),
    cmocka_unit_test(symbolic_link_stays_and_its_target_is_written),
};

UNIT_MAIN(tests)
