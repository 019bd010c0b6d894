#include "sky/between/taken.h"

#include "image/codec/calendar.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

static bool is_digit(char c)
{
    return c >= '0' && c <= '9';
}

static size_t digits_at(const char *s)
{
    return strspn(s, "0123456789");
}

/* Takes `count` digits. */
static bool take_digits(const char **at, size_t count, int *out)
{
    int v = 0;

    for (size_t i = 0; i < count; i++) {
        if (!is_digit((*at)[i]))
            return false;
        v = 10 * v + (*at)[i] - '0';
    }
    *at += count;
    *out = v;
    return true;
}

/* Takes the fraction behind whole seconds: any digits after a dot or comma, three after '_', '-' or nothing. */
static int64_t take_fraction(const char **at)
{
    const char *s = *at;
    const bool point = *s == '.' || *s == ',', dash = *s == '_' || *s == '-';
    const size_t count = digits_at(s + (point || dash));
    int64_t us = 0, unit = 100000;

    if (count == 0 || count > 9 || (!point && count != 3))
        return 0;
    s += point || dash;
    for (size_t i = 0; i < count; i++, unit /= 10)
        us += (s[i] - '0') * unit;
    *at = s + count;
    return us;
}

/* The offset from UTC behind a time, in microseconds; 0: none, or one that no place has. */
static int64_t offset_at(const char *s)
{
    const bool minus = *s == '-';
    int hours, minutes;

    if (*s != '+' && !minus)
        return 0;
    s++;
    if (!take_digits(&s, 2, &hours) || (minus && *s != ':'))
        return 0;
    s += *s == ':';
    if (!take_digits(&s, 2, &minutes) || is_digit(*s) || hours > 14 || minutes > 59)
        return 0;
    return (minus ? -1 : 1) * (60 * hours + minutes) * INT64_C(60000000);
}

/* A date and time that begins here; 0: none does. */
static int64_t calendar_at(const char *s)
{
    static const char *const between[6] = { "", "-_.:", "-_.:", "-_.:Tt ", "-_.:", "-_.:" };
    static const size_t width[6] = { 4, 2, 2, 2, 2, 2 }, most[6] = { 0, 1, 1, 3, 1, 1 };
    int v[6];

    for (int k = 0; k < 6; k++) {
        const size_t apart = strspn(s, between[k]);
        s += apart;
        if (apart > most[k] || !take_digits(&s, width[k], &v[k]))
            return 0;
    }
    if (is_digit(*s) && digits_at(s) != 3)
        return 0;
    int64_t us = calendar_us(v[0], v[1], v[2], v[3], v[4], v[5]);
    if (us == 0)
        return 0;
    us += take_fraction(&s);
    us -= offset_at(s);
    return us > 0 ? us : 0;
}

/* A number of seconds or milliseconds that begins here, from September 2001 on; 0: none does. */
static int64_t unix_at(const char *s)
{
    const size_t count = digits_at(s);

    if ((count != 10 && count != 13) || *s == '0')
        return 0;
    int64_t us = strtoll(s, NULL, 10) * (count == 10 ? 1000000 : 1000);
    s += count;
    if (count == 10 && (*s == '.' || *s == ','))
        us += take_fraction(&s);
    return us < CALENDAR_MAX_US ? us : 0;
}

int64_t taken_from_name(const char *name)
{
    const char *slash = strrchr(name, '/');

    for (const char *s = slash ? slash + 1 : name; *s; s += is_digit(*s) ? digits_at(s) : 1) {
        int64_t us = is_digit(*s) ? calendar_at(s) : 0;
        if (us == 0)
            us = unix_at(s);
        if (us)
            return us;
    }
    return 0;
}
