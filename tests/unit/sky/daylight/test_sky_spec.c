#include "sky/daylight/sky_pictures.h"

#include "sky/source/source.h"

/* ---- Where the sun stands ---- */

static double elevation_at(const char *spec)
{
    const struct sky_desc d = parse(spec);
    struct sky_state s;

    sky_state_at(&d, 0, &s);
    return s.sun_elevation / DEGREE;
}

static void noon_elevations_are_the_almanacs(void **state)
{
    (void)state;
    assert_true(fabs(elevation_at("latitude=45,date=06-21,hour=12") - (90.0 - 45.0 + 23.44)) < 0.1);
    assert_true(fabs(elevation_at("latitude=45,date=12-21,hour=12") - (90.0 - 45.0 - 23.44)) < 0.1);
    assert_true(fabs(elevation_at("latitude=-33.9,date=12-21,hour=12") - (90.0 - 33.9 + 23.44)) < 0.1);
    assert_true(fabs(elevation_at("latitude=0,date=03-20,hour=12") - 90.0) < 0.6); /* the equinox is in the evening */
    assert_true(fabs(elevation_at("latitude=90,date=06-21,hour=3") - 23.44) < 0.1);
}

/* The centre on the horizon, without refraction: cos(azimuth) = sin(declination) / cos(latitude). At the
 * equinox a day is 0.4 degrees of declination, and its date moves by a day from year to year. */
static void sun_rises_where_the_almanac_says(void **state)
{
    static const struct {
        const char *spec;
        double azimuth, within;
    } known[] = {
        { "latitude=45,date=06-21,hour=3,speed=1", 55.8, 0.5 },
        { "latitude=45,date=12-21,hour=3,speed=1", 124.2, 0.5 },
        { "latitude=60,date=06-21,hour=1,speed=1", 37.3, 0.5 },
        { "latitude=45,date=03-20,hour=3,speed=1", 90.0, 1.2 },
    };

    (void)state;
    for (size_t k = 0; k < sizeof(known) / sizeof(known[0]); k++) {
        const struct sky_desc d = parse(known[k].spec);
        struct sky_state s;
        uint64_t frame = 0;
        do
            sky_state_at(&d, frame++, &s);
        while (s.sun_elevation < 0.0 && frame < 10000);
        const double azimuth = atan2(-s.sun_direction[0], s.sun_direction[2]) / DEGREE; /* north +Z, east -X */
        printf("%s: azimuth %.2f, almanac %.1f\n", known[k].spec, azimuth, known[k].azimuth);
        assert_true(fabs(azimuth - known[k].azimuth) < known[k].within);
    }
}

static void morning_sun_stands_in_the_east(void **state)
{
    struct sky_desc d = parse("hour=8,size=256x128");
    struct sky_state s;
    size_t brightest = 0;

    (void)state;
    sky_state_at(&d, 0, &s);
    assert_true(s.sun_direction[0] < -0.5); /* east is -X */
    float *rgb = render(&d, &s);
    for (size_t i = 0; i < (size_t)d.width * d.height; i++)
        brightest = rgb[3 * i] > rgb[3 * brightest] ? i : brightest;
    test_free(rgb);
    /* Looking north, +Z, at the image's centre: +X is a quarter to the left, so east is to the right. */
    assert_in_range(brightest % d.width, d.width * 5 / 8, d.width * 7 / 8);
    d.hour = 12.0;
    sky_state_at(&d, 0, &s);
    assert_true(s.sun_direction[2] < 0.0 && fabs(s.sun_direction[0]) < 1e-9); /* south */
    d.latitude_degrees = -45.0;
    sky_state_at(&d, 0, &s);
    assert_true(s.sun_direction[2] > 0.0); /* north, south of the tropics */
    d.hour = 16.0;
    sky_state_at(&d, 0, &s);
    assert_true(s.sun_direction[0] > 0.5); /* west */
}

static void frames_advance_the_sun(void **state)
{
    const struct sky_desc d = parse("hour=10,speed=30"), later = parse("hour=15"), still = parse("hour=10,speed=0");
    struct sky_state a, b;

    (void)state;
    sky_state_at(&d, 10, &a);
    sky_state_at(&later, 0, &b);
    assert_true(fabs(a.sun_elevation - b.sun_elevation) < 1e-9);
    assert_true(a.sun_direction[0] > 0.0 && fabs(a.sun_direction[0] - b.sun_direction[0]) < 1e-9); /* in the west */
    sky_state_at(&d, 48 * 30 + 10, &a); /* the same hour 30 days on: the sun stands lower */
    assert_true(a.sun_elevation < b.sun_elevation - 1.0 * DEGREE && a.sun_elevation > b.sun_elevation - 5.0 * DEGREE);
    sky_state_at(&still, 0, &a);
    sky_state_at(&still, UINT64_MAX, &b);
    assert_true(a.sun_elevation == b.sun_elevation);
}

static void default_morning_has_a_low_sun(void **state)
{
    const double elevation = elevation_at("");

    (void)state;
    assert_true(elevation > 15.0 && elevation < 20.0);
}

/* ---- As a source ---- */

static void source_numbers_the_frames_of_its_range(void **state)
{
    const struct source_desc desc = { .spec = "sky:size=64x32,speed=60", .frames = { true, 3, 5 } };
    struct source *s = NULL;
    struct reason why;
    struct frame f = { .kind = FRAME_NONE };

    (void)state;
    assert_int_equal(source_open(&desc, &s, &why), ERR_OK);
    assert_int_equal(source_count(s), 3);
    const struct sky_desc d = parse("size=64x32,speed=60");
    for (uint64_t i = 3; i <= 5; i++) {
        struct sky_state at;
        assert_int_equal(source_next(s, &f, &why), ERR_OK);
        assert_int_equal(f.kind, FRAME_TEXELS);
        assert_int_equal(f.number, i);
        assert_int_equal(f.width, 64);
        sky_state_at(&d, i, &at);
        float *rgb = render(&d, &at);
        assert_memory_equal(rgb, f.rgb, (size_t)3 * 64 * 32 * sizeof(float));
        test_free(rgb);
    }
    assert_int_equal(source_next(s, &f, &why), ERR_END);
    assert_int_equal(source_next(s, &f, &why), ERR_END);
    source_close(s);
    frame_finish(&f);
}

static void source_goes_on_without_a_range(void **state)
{
    struct source *s = NULL;
    struct reason why;
    struct frame f = { .kind = FRAME_NONE };

    (void)state;
    assert_int_equal(source_open(&(struct source_desc){ .spec = "sky:size=16x8" }, &s, &why), ERR_OK);
    assert_int_equal(source_count(s), 0);
    for (uint64_t i = 0; i < 100; i++) {
        assert_int_equal(source_next(s, &f, &why), ERR_OK);
        assert_int_equal(f.number, i);
    }
    source_close(s);
    frame_finish(&f);
    assert_int_equal(source_open(&(struct source_desc){ .spec = "sky:haze=3" }, &s, &why), ERR_USAGE);
    assert_null(s);
}

/* ---- Keys ---- */

static void parse_reads_every_key(void **state)
{
    const struct sky_desc d =
        parse("latitude=-12.5,longitude=100,date=2024-02-29,time=18:30,speed=2,turbidity=4,ground=0.5,"
              "sun_ratio=7,night=0.1,scale=2,size=64x32");
    const struct sky_desc plain = parse(""), late = parse("hour=24");

    (void)state;
    assert_true(d.latitude_degrees == -12.5 && d.longitude_degrees == 100.0 && d.month == 2 && d.day == 29);
    assert_true(d.hour == 18.5 && fabs(d.speed_hours - 2.0 / 60.0) < 1e-15 && d.turbidity == 4.0);
    assert_true(d.ground_albedo == 0.5 && d.sun_ratio == 7.0 && d.night_lux == 0.1 && d.scale == 2.0);
    assert_true(d.width == 64 && d.height == 32);
    assert_true(plain.latitude_degrees == 45.0 && plain.month == 6 && plain.day == 21 && plain.width == 1024);
    assert_true(late.hour == 24.0);
}

/* What --help says are the defaults, parsed, are the defaults. */
static void help_tells_the_defaults(void **state)
{
    const struct sky_desc plain = parse("");
    const char *line = sky_help;
    size_t keys = 0;

    (void)state;
    for (; *line; line = strchr(line, '\n') + 1) {
        char key[64];
        const size_t n = strcspn(line, " ");
        assert_true(n < sizeof(key));
        memcpy(key, line, n);
        key[n] = '\0';
        if (strcmp(key, "utc=HH:MM") == 0)
            continue;
        const struct sky_desc d = parse(key);
        if (memcmp(&d, &plain, sizeof(d)) != 0)
            fail_msg("%s is not the default", key);
        keys++;
    }
    assert_int_equal(keys, 11);
}

/* 13:00 UTC at 15 degrees east is 14:00 mean time; on 3 November the sun is 16.4 minutes ahead of it. */
static void utc_becomes_solar_time(void **state)
{
    const struct sky_desc d = parse("utc=13:00,date=11-03,longitude=15"), behind = parse("utc=01:00,longitude=-30");

    (void)state;
    assert_true(fabs(d.hour - (14.0 + 16.4 / 60.0)) < 1.0 / 60.0);
    assert_true(fabs(behind.hour - (23.0 - 1.8 / 60.0)) < 1.0 / 60.0); /* 21 June: 1.8 minutes behind; a day earlier */
}

static void parse_errors_name_the_key(void **state)
{
    static const struct {
        const char *text, *named;
    } bad[] = {
        { "haze=3", "'haze'" },
        { "turbidity", "'turbidity' has no value" },
        { "turbidity=", "turbidity=" },
        { "turbidity=1", "turbidity=1 is not a number from 1.7 to 10" },
        { "turbidity=11", "turbidity=11" },
        { "turbidity=nan", "turbidity=nan" },
        { "turbidity=3x", "turbidity=3x" },
        { "latitude=90.1", "latitude=90.1" },
        { "longitude=-181", "longitude=-181" },
        { "hour=25", "hour=25" },
        { "time=24:01", "time=24:01" },
        { "time=7", "time=7" },
        { "utc=07:60", "utc=07:60" },
        { "speed=-1", "speed=-1" },
        { "date=13-01", "date=13-01" },
        { "date=02-30", "date=02-30" },
        { "date=00-10", "date=00-10" },
        { "date=today", "date=today" },
        { "date=2024-6-21", "date=2024-6-21" },
        { "ground=1.5", "ground=1.5" },
        { "sun_ratio=-1", "sun_ratio=-1" },
        { "night=-1", "night=-1" },
        { "scale=0", "scale=0" },
        { "size=100x100", "size=100x100" },
        { "size=6x3", "size=6x3" },
        { "size=32768x16384", "size=32768x16384" },
        { "size=0x0", "size=0x0" },
        { "size=1024", "size=1024" },
        { "latitude=45,,hour=3", "'' has no value" },
    };

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        struct sky_desc d;
        struct reason why = { "" };
        assert_int_equal(sky_parse(bad[i].text, &d, &why), ERR_USAGE);
        if (!strstr(why.text, bad[i].named))
            fail_msg("%s: '%s' does not name %s", bad[i].text, why.text, bad[i].named);
    }
    char endless[400];
    struct sky_desc d;
    struct reason why;
    memset(endless, 'a', sizeof(endless));
    endless[sizeof(endless) - 1] = '\0';
    assert_int_equal(sky_parse(endless, &d, &why), ERR_USAGE);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(noon_elevations_are_the_almanacs), cmocka_unit_test(sun_rises_where_the_almanac_says),
    cmocka_unit_test(morning_sun_stands_in_the_east),   cmocka_unit_test(frames_advance_the_sun),
    cmocka_unit_test(default_morning_has_a_low_sun),    cmocka_unit_test(source_numbers_the_frames_of_its_range),
    cmocka_unit_test(source_goes_on_without_a_range),   cmocka_unit_test(parse_reads_every_key),
    cmocka_unit_test(help_tells_the_defaults),          cmocka_unit_test(utc_becomes_solar_time),
    cmocka_unit_test(parse_errors_name_the_key),
};

UNIT_MAIN(tests)
