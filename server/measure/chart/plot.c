#include "measure/chart/plot.h"

#include <errno.h>
#include <math.h>
#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#define WIDTH 820
#define HEIGHT 500
#define SPAN 300.0 /* highest over least error that is drawn: what is wronger is named in the legend */

extern char **environ;

/* On a script's file, or on `option` (NULL: none) and what it takes. */
static enum err run_gnuplot(const char *option, const char *argument, struct reason *why)
{
    char *const with[] = { (char *)"gnuplot", (char *)option, (char *)argument, NULL };
    char *const without[] = { (char *)"gnuplot", (char *)argument, NULL };
    pid_t child;
    int status;

    if (posix_spawnp(&child, "gnuplot", NULL, NULL, option ? with : without, environ) != 0)
        return err_say(why, ERR_UNSUPPORTED, "gnuplot cannot be run: it draws the charts (Debian: gnuplot-nox)");
    while (waitpid(child, &status, 0) < 0)
        if (errno != EINTR)
            return err_say(why, ERR_IO, "gnuplot: %s", strerror(errno));
    if (WIFEXITED(status) && WEXITSTATUS(status) == 127)
        return err_say(why, ERR_UNSUPPORTED, "gnuplot is not installed: it draws the charts (Debian: gnuplot-nox)");
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
        return err_say(why, ERR_IO, "gnuplot failed on %s", argument);
    return ERR_OK;
}

/* By a command, not by an empty script: where /dev/null was replaced by a plain file it holds what others wrote. */
enum err plot_check(struct reason *why)
{
    return run_gnuplot("-e", "exit", why);
}

/* A string of gnuplot's, within single quotes. */
static void add_quoted(struct text *t, const char *plain)
{
    text_add(t, "'");
    for (; *plain; plain++)
        text_add_bytes(t, *plain == '\'' ? "''" : plain, *plain == '\'' ? 2 : 1);
    text_add(t, "'");
}

static void add_value(struct text *t, double v)
{
    if (isfinite(v) && v > 0.0)
        text_add(t, " %.6g", v);
    else
        text_add(t, " NaN"); /* a logarithm has no place for it */
}

struct frame_of { /* ranges of the axes */
    double x[2], y[2];
};

static void widen(double range[2], double v)
{
    if (isfinite(v) && v > 0.0) {
        range[0] = fmin(range[0], v);
        range[1] = fmax(range[1], v);
    }
}

static struct frame_of find_frame(const struct panel *p, enum error_kind kind)
{
    struct frame_of f = { { INFINITY, 0.0 }, { INFINITY, 0.0 } };

    for (size_t c = 0; c < p->curve_count; c++)
        for (uint32_t k = 0; k < p->budget_count && !p->curves[c].left_out.text[0]; k++) {
            const struct panel_point *point = &p->curves[c].points[k];
            widen(f.x, 1e3 * point->seconds.median);
            widen(f.y, point->errors[kind].median);
        }
    if (!(f.x[1] > 0.0) || !(f.y[1] > 0.0))
        return (struct frame_of){ { 1.0, 10.0 }, { 0.1, 1.0 } };
    return (struct frame_of){ { f.x[0] / 1.15, f.x[1] * 1.15 }, { f.y[0] / 1.6, fmin(f.y[1], SPAN * f.y[0]) * 1.6 } };
}

/* Whether all of a curve lies above the chart. */
static bool is_above(const struct panel *p, const struct panel_curve *c, enum error_kind kind, double top)
{
    for (uint32_t k = 0; k < p->budget_count; k++)
        if (c->points[k].errors[kind].median < top)
            return false;
    return true;
}

static void add_data(struct text *t, const struct panel *p, enum error_kind kind)
{
    for (size_t c = 0; c < p->curve_count; c++) {
        if (p->curves[c].left_out.text[0])
            continue;
        text_add(t, "$curve%zu << EOD\n", c);
        for (uint32_t k = 0; k < p->budget_count; k++) {
            const struct panel_point *point = &p->curves[c].points[k];
            text_add(t, "%.6g", 1e3 * point->seconds.median);
            add_value(t, point->errors[kind].low);
            add_value(t, point->errors[kind].median);
            add_value(t, point->errors[kind].high);
            text_add(t, "\n");
        }
        text_add(t, "EOD\n");
    }
}

static void add_style(struct text *t, const struct technique *q)
{
    if (q->colour)
        text_add(t, "lc rgb '#%06x' ", q->colour);
    else
        text_add(t, "lc rgb 'black' ");
    if (q->kind == TECHNIQUE_AUTO)
        text_add(t, "lw 3 pt 7 ps 0.6");
    else if (q->kind == TECHNIQUE_PREPARED)
        text_add(t, "lw 2 dt (2,3) pt 4 ps 0.6");
    else if (q->kind == TECHNIQUE_BASELINE)
        text_add(t, "lw 1.6 dt (6,3) pt 6 ps 0.45");
    else if (q->kind == TECHNIQUE_FILTERED)
        text_add(t, "lw 2.4 dt (8,2,2,2) pt 5 ps 0.5");
    else
        text_add(t, "lw 2 pt 7 ps 0.45");
}

/* Bands first, so that no line lies beneath one. */
static void add_curves(struct text *t, const struct panel *p, enum error_kind kind, double top)
{
    for (size_t c = 0; c < p->curve_count; c++)
        if (!p->curves[c].left_out.text[0] && !is_above(p, &p->curves[c], kind, top))
            text_add(t,
                     ", \\\n  $curve%zu using 1:2:4 with filledcurves fc rgb '#%06x' fs transparent solid 0.13 "
                     "noborder notitle",
                     c, p->curves[c].technique->colour ? p->curves[c].technique->colour : 0x808080);
    for (size_t c = 0; c < p->curve_count; c++) {
        if (p->curves[c].left_out.text[0])
            continue;
        text_add(t, ", \\\n  $curve%zu using 1:3 with linespoints ", c);
        add_style(t, p->curves[c].technique);
        text_add(t, " title '%s%s'", p->curves[c].technique->name,
                 is_above(p, &p->curves[c], kind, top) ? " (above)" : "");
    }
    text_add(t, "\n");
}

static void write_script(struct text *t, const struct panel *p, enum error_kind kind, const char *svg)
{
    const struct frame_of f = find_frame(p, kind);
    const double slope = error_about(kind)->slope;
    const double through = sqrt(f.y[0] * f.y[1]) * pow(f.x[0] * f.x[1], -0.5 * slope); /* the middle of the chart */

    text_add(t,
             "set terminal svg size %d,%d dynamic noenhanced font 'sans-serif,15' background rgb '#ffffff'\n"
             "set output ",
             WIDTH, HEIGHT);
    add_quoted(t, svg);
    text_add(t, "\nset logscale xy\nset xrange [%.6g:%.6g]\nset yrange [%.6g:%.6g]\n", f.x[0], f.x[1], f.y[0], f.y[1]);
    text_add(t, "set xlabel 'milliseconds for a whole frame'\nset ylabel '%s'\n", error_about(kind)->title);
    text_add(t, "set border 3 lc rgb 'black'\nset tics nomirror out\nset format x '%%g'\nset format y '%%g'\n"
                "set xtics add (2, 3, 5, 20, 30, 50, 200, 300, 500, 2000, 3000, 5000)\n"
                "set grid xtics ytics lc rgb '#888888' lw 0.3 dt (1,4)\n"
                "set key outside right top reverse Left samplen 2 spacing 1.0 font ',14'\n");
    if (kind == ERROR_REL_MSE)
        text_add(t, "doubt = %.6g\n", fmax(2.0 * p->judge.doubt, 1e-30));
    add_data(t, p, kind);
    text_add(t, "plot %.6g * x ** %g with lines lc rgb '#888888' lw 1.5 dt (2,4) title 'slope %g'", through, slope,
             slope);
    if (kind == ERROR_REL_MSE && 2.0 * p->judge.doubt > f.y[0])
        text_add(t, ", \\\n  doubt with lines lc rgb '#888888' lw 1 dt (8,6) title 'reference ends'");
    add_curves(t, p, kind, f.y[1]);
}

enum err plot_draw(const struct panel *p, enum error_kind kind, const char *svg, struct reason *why)
{
    struct text script = { .bytes = NULL };
    char name[4200];

    write_script(&script, p, kind, svg);
    snprintf(name, sizeof(name), "%s.gp", svg);
    enum err e = text_store(&script, name, why);
    if (!e)
        e = run_gnuplot(NULL, name, why);
    unlink(name);
    text_finish(&script);
    return e;
}

static const struct change { /* {} stands for the prefix */
    const char *from, *to;
} changes[] = {
    { "id='", "id='{}" },
    { "id=\"", "id=\"{}" },
    { "href='#", "href='#{}" },
    { "url(#", "url(#{}" },
    { "'black'", "'currentColor'" },
    { "\"black\"", "\"currentColor\"" },
    { "'rgb(  0,   0,   0)'", "'currentColor'" },
    { "\"rgb(  0,   0,   0)\"", "\"currentColor\"" },
    { "\"rgb(0,0,0)\"", "\"currentColor\"" },
    { "fill=\"#ffffff\"", "fill=\"none\"" },
};

static void add_changed(struct text *t, const char *to, const char *prefix)
{
    const char *hole = strstr(to, "{}");

    if (!hole) {
        text_add(t, "%s", to);
    } else {
        text_add_bytes(t, to, (size_t)(hole - to));
        text_add(t, "%s%s", prefix, hole + 2);
    }
}

static void add_svg(struct text *t, const char *at, const char *prefix, const char *label)
{
    const size_t count = sizeof(changes) / sizeof(changes[0]);

    text_add(t, "<svg class=\"chart\" role=\"img\" aria-label=\"");
    text_add_escaped(t, label);
    text_add(t, "\" ");
    at += strlen("<svg");
    while (*at) {
        size_t k = 0;
        while (k < count && strncmp(at, changes[k].from, strlen(changes[k].from)) != 0)
            k++;
        if (k < count) {
            add_changed(t, changes[k].to, prefix);
            at += strlen(changes[k].from);
        } else {
            text_add_bytes(t, at++, 1);
        }
    }
}

enum err plot_inline(struct text *t, const char *svg, const char *prefix, const char *label, struct reason *why)
{
    struct text file = { .bytes = NULL };
    char block[4096];
    FILE *f = fopen(svg, "rb");
    size_t n;

    if (!f)
        return err_say(why, ERR_IO, "%s: %s", svg, strerror(errno));
    while ((n = fread(block, 1, sizeof(block), f)) > 0)
        text_add_bytes(&file, block, n);
    fclose(f);
    const char *begin = file.bytes ? strstr(file.bytes, "<svg") : NULL;
    enum err e = ERR_OK;
    if (file.failed)
        e = err_say(why, ERR_NOMEM, "%s: no memory to read it", svg);
    else if (!begin || !strstr(begin, "</svg>"))
        e = err_say(why, ERR_FORMAT, "%s: is not a complete SVG image: gnuplot has not finished it", svg);
    else
        add_svg(t, begin, prefix, label);
    text_finish(&file);
    return e;
}
