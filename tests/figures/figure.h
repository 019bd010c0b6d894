/* What the programs of this folder have in common: flags, errors, the first frame of a source, processor time, medians.
 * Thread: main. */
#pragma once

#include "base/log.h"
#include "base/setting_table.h"
#include "sky/source/source.h"
#include "sky/tables/environment.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define ALL .section = "Flags"
#define AT(field) SETTING_AT(flags, field) /* a program's values are its own struct flags */

/* Ends the program with the reason, if there is an error. */
static inline void figure_must(enum err e, const struct reason *why)
{
    if (!e)
        return;
    log_error("%s", why->text[0] ? why->text : err_text(e));
    exit(err_exit_code(e));
}

/* Starts the log and reads argv into the flags. --help and bad arguments end the program. */
static inline void figure_begin(struct command *c, int argc, char **argv)
{
    struct reason why = { "" };
    bool done;

    log_init(c->name, LOG_INFO);
    command_begin(c);
    figure_must(command_parse(c, argc, argv, &done, &why), &why);
    if (done)
        exit(0);
    figure_must(command_read(c, &why), &why);
}

/* The first frame of a source; the caller calls frame_finish. */
static inline struct frame figure_frame(const char *spec)
{
    const struct source_desc from = { .spec = spec };
    struct source *source = NULL;
    struct frame frame = { 0 };
    struct reason why = { "" };

    figure_must(source_open(&from, &source, &why), &why);
    figure_must(source_next(source, &frame, &why), &why);
    source_close(source);
    return frame;
}

/* The environment of a frame; the caller destroys it. */
static inline struct environment *figure_sky(const struct frame *frame, bool lean)
{
    struct environment *sky = environment_create(&(struct environment_desc){ .lean = lean });
    struct reason why = { "" };

    figure_must(sky ? environment_update(sky, frame, &why) : ERR_NOMEM, &why);
    return sky;
}

/* Processor time of all threads. */
static inline double figure_cpu_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static inline int figure_ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The middle of n > 0 values, which are sorted then. */
static inline double figure_median(double *v, uint32_t n)
{
    qsort(v, n, sizeof(*v), figure_ascending);
    return n % 2 ? v[n / 2] : 0.5 * (v[n / 2 - 1] + v[n / 2]);
}
