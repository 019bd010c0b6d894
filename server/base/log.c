#include "log.h"

#include "progress.h"

#include <stdarg.h>
#include <stdio.h>

/* Set once before threads start, then only read: the sink is the process's own standard error. */
static const char *log_program = "relight";
static enum log_level log_most = LOG_INFO;

void log_init(const char *program, enum log_level level)
{
    log_program = program;
    log_most = level;
}

void log_line(enum log_level level, const char *format, ...)
{
    static const char *const names[] = { "error: ", "warning: ", "", "debug: " };
    char text[1024];
    va_list args;

    if (level > log_most)
        return;
    va_start(args, format);
    vsnprintf(text, sizeof(text), format, args);
    va_end(args);
    /* A progress line may be standing on the terminal: start at its beginning and wipe it. */
    fprintf(stderr, "%s%s: %s%s\n", progress_wipe(stderr), log_program, names[level], text);
}
