/* What the tests of the decoders share. */
#pragma once

#include "support/unit.h"

#include "image/codec/decode.h"

#include <math.h>
#include <stdbool.h>

#define NAME "a folder/sky.0017"

/* Every refusal names the file first, then the fault, in one line of what a terminal can show. */
static inline void check_reason(const char *name, enum err e, const struct reason *why)
{
    const size_t length = strlen(name);

    if (strncmp(why->text, name, length) != 0 || strncmp(why->text + length, ": ", 2) != 0 ||
        strlen(why->text) < length + 8)
        fail_msg("%s: '%s' does not name %s", err_text(e), why->text, name);
    for (const char *s = why->text; *s; s++)
        if (*s < 0x20 || *s > 0x7e)
            fail_msg("'%s' is not one plain line", why->text);
}

/* What may be relied on after any decoding: texels that are there, finite and not negative. */
static inline void check_image(const struct image *im)
{
    assert_in_range(im->width, 1, IMAGE_MAX_SIDE);
    assert_in_range(im->height, 1, IMAGE_MAX_SIDE);
    assert_true(im->capacity >= (size_t)im->width * im->height * 3);
    for (size_t i = 0; i < (size_t)im->width * im->height * 3; i++)
        if (!(im->rgb[i] >= 0.0f && im->rgb[i] <= IMAGE_MAX))
            fail_msg("value %zu is %g", i, (double)im->rgb[i]);
}

/* Decodes bytes that lie alone in memory, so that a sanitizer sees a step beyond them, and checks what must hold
 * whatever they are. */
static inline enum err decode_alone(const uint8_t *bytes, size_t size, struct image *im, struct reason *why)
{
    uint8_t *alone = malloc(size ? size : 1);

    assert_non_null(alone);
    memcpy(alone, bytes, size);
    why->text[0] = '\0';
    const enum err e = decode_image(alone, size, NAME, im, why);
    free(alone);
    if (e)
        check_reason(NAME, e, why);
    else
        check_image(im);
    return e;
}

static inline void must_decode(const uint8_t *bytes, size_t size, struct image *im)
{
    struct reason why;

    if (decode_alone(bytes, size, im, &why))
        fail_msg("%s", why.text);
}

/* Refused with this code, in words that have `about` in them. */
static inline void must_refuse(const uint8_t *bytes, size_t size, enum err code, const char *about)
{
    struct image im = { 0 };
    struct reason why;
    const enum err e = decode_alone(bytes, size, &im, &why);

    image_finish(&im);
    if (e != code)
        fail_msg("%s, not %s: %s", err_text(e), err_text(code), why.text);
    if (!strstr(why.text, about))
        fail_msg("'%s' has no '%s'", why.text, about);
}

/* Each beginning of the file is refused: nothing of it may be left out. */
static inline void must_refuse_each_cut(const uint8_t *bytes, size_t size)
{
    struct image im = { 0 };
    struct reason why;

    for (size_t n = 0; n < size; n++)
        if (!decode_alone(bytes, n, &im, &why))
            fail_msg("the first %zu bytes of %zu are taken for whole", n, size);
    image_finish(&im);
}

/* Bits turned over one at a time, all of a small file, evenly spread ones of a larger: refused or decoded, nothing
 * else. */
static inline void must_survive_turned_bits(uint8_t *bytes, size_t size)
{
    struct image im = { 0 };
    struct reason why;
    const size_t step = 8 * size / 4000 * 2 + 1; /* odd, so that each of a byte's bits has its turn */

    for (size_t bit = 0; bit < 8 * size; bit += step) {
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        (void)!decode_alone(bytes, size, &im, &why);
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    image_finish(&im);
}
