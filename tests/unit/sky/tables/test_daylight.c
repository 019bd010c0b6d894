/* Skies of weather files and of the standard as environment maps: the horizontal illuminance of the open plane, by the
 * function that lights scenes. */
#include "base/luminance.h"
#include "base/mem.h"
#include "sky/daylight/weather.h"
#include "sky/daylight/sky.h"
#include "sky/source/source.h"
#include "sky/tables/irradiance.h"
#include "support/unit.h"

#include <math.h>
#include <unistd.h>

#define N 256

/* A year at 62 degrees north, where the sun is low for long. */
static void write_weather(char path[64])
{
    char *text = weather_text(2), *latitude = strstr(text, ",40,");

    strcpy(path, "/tmp/weather.XXXXXX");
    const int fd = mkstemp(path);
    assert_true(fd >= 0);
    latitude[1] = '6';
    latitude[2] = '2';
    assert_true(write(fd, text, strlen(text)) == (ssize_t)strlen(text));
    close(fd);
    free(text);
}

struct light {
    struct environment *environment;
    double *weights;
    struct frame frame;
};

static void begin(struct light *l)
{
    const struct environment_desc d = { .n = N, .layout = LAYOUT_LATLONG, .lean = true };

    *l = (struct light){ .environment = environment_create(&d), .weights = malloc(2 * N * N * sizeof(double)) };
    irradiance_weights(N, l->weights);
}

static void end(struct light *l)
{
    environment_destroy(l->environment);
    free(l->weights);
    frame_finish(&l->frame);
}

/* Illuminance of the open plane, lx. */
static double open_lux(struct light *l, const struct daylight *d, const struct moment *m)
{
    struct reason why;
    double rgb[3];

    assert_int_equal(frame_reserve_texels(&l->frame, d->width, d->height), ERR_OK);
    snprintf(l->frame.name, sizeof(l->frame.name), "a test");
    daylight_render(d, m, l->frame.rgb);
    assert_int_equal(environment_update(l->environment, &l->frame, &why), ERR_OK);
    irradiance_upward(l->environment, l->weights, rgb);
    return LUMINOUS_EFFICACY * rgb[1];
}

static struct daylight *open_sky(const char *format, const char *path)
{
    char spec[200];
    struct daylight *d;
    struct reason why = { "" };

    snprintf(spec, sizeof(spec), format, path);
    if (daylight_open(spec, &d, &why) != ERR_OK)
        fail_msg("%s: %s", spec, why.text);
    return d;
}

/* Some hours of all heights of the sun, and those in which it is lowest. */
static void open_illuminance_is_the_files(void **state)
{
    char path[64];
    struct light l;
    int low = 0;

    (void)state;
    write_weather(path);
    struct daylight *d = open_sky("epw:%s", path);
    assert_int_equal(d->year.missing, 2);
    begin(&l);
    for (size_t i = 0; i < d->count; i++) {
        const struct moment *m = daylight_moment(d, i);
        const int lowest = m->altitude > 0.0 && m->altitude < 0.03 && low < 15;
        low += lowest;
        if (i % 83 != 0 && !lowest)
            continue;
        const double error = open_lux(&l, d, m) / moment_open_lux(m, true, true) - 1.0;
        if (fabs(error) > 0.01)
            fail_msg("sun at %.2f degrees: %.3f %% off", m->altitude * 57.3, 100.0 * error);
    }
    assert_true(low == 15);
    end(&l);
    daylight_close(d);
    unlink(path);
}

static void standard_skies_have_the_illuminance_asked_for(void **state)
{
    struct light l;

    (void)state;
    begin(&l);
    for (int type = 1; type <= CIE_SKIES; type++) {
        char number[8];
        snprintf(number, sizeof(number), "%d", type);
        struct daylight *d = open_sky("cie:%s,lux=8000,altitude=35,direct=30000,size=512x256", number);
        const double want = 8000.0 + 30000.0 * sin(35.0 * 0.017453292519943295);
        assert_true(fabs(open_lux(&l, d, daylight_moment(d, 0)) / want - 1.0) < 0.005);
        daylight_close(d);
    }
    end(&l);
}

/* The brightest texel is the sun's, east of south in the morning; north= turns it clockwise. */
static void north_turns_the_sky(void **state)
{
    double azimuth[2];
    char path[64];

    (void)state;
    write_weather(path);
    for (int k = 0; k < 2; k++) {
        struct daylight *d =
            open_sky(k ? "epw:%s,days=06-21,hours=9-10,north=30" : "epw:%s,days=06-21,hours=9-10", path);
        double w[3];
        daylight_sun(d, daylight_moment(d, 0), w);
        azimuth[k] = atan2(-w[0], w[2]) * 57.29577951308232;
        daylight_close(d);
    }
    assert_true(azimuth[0] > 100.0 && azimuth[0] < 150.0);
    assert_true(fabs(azimuth[1] - azimuth[0] - 30.0) < 1e-6);
    unlink(path);
}

/* As many frames as the days have lit hours, and where the file has a 29 February, only its own range shows it. */
static void a_29_february_is_chosen_by_its_date(void **state)
{
    static const struct {
        const char *days, *first; /* moment */
        size_t count;
    } rows[] = { { "02-29", "29 February, 8:30", 8 },
                 { "2-29", "29 February, 8:30", 8 },
                 { "02-29:02-29", "29 February, 8:30", 8 },
                 { "02-28:02-29", "28 February, 8:30", 8 },
                 { "02-29:03-01", "1 March, 8:30", 8 },
                 { "02-28:03-01", "28 February, 8:30", 16 },
                 { "03-01", "1 March, 8:30", 8 } };
    char path[] = "/tmp/test_daylight_leap.XXXXXX", line[200], name[40];
    (void)state;

    FILE *f = fdopen(mkstemp(path), "w");
    assert_non_null(f);
    fputs(WEATHER_HEADER, f);
    for (int day = 28; day <= 30; day++)
        for (int hour = 1; hour <= 24; hour++) {
            const bool lit = hour > 8 && hour <= 16;
            weather_record(line, sizeof(line), day < 30 ? 2 : 3, day < 30 ? day : 1, hour, lit ? "500" : "0",
                           lit ? "100" : "0");
            fputs(line, f);
        }
    fclose(f);
    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        char spec[100];
        snprintf(spec, sizeof(spec), "epw:%%s,size=64x32,days=%s", rows[i].days);
        struct daylight *d = open_sky(spec, path);
        moment_name(daylight_moment(d, 0), name, sizeof(name));
        if (d->count != rows[i].count || strcmp(name, rows[i].first) != 0)
            fail_msg("days=%s: %zu lit hours from %s", rows[i].days, d->count, name);
        daylight_close(d);
    }
    unlink(path);
}

static void sources_step_through_the_lit_hours(void **state)
{
    char path[64], spec[100];
    struct source *s;
    struct frame f = { .kind = FRAME_NONE };
    struct reason why;

    (void)state;
    write_weather(path);
    snprintf(spec, sizeof(spec), "epw:%s,size=64x32", path);
    const struct source_desc desc = { .spec = spec, .frames = { .given = true, .first = 24, .last = 71 } };
    assert_int_equal(source_open(&desc, &s, &why), ERR_OK);
    assert_int_equal(source_count(s), 14); /* two days of eight hours, two of them missing */
    assert_int_equal(source_next(s, &f, &why), ERR_OK);
    assert_int_equal(f.number, 24 + 8);
    assert_true(source_seek(s, 13));
    assert_int_equal(source_next(s, &f, &why), ERR_OK);
    assert_int_equal(f.number, 48 + 15);
    assert_int_equal(source_next(s, &f, &why), ERR_END);
    source_close(s);
    frame_finish(&f);
    unlink(path);
}

/* A matrix of Tregenza's 146 patches and two steps: the first is dark, in the second patch p has a radiance of p. */
static void write_matrix(char path[64], const char *format, size_t values)
{
    strcpy(path, "/tmp/matrix.XXXXXX");
    const int fd = mkstemp(path);
    FILE *f = fdopen(fd, "wb");

    assert_non_null(f);
    fprintf(f, "#?RADIANCE\ngendaymtx -m 1\nNROWS=146\nNCOLS=2\nNCOMP=3\nFORMAT=%s\n\n", format);
    for (size_t k = 0; k < values; k++) {
        const float v = k / 3 % 2 ? (float)(k / 6) : 0.0f;
        if (strcmp(format, "ascii") == 0)
            fprintf(f, "%g%s", (double)v, k % 3 == 2 ? "\n" : " ");
        else
            fwrite(&v, sizeof(v), 1, f);
    }
    fclose(f);
}

/* Radiance's patches: the ground is patch 0, the zenith the last, patch 1 lies in the north and the next ones east of
 * it. North is the middle of the image and east lies to its right. */
static void matrices_are_read_as_gendaymtx_writes_them(void **state)
{
    static const char *const formats[] = { "ascii", "float" };
    char path[64], spec[100];

    (void)state;
    for (int k = 0; k < 2; k++) {
        struct reason why;
        struct source *s;
        struct frame f = { .kind = FRAME_NONE };
        write_matrix(path, formats[k], 6 * 146);
        snprintf(spec, sizeof(spec), "mtx:%s,scale=2", path);
        const struct source_desc desc = { .spec = spec };
        assert_int_equal(source_open(&desc, &s, &why), ERR_OK);
        assert_int_equal(source_count(s), 1);
        assert_int_equal(source_next(s, &f, &why), ERR_OK);
        assert_int_equal(f.number, 1);
        assert_string_equal(f.layout, "latlong");
        const float *horizon = f.rgb + 3 * (size_t)(f.height / 2 - 1) * f.width;
        assert_true(f.rgb[0] == 2.0f * 145.0f && f.rgb[3 * (size_t)(f.height - 1) * f.width] == 0.0f);
        assert_true(horizon[3 * (size_t)(f.width / 2)] == 2.0f);
        assert_true(horizon[3 * (size_t)(f.width / 2 + f.width / 30)] == 4.0f);
        source_close(s);
        frame_finish(&f);
        unlink(path);
    }
}

/* The sun's disc beside the patches: all that shines is the sky of the matrix, 1 W sr^-1 m^-2 in every patch of the
 * upper hemisphere, and the sun's irradiance at normal incidence, in a disc of the sun's size where it stands. */
static void a_matrix_may_have_a_sharp_sun(void **state)
{
    char matrix[64], suns[] = "/tmp/suns.XXXXXX", spec[200];
    struct daylight *d;
    struct reason why;
    FILE *f;
    (void)state;

    snprintf(matrix, sizeof(matrix), "/tmp/matrix.XXXXXX");
    close(mkstemp(matrix));
    f = fopen(matrix, "w");
    assert_non_null(f);
    fputs("#?RADIANCE\nNROWS=146\nNCOLS=1\nNCOMP=3\nFORMAT=ascii\n\n", f);
    for (int p = 0; p < 146; p++)
        fputs(p == 0 ? "0 0 0\n" : "1 1 1\n", f);
    fclose(f);
    close(mkstemp(suns));
    f = fopen(suns, "w");
    assert_non_null(f);
    /* 800 W m^-2 over 0.533 degrees, at an altitude of 53.13 degrees in the east-south-east. */
    fputs("void light solar247710\n0\n0\n3 1.1772e7 1.1772e7 1.1772e7\nsolar247710 source sun247710\n0\n0\n"
          "4 0.48 -0.36 0.8 0.533\n",
          f);
    fclose(f);
    snprintf(spec, sizeof(spec), "mtx:%s,suns=%s,scale=2", matrix, suns);
    assert_int_equal(daylight_open(spec, &d, &why), ERR_OK);
    const struct moment *m = daylight_moment(d, 0);
    assert_true(m->month == 6 && m->day == 22 && fabs(m->clock - 0.5) < 1e-9);
    float *rgb = mem_alloc((size_t)3 * d->width * d->height, sizeof(float));
    daylight_render(d, m, rgb);
    double sky = 0.0, sun = 0.0, towards[3] = { 0 };
    for (uint32_t y = 0; y < d->height; y++)
        for (uint32_t x = 0; x < d->width; x++) {
            const double theta = PI * (y + 0.5) / d->height, phi = PI - 2.0 * PI * (x + 0.5) / d->width;
            const double solid = 4.0 * PI / d->width * sin(theta) * sin(0.5 * PI / d->height);
            const double over = (double)rgb[3 * ((size_t)y * d->width + x) + 1] - (y < d->height / 2 ? 2.0 : 0.0);
            sky += y < d->height / 2 ? 2.0 * solid : 0.0;
            sun += over * solid;
            towards[0] += over * solid * sin(theta) * sin(phi);
            towards[1] += over * solid * cos(theta);
            towards[2] += over * solid * sin(theta) * cos(phi);
        }
    assert_true(fabs(sky / (4.0 * PI) - 1.0) < 1e-4);
    assert_true(fabs(sun / 1600.0 - 1.0) < 5e-3);
    assert_true(fabs(towards[0] / sun + 0.48) < 2e-3 && fabs(towards[1] / sun - 0.8) < 2e-3 &&
                fabs(towards[2] / sun + 0.36) < 2e-3);
    mem_free(rgb);
    daylight_close(d);
    unlink(matrix);
    unlink(suns);
}

static void refuse(const char *spec, const char *expected)
{
    struct daylight *d;
    struct reason why = { "" };

    assert_int_not_equal(daylight_open(spec, &d, &why), ERR_OK);
    assert_null(d);
    if (!strstr(why.text, expected))
        fail_msg("%s: '%s'; expected '%s'", spec, why.text, expected);
}

static void bad_specs_are_refused(void **state)
{
    (void)state;
    refuse("epw:", "the weather file is missing");
    refuse("epw:/nowhere/x.epw", "/nowhere/x.epw: No such file");
    refuse("epw:x.epw,days=02-30", "'02-30' is not a date");
    refuse("epw:x.epw,hours=18-8", "hours=18-8 is not A-B");
    refuse("epw:x.epw,efficacy=high", "efficacy=high is not perez, file or a number");
    refuse("epw:x.epw,cloud=3", "unknown key 'cloud'");
    char matrix[64], spec[100];
    write_matrix(matrix, "float", 6 * 40 + 1);
    snprintf(spec, sizeof(spec), "mtx:%s", matrix);
    refuse(spec, "ends, or has no number, at row 40, column 0, from 0");
    unlink(matrix);
    write_matrix(matrix, "rgbe", 0);
    snprintf(spec, sizeof(spec), "mtx:%s", matrix);
    refuse(spec, "FORMAT=rgbe: expected ascii, float or double");
    unlink(matrix);
    refuse("mtx:/nowhere/x.mtx", "/nowhere/x.mtx: No such file");
    refuse("mtx:x,north=3", "unknown key 'north'; expected suns or scale");
    refuse("cie:17", "there is no such sky");
    refuse("cie:1,days=03-21", "unknown key 'days'");
    refuse("cie:1,lux=-1", "lux=-1 is not a number from 0 to 200000");
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(open_illuminance_is_the_files),
    cmocka_unit_test(standard_skies_have_the_illuminance_asked_for),
    cmocka_unit_test(north_turns_the_sky),
    cmocka_unit_test(a_29_february_is_chosen_by_its_date),
    cmocka_unit_test(sources_step_through_the_lit_hours),
    cmocka_unit_test(matrices_are_read_as_gendaymtx_writes_them),
    cmocka_unit_test(a_matrix_may_have_a_sharp_sun),
    cmocka_unit_test(bad_specs_are_refused),
};

UNIT_MAIN(tests)
