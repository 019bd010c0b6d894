#include "sky/daylight/sky.h"

#include "base/vec.h"

#include <ctype.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#define DEGREE (PI / 180.0)

const char *const sky_help =
    "latitude=45       degrees, north positive\n"
    "longitude=0       degrees, east positive; only utc= needs it\n"
    "date=06-21        MM-DD or YYYY-MM-DD, of the first frame\n"
    "hour=6.25         local solar time of the first frame, 0 to 24; or time=06:15\n"
    "utc=HH:MM         UTC instead; longitude and date then give the solar time\n"
    "speed=1           minutes of solar time from frame to frame, 0 to 1440\n"
    "turbidity=3       haziness: 1.7 very clear, 10 hazy\n"
    "ground=0.2        albedo of the ground below the horizon, 0 to 1\n"
    "sun_ratio=0       luminance of the sun's disc over the sky's mean; 0: from the atmosphere\n"
    "night=0.002       illuminance at night in lux; 0.2 is a full moon\n"
    "scale=0.0065      output units per W sr^-1 m^-2\n"
    "size=1024x512     texels; must be 2:1 with an even height\n";

/* ---- Parsing ---- */

enum clock_kind {
    CLOCK_SOLAR,
    CLOCK_UTC,
};

struct reading {
    struct sky_desc *d;
    enum clock_kind clock;
    double utc_hour;
};

static const struct {
    const char *name;
    size_t offset;
    double least, most, unit; /* unit: factor from the user's unit to the description's */
} numbers[] = {
    { "latitude", offsetof(struct sky_desc, latitude_degrees), -90.0, 90.0, 1.0 },
    { "longitude", offsetof(struct sky_desc, longitude_degrees), -180.0, 180.0, 1.0 },
    { "hour", offsetof(struct sky_desc, hour), 0.0, 24.0, 1.0 },
    { "speed", offsetof(struct sky_desc, speed_hours), 0.0, 1440.0, 1.0 / 60.0 },
    { "turbidity", offsetof(struct sky_desc, turbidity), 1.7, 10.0, 1.0 },
    { "ground", offsetof(struct sky_desc, ground_albedo), 0.0, 1.0, 1.0 },
    { "sun_ratio", offsetof(struct sky_desc, sun_ratio), 0.0, 1e9, 1.0 },
    { "night", offsetof(struct sky_desc, night_lux), 0.0, 100.0, 1.0 },
    { "scale", offsetof(struct sky_desc, scale), 1e-9, 1e9, 1.0 },
};

static const int month_days[12] = { 31, 29, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31 };

/* `text` as a number of 1..5 digits; -1 if it is anything else. */
static int small_number(const char *text, size_t length)
{
    int v = 0;

    if (length < 1 || length > 5)
        return -1;
    for (size_t i = 0; i < length; i++) {
        if (!isdigit((unsigned char)text[i]))
            return -1;
        v = 10 * v + (text[i] - '0');
    }
    return v;
}

/* Two numbers around the last `mark`, as in 06-21 or 1024x512. */
static bool two_numbers(const char *text, char mark, int *a, int *b)
{
    const char *at = strrchr(text, mark);

    *a = at ? small_number(text, (size_t)(at - text)) : -1;
    *b = at ? small_number(at + 1, strlen(at + 1)) : -1;
    return *a >= 0 && *b >= 0;
}

static enum err read_date(struct sky_desc *d, const char *value, struct reason *why)
{
    const char *date = value;
    int month, day;

    if (strlen(value) == 10 && small_number(value, 4) >= 0 && value[4] == '-') /* the year is ignored */
        date = value + 5;
    if (!two_numbers(date, '-', &month, &day) || month < 1 || month > 12)
        return err_say(why, ERR_USAGE, "sky: date=%s is not MM-DD or YYYY-MM-DD", value);
    if (day < 1 || day > month_days[month - 1])
        return err_say(why, ERR_USAGE, "sky: date=%s: there is no such day; month %d has the days 1 to %d", value,
                       month, month_days[month - 1]);
    d->month = month;
    d->day = day;
    return ERR_OK;
}

static enum err read_clock(const char *name, const char *value, double *hour, struct reason *why)
{
    int h, m;

    if (!two_numbers(value, ':', &h, &m) || m > 59 || h * 60 + m > 24 * 60)
        return err_say(why, ERR_USAGE, "sky: %s=%s is not HH:MM from 00:00 to 24:00", name, value);
    *hour = h + m / 60.0;
    return ERR_OK;
}

static enum err read_size(struct sky_desc *d, const char *value, struct reason *why)
{
    int w, h;

    if (!two_numbers(value, 'x', &w, &h) || h < 2 || h % 2 || w != 2 * h || w > SKY_SIDE_MAX)
        return err_say(why, ERR_USAGE,
                       "sky: size=%s is not WIDTHxHEIGHT; expected 2:1 from 4x2 to %dx%d with an even height", value,
                       SKY_SIDE_MAX, SKY_SIDE_MAX / 2);
    d->width = (uint32_t)w;
    d->height = (uint32_t)h;
    return ERR_OK;
}

static enum err read_key(struct reading *r, const char *name, const char *value, struct reason *why)
{
    char *end;

    if (strcmp(name, "date") == 0)
        return read_date(r->d, value, why);
    if (strcmp(name, "size") == 0)
        return read_size(r->d, value, why);
    if (strcmp(name, "time") == 0 || strcmp(name, "hour") == 0)
        r->clock = CLOCK_SOLAR;
    if (strcmp(name, "time") == 0)
        return read_clock(name, value, &r->d->hour, why);
    if (strcmp(name, "utc") == 0) {
        r->clock = CLOCK_UTC;
        return read_clock(name, value, &r->utc_hour, why);
    }
    for (size_t i = 0; i < sizeof(numbers) / sizeof(numbers[0]); i++) {
        if (strcmp(name, numbers[i].name) != 0)
            continue;
        const double v = strtod(value, &end);
        if (end == value || *end || !(v >= numbers[i].least && v <= numbers[i].most))
            return err_say(why, ERR_USAGE, "sky: %s=%s is not a number from %g to %g", name, value, numbers[i].least,
                           numbers[i].most);
        *(double *)((char *)r->d + numbers[i].offset) = v * numbers[i].unit;
        return ERR_OK;
    }
    return err_say(
        why, ERR_USAGE,
        "sky: unknown key '%s'; expected latitude, longitude, date, hour, time, utc, speed, turbidity, ground, "
        "sun_ratio, night, scale or size",
        name);
}

enum err sky_parse(const char *text, struct sky_desc *out, struct reason *why)
{
    struct reading r = { .d = out };
    char key[128];

    *out = (struct sky_desc){ .latitude_degrees = 45.0,
                              .month = 6,
                              .day = 21,
                              .hour = 6.25,
                              .speed_hours = 1.0 / 60.0,
                              .turbidity = 3.0,
                              .ground_albedo = 0.2,
                              .night_lux = 0.002,
                              .scale = 0.0065,
                              .width = 1024,
                              .height = 512 };
    while (*text) {
        const size_t length = strcspn(text, ",");
        if (length >= sizeof(key))
            return err_say(why, ERR_USAGE, "sky: '%.40s...' is too long for a key and a value", text);
        memcpy(key, text, length);
        key[length] = '\0';
        text += length + (text[length] == ',');
        char *equals = strchr(key, '=');
        if (!equals)
            return err_say(why, ERR_USAGE, "sky: '%s' has no value; expected KEY=VALUE, as in latitude=45,date=06-21",
                           key);
        *equals = '\0';
        const enum err e = read_key(&r, key, equals + 1, why);
        if (e)
            return e;
    }
    if (r.clock == CLOCK_UTC) {
        const double solar = r.utc_hour + out->longitude_degrees / 15.0;
        const double shift = sky_equation_of_time(day_of_year(out->month, out->day), solar) / 60.0;
        out->hour = fmod(solar + shift + 48.0, 24.0);
    }
    return ERR_OK;
}

/* ---- The sky at one moment ---- */

struct sun_day sky_day(const struct sky_desc *d, uint64_t frame)
{
    const int later = (int)floor(fmod(d->hour + d->speed_hours * (double)frame, 365.0 * 24.0) / 24.0);

    return (struct sun_day){ d->latitude_degrees * DEGREE, day_of_year(d->month, d->day) + later, .solar = true };
}

void sky_state_at(const struct sky_desc *d, uint64_t frame, struct sky_state *out)
{
    const double year = 365.0 * 24.0;
    const double hours = fmod(d->hour + d->speed_hours * (double)frame, year);

    *out = (struct sky_state){ .sun_elevation = 0.0 };
    sky_sun_place(d->latitude_degrees * DEGREE, day_of_year(d->month, d->day), hours, out->sun_direction);
    const double *w = out->sun_direction;
    out->sun_elevation = atan2(w[1], sqrt(w[0] * w[0] + w[2] * w[2]));
    sky_state_fill(d, out);
}
