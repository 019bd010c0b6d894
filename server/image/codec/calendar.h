/* Dates and times of files as one number: microseconds since 1970 UTC, without leap seconds. Thread: any. No errors: 0
 * means that there is no such moment. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#define CALENDAR_MAX_US INT64_C(7258118400000000) /* 1 January 2200: what is later is a mistake */

/* A moment of the Gregorian calendar, from 1970 to 2199: hour 0 to 23, second 0 to 60 (60 is a leap second, which is
 * the next minute's first). */
int64_t calendar_us(int year, int month, int day, int hour, int minute, int second);

/* "2024:06:12 14:30:05", as Exif, OpenEXR's capDate and Radiance's CAPDATE have it; spaces and zeros may follow. The
 * text need not end. */
int64_t calendar_of_text(const char *text, size_t size);
