#include "base/setting.h"

#include <assert.h>
#include <math.h>
#include <string.h>

bool setting_ends(const struct setting *row)
{
    return !row->name && !row->key;
}

const char *setting_prefix(const struct setting *row)
{
    return row->level == SETTING_TUNE ? "--tune " : "--";
}

static const void *field(const struct setting *row, const void *values)
{
    return (const char *)values + row->offset;
}

void setting_copy(const struct setting *row, void *to, const void *from)
{
    memcpy((char *)to + row->offset, field(row, from), row->size);
}

void setting_store_whole(const struct setting *row, void *values, uint64_t v)
{
    void *at = (char *)values + row->offset;

    switch (row->size) {
    case 0: break;
    case 1: memcpy(at, &(uint8_t){ (uint8_t)v }, 1); break;
    case 2: memcpy(at, &(uint16_t){ (uint16_t)v }, 2); break;
    case 4: memcpy(at, &(uint32_t){ (uint32_t)v }, 4); break;
    default: assert(row->size == 8); memcpy(at, &v, 8);
    }
}

void setting_store_real(const struct setting *row, void *values, double v)
{
    assert(row->size == sizeof(v));
    memcpy((char *)values + row->offset, &v, sizeof(v));
}

int64_t setting_whole(const struct setting *row, const void *values)
{
    const void *at = field(row, values);
    uint8_t one;
    uint16_t two;
    uint32_t four;
    int64_t eight;

    switch (row->size) {
    case 1: memcpy(&one, at, 1); return one;
    case 2: memcpy(&two, at, 2); return two;
    case 4: memcpy(&four, at, 4); return four;
    default:
        assert(row->size == 8);
        memcpy(&eight, at, 8);
        return eight;
    }
}

double setting_real(const struct setting *row, const void *values)
{
    double v;

    assert(row->size == sizeof(v));
    memcpy(&v, field(row, values), sizeof(v));
    return v;
}

bool setting_is_null(const struct setting *row, const void *values)
{
    if (!row->has_null)
        return false;
    const double v = row->type == SETTING_REAL ? setting_real(row, values) : (double)setting_whole(row, values);
    return v == row->null || (isnan(v) && isnan(row->null));
}
