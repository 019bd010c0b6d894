#include "image/codec/encode.h"

#include "base/mem.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint32_t rotate(uint32_t x, int by)
{
    return x << by | x >> (32 - by);
}

static uint32_t scramble(uint32_t k)
{
    return rotate(k * 0xcc9e2d51u, 15) * 0x1b873593u;
}

uint32_t cryptomatte_hash(const char *name)
{
    const size_t length = strlen(name);
    uint32_t h = 0, k = 0;

    for (size_t i = 0; i + 4 <= length; i += 4) { /* little-endian words */
        for (size_t b = 4; b-- > 0;)
            k = k << 8 | (uint8_t)name[i + b];
        h = rotate(h ^ scramble(k), 13) * 5 + 0xe6546b64u;
    }
    k = 0;
    for (size_t b = length & 3; b-- > 0;)
        k = k << 8 | (uint8_t)name[(length & ~(size_t)3) + b];
    h ^= scramble(k) ^ (uint32_t)length;
    h = (h ^ h >> 16) * 0x85ebca6bu;
    h = (h ^ h >> 13) * 0xc2b2ae35u;
    return h ^ h >> 16;
}

/* "uint32_to_float32": exponents 0 and 255 become 1 and 254. */
static uint32_t id_bits(const char *name)
{
    const uint32_t hash = cryptomatte_hash(name), exponent = hash >> 23 & 255;
    const uint32_t kept = exponent == 0 ? 1 : exponent == 255 ? 254 : exponent;

    return (hash & ~(255u << 23)) | kept << 23;
}

float cryptomatte_id(const char *name)
{
    const uint32_t bits = id_bits(name);
    float id;

    memcpy(&id, &bits, sizeof(id));
    return id;
}

static int by_text(const void *a, const void *b)
{
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}

/* The name as a string of JSON; returns what follows it. */
static char *put_string(char *at, const char *name)
{
    *at++ = '"';
    for (; *name; name++) {
        const unsigned char c = (unsigned char)*name;
        if (c == '"' || c == '\\')
            at += sprintf(at, "\\%c", c);
        else if (c < 32)
            at += sprintf(at, "\\u%04x", c);
        else
            *at++ = (char)c;
    }
    *at++ = '"';
    return at;
}

static char *make_manifest(const char **sorted, size_t count)
{
    size_t room = 3;

    for (size_t i = 0; i < count; i++)
        room += 6 * strlen(sorted[i]) + 14;
    char *text = mem_alloc(room, 1), *at = text;
    if (!text)
        return NULL;
    *at++ = '{';
    for (size_t i = 0; i < count; i++) {
        if (i > 0 && strcmp(sorted[i], sorted[i - 1]) == 0)
            continue;
        if (i > 0)
            *at++ = ',';
        at = put_string(at, sorted[i]);
        at += sprintf(at, ":\"%08x\"", id_bits(sorted[i]));
    }
    *at++ = '}';
    *at = '\0';
    return text;
}

enum err cryptomatte_init(struct cryptomatte *c, const char *layer, const char *const *names, size_t count)
{
    static const char *const what[] = { "name", "hash", "conversion", "manifest" };
    const char **sorted = mem_alloc(count + 1, sizeof(*sorted));

    *c = (struct cryptomatte){ .value = { layer, "MurmurHash3_32", "uint32_to_float32" } };
    if (!sorted)
        return ERR_NOMEM;
    memcpy(sorted, names, count * sizeof(*sorted));
    qsort(sorted, count, sizeof(*sorted), by_text);
    c->manifest = make_manifest(sorted, count);
    mem_free(sorted);
    c->value[3] = c->manifest;
    for (int k = 0; k < 4; k++)
        snprintf(c->key[k], sizeof(c->key[k]), "cryptomatte/%07x/%s", cryptomatte_hash(layer) >> 4, what[k]);
    return c->manifest ? ERR_OK : ERR_NOMEM;
}

void cryptomatte_finish(struct cryptomatte *c)
{
    mem_free(c->manifest);
    *c = (struct cryptomatte){ .manifest = NULL };
}
