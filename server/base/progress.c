#include "base/progress.h"

#include "base/clock.h"
#include "base/log.h"

#include <inttypes.h>
#include <math.h>
#include <stdatomic.h>
#include <unistd.h>

#define REDRAW_MS 100   /* of a line on a terminal */
#define LOG_MS 10000    /* without a terminal */
#define KNOWN_FROM 0.02 /* share of the work; before, the time left would be a guess of hours */
#define PACED 0.05      /* likewise, since pace_take was first called */

/* A terminal has one last line, so one flag suffices. */
static _Atomic bool line_shown;

static void draw(const struct progress *p, uint64_t done, int64_t now_ms)
{
    char left[32] = "";
    const double elapsed_s = (double)(now_ms - p->begun_ms) / 1000.0;
    /* A part of the step that is being made counts, too. */
    const double made =
        (double)done + (p->part ? fmin(1.0, (double)atomic_load(&p->part->done) / (double)p->part->total) : 0.0);

    if (!p->terminal && p->total == 0) {
        log_info("%s: %" PRIu64, p->what, done);
        return;
    }
    if (p->total == 0) {
        fprintf(p->stream, "\r\033[K%s  %" PRIu64, p->what, done);
    } else {
        if (made >= KNOWN_FROM * (double)p->total && elapsed_s > 1.0) {
            const unsigned s = (unsigned)(elapsed_s * fmax(0.0, (double)p->total - made) / made + 0.5);
            snprintf(left, sizeof(left), "  %u:%02u left", s / 60, s % 60);
        }
        const unsigned percent = (unsigned)(100.0 * fmin(1.0, made / (double)p->total));
        if (!p->terminal) {
            log_info("%s: %u %%%s%s", p->what, percent, left[0] ? ", about" : "", left + (left[0] ? 1 : 0));
            return;
        }
        fprintf(p->stream, "\r\033[K%s  %" PRIu64 "/%" PRIu64 "  %u %%%s", p->what, done, p->total, percent, left);
    }
    fflush(p->stream);
    atomic_store(&line_shown, true);
}

void progress_begin(struct progress *p, const char *what, uint64_t total, FILE *stream)
{
    *p = (struct progress){
        .what = what,
        .stream = stream,
        .terminal = stream && isatty(fileno(stream)),
        .total = total,
        .begun_ms = clock_ms(),
    };
    p->drawn_ms = p->begun_ms;
    if (p->terminal)
        draw(p, 0, p->begun_ms);
}

static void draw_if_due(struct progress *p, uint64_t done)
{
    if (!p->stream)
        return;
    if (p->total > 0 && done > p->total)
        done = p->total;
    const int64_t now = clock_ms();
    int64_t drawn = atomic_load(&p->drawn_ms);
    /* The thread that advances drawn_ms draws; the others go on. */
    if (now - drawn >= (p->terminal ? REDRAW_MS : LOG_MS) && atomic_compare_exchange_strong(&p->drawn_ms, &drawn, now))
        draw(p, done, now);
}

void progress_step(struct progress *p, uint64_t steps)
{
    if (p)
        draw_if_due(p, atomic_fetch_add(&p->done, steps) + steps);
}

void progress_part_begin(struct progress_part *part, struct progress *line, uint64_t total)
{
    *part = (struct progress_part){ .line = line, .total = total > 0 ? total : 1 };
    if (line)
        line->part = part;
}

void progress_part_step(struct progress_part *part, uint64_t steps)
{
    if (!part || !part->line)
        return;
    atomic_fetch_add(&part->done, steps);
    draw_if_due(part->line, atomic_load(&part->line->done));
}

void progress_part_end(struct progress_part *part)
{
    if (part && part->line)
        part->line->part = NULL;
}

double pace_take(struct pace *p, double share, double now_s)
{
    if (p->share == 0.0 || share < p->last)
        *p = (struct pace){ .share = share, .begun_s = now_s };
    p->last = share;
    if (share >= p->share + PACED) {
        const double left_s = (now_s - p->begun_s) * (1.0 - share) / (share - p->share);
        p->left_s = p->left_s > 0.0 ? fmin(p->left_s, left_s) : left_s;
    }
    return p->left_s;
}

void progress_end(struct progress *p)
{
    if (!p)
        return;
    if (p->terminal) {
        fputs(progress_wipe(p->stream), p->stream);
        fflush(p->stream);
    }
    p->stream = NULL;
    p->terminal = false;
}

void progress_show(FILE *stream, const char *text)
{
    if (!isatty(fileno(stream)))
        return;
    fprintf(stream, "\r\033[K%s", text);
    fflush(stream);
    atomic_store(&line_shown, text[0] != '\0');
}

const char *progress_wipe(FILE *stream)
{
    if (atomic_load(&line_shown) && isatty(fileno(stream))) {
        atomic_store(&line_shown, false);
        return "\r\033[K";
    }
    return "";
}
