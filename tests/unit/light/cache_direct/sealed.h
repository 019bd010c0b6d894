/* Files of tables (light/cache/cache_file.h) as bytes, for those who forge them. */
#pragma once

#include "base/mem.h"
#include "support/unit.h"

#include <string.h>
#include <sys/stat.h>
#include <zlib.h>

enum { SEALED_HEADER = 24, SEALED_ENTRY = 56 };

static inline void set_number(uint8_t *at, uint32_t value)
{
    memcpy(at, &value, sizeof(value));
}

/* The file's bytes, *size of them, for mem_free. */
static inline uint8_t *sealed_read(const char *path, size_t *size)
{
    struct stat st;

    assert_int_equal(stat(path, &st), 0);
    *size = (size_t)st.st_size;
    uint8_t *bytes = mem_alloc(*size, 1);
    FILE *in = fopen(path, "rb");
    assert_non_null(in);
    assert_int_equal(fread(bytes, 1, *size, in), *size);
    fclose(in);
    return bytes;
}

/* Makes the checksums those of what is there. */
static inline void seal(uint8_t *bytes, size_t size)
{
    enum { CHECK = 20, LENGTH_AT = 40, CHECK_AT = 48 };
    uint32_t sections;
    size_t at;

    memcpy(&sections, bytes + 16, sizeof(sections));
    at = SEALED_HEADER + sections * SEALED_ENTRY;
    for (uint32_t k = 0; k < sections; k++) {
        uint8_t *entry = bytes + SEALED_HEADER + k * SEALED_ENTRY;
        uint64_t length;
        memcpy(&length, entry + LENGTH_AT, sizeof(length));
        set_number(entry + CHECK_AT, (uint32_t)crc32_z(0, bytes + at, length));
        at += length;
    }
    assert_true(at == size);
    set_number(bytes + CHECK, 0);
    set_number(bytes + CHECK, (uint32_t)crc32_z(0, bytes, SEALED_HEADER + sections * SEALED_ENTRY));
}
