/* server/base/log.h */
/* One line per event on standard error: `relightd: warning: text`. Any thread; a line is written in one piece. */
#ifndef BASE_LOG_H
#define BASE_LOG_H

#include "err.h"

enum log_level {
    LOG_ERROR,
    LOG_WARNING,
    LOG_INFO,
    LOG_DEBUG,
};

/* Names the program and the most talkative level that is printed. Called once by a main, before any other thread. */
void log_init(const char *program, enum log_level level);

void log_line(enum log_level level, const char *format, ...) PRINTF_LIKE(2, 3);

#define log_error(...) log_line(LOG_ERROR, __VA_ARGS__)
#define log_warning(...) log_line(LOG_WARNING, __VA_ARGS__)
#define log_info(...) log_line(LOG_INFO, __VA_ARGS__)
#define log_debug(...) log_line(LOG_DEBUG, __VA_ARGS__)

#endif
