/* One line per event on standard error: `relightd: warning: text`, or the same for machines. Any thread; a line is
 * written in one piece, and control characters in it, which may come from outside, are written as '?'. */
#ifndef BASE_LOG_H
#define BASE_LOG_H

#include "err.h"

#include <stdbool.h>
#include <stdint.h>

enum log_level {
    LOG_ERROR,
    LOG_WARNING,
    LOG_INFO,
    LOG_DEBUG,
    LOG_LEVELS,
};

enum log_form {
    LOG_PLAIN, /* program: warning: text */
    LOG_PAIRS, /* time=2026-06-21T12:00:00.000Z level=warning program=relightd message="text" */
    LOG_JSON,  /* {"time":"...","level":"warning","program":"relightd","message":"text"} */
};

/* Names the program and the most talkative level that is printed. Called once by a main, before any other thread. */
void log_init(const char *program, enum log_level level);

/* After log_init, and likewise before any other thread. */
struct log_desc {
    enum log_level level;
    enum log_form form; /* time is left out where standard error is journald's, which has its own */
    unsigned burst;     /* lines of one kind within window_ms; what is above is counted, and told at its end as one line
                           "N more like this: ..."; 0: no limit. Errors are never held back. */
    unsigned window_ms;
};
void log_configure(const struct log_desc *desc);

/* ERR_USAGE names the flag. Names are error, warning, info, debug; plain, text, json. */
MUST_CHECK enum err log_parse_level(const char *name, enum log_level *out, struct reason *why);
MUST_CHECK enum err log_parse_form(const char *name, enum log_form *out, struct reason *why);

/* Tells what was held back and whose time is over; `all`: also what is not. To be called about once a second. */
void log_flush(bool all);

struct log_counts {
    uint64_t lines[LOG_LEVELS]; /* asked for, up to the level in force */
    uint64_t held;              /* of these, not written */
};
void log_counts(struct log_counts *out);

/* A place in the program that logs: the kind of its lines. {log.c's lock} */
struct log_site {
    struct log_site *next;
    bool listed;
    enum log_level level;
    int64_t window_ms; /* when the present window began */
    unsigned count;    /* lines in it, */
    unsigned held;     /* and those not written */
    char last[160];    /* of these */
};

void log_line(struct log_site *site, enum log_level level, const char *format, ...) PRINTF_LIKE(3, 4);

#define log_at(level, ...)                                                                                             \
    do {                                                                                                               \
        static struct log_site log_site;                                                                               \
        log_line(&log_site, level, __VA_ARGS__);                                                                       \
    } while (0)
#define log_error(...) log_at(LOG_ERROR, __VA_ARGS__)
#define log_warning(...) log_at(LOG_WARNING, __VA_ARGS__)
#define log_info(...) log_at(LOG_INFO, __VA_ARGS__)
#define log_debug(...) log_at(LOG_DEBUG, __VA_ARGS__)

#endif
