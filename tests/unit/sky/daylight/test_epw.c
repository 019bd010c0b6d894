/* Weather files: what is read, what is refused with line and field, and the moments chosen of them. */
#include "sky/daylight/moments.h"
#include "sky/daylight/sun.h"
#include "sky/daylight/weather.h"
#include "support/unit.h"

#include <math.h>

#define DEGREE 0.017453292519943295

static enum err parse(const char *text, struct epw *out, struct reason *why)
{
    char *copy = strdup(text);
    const enum err e = epw_parse("x.epw", copy, strlen(copy), out, why);
    free(copy);
    return e;
}

static struct epw year(int missing)
{
    struct reason why;
    struct epw w;
    char *text = weather_text(missing);

    assert_int_equal(epw_parse("x.epw", text, strlen(text), &w, &why), ERR_OK);
    free(text);
    return w;
}

static void a_year_is_read(void **state)
{
    struct epw w = year(0);

    (void)state;
    assert_int_equal(w.count, 8760);
    assert_true(w.latitude == 40.0 && w.longitude == 15.0 && w.zone == 1.0 && w.interval == 1.0);
    const struct epw_record *r = &w.records[24 * 31 + 11]; /* the hour that ends at 12, on 1 February */
    assert_true(r->month == 2 && r->day == 1 && r->end == 12.0);
    assert_true(r->direct_normal == 500.0 && r->diffuse == 100.0 && r->dew_point == 5.0);
    assert_true(isnan(r->direct_normal_lux) && isnan(r->diffuse_lux)); /* 999999 */
    epw_finish(&w);
}

/* A header and one record; `from` in it becomes `to`. */
static void refuse(const char *from, const char *to, const char *expected)
{
    char record[256], text[1024];
    struct reason why = { "" };
    struct epw w;

    weather_record(record, sizeof(record), 3, 21, 12, "600", "80");
    snprintf(text, sizeof(text), "%s%s", WEATHER_HEADER, record);
    char *at = strstr(text, from);
    assert_non_null(at);
    memmove(at + strlen(to), at + strlen(from), strlen(at + strlen(from)) + 1);
    memcpy(at, to, strlen(to));
    const enum err e = parse(text, &w, &why);
    if (e == ERR_OK || !strstr(why.text, expected))
        fail_msg("'%s' for '%s' gave %d, '%s'; expected '%s'", to, from, e, why.text, expected);
    assert_null(w.records);
}

static void bad_files_are_refused_with_line_and_field(void **state)
{
    (void)state;
    refuse("LOCATION", "PLACE", "line 1: expected LOCATION");
    refuse(",40,", ",140,", "line 1: field 7, the latitude, is 140; expected -90 to 90");
    refuse(",40,", ",north,", "line 1: field 7, the latitude, is 'north', which is not a number");
    refuse("DATA PERIODS,1,1", "DATA PERIODS,1,7", "line 4: 7 records per hour");
    refuse(",600,", ",1600,", "line 5: field 15, the direct normal radiation, is 1600; expected 0 to 1500");
    refuse(",80,", ",8O,", "line 5: field 16, the diffuse horizontal radiation, is '8O'");
    refuse(",3,21,", ",13,21,", "line 5: field 2, the month, is 13");
    refuse(",3,21,", ",3.5,21,", "line 5: field 2, the month, is 3.5; expected a whole number");
    refuse(",21,12,", ",21,11.5,", "line 5: field 4, the hour, is 11.5; expected a whole number");
    refuse(",3,21,", ",2,30,", "line 5: field 3: month 2 has no day 30");
    refuse("9999,0,600,80,999999,999999,999999,9999,0,0,0,0\n", "9999,0\n",
           "line 5: has 14 fields; field 15, the direct normal radiation, is missing");
    refuse("2021,3,21,12,0,?9,10.0,5.0,70,101325,9999,9999,9999,0,600,80,999999,999999,999999,9999,0,0,0,0\n", "",
           "the file ends after the header");
    refuse("DATA PERIODS,1,1,Data,Sunday, 1/ 1,12/31\n2021", "2021", "before DATA PERIODS");
}

/* The record's direct radiation, and whether it was mended, where `from` in the file becomes `to`. */
static double direct_where(const char *from, const char *to, size_t mended)
{
    char record[256], text[1024];
    struct reason why = { "" };
    struct epw w;

    weather_record(record, sizeof(record), 3, 21, 12, "600", "80");
    snprintf(text, sizeof(text), "%s%s", WEATHER_HEADER, record);
    char *at = strstr(text, from);
    assert_non_null(at);
    memmove(at + strlen(to), at + strlen(from), strlen(at + strlen(from)) + 1);
    memcpy(at, to, strlen(to));
    if (parse(text, &w, &why))
        fail_msg("'%s' for '%s': %s", to, from, why.text);
    const double direct = w.records[0].direct_normal;
    assert_int_equal(w.mended, mended);
    assert_true(w.latitude == 40.0);
    epw_finish(&w);
    return direct;
}

/* What is harmless, or is not read, does not refuse a file. */
static void odd_measurements_are_mended_or_missing(void **state)
{
    (void)state;
    assert_true(direct_where(",600,", ",-0.4,", 1) == 0.0);
    assert_true(isnan(direct_where(",600,", ",-9999,", 1)));
    assert_true(isnan(direct_where(",600,", ",N/A,", 1)));
    assert_true(isnan(direct_where(",600,", ", nan ,", 1)));
    assert_true(isnan(direct_where(",600,", ",,", 1)));
    assert_true(isnan(direct_where(",600,", ", ,", 1)));
    assert_true(isnan(direct_where(",600,", ",9999,", 0)));
    assert_true(direct_where("999999,999999", "-9999,,", 0) == 600.0); /* illuminance */
    assert_true(direct_where("999999,999999", "none,-1", 0) == 600.0);
    assert_true(direct_where(",5.0,", ",,", 0) == 600.0); /* dew point */
    assert_true(direct_where(",5.0,", ",-999,", 0) == 600.0);
    assert_true(direct_where("LOCATION,", "LOCATION,\"Milan, Linate\",-,-,x,0,40,15,1,0\nX,", 0) == 600.0);
}

static void a_zero_byte_is_refused_with_line_and_field(void **state)
{
    char text[] = "LOCATION,x,y\nDESIGN\n2021,3,2\0001,12\n";
    struct reason why = { "" };
    struct epw w;

    (void)state;
    assert_int_equal(epw_parse("x.epw", text, sizeof(text) - 1, &w, &why), ERR_FORMAT);
    assert_string_equal(why.text, "x.epw: line 3: field 3 has a zero byte; expected text");
}

static void choose(const struct epw *w, const struct moments_desc *d, struct moments *out)
{
    struct reason why = { "" };

    if (moments_choose(w, d, "x.epw", out, &why) != ERR_OK)
        fail_msg("%s", why.text);
}

static const struct moments_desc all = { .first_day = 1, .last_day = 365, .last_hour = 24.0 };

static void moments_cover_the_year_and_missing_hours_are_named(void **state)
{
    struct epw w = year(4);
    struct moments m;
    char names[200];
    size_t lit = 0;

    (void)state;
    choose(&w, &all, &m);
    assert_int_equal(m.count, 8760);
    assert_int_equal(m.missing, 4);
    for (size_t i = 0; i < m.count; i++) {
        assert_int_equal(m.at[i].number, i);
        lit += m.at[i].lit;
        assert_true(!m.at[i].missing || !m.at[i].lit);
    }
    assert_int_equal(lit, 365 * 8 - 4);
    moments_name_missing(&m, names, sizeof(names));
    assert_string_equal(names, "2 January, 10:30; 2 January, 11:30; 2 January, 12:30 and 1 more");
    moments_finish(&m);
    epw_finish(&w);
}

static void days_hours_and_steps_are_chosen(void **state)
{
    struct moments_desc d = { .first_day = 80, .last_day = 80, .first_hour = 8.0, .last_hour = 18.0 };
    struct epw w = year(0);
    struct moments m;

    (void)state;
    choose(&w, &d, &m);
    assert_int_equal(m.count, 10); /* 8:30 to 17:30 */
    assert_true(m.at[0].month == 3 && m.at[0].day == 21 && m.at[0].clock == 8.5);
    moments_finish(&m);
    d.first_day = 365; /* over New Year */
    d.last_day = 1;
    d.step_minutes = 15.0;
    choose(&w, &d, &m);
    assert_int_equal(m.count, 80);
    assert_true(m.at[0].day == 1 && m.at[0].month == 1 && m.at[79].day == 31 && m.at[79].month == 12);
    /* Between 7:30, dark, and 8:30, full, the direct light rises in proportion. */
    assert_true(m.at[0].clock == 8.125 && fabs(m.at[0].direct_normal - 500.0 * 0.625) < 1e-9);
    moments_finish(&m);
    epw_finish(&w);
}

/* Noon of the equinox at 40 degrees north, 15 degrees east, UTC+1: solar time is clock time, but for the equation. */
static void the_sun_is_where_it_should_be(void **state)
{
    struct epw w = year(0);
    struct moments m;

    (void)state;
    choose(&w, &all, &m);
    const struct moment *noon = &m.at[24 * 79 + 12], *morning = &m.at[24 * 79 + 8]; /* 12:30, 8:30 on 21 March */
    assert_true(fabs(noon->altitude - 50.0 * DEGREE) < 1.2 * DEGREE);
    assert_true(morning->sun[0] < -0.6); /* in the east */
    assert_true(noon->sun[2] < -0.6);    /* in the south */
    moments_finish(&m);
    epw_finish(&w);
}

/* At sunrise the sun stands in the middle of the part of the hour in which it is up: never below the horizon while the
 * record has direct light. */
static void the_sun_is_up_in_the_hour_of_sunrise(void **state)
{
    char record[256], text[1024];
    struct reason why;
    struct moments m;
    struct epw w;

    (void)state;
    weather_record(record, sizeof(record), 3, 10, 7, "20", "10"); /* 6 to 7; the sun rises after the middle */
    snprintf(text, sizeof(text), "%s%s", WEATHER_HEADER, record);
    assert_int_equal(parse(text, &w, &why), ERR_OK);
    choose(&w, &all, &m);
    assert_int_equal(m.count, 1);
    assert_true(m.at[0].lit && m.at[0].altitude > 0.0 && m.at[0].direct_normal_lux > 0.0);
    moments_finish(&m);
    epw_finish(&w);
}

static void records_out_of_order_are_refused(void **state)
{
    struct epw w = year(0);
    struct moments m;
    struct reason why;

    (void)state;
    const struct epw_record swapped = w.records[100];
    w.records[100] = w.records[200];
    w.records[200] = swapped;
    assert_int_equal(moments_choose(&w, &all, "x.epw", &m, &why), ERR_FORMAT);
    assert_non_null(strstr(why.text, "line 106: 1/5, hour 6, comes after 1/9"));
    epw_finish(&w);
}

static void efficacies_are_applied(void **state)
{
    struct moments_desc d = all;
    struct epw w = year(0);
    struct moments m;

    (void)state;
    d.efficacy = EFFICACY_FIXED;
    d.lm_per_w = 179.0;
    choose(&w, &d, &m);
    assert_true(m.at[12].direct_normal_lux == 500.0 * 179.0 && m.at[12].diffuse_lux == 100.0 * 179.0);
    assert_true(fabs(moment_open_lux(&m.at[12], true, true) - 179.0 * (100.0 + 500.0 * m.at[12].sun[1])) < 1e-6);
    moments_finish(&m);
    w.records[12].diffuse_lux = 7000.0;
    w.records[12].direct_normal_lux = 40000.0;
    d.efficacy = EFFICACY_FILE;
    choose(&w, &d, &m);
    assert_true(m.at[12].direct_normal_lux == 40000.0 && m.at[12].diffuse_lux == 7000.0);
    assert_true(m.at[13].diffuse_lux > 100.0 * 90.0 && m.at[13].diffuse_lux < 100.0 * 160.0); /* not stated there */
    moments_finish(&m);
    epw_finish(&w);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_year_is_read),
    cmocka_unit_test(bad_files_are_refused_with_line_and_field),
    cmocka_unit_test(odd_measurements_are_mended_or_missing),
    cmocka_unit_test(a_zero_byte_is_refused_with_line_and_field),
    cmocka_unit_test(moments_cover_the_year_and_missing_hours_are_named),
    cmocka_unit_test(days_hours_and_steps_are_chosen),
    cmocka_unit_test(the_sun_is_where_it_should_be),
    cmocka_unit_test(the_sun_is_up_in_the_hour_of_sunrise),
    cmocka_unit_test(records_out_of_order_are_refused),
    cmocka_unit_test(efficacies_are_applied),
};

UNIT_MAIN(tests)
