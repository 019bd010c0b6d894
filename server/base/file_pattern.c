#include "base/file_store.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define DIGITS_MAX 20 /* digits of 2^64 - 1 */

enum err file_pattern_parse(const char *text, const char *flag, struct file_pattern *out, struct reason *why)
{
    *out = (struct file_pattern){ .text = text };
    for (const char *p = strchr(text, '%'); p; p = strchr(p + 1, '%')) {
        size_t n = 1;
        unsigned width = 0;
        while (p[n] >= '0' && p[n] <= '9' && width <= DIGITS_MAX)
            width = 10 * width + (unsigned)(p[n++] - '0');
        if (p[n] != 'd' || width > DIGITS_MAX || out->length)
            return err_say(why, ERR_USAGE, "%s '%s' must contain at most one %%d or %%04d and no other '%%'", flag,
                           text);
        out->at = (size_t)(p - text);
        out->length = n + 1;
        out->digits = width;
    }
    return ERR_OK;
}

enum err file_pattern_name(const struct file_pattern *p, uint64_t number, char *name, size_t size, struct reason *why)
{
    const int n = p->length ? snprintf(name, size, "%.*s%0*" PRIu64 "%s", (int)p->at, p->text, (int)p->digits, number,
                                       p->text + p->at + p->length)
                            : snprintf(name, size, "%s", p->text);

    return n > 0 && (size_t)n < size ? ERR_OK : err_say(why, ERR_USAGE, "'%.200s': the file name is too long", p->text);
}
