/* OpenEXR files that are damaged, cut short or lie; and the outside files, damaged and odd. */
#include "image/codec/decoding.h"

#include "image/codec/make_exr.h"

#include <dirent.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

static const struct made_channel rgba[] = { { "A", EXR_PIXEL_HALF },
                                           { "B", EXR_PIXEL_HALF },
                                           { "G", EXR_PIXEL_FLOAT },
                                           { "R", EXR_PIXEL_HALF },
                                           { NULL, EXR_PIXEL_HALF } };

static const struct exr_recipe small[] = {
    { .channels = rgba, .compression = EXR_COMPRESSION_NONE, .width = 7, .height = 5 },
    { .channels = rgba, .compression = EXR_COMPRESSION_RLE, .width = 7, .height = 5 },
    { .channels = rgba, .compression = EXR_COMPRESSION_ZIPS, .width = 16, .height = 5 },
    { .channels = rgba, .compression = EXR_COMPRESSION_ZIP, .width = 7, .height = 18 },
    { .channels = rgba, .compression = EXR_COMPRESSION_PIZ, .width = 16, .height = 33 },
    { .channels = rgba, .compression = EXR_COMPRESSION_PXR24, .width = 7, .height = 18 },
    { .channels = rgba, .compression = EXR_COMPRESSION_B44, .width = 8, .height = 33 },
    { .channels = rgba, .compression = EXR_COMPRESSION_B44A, .width = 8, .height = 33 },
    { .channels = rgba, .compression = EXR_COMPRESSION_ZIP, .width = 9, .height = 9, .tile_w = 8, .tile_h = 8 },
    { .channels = rgba, .compression = EXR_COMPRESSION_PIZ, .width = 9, .height = 9, .tile_w = 8, .tile_h = 8 },
};

#define SMALL (sizeof(small) / sizeof(small[0]))

static void a_file_cut_at_any_byte_is_refused(void **state)
{
    (void)state;

    for (size_t i = 0; i < SMALL; i++) {
        size_t size;
        uint8_t *bytes = exr_make(&small[i], &size);
        must_refuse_each_cut(bytes, size);
        free(bytes);
    }
}

static void turned_bits_are_survived(void **state)
{
    (void)state;

    for (size_t i = 0; i < SMALL; i++) {
        size_t size;
        uint8_t *bytes = exr_make(&small[i], &size);
        must_survive_turned_bits(bytes, size);
        free(bytes);
    }
}

static void faults_in_a_later_part_are_told(void **state)
{
    static const struct made_channel depth[] = { { "Z", EXR_PIXEL_FLOAT }, { NULL, EXR_PIXEL_HALF } };
    const struct exr_recipe parts[] = {
        { .channels = depth, .width = 2, .height = 2 },
        { .channels = rgba, .width = 5, .height = 4, .compression = EXR_COMPRESSION_RLE }
    };
    size_t size;
    uint8_t *bytes = exr_make_parts(parts, 2, &size);
    (void)state;

    must_refuse_each_cut(bytes, size);
    must_refuse(bytes, size - 1, ERR_FORMAT, "scanline 3");
    must_survive_turned_bits(bytes, size);
    free(bytes);
}

/* Finds the attribute's value: behind its name, its type and four bytes of size. */
static uint8_t *find_attribute(uint8_t *bytes, size_t size, const char *name, const char *type)
{
    char key[64];
    const size_t n = strlen(name) + 1, t = strlen(type) + 1;

    memcpy(key, name, n);
    memcpy(key + n, type, t);
    for (size_t at = 0; at + n + t < size; at++)
        if (memcmp(bytes + at, key, n + t) == 0)
            return bytes + at + n + t + 4;
    fail_msg("no attribute %s", name);
    return NULL;
}

/* A small file whose data window claims to be larger. */
static uint8_t *make_liar(const struct exr_recipe *r, int32_t width, int32_t height, size_t *size)
{
    uint8_t *bytes = exr_make(r, size);
    const int32_t window[4] = { 0, 0, width - 1, height - 1 };

    memcpy(find_attribute(bytes, *size, "dataWindow", "box2i"), window, sizeof(window));
    return bytes;
}

static void sizes_beyond_the_limit_are_refused_as_such(void **state)
{
    static const int32_t sizes[][2] = {
        { IMAGE_MAX_SIDE + 1, 4 },
        { 4, IMAGE_MAX_SIDE + 1 },
        { IMAGE_MAX_SIDE, IMAGE_MAX_SIDE },
        { 1000000000, 1 },
    };
    (void)state;

    for (size_t i = 0; i < SMALL; i++) {
        for (size_t s = 0; s < sizeof(sizes) / sizeof(sizes[0]); s++) {
            size_t size;
            uint8_t *bytes = make_liar(&small[i], sizes[s][0], sizes[s][1], &size);
            must_refuse(bytes, size, ERR_RANGE, "too large");
            free(bytes);
        }
    }
}

static void sizes_that_the_file_cannot_hold_take_no_memory(void **state)
{
    struct image im = { 0 };
    struct reason why;
    (void)state;

    for (size_t i = 0; i < SMALL; i++) {
        size_t size;
        uint8_t *bytes = make_liar(&small[i], IMAGE_MAX_SIDE, IMAGE_MAX_SIDE / 2, &size);
        assert_int_equal(decode_alone(bytes, size, &im, &why), ERR_FORMAT);
        assert_non_null(strstr(why.text, "16384x8192 texels"));
        assert_null(im.rgb);
        free(bytes);
    }
    image_finish(&im);
}

/* What the library itself takes is measured too: in a process that may have no more than 256 MiB. A sanitizer needs
 * more than that for itself. */
static void liars_are_refused_in_little_memory(void **state)
{
    const struct rlimit limit = { (rlim_t)256 << 20, (rlim_t)256 << 20 };
    (void)state;

#if defined(__SANITIZE_ADDRESS__)
    skip();
#endif
    for (size_t i = 0; i < SMALL; i++) {
        size_t size;
        uint8_t *bytes = make_liar(&small[i], 16000, 8000, &size);
        const pid_t child = fork();
        if (child == 0) {
            struct image im = { 0 };
            _exit(setrlimit(RLIMIT_AS, &limit) ? 99 : (int)decode_image(bytes, size, NAME, &im, NULL));
        }
        int status = 0;
        assert_true(child > 0 && waitpid(child, &status, 0) == child);
        assert_true(WIFEXITED(status));
        assert_int_equal(WEXITSTATUS(status), ERR_FORMAT);
        free(bytes);
    }
}

/* The file with `count` times `entry` put in at `at`; the caller frees it. */
static uint8_t *stuff(const uint8_t *bytes, size_t size, size_t at, const void *entry, size_t length, size_t count)
{
    uint8_t *more = malloc(size + count * length);

    assert_non_null(more);
    memcpy(more, bytes, at);
    for (size_t i = 0; i < count; i++)
        memcpy(more + at + i * length, entry, length);
    memcpy(more + at + count * length, bytes + at, size - at);
    return more;
}

/* Either would keep the library busy for minutes. */
static void endless_headers_are_refused_before_they_are_sorted(void **state)
{
    static const char attribute[] = "a\0int\0\4\0\0\0\0\0\0";
    const size_t count = 200000, entry = 2 + 16;
    size_t size;
    uint8_t *bytes = exr_make(&small[0], &size);
    uint8_t *list = find_attribute(bytes, size, "channels", "chlist");
    (void)state;

    uint8_t *more = stuff(bytes, size, 8, attribute, sizeof(attribute), count);
    must_refuse(more, size + count * sizeof(attribute), ERR_RANGE, "attributes");
    free(more);

    const size_t at = (size_t)(list - bytes);
    const uint32_t length = (uint32_t)(list[-4] + count * entry);
    more = stuff(bytes, size, at, list, entry, count);
    memcpy(more + at - 4, &length, 4);
    must_refuse(more, size + count * entry, ERR_RANGE, "channel list");
    free(more);
    free(bytes);
}

static void lists_of_many_channels_are_refused(void **state)
{
    const size_t count = 1100, entry = 6 + 16;
    size_t size;
    uint8_t *bytes = exr_make(&small[0], &size);
    uint8_t *list = find_attribute(bytes, size, "channels", "chlist");
    const size_t at = (size_t)(list - bytes);
    const uint32_t length = (uint32_t)(list[-4] + count * entry);
    char name[8];
    (void)state;

    uint8_t *more = stuff(bytes, size, at, "\0\0\0\0\0\0\1\0\0\0\0\0\0\0\1\0\0\0\1\0\0", entry, count);
    for (size_t i = 0; i < count; i++) {
        snprintf(name, sizeof(name), "0%04zu", i);
        memcpy(more + at + i * entry, name, 6);
    }
    memcpy(more + at - 4, &length, 4);
    must_refuse(more, size + count * entry, ERR_RANGE, "1104 channels");
    free(more);
    free(bytes);
}

static void neither_format_is_said_with_the_first_bytes(void **state)
{
    (void)state;

    must_refuse((const uint8_t *)"", 0, ERR_FORMAT, "empty");
    must_refuse((const uint8_t *)"\x89PNG", 4, ERR_FORMAT, "89 50 4e 47");
    must_refuse((const uint8_t *)"v", 1, ERR_FORMAT, "76 00");
}

static void files_are_read_whole_or_refused_with_their_path(void **state)
{
    char path[] = "/tmp/relight-decode-XXXXXX";
    struct image im = { 0 };
    struct reason why;
    size_t size;
    uint8_t *bytes = exr_make(&small[4], &size);
    const int fd = mkstemp(path);
    (void)state;

    assert_true(fd >= 0);
    assert_int_equal(write(fd, bytes, size), size);
    assert_int_equal(decode_file(path, &im, &why), ERR_OK);
    assert_int_equal(im.width, small[4].width);
    assert_int_equal(ftruncate(fd, (off_t)size - 1), 0);
    assert_int_equal(decode_file(path, &im, &why), ERR_FORMAT);
    check_reason(path, ERR_FORMAT, &why);
    close(fd);
    unlink(path);
    assert_int_equal(decode_file(path, &im, &why), ERR_IO);
    check_reason(path, ERR_IO, &why);
    assert_int_equal(decode_file("/tmp", &im, &why), ERR_IO);
    check_reason("/tmp", ERR_IO, &why);
    image_finish(&im);
    free(bytes);
}

/* Decodes the file at unit_data(relative) and returns the code; any reason names the file. */
static enum err decode_data(const char *relative, struct image *im, struct reason *why)
{
    const char *path = unit_data(relative);

    why->text[0] = '\0';
    const enum err e = decode_file(path, im, why);
    if (e)
        check_reason(path, e, why);
    else
        check_image(im);
    return e;
}

static void damaged_files_are_refused(void **state)
{
    struct image im = { 0 };
    struct reason why;
    char relative[300];
    int seen = 0;
    DIR *dir = opendir(unit_data("bad_exr/damaged"));
    (void)state;

    assert_non_null(dir);
    for (struct dirent *d; (d = readdir(dir)); seen++) {
        snprintf(relative, sizeof(relative), "bad_exr/damaged/%s", d->d_name);
        if (!decode_data(relative, &im, &why))
            fail_msg("%s is taken for whole", d->d_name);
    }
    closedir(dir);
    assert_true(seen > 2); /* more than the folder and its parent, which are refused too */
    image_finish(&im);
}

static void odd_files_decode_or_are_refused_by_name(void **state)
{
    static const struct {
        const char *name, *about; /* about: what the refusal says; NULL: decodes */
        uint32_t width, height;
        bool nan, negative;
    } rows[] = {
        { "AllHalfValues", NULL, 256, 256, true, true },
        { "BrightRingsNanInf", NULL, 800, 800, true, false },
        { "BrightRings", NULL, 800, 800, false, false },
        { "WideColorGamut", NULL, 800, 800, false, true },
        { "stripes", NULL, 100, 50, false, false },
        { "t05", NULL, 340, 260, false, false },
        { "t08", NULL, 501, 401, false, false },
        { "t12", NULL, 400, 300, false, false }, /* its display window is elsewhere */
        { "Garden", NULL, 874, 493, false, false },
        { "multipart.0001", NULL, 2048, 1556, false, false },
        { "ColorCodedLevels", NULL, 512, 512, false, false },
        { "Trunks", "deep", 0, 0, false, false },
    };
    struct image im = { 0 };
    struct reason why;
    char relative[300];
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        snprintf(relative, sizeof(relative), "bad_exr/odd_valid/%s.exr", rows[i].name);
        const enum err e = decode_data(relative, &im, &why);
        if (rows[i].about) {
            assert_int_equal(e, ERR_UNSUPPORTED);
            assert_non_null(strstr(why.text, rows[i].about));
            continue;
        }
        if (e)
            fail_msg("%s", why.text);
        assert_int_equal(im.width, rows[i].width);
        assert_int_equal(im.height, rows[i].height);
        assert_int_equal(im.faults.nan > 0, rows[i].nan);
        assert_int_equal(im.faults.negative > 0, rows[i].negative);
    }
    image_finish(&im);
}

/* Of the 65536 half floats 2046 are NaN and 2 infinite; each stands once in each channel. */
static void all_half_values_are_counted(void **state)
{
    struct image im = { 0 };
    struct reason why;
    (void)state;

    assert_int_equal(decode_data("bad_exr/odd_valid/AllHalfValues.exr", &im, &why), ERR_OK);
    assert_int_equal(im.faults.nan, 3 * 2046);
    assert_int_equal(im.faults.infinite, 3 * 2);
    assert_int_equal(im.faults.negative, 3 * (32768 - 1024 - 1)); /* not -0, -infinity and NaN */
    assert_int_equal(im.faults.clipped, 3);
    image_finish(&im);
}

static void captured_maps_decode(void **state)
{
    struct image im = { 0 };
    struct reason why;
    char relative[300];
    int seen = 0;
    DIR *dir = opendir(unit_data("env"));
    (void)state;

    assert_non_null(dir);
    for (struct dirent *d; (d = readdir(dir));) {
        if (d->d_name[0] == '.')
            continue;
        snprintf(relative, sizeof(relative), "env/%s", d->d_name);
        if (decode_data(relative, &im, &why))
            fail_msg("%s", why.text);
        seen++;
    }
    closedir(dir);
    assert_true(seen > 0);
    image_finish(&im);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_file_cut_at_any_byte_is_refused),
    cmocka_unit_test(turned_bits_are_survived),
    cmocka_unit_test(faults_in_a_later_part_are_told),
    cmocka_unit_test(sizes_beyond_the_limit_are_refused_as_such),
    cmocka_unit_test(sizes_that_the_file_cannot_hold_take_no_memory),
    cmocka_unit_test(liars_are_refused_in_little_memory),
    cmocka_unit_test(endless_headers_are_refused_before_they_are_sorted),
    cmocka_unit_test(lists_of_many_channels_are_refused),
    cmocka_unit_test(neither_format_is_said_with_the_first_bytes),
    cmocka_unit_test(files_are_read_whole_or_refused_with_their_path),
    cmocka_unit_test(damaged_files_are_refused),
    cmocka_unit_test(odd_files_decode_or_are_refused_by_name),
    cmocka_unit_test(all_half_values_are_counted),
    cmocka_unit_test(captured_maps_decode),
};

UNIT_MAIN(tests)
