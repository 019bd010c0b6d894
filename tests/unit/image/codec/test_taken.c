/* When an image was taken and for how long, by what its file says; damage never costs the image. */
#include "image/codec/decoding.h"

#include "image/codec/calendar.h"
#include "image/codec/make_exr.h"
#include "image/codec/make_hdr.h"

#include <math.h>
#include <turbojpeg.h>

#define NOON INT64_C(1718202605000000) /* 12 June 2024, 14:30:05 UTC, by date -u -d '2024-06-12 14:30:05' +%s */
#define HOUR INT64_C(3600000000)

static void calendar_has_the_gregorian_days(void **state)
{
    int64_t want = INT64_C(86400000000); /* day by day from 2 January 1970 on */

    (void)state;
    for (int year = 1970; year < 2200; year++)
        for (int month = 1; month <= 12; month++)
            for (int day = 1; day <= 31; day++) {
                const int64_t got = calendar_us(year, month, day, 0, 0, 0);
                if (year == 1970 && month == 1 && day == 1)
                    continue;
                if (day > 28 && got == 0)
                    continue;
                if (got != want)
                    fail_msg("%d-%d-%d: %lld, not %lld", year, month, day, (long long)got, (long long)want);
                want += INT64_C(86400000000);
            }
    assert_int_equal(want, CALENDAR_MAX_US);
    assert_int_equal(calendar_us(2024, 6, 12, 14, 30, 5), NOON);
    assert_int_equal(calendar_of_text("2024:06:12 14:30:05", 19), NOON);
    assert_int_equal(calendar_of_text("2024:06:12 14:30:05\0 ", 21), NOON);
    assert_int_equal(calendar_of_text("2024:06:12 14:30:0", 18), 0);
    assert_int_equal(calendar_of_text("2024:06:12 14:30:05x", 20), 0);
    assert_int_equal(calendar_of_text("2024-06-12 14:30:05", 19), 0);
    assert_int_equal(calendar_of_text("0000:00:00 00:00:00", 19), 0);
    assert_int_equal(calendar_of_text("2024:06:31 14:30:05", 19), 0);
    assert_int_equal(calendar_of_text("2024:06:12 14:30:61", 19), 0);
    assert_int_equal(calendar_of_text("2024:06:12 14:30:60", 19), NOON + 55000000);
}

static void decode_exr_with(const struct made_attribute *more, struct image *im)
{
    static const struct made_channel grey[] = { { "Y", EXR_PIXEL_FLOAT }, { NULL, EXR_PIXEL_HALF } };
    size_t size;
    uint8_t *bytes = exr_make(
        &(struct exr_recipe){ .channels = grey, .compression = EXR_COMPRESSION_ZIP, 4, 2, .more = more }, &size);

    must_decode(bytes, size, im);
    free(bytes);
}

static void an_exr_says_when_it_was_taken(void **state)
{
    static const struct {
        struct made_attribute more[4];
        int64_t us;
        double exposure;
        const char *note; /* "": none */
    } rows[] = {
        { { { "capDate", "2024:06:12 14:30:05", 0 } }, NOON, 0.0, "" },
        { { { "capDate", "2024:06:12 16:30:05", 0 }, { "utcOffset", NULL, -7200 }, { "expTime", NULL, 0.25f } },
          NOON,
          0.25,
          "" },
        { { { "capDate", "2024:06:12 09:30:05", 0 }, { "utcOffset", NULL, 18000 } }, NOON, 0.0, "" },
        { { { "expTime", NULL, 2.0f } }, 0, 2.0, "" },
        { { { "utcOffset", NULL, 18000 } }, 0, 0.0, "" },
        { { { "capDate", "yesterday", 0 }, { "expTime", NULL, 0.5f } }, 0, 0.5, "capDate 'yesterday'" },
        { { { "capDate", "2024:13:12 14:30:05", 0 } }, 0, 0.0, "capDate" },
        { { { "capDate", NULL, 3.0f } }, 0, 0.0, "capDate" },
        { { { "capDate", "2024:06:12 14:30:05", 0 }, { "utcOffset", NULL, NAN } }, NOON, 0.0, "utcOffset" },
        { { { "capDate", "2024:06:12 14:30:05", 0 }, { "utcOffset", "2", 0 } }, NOON, 0.0, "utcOffset" },
        { { { "capDate", "2024:06:12 14:30:05", 0 }, { "utcOffset", NULL, 1e9f } }, NOON, 0.0, "utcOffset" },
        { { { "capDate", "1970:01:01 01:00:00", 0 }, { "utcOffset", NULL, -7200 } }, 0, 0.0, "" },
        { { { "expTime", NULL, -1.0f } }, 0, 0.0, "expTime" },
        { { { "expTime", NULL, INFINITY } }, 0, 0.0, "expTime" },
        { { { "expTime", "1/60", 0 } }, 0, 0.0, "expTime" },
    };
    struct image im = { .taken_us = 5, .exposure_s = 5.0 }; /* of an earlier image */

    (void)state;
    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        decode_exr_with(rows[i].more, &im);
        if (im.taken_us != rows[i].us || im.exposure_s != rows[i].exposure)
            fail_msg("row %zu: %lld us, %g s: %s", i, (long long)im.taken_us, im.exposure_s, im.note);
        if (rows[i].note[0] ? !strstr(im.note, rows[i].note) : im.note[0] != '\0')
            fail_msg("row %zu: note '%s'", i, im.note);
    }
    decode_exr_with(NULL, &im);
    assert_true(im.taken_us == 0 && im.exposure_s == 0.0);
    image_finish(&im);
}

static void a_radiance_file_says_when_it_was_taken(void **state)
{
    static const struct {
        const char *lines;
        int64_t us;
    } rows[] = {
        { "CAPDATE= 2024:06:12 14:30:05\n", NOON },
        { "CAPDATE= 2024:06:12 16:30:05\nGMT= 2024:06:12 14:30:05\n", NOON },
        { "GMT=2024:06:12 14:30:05\nCAPDATE=2024:06:12 16:30:05\n", NOON },
        { "\tCAPDATE= 2024:06:12 14:30:05\n", 0 }, /* of a source image */
        { "CAPDATE= 2024:06:12\n", 0 },
        { "CAPDATE=\n", 0 },
    };
    struct image im = { 0 };

    (void)state;
    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        char header[200];
        size_t size;
        snprintf(header, sizeof(header), "%sFORMAT=32-bit_rle_rgbe", rows[i].lines);
        uint8_t *bytes = hdr_make(&(struct hdr_recipe){ .header = header, .scanlines = 2, .length = 4 }, &size);
        must_decode(bytes, size, &im);
        free(bytes);
        if (im.taken_us != rows[i].us)
            fail_msg("row %zu: %lld us", i, (long long)im.taken_us);
        assert_int_equal(im.note[0] != '\0', i >= 4);
    }
    image_finish(&im);
}

/* ---- Exif ---- */

struct block {
    uint8_t at[400];
    size_t size;
    bool little;
};

static void put(struct block *b, uint32_t v, int bytes)
{
    for (int i = 0; i < bytes; i++)
        b->at[b->size++] = (uint8_t)(v >> 8 * (b->little ? i : bytes - 1 - i));
}

/* Texts of more than four characters lie at `*heap`, which moves on. */
static void put_text(struct block *b, uint32_t tag, const char *text, uint32_t *heap)
{
    const uint32_t count = (uint32_t)strlen(text) + 1;

    put(b, tag, 2);
    put(b, 2, 2);
    put(b, count, 4);
    if (count > 4) {
        memcpy(b->at + *heap, text, count);
        put(b, *heap, 4);
        *heap += 40;
    } else {
        memcpy(b->at + b->size, text, count);
        b->size += 4;
    }
}

/* A directory that points to a photograph's own, with four tags. */
static void make_exif(struct block *b, bool little, const char *taken, const char *fraction, const char *offset)
{
    uint32_t heap = 120;

    *b = (struct block){ .little = little };
    memcpy(b->at, little ? "II*\0" : "MM\0*", 4);
    b->size = 4;
    put(b, 8, 4);
    put(b, 1, 2);
    put(b, 0x8769, 2), put(b, 4, 2), put(b, 1, 4), put(b, 26, 4);
    put(b, 0, 4);
    put(b, 4, 2);
    put(b, 0x829a, 2), put(b, 5, 2), put(b, 1, 4), put(b, 100, 4);
    put_text(b, 0x9003, taken, &heap);
    put_text(b, 0x9011, offset, &heap);
    put_text(b, 0x9291, fraction, &heap);
    b->size = 100;
    put(b, 1, 4);
    put(b, 8, 4);
    b->size = 240;
}

/* A JPEG with this Exif behind its first marker. */
static void decode_with_exif(const uint8_t *exif, size_t size, struct image *im)
{
    uint8_t codes[16 * 16 * 3] = { 0 }, *jpeg = NULL, file[4000];
    unsigned long length = 0;
    struct reason why;
    tjhandle tj = tjInitCompress();

    assert_int_equal(tjCompress2(tj, codes, 16, 0, 16, TJPF_RGB, &jpeg, &length, TJSAMP_444, 80, 0), 0);
    assert_true(length + size + 10 < sizeof(file));
    memcpy(file, jpeg, 2);
    memcpy(file + 2, (uint8_t[]){ 0xff, 0xe1, 0, (uint8_t)(size + 8), 'E', 'x', 'i', 'f', 0, 0 }, 10);
    memcpy(file + 12, exif, size);
    memcpy(file + 12 + size, jpeg + 2, length - 2);
    if (decode_alone(file, length + size + 10, im, &why))
        fail_msg("%s", why.text);
    tjFree(jpeg);
    tjDestroy(tj);
}

static void a_jpeg_says_when_it_was_taken(void **state)
{
    static const struct {
        const char *taken, *fraction, *offset;
        int64_t us;
        bool noted;
    } rows[] = {
        { "2024:06:12 14:30:05", "", "", NOON, false },
        { "2024:06:12 16:30:05", "25", "+02:00", NOON + 250000, false },
        { "2024:06:12 09:00:05", "007", "-05:30", NOON + 7000, false },
        { "2024:06:12 14:30:05", "123456789012", "Z", NOON + 123456, false },
        { "2024:06:12 14:30:05", "x", "+99:00", NOON, false },
        { "1970:01:01 01:00:00", "", "+02:00", 0, false },
        { "    :  :     :  :  ", "5", "+02:00", 0, true },
        { "0000:00:00 00:00:00", "", "", 0, true },
        { "2024:06:12 14:30:05             ", "", "", 0, false }, /* longer than any time */
        { "", "", "", 0, false },
    };
    struct image im = { 0 };
    struct block b;

    (void)state;
    for (size_t i = 0; i < 2 * sizeof(rows) / sizeof(rows[0]); i++) {
        make_exif(&b, i % 2, rows[i / 2].taken, rows[i / 2].fraction, rows[i / 2].offset);
        decode_with_exif(b.at, b.size, &im);
        if (im.taken_us != rows[i / 2].us || im.exposure_s != 0.125 || (im.note[0] != '\0') != rows[i / 2].noted)
            fail_msg("row %zu: %lld us, %g s, '%s'", i, (long long)im.taken_us, im.exposure_s, im.note);
    }
    image_finish(&im);
}

/* Cut anywhere, or with any byte changed to a few others: an image all the same, with a time within the calendar. */
static void damaged_exif_costs_no_image(void **state)
{
    struct image im = { 0 };
    struct block b;

    (void)state;
    make_exif(&b, true, "2024:06:12 14:30:05", "25", "+02:00");
    for (size_t n = 0; n < b.size; n += 3)
        decode_with_exif(b.at, n, &im);
    for (size_t i = 0; i < 160; i++)
        for (int v = 0; v < 4; v++) {
            const uint8_t was = b.at[i];
            b.at[i] = (uint8_t[]){ 0, 0xff, 0x7f, 0xf0 }[v];
            decode_with_exif(b.at, b.size, &im);
            assert_true(im.taken_us >= 0 && im.taken_us < CALENDAR_MAX_US + 14 * HOUR);
            assert_true(im.exposure_s >= 0.0 && im.exposure_s <= IMAGE_EXPOSURE_MAX_S);
            b.at[i] = was;
        }
    image_finish(&im);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(calendar_has_the_gregorian_days),
    cmocka_unit_test(an_exr_says_when_it_was_taken),
    cmocka_unit_test(a_radiance_file_says_when_it_was_taken),
    cmocka_unit_test(a_jpeg_says_when_it_was_taken),
    cmocka_unit_test(damaged_exif_costs_no_image),
};

UNIT_MAIN(tests)
