#include "base/text.h"

#include "base/file_store.h"
#include "base/mem.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define FIRST_CAPACITY 4096 /* it doubles from there */

bool text_ends_with(const char *text, const char *end)
{
    const size_t n = strlen(text), m = strlen(end);
    return n >= m && strcmp(text + n - m, end) == 0;
}

void text_finish(struct text *t)
{
    mem_free(t->bytes);
    *t = (struct text){ .bytes = NULL };
}

/* Room for `more` characters and the 0 behind them. */
static bool reserve(struct text *t, size_t more)
{
    const size_t want = t->size + more + 1;
    size_t capacity = t->capacity ? t->capacity : FIRST_CAPACITY;

    if (t->failed)
        return false;
    if (want <= t->capacity)
        return true;
    while (capacity < want)
        capacity *= 2;
    char *bytes = mem_grow(t->bytes, t->bytes ? t->size + 1 : 0, capacity, 1);
    if (!bytes) {
        t->failed = true;
        return false;
    }
    t->bytes = bytes;
    t->capacity = capacity;
    return true;
}

void text_add_bytes(struct text *t, const char *bytes, size_t size)
{
    if (!reserve(t, size))
        return;
    memcpy(t->bytes + t->size, bytes, size);
    t->size += size;
    t->bytes[t->size] = '\0';
}

void text_add(struct text *t, const char *format, ...)
{
    va_list args, again;

    va_start(args, format);
    va_copy(again, args);
    const int n = vsnprintf(NULL, 0, format, args);
    if (n >= 0 && reserve(t, (size_t)n)) {
        vsnprintf(t->bytes + t->size, (size_t)n + 1, format, again);
        t->size += (size_t)n;
    }
    va_end(again);
    va_end(args);
}

void text_add_base64(struct text *t, const uint8_t *bytes, size_t size)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

    for (size_t i = 0; i < size; i += 3) {
        const size_t left = size - i;
        const uint32_t three = (uint32_t)bytes[i] << 16 | (uint32_t)(left > 1 ? bytes[i + 1] : 0) << 8 |
                               (uint32_t)(left > 2 ? bytes[i + 2] : 0);
        const char four[4] = { digits[three >> 18], digits[three >> 12 & 63], left > 1 ? digits[three >> 6 & 63] : '=',
                               left > 2 ? digits[three & 63] : '=' };
        text_add_bytes(t, four, 4);
    }
}

enum err text_store(const struct text *t, const char *path, struct reason *why)
{
    if (t->failed)
        return err_say(why, ERR_NOMEM, "%s: no memory to write it", path);
    return file_store(path, t->bytes ? t->bytes : "", t->size, why);
}
