/* Invariants after decoding arbitrary input. */
#pragma once

#include "image/codec/decode.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define IMAGE_NAME "picture"

static inline void image_require(int holds, const char *what)
{
    if (holds)
        return;
    fprintf(stderr, "broken promise: %s\n", what);
    abort();
}

/* Decoded: every texel exists, finite and not negative. Refused: with one line that begins with the name. */
static inline void image_check(enum err e, const struct image *im, const struct reason *why)
{
    if (e) {
        image_require(strncmp(why->text, IMAGE_NAME ": ", sizeof(IMAGE_NAME) + 1) == 0, "a reason has the name");
        for (const char *s = why->text; *s; s++)
            image_require(*s >= 0x20 && *s < 0x7f, "a reason is one plain line");
        return;
    }
    image_require(im->width >= 1 && im->width <= IMAGE_MAX_SIDE, "width");
    image_require(im->height >= 1 && im->height <= IMAGE_MAX_SIDE, "height");
    const size_t count = (size_t)im->width * im->height * 3;
    image_require(im->capacity >= count, "capacity");
    for (size_t i = 0; i < count; i++)
        image_require(im->rgb[i] >= 0.0f && im->rgb[i] <= IMAGE_MAX, "a value lies in 0..IMAGE_MAX");
}

/* Decodes the same bytes again into the used memory: the same result and values. */
static inline void image_check_again(enum err (*decode)(const uint8_t *, size_t, const char *, struct image *,
                                                          struct reason *),
                                       const uint8_t *bytes, size_t size, enum err e, struct image *im)
{
    const size_t count = e ? 0 : (size_t)im->width * im->height * 3;
    float *first = malloc(count * sizeof(float) + 1);
    struct reason why = { "" };

    image_require(first != NULL, "the fuzzer's own memory");
    if (count)
        memcpy(first, im->rgb, count * sizeof(float));
    image_require(decode(bytes, size, IMAGE_NAME, im, &why) == e, "the same end the second time");
    image_require(count == 0 || memcmp(first, im->rgb, count * sizeof(float)) == 0, "the same values");
    free(first);
}
