#include "base/log.h"

#include "base/clock.h"
#include "base/progress.h"

#include <pthread.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define TEXT 1024 /* longer messages are cut */

/* Set once before other threads start, read-only afterwards. */
static const char *log_program = "relight";
static struct log_desc log_now = { .level = LOG_INFO };
static bool log_timed;
static void (*log_diverted)(enum log_level level, const char *text); /* NULL: to standard error */

/* Guards the sites and their suppressed lines. */
static pthread_mutex_t log_lock = PTHREAD_MUTEX_INITIALIZER;
static struct log_site *log_sites; /* {log_lock} sites with suppressed lines */
static atomic_uint_fast64_t log_lines[LOG_LEVELS], log_suppressed;

void log_init(const char *program, enum log_level level)
{
    log_program = program;
    log_now.level = level;
}

/* journald names its own pipe in an environment variable [systemd.exec(5)]. A child whose standard error is redirected
 * inherits that variable, so the pipe has to be compared. */
static bool is_journald(void)
{
    const char *stream = getenv("JOURNAL_STREAM");
    unsigned long long device, inode;
    struct stat st;

    return stream && sscanf(stream, "%llu:%llu", &device, &inode) == 2 && fstat(STDERR_FILENO, &st) == 0 &&
           device == (unsigned long long)st.st_dev && inode == (unsigned long long)st.st_ino;
}

void log_configure(const struct log_desc *desc)
{
    log_now = *desc;
    log_timed = desc->form != LOG_PLAIN && !is_journald();
}

void log_divert(void (*to)(enum log_level level, const char *text))
{
    log_diverted = to;
}

const struct setting_choice log_levels[] = {
    { "error", LOG_ERROR, "errors", 0 },
    { "warning", LOG_WARNING, "and warnings", 0 },
    { "info", LOG_INFO, "and events", 0 },
    { "debug", LOG_DEBUG, "and details", 0 },
    { NULL, 0, NULL, 0 },
};

const struct setting_choice log_forms[] = {
    { "plain", LOG_PLAIN, "text for people", 0 },
    { "text", LOG_PAIRS, "key=value pairs with the time", 0 },
    { "json", LOG_JSON, "one JSON object per line", 0 },
    { NULL, 0, NULL, 0 },
};

/* ---- One line ---- */

/* Length in bytes of the UTF-8 character at `at`; 0 if it is invalid [RFC 3629, 4]. */
static size_t character(const unsigned char *at)
{
    const size_t n = at[0] < 0x80 ? 1 : at[0] >= 0xc2 && at[0] < 0xe0 ? 2 : (at[0] & 0xf0) == 0xe0 ? 3 : 4;

    if (at[0] >= 0x80 && (at[0] < 0xc2 || at[0] > 0xf4))
        return 0;
    for (size_t i = 1; i < n; i++)
        if ((at[i] & 0xc0) != 0x80)
            return 0;
    const bool overlong = (at[0] == 0xe0 && at[1] < 0xa0) || (at[0] == 0xf0 && at[1] < 0x90);
    const bool beyond = (at[0] == 0xed && at[1] > 0x9f) || (at[0] == 0xf4 && at[1] > 0x8f);
    return overlong || beyond ? 0 : n;
}

/* Replaces control characters and invalid UTF-8 by '?', and escapes quotes and backslashes if `quoted`. File names from
 * outside can thus neither break a line nor send codes to a terminal. */
static void clean(const char *text, bool quoted, char *out, size_t size)
{
    const unsigned char *at = (const unsigned char *)text;
    size_t used = 0;

    while (*at && used + 5 < size) {
        const size_t n = character(at);
        if (n == 0 || (n == 1 && (*at < 0x20 || *at == 0x7f)) || (n == 2 && at[0] == 0xc2 && at[1] < 0xa0)) {
            out[used++] = '?';
            at += n ? n : 1;
            continue;
        }
        if (quoted && (*at == '"' || *at == '\\'))
            out[used++] = '\\';
        memcpy(out + used, at, n);
        used += n;
        at += n;
    }
    out[used] = '\0';
}

static void stamp(char *out, size_t size)
{
    const int64_t now_us = clock_wall_us();
    const time_t seconds = (time_t)(now_us / 1000000);
    struct tm t;

    gmtime_r(&seconds, &t);
    const size_t n = strftime(out, size, "%Y-%m-%dT%H:%M:%S", &t);
    snprintf(out + n, size - n, ".%03dZ", (int)(now_us / 1000 % 1000));
}

/* {log_lock} If a progress line is on the terminal, wipes it first. */
static void put(enum log_level level, const char *text)
{
    static const char *const heads[LOG_LEVELS] = { "error: ", "warning: ", "", "debug: " };
    char line[2 * TEXT], time[64] = "";

    clean(text, log_now.form != LOG_PLAIN, line, sizeof(line));
    if (log_timed)
        stamp(time, sizeof(time));
    const char *wipe = progress_wipe(stderr);
    if (log_now.form == LOG_PLAIN)
        fprintf(stderr, "%s%s: %s%s\n", wipe, log_program, heads[level], line);
    else if (log_now.form == LOG_PAIRS)
        fprintf(stderr, "%s%s%s%slevel=%s program=%s message=\"%s\"\n", wipe, log_timed ? "time=" : "", time,
                log_timed ? " " : "", log_levels[level].name, log_program, line);
    else
        fprintf(stderr, "%s{%s%s%s\"level\":\"%s\",\"program\":\"%s\",\"message\":\"%s\"}\n", wipe,
                log_timed ? "\"time\":\"" : "", time, log_timed ? "\"," : "", log_levels[level].name, log_program,
                line);
}

/* ---- How often ---- */

/* {log_lock} */
static void report_suppressed(struct log_site *site)
{
    char text[TEXT];

    if (site->suppressed == 0)
        return;
    snprintf(text, sizeof(text), "%u more like this: %s", site->suppressed, site->last);
    site->suppressed = 0;
    put(site->level, text);
}

/* {log_lock} Whether to write the line now. */
static bool admit(struct log_site *site, enum log_level level, const char *text, int64_t now_ms)
{
    if (log_now.burst == 0 || level == LOG_ERROR)
        return true;
    if (site->window_ms == 0 || now_ms - site->window_ms >= (int64_t)log_now.window_ms) {
        report_suppressed(site);
        site->window_ms = now_ms;
        site->count = 0;
    }
    if (++site->count <= log_now.burst)
        return true;
    if (!site->listed) {
        site->next = log_sites;
        site->listed = true;
        log_sites = site;
    }
    site->level = level;
    site->suppressed++;
    snprintf(site->last, sizeof(site->last), "%.*s", (int)sizeof(site->last) - 1, text);
    atomic_fetch_add(&log_suppressed, 1);
    return false;
}

void log_line(struct log_site *site, enum log_level level, const char *format, ...)
{
    char text[TEXT];
    va_list args;

    if (level > log_now.level)
        return;
    va_start(args, format);
    vsnprintf(text, sizeof(text), format, args);
    va_end(args);
    atomic_fetch_add(&log_lines[level], 1);
    if (log_diverted) {
        log_diverted(level, text);
        return;
    }
    pthread_mutex_lock(&log_lock);
    if (admit(site, level, text, clock_ms()))
        put(level, text);
    pthread_mutex_unlock(&log_lock);
}

void log_flush(bool all)
{
    const int64_t now_ms = clock_ms();

    pthread_mutex_lock(&log_lock);
    for (struct log_site *site = log_sites; site; site = site->next)
        if (all || now_ms - site->window_ms >= (int64_t)log_now.window_ms)
            report_suppressed(site);
    pthread_mutex_unlock(&log_lock);
}

void log_counts(struct log_counts *out)
{
    for (int k = 0; k < LOG_LEVELS; k++)
        out->lines[k] = atomic_load(&log_lines[k]);
    out->suppressed = atomic_load(&log_suppressed);
}
