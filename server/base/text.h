/* Text that grows in memory and is stored whole. A zeroed struct text is empty. Out of memory, the text stays as it is
 * and `failed` is set, which text_store reports. One thread at a time. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct text {
    char *bytes; /* ended by 0; NULL while nothing was added */
    size_t size; /* without the 0 */
    size_t capacity;
    bool failed;
};

/* Whether any text ends with `end`. */
bool text_ends_with(const char *text, const char *end);

void text_finish(struct text *t); /* zeroed memory is allowed */

/* Adds formatted text; adds bytes as they are. */
void text_add(struct text *t, const char *format, ...) PRINTF_LIKE(2, 3);
void text_add_bytes(struct text *t, const char *bytes, size_t size);

/* As base64 [RFC 4648], for data: addresses. */
void text_add_base64(struct text *t, const uint8_t *bytes, size_t size);

/* As base/file_store.h does it; ERR_NOMEM where something could not be added. */
MUST_CHECK enum err text_store(const struct text *t, const char *path, struct reason *why);
