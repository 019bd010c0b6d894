/* EnergyPlus weather files (.epw) [EnergyPlus 2024]: a header with the place, then one line for each hour. Only what
 * light needs is read. Thread: any. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* The measurements of one record: means over an interval that ends at `end`. Missing ones are NAN. */
struct epw_record {
    int month, day;                        /* 1..12, 1..31 */
    double end;                            /* local standard time, hours, above 0 and at most 24 */
    double direct_normal;                  /* irradiance, W m^-2 */
    double diffuse;                        /* horizontal irradiance, W m^-2 */
    double direct_normal_lux, diffuse_lux; /* illuminance, lx; NAN in files that do not state it */
    double dew_point;                      /* degrees Celsius; NAN: missing */
    uint32_t line;                         /* in the file, from 1 */
};

struct epw {
    char place[100];  /* city and country */
    double latitude;  /* degrees, north positive */
    double longitude; /* degrees, east positive */
    double zone;      /* hours ahead of UTC */
    double interval;  /* hours that a record covers */
    struct epw_record *records;
    size_t count, capacity;
    size_t mended; /* measurements that were blank or negative: a little below 0 became 0, others are missing */
};

/* Reads a file. The caller frees *out with epw_finish. ERR_IO: cannot be read; ERR_FORMAT names line and field;
 * ERR_RANGE: a value that no weather has, or a file above 64 MB; ERR_NOMEM. On an error *out is empty. */
MUST_CHECK enum err epw_read(const char *path, struct epw *out, struct reason *why);
void epw_finish(struct epw *w); /* zeroed memory is allowed */

/* The same from memory, which is changed. name: of the file, for messages. */
MUST_CHECK enum err epw_parse(const char *name, char *text, size_t size, struct epw *out, struct reason *why);
