/* When a sky was taken, by its name: right times of many forms, and none where there is none. */
#include "support/unit.h"

#include "sky/between/taken.h"

#define NOON INT64_C(1718202605000000) /* 12 June 2024, 14:30:05 UTC, by `date -u -d '2024-06-12 14:30:05' +%s` */
#define HOUR INT64_C(3600000000)

static void must_be(const char *name, int64_t want)
{
    const int64_t got = taken_from_name(name);

    if (got != want)
        fail_msg("'%s': %lld, not %lld", name, (long long)got, (long long)want);
}

static void dates_with_separators_are_times(void **state)
{
    static const char *const names[] = { "sky_20240612_143005.exr",
                                         "2024-06-12T14-30-05.jpg",
                                         "2024-06-12 14.30.05.hdr",
                                         "20240612143005.exr",
                                         "/a/2019-01-01_00-00-00/sky_20240612-143005.exr",
                                         "IMG_20240612_143005_HDR.exr",
                                         "2024:06:12 14:30:05",
                                         "cam1_2024_06_12_14_30_05.exr",
                                         "20240612_-_143005.exr",
                                         "2024.06.12-14.30.05",
                                         "20240612t143005z.exr",
                                         "2024-06-12T14:30:05Z.exr",
                                         "12345_20240612_143005_0017.exr",
                                         "x99999999_20240612_143005.exr" };

    (void)state;
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++)
        must_be(names[i], NOON);
    must_be("20240229_120000.exr", INT64_C(1709208000000000)); /* a leap day */
    must_be("20240301_000000.exr", INT64_C(1709251200000000));
    must_be("20000229_000000.exr", INT64_C(951782400000000));
    must_be("20231231_235959.exr", INT64_C(1704067199000000));
    must_be("19700101_000001.exr", 1000000);
    must_be("21001231_000000.exr", INT64_C(4133894400000000)); /* 2100 has no leap day */
    must_be("20161231_235960.exr", INT64_C(1483228800000000)); /* a leap second is the next minute */
}

static void fractions_and_offsets_count(void **state)
{
    (void)state;
    must_be("sky_20240612_143005.5.exr", NOON + 500000);
    must_be("sky_20240612_143005,250.exr", NOON + 250000);
    must_be("sky_20240612_143005_250.exr", NOON + 250000);
    must_be("PXL_20240612_143005250.jpg", NOON + 250000);
    must_be("sky_20240612_143005.1234567.exr", NOON + 123456);
    must_be("2024-06-12T16-30-05+0200.exr", NOON);
    must_be("2024-06-12T16:30:05.250+02:00.exr", NOON + 250000);
    must_be("2024-06-12T09:30:05-05:00.exr", NOON);
    must_be("2024-06-12T20:00:05+05:30", NOON);
    must_be("sky_20240612_143005-0100.exr", NOON); /* a counter */
    must_be("sky_20240612_143005+9900.exr", NOON);
    must_be("sky_20240612_143005_0001.exr", NOON);
}

static void unix_times_are_times(void **state)
{
    (void)state;
    must_be("1718202605.exr", NOON);
    must_be("sky-1718202605250.exr", NOON + 250000);
    must_be("sky_1718202605.75.exr", NOON + 750000);
    must_be("1718202605_0001.exr", NOON);
    must_be("0000000012.exr", 0); /* a counter */
    must_be("9999999999.exr", 0);
    must_be("17182026051.exr", 0);
}

static void other_numbers_are_no_times(void **state)
{
    static const char *const names[] = { "",
                                         "/",
                                         "sky.exr",
                                         "sky.0017.exr",
                                         "20240612.exr",
                                         "20240612_1430.exr",
                                         "20241312_143005.exr",
                                         "20240632_143005.exr",
                                         "20230229_143005.exr",
                                         "21000229_143005.exr",
                                         "20240612_243005.exr",
                                         "20240612_146005.exr",
                                         "20240612_143061.exr",
                                         "00000000_000000.exr",
                                         "19691231_235959.exr",
                                         "22000101_000000.exr",
                                         "20240612_1430051.exr",
                                         "120240612_143005.exr",
                                         "20240612____143005.exr",
                                         "143005.exr",
                                         "20240612_143005/sky.exr",
                                         "123456789012345678901234567890.exr",
                                         "2024-06-12.exr",
                                         "1024x512.exr" };

    (void)state;
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++)
        must_be(names[i], 0);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(dates_with_separators_are_times),
    cmocka_unit_test(fractions_and_offsets_count),
    cmocka_unit_test(unix_times_are_times),
    cmocka_unit_test(other_numbers_are_no_times),
};

UNIT_MAIN(tests)
