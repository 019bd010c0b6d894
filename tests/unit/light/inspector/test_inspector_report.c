/* A probe's report is JSON that fits, whatever is asked; and its flags. */
#include "base/setting_table.h"
#include "light/inspector/inspector.h"
#include "relightd/settings/settings.h"

#include "light/frame/relight.h"
#include "support/sets.h"
#include "support/skies.h"

#include <jansson.h>

enum { WIDTH = 64, HEIGHT = 36 };

struct stand {
    struct prepared_scene *set;
    const struct kernels *kernels;
    struct environment *sky;
    struct inspector *inspector;
};

static struct stand stand_make(struct frame sky)
{
    const struct prepared_scene_desc desc = { .width = WIDTH, .height = HEIGHT };
    struct stand s = { .sky = sky_environment(sky, 64, 0.0) };
    struct reason why;

    assert_int_equal(kernels_select(NULL, &s.kernels, &why), ERR_OK);
    s.set = set_of(&desc);
    s.inspector = inspector_create(s.set, s.kernels);
    assert_non_null(s.inspector);
    return s;
}

static void stand_finish(struct stand *s)
{
    inspector_destroy(s->inspector);
    set_destroy(s->set);
    environment_destroy(s->sky);
}

/* The report, read back; *size: of its text. */
static json_t *report(const struct stand *s, const struct relight_desc *light, const struct inspect_request *q,
                      const float *rgb, size_t *size)
{
    char *text;

    assert_int_equal(inspector_report(s->inspector, s->sky, light, q, rgb, NULL, &text), ERR_OK);
    json_t *j = json_loads(text, JSON_REJECT_DUPLICATES, NULL);
    assert_non_null(j);
    *size = strlen(text);
    mem_free(text);
    return j;
}

static double number_at(const json_t *array, size_t k)
{
    return json_number_value(json_array_get(array, k));
}

/* A sky of noise makes the largest image of it; with as many samples and strata as there are the report still fits,
 * without the sky's image if need be. */
static void the_largest_report_fits(void **state)
{
    struct frame noise = sky_constant(128, 64, 0.0f);
    (void)state;
    for (uint32_t i = 0; i < 128 * 64; i++)
        sky_paint(&noise, i % 128, i / 128, (float)rng_unit(rng_mix(1, i)), (float)rng_unit(rng_mix(2, i)),
                  (float)rng_unit(rng_mix(3, i)));
    sky_paint(&noise, 40, 16, 1e5f, 1e5f, 1e5f);
    struct stand s = stand_make(noise);
    const uint32_t cells[] = { 0, 2, 8 };
    size_t largest = 0;
    for (size_t k = 0; k < 3; k++) {
        const struct relight_desc light = {
            .direct = { .method = METHOD_AUTO, .samples = 1000000, .sun = true, .cells = cells[k], .seed = k }
        };
        for (uint32_t x = 4; x < WIDTH; x += 11) {
            size_t size;
            json_t *j = report(&s, &light, &(struct inspect_request){ .x = x, .y = 30, .sky = true }, NULL, &size);
            assert_true(size <= INSPECT_TEXT_MAX);
            assert_int_equal(json_integer_value(json_object_get(j, "samples")), 256);
            assert_int_equal(json_array_size(json_object_get(j, "lobes")), 128);
            assert_int_equal(json_array_size(json_object_get(j, "shares")), 7);
            largest = size > largest ? size : largest;
            json_decref(j);
        }
    }
    printf("%zu bytes\n", largest);
    stand_finish(&s);
}

/* What arrives adds up to the point's radiance, the counts of the shares to the samples, and the image is quoted. */
static void a_report_adds_up(void **state)
{
    struct stand s = stand_make(sky_with_sun(64, 32, 1e4f));
    const struct relight_desc light = { .direct = { .method = METHOD_MIS, .samples = 64 } };
    float *rgb = mem_alloc((size_t)WIDTH * HEIGHT, 3 * sizeof(float));
    uint32_t points = 0;
    (void)state;

    rgb[3 * (30 * WIDTH + 20) + 1] = 0.5f;
    for (uint32_t x = 0; x < WIDTH; x += 5) {
        size_t size;
        json_t *j = report(&s, &light, &(struct inspect_request){ .x = x, .y = 30 }, rgb, &size);
        const json_t *point = json_object_get(j, "point"), *samples;
        double sum[3] = { 0.0 };
        size_t i, generated = 0;
        json_t *one;
        assert_true(json_is_null(json_object_get(j, "sky")) || !json_object_get(j, "sky"));
        assert_true(number_at(json_object_get(j, "picture"), 1) == (x == 20 ? 0.5 : 0.0));
        for (int list = 0; list < 2; list++) {
            samples = json_object_get(j, list ? "lobes" : "light");
            json_array_foreach(samples, i, one)
            {
                for (size_t c = 0; c < 3 && json_array_size(one) == 9 && number_at(one, 3) == 2.0; c++)
                    sum[c] += number_at(one, 6 + c);
            }
        }
        json_array_foreach(json_object_get(j, "shares"), i, one) generated +=
            (size_t)json_integer_value(json_object_get(one, "generated"));
        assert_int_equal(generated, json_array_size(json_object_get(j, "light")));
        for (size_t c = 0; c < 3 && !json_is_null(point); c++) {
            const double want = number_at(json_object_get(point, "radiance"), c);
            assert_true(fabs(sum[c] - want) <= 1e-5 * want);
        }
        points += !json_is_null(point);
        json_decref(j);
    }
    assert_true(points > 6);
    mem_free(rgb);
    stand_finish(&s);
}

/* A letter for each five minutes of the day: the nights are the rest, and nobody sees the sun at night. At the pole,
 * one long day. */
static void a_report_has_the_day_of_the_sun(void **state)
{
    struct stand s = stand_make(sky_constant(64, 32, 0.5f));
    const struct relight_desc light = { .direct = { .method = METHOD_MIS, .samples = 16 } };
    (void)state;

    for (int pole = 0; pole < 2; pole++) {
        const struct sun_day day = { .latitude = pole ? 0.5 * PI : 0.0, .day = 172, .solar = true };
        size_t size, letters[256] = { 0 };
        json_t *j = report(&s, &light, &(struct inspect_request){ .x = 20, .y = 33, .day = &day }, NULL, &size);
        const json_t *sun = json_object_get(j, "sunlight");
        const char *shares = json_string_value(json_object_get(sun, "shares"));
        const double hours = json_number_value(json_object_get(sun, "hours")),
                     daylight = json_number_value(json_object_get(sun, "daylight"));
        assert_int_equal(strlen(shares), 288);
        assert_int_equal(strspn(shares, "0123456789-"), 288);
        for (const char *c = shares; *c; c++)
            letters[(unsigned char)*c]++;
        assert_true(fabs(daylight - (pole ? 24.0 : 12.0)) < 0.1);
        assert_true(fabs((288 - (double)letters['-']) / 12.0 - daylight) < 1e-3);
        assert_true(hours > 1.0 && hours <= daylight && letters['9'] > 0);
        json_decref(j);
        j = report(&s, &light, &(struct inspect_request){ .x = 20, .y = 33 }, NULL, &size);
        assert_true(json_is_null(json_object_get(j, "sunlight")));
        json_decref(j);
    }
    stand_finish(&s);
}

/* The classes of the image, whose shares add up to 1; with the preset there is no pixel to divide. */
static void a_report_divides_the_light(void **state)
{
    static const struct {
        uint32_t classes;
        size_t parts;
    } ways[] = { { PATH_ALL, 4 }, { 0, 2 }, { PATH_INDIRECT, 1 } };
    struct stand s = stand_make(sky_constant(64, 32, 0.5f));
    (void)state;

    for (size_t k = 0; k < sizeof(ways) / sizeof(ways[0]); k++) {
        const struct relight_desc light = { .direct = { .method = METHOD_MIS, .samples = 16 },
                                            .classes = ways[k].classes };
        double sum = 0.0;
        const char *name;
        size_t size;
        json_t *j = report(&s, &light, &(struct inspect_request){ .x = 20, .y = 30 }, NULL, &size), *one;
        const json_t *parts = json_object_get(json_object_get(j, "pixel"), "parts");
        assert_int_equal(json_object_size(parts), ways[k].parts);
        json_object_foreach((json_t *)parts, name, one) sum += json_number_value(json_object_get(one, "share"));
        assert_true(fabs(sum - 1.0) < 1e-6);
        json_decref(j);
    }
    stand_finish(&s);
}

/* Arguments as one string, split at blanks, for an image of 320 x 180. */
static enum err read_line(const char *line, bool *asked, struct inspect_request *q, struct reason *why)
{
    static const struct setting rows[] = { { "probe", "X,Y", "", NULL, .section = "in", TEXT },
                                           { "probe-samples", "N", "", NULL, .section = "in",
                                             WHOLE(1, INSPECT_SAMPLES_MAX), SETTING_AT(inspect_request, samples) },
                                           { "probe-preset", "P", "", NULL, .section = "in", CHOICE(inspect_presets),
                                             SETTING_AT(inspect_request, figure) },
                                           { .name = NULL } };
    struct command c = { .name = "test", .lists = { { rows, q } } };
    static char copy[256];
    char *argv[16] = { "test" };
    int argc = 1;
    bool done = false;

    snprintf(copy, sizeof(copy), "%s", line);
    for (char *word = strtok(copy, " "); word; word = strtok(NULL, " "))
        argv[argc++] = word;
    *q = (struct inspect_request){ 0 };
    command_begin(&c);
    assert_int_equal(command_parse(&c, argc, argv, &done, why), ERR_OK);
    const enum err e = command_read(&c, why);
    return e ? e : inspect_options_read(&c, 320, 180, asked, q, why);
}

/* By whatever way it is asked for. */
static void the_sky_alone_is_that_of_a_report(void **state)
{
    (void)state;
    struct frame lit = sky_constant(64, 32, 0.2f);
    sky_paint(&lit, 40, 8, 90.0f, 80.0f, 70.0f);
    struct stand s = stand_make(lit);
    const struct relight_desc light = { .direct = { .method = METHOD_MIS, .samples = 16, .seed = 1 } };
    size_t size;
    char *text;
    json_t *whole = report(&s, &light, &(struct inspect_request){ .x = 20, .y = 30, .sky = true }, NULL, &size);

    assert_int_equal(inspector_sky(s.inspector, s.sky, &text), ERR_OK);
    json_t *alone = json_loads(text, JSON_REJECT_DUPLICATES, NULL);
    assert_non_null(alone);
    assert_true(json_is_object(json_object_get(alone, "sky")));
    assert_true(json_equal(json_object_get(alone, "sky"), json_object_get(whole, "sky")));
    assert_true(json_equal(json_object_get(alone, "frame"), json_object_get(whole, "frame")));
    assert_true(json_is_number(json_object_get(alone, "rotate_degrees")));
    mem_free(text);
    json_decref(alone);
    json_decref(whole);
    stand_finish(&s);
}

static void flags_are_read_or_refused(void **state)
{
    static const char *const wrong[] = {
        "--probe 320,0",
        "--probe 0,180",
        "--probe 1",
        "--probe 1,2,3",
        "--probe -1,2",
        "--probe x,y",
        "--probe 1,2x",
        "--probe 99999999999,1",
        "--probe-samples 4",
        "--probe 1,",
        "--probe-preset fig1",
        "--probe 1,2 --probe-samples 0",
        "--probe ,1",
        "--probe 1,2 --probe-preset fig2",
        "--probe 1,2 --probe-samples 257",
    };
    struct inspect_request q;
    struct reason why;
    bool asked;
    (void)state;

    assert_int_equal(read_line("", &asked, &q, &why), ERR_OK);
    assert_false(asked);
    assert_int_equal(read_line("--probe 319,179 --probe-samples 256 --probe-preset fig1", &asked, &q, &why), ERR_OK);
    assert_true(asked && q.x == 319 && q.y == 179 && q.samples == 256 && q.figure && q.sky);
    for (size_t k = 0; k < sizeof(wrong) / sizeof(wrong[0]); k++) {
        why.text[0] = '\0';
        if (read_line(wrong[k], &asked, &q, &why) != ERR_USAGE)
            fail_msg("%s is taken", wrong[k]);
        assert_non_null(strstr(why.text, "--probe"));
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(the_largest_report_fits),           cmocka_unit_test(a_report_adds_up),
    cmocka_unit_test(a_report_divides_the_light),        cmocka_unit_test(a_report_has_the_day_of_the_sun),
    cmocka_unit_test(the_sky_alone_is_that_of_a_report), cmocka_unit_test(flags_are_read_or_refused),
};

UNIT_MAIN(tests)
