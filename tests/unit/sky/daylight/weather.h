/* A weather file in memory: every hour of a year at 40 degrees north, with sun from 8 to 16 o'clock. */
#pragma once

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WEATHER_HEADER                                                                                                 \
    "LOCATION,Somewhere,-,Land,test,0,40,15,1,0\nDESIGN CONDITIONS,0\nCOMMENTS 1,x\n"                                  \
    "DATA PERIODS,1,1,Data,Sunday, 1/ 1,12/31\n"

/* A record, with what stands in fields 15 and 16, direct and diffuse. */
static inline int weather_record(char *out, size_t size, int month, int day, int hour, const char *direct,
                                 const char *diffuse)
{
    return snprintf(out, size,
                    "2021,%d,%d,%d,0,?9,10.0,5.0,70,101325,9999,9999,9999,0,%s,%s,999999,999999,999999,9999,0,0,0,0\n",
                    month, day, hour, direct, diffuse);
}

/* The text of a year; free it with free. missing: hours on 2 January from 10 on. */
static inline char *weather_text(int missing)
{
    static const int days[12] = { 31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31 };
    const size_t size = 8760 * 128 + 1000;
    char *text = malloc(size);
    size_t used = (size_t)snprintf(text, size, "%s", WEATHER_HEADER);

    for (int m = 1; m <= 12; m++)
        for (int d = 1; d <= days[m - 1]; d++)
            for (int h = 1; h <= 24; h++) {
                const int day = h > 8 && h <= 16, gone = m == 1 && d == 2 && h > 10 && h <= 10 + missing;
                used += (size_t)weather_record(text + used, size - used, m, d, h,
                                               gone  ? "9999"
                                               : day ? "500"
                                                     : "0",
                                               day ? "100" : "0");
            }
    return text;
}
