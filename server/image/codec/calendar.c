#include "image/codec/calendar.h"

#include <stdbool.h>

static bool is_leap(int year)
{
    return year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
}

int64_t calendar_us(int year, int month, int day, int hour, int minute, int second)
{
    static const int before[] = { 0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334, 365 };

    if (year < 1970 || year > 2199 || month < 1 || month > 12 || day < 1 ||
        day > before[month] - before[month - 1] + (month == 2 && is_leap(year)) || hour < 0 || hour > 23 ||
        minute < 0 || minute > 59 || second < 0 || second > 60)
        return 0;
    const int past = year - 1; /* leap days are counted to the end of the year before */
    const int64_t leaps = past / 4 - past / 100 + past / 400 - (1969 / 4 - 1969 / 100 + 1969 / 400);
    const int64_t days =
        365 * (int64_t)(year - 1970) + leaps + before[month - 1] + (month > 2 && is_leap(year)) + day - 1;
    return (((days * 24 + hour) * 60 + minute) * 60 + second) * 1000000;
}

int64_t calendar_of_text(const char *text, size_t size)
{
    static const char form[] = "0000:00:00 00:00:00";
    int v[6] = { 0 }, k = 0;

    if (size < sizeof(form) - 1)
        return 0;
    for (size_t i = 0; i < size; i++) {
        const bool fits = i >= sizeof(form) - 1 ? text[i] == ' ' || text[i] == '\0'
                          : form[i] == '0'      ? text[i] >= '0' && text[i] <= '9'
                                                : text[i] == form[i];
        if (!fits)
            return 0;
    }
    for (size_t i = 0; i < sizeof(form) - 1; i++)
        if (form[i] == '0')
            v[k] = 10 * v[k] + text[i] - '0';
        else
            k++;
    return calendar_us(v[0], v[1], v[2], v[3], v[4], v[5]);
}
