/* The log: one line per event on standard error, as `relightd: warning: text` or in a machine-readable format.
 * Thread: any, except log_init and log_configure. Lines are never interleaved. Control characters, which may come from
 * outside, are written as '?'. */
#pragma once

#include "base/setting.h"

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

/* Sets the program's name and the most verbose level to print. Called once by main, before any other thread starts. */
void log_init(const char *program, enum log_level level);

/* Called after log_init and before any other thread starts. */
struct log_desc {
    enum log_level level;
    enum log_form form; /* the time is omitted if standard error is journald's, which adds its own */
    unsigned burst; /* maximum lines of one kind within window_ms; further ones are counted and reported at its end as
                       one line "N more like this: ..."; 0: no limit. Errors are never suppressed. */
    unsigned window_ms;
};
/* Thread: main, before any other starts. */
void log_configure(const struct log_desc *desc);

extern const struct setting_choice log_levels[], log_forms[];

/* From now on, lines go to `to` instead of standard error. Called before any other thread starts. */
void log_divert(void (*to)(enum log_level level, const char *text));

/* Reports suppressed lines whose window has ended; with `all`, every suppressed line. Call it about once a second. */
void log_flush(bool all);

struct log_counts {
    uint64_t lines[LOG_LEVELS]; /* logged at or above the current level */
    uint64_t suppressed;        /* of these, suppressed */
};
void log_counts(struct log_counts *out); /* since the start */

/* A call site that logs; its lines count as one kind. Guarded by log.c's lock. */
struct log_site {
    struct log_site *next;
    bool listed;
    enum log_level level;
    int64_t window_ms;   /* start of the current window */
    unsigned count;      /* lines in the window */
    unsigned suppressed; /* of these, suppressed */
    char last[160];      /* the last suppressed line */
};

/* Used by the macros below, which give each call site its own log_site. */
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
