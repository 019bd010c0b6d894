#include "base/err.h"

#include <stdarg.h>
#include <stdio.h>

const char *err_text(enum err e)
{
    switch (e) {
    case ERR_OK: return "ok";
    case ERR_NOMEM: return "out of memory";
    case ERR_IO: return "input or output failed";
    case ERR_FORMAT: return "malformed data";
    case ERR_RANGE: return "out of range";
    case ERR_UNSUPPORTED: return "not supported";
    case ERR_USAGE: return "wrong usage";
    case ERR_END: return "end of data";
    }
    return "unknown error";
}

enum err err_say(struct reason *why, enum err e, const char *format, ...)
{
    if (why) {
        va_list args;
        va_start(args, format);
        vsnprintf(why->text, sizeof(why->text), format, args);
        va_end(args);
    }
    return e;
}

int err_exit_code(enum err e)
{
    if (e == ERR_OK)
        return 0;
    return e == ERR_USAGE ? 2 : 1;
}
