/* When a sky was taken, by its file's name. Thread: any. */
#pragma once

#include <stdint.h>

/* Microseconds since 1970 UTC; 0: the name has no time. Folders do not count. It is the first of these that is a moment
 * of the calendar (1970 to 2199):
 * - date and time as digits, with or without separators: sky_20240612_143005.exr, 2024-06-12T14-30-05.jpg,
 *   `2024-06-12 14.30.05.hdr`, 20240612143005.exr. Behind it, a fraction (.5, or exactly three digits: 143005_250,
 *   143005250) and an offset from UTC (Z, +0200, +02:00, -05:00; -0500 is more likely a counter and is left alone);
 * - seconds (10 digits, from 2001 on, with or without a fraction) or milliseconds (13 digits) since 1970.
 * Without an offset local time is taken as UTC: differences between names, all that an interpolation needs, are right,
 * the sun's place is not. */
int64_t taken_from_name(const char *name);
