/* server/chart/video_plot.c: the charts of moving pictures (video.h). */
#include "video.h"

#include "plot.h"

#include <math.h>
#include <stdio.h>

#define WIDTH 820
#define HEIGHT 500

static void add_head(struct text *t, const char *svg, const char *x, const char *y)
{
    text_add(t,
             "set terminal svg size %d,%d dynamic noenhanced font 'sans-serif,15' background rgb '#ffffff'\n"
             "set output ",
             WIDTH, HEIGHT);
    plot_add_quoted(t, svg);
    text_add(t,
             "\nset xlabel '%s'\nset ylabel '%s'\nset border 3 lc rgb 'black'\nset tics nomirror out\n"
             "set format x '%%g'\nset format y '%%g'\nset grid xtics ytics lc rgb '#888888' lw 0.3 dt (1,4)\n"
             "set key outside right top reverse Left samplen 2.2 spacing 1.15\n",
             x, y);
}

static void add_colour(struct text *t, const struct video_way *w)
{
    if (w->colour)
        text_add(t, "lc rgb '#%06x' ", w->colour);
    else
        text_add(t, "lc rgb 'black' ");
    text_add(t, w->reseed ? "lw 2 dt (7,4) pt 6 ps 0.5" : w->colour ? "lw 2 pt 7 ps 0.5" : "lw 3 pt 7 ps 0.6");
}

static const struct band *band_of(const struct video_sequence *s, int way, uint32_t budget, bool change)
{
    const struct video_point *p = &s->points[way][budget];
    return change ? &p->change : &p->flicker;
}

/* Least and highest median, with room for the points. */
static void find_range(const struct video *v, const struct video_sequence *s, bool change, double range[2])
{
    range[0] = INFINITY;
    range[1] = 0.0;
    for (int w = 0; w < VIDEO_WAYS; w++)
        for (uint32_t k = 0; k < v->budget_count && v->takes[w]; k++) {
            const double y = band_of(s, w, k, change)->median;
            if (isfinite(y) && y > 0.0) {
                range[0] = fmin(range[0], y / 1.6);
                range[1] = fmax(range[1], y * 1.6);
            }
        }
    if (!(range[1] > 0.0))
        range[0] = 0.1, range[1] = 1.0;
}

/* Flicker in percent, or the error of frame differences, over samples. */
static void sequence_script(struct text *t, const struct video *v, const struct video_sequence *s, bool change,
                            const char *svg)
{
    const double scale = change ? 1.0 : 100.0;
    const char *separator = "plot";
    double range[2];

    find_range(v, s, change, range);
    add_head(t, svg, "samples per shade point",
             change ? "error of frame differences" : "flicker where nothing moves, %");
    text_add(t, "set logscale xy\nset xtics (");
    for (uint32_t k = 0; k < v->budget_count; k++)
        text_add(t, "%s%u", k ? ", " : "", v->budgets[k]);
    text_add(t, ")\nset xrange [%.6g:%.6g]\nset yrange [%.6g:%.6g]\n", v->budgets[0] / 1.15,
             v->budgets[v->budget_count - 1] * 1.15, scale * range[0], scale * range[1]);
    for (int w = 0; w < VIDEO_WAYS; w++) {
        if (!v->takes[w])
            continue;
        text_add(t, "$way%d << EOD\n", w);
        for (uint32_t k = 0; k < v->budget_count; k++) {
            const struct band *b = band_of(s, w, k, change);
            text_add(t, "%u", v->budgets[k]);
            plot_add_value(t, scale * b->low);
            plot_add_value(t, scale * b->median);
            plot_add_value(t, scale * b->high);
            text_add(t, "\n");
        }
        text_add(t, "EOD\n");
    }
    for (int band = 1; band >= 0; band--) /* bands first, so that no line lies beneath one */
        for (int w = 0; w < VIDEO_WAYS; w++) {
            if (!v->takes[w])
                continue;
            text_add(t, "%s ", separator);
            separator = ",";
            if (band) {
                text_add(
                    t, "$way%d using 1:2:4 with filledcurves fc rgb '#%06x' fs transparent solid 0.13 noborder notitle",
                    w, video_ways[w].colour ? video_ways[w].colour : 0x808080);
                continue;
            }
            text_add(t, "$way%d using 1:3 with linespoints ", w);
            add_colour(t, &video_ways[w]);
            text_add(t, " title '%s'", video_ways[w].name);
        }
    text_add(t, "\n");
}

static void add_step_data(struct text *t, const char *name, int number, const double *values, bool logarithmic)
{
    text_add(t, "$%s%d << EOD\n", name, number);
    for (int k = 0; k < VIDEO_BEFORE + VIDEO_AFTER; k++) {
        text_add(t, "%d", k - VIDEO_BEFORE);
        if (logarithmic)
            plot_add_value(t, values[k]);
        else
            text_add(t, " %.6g", values[k]);
        text_add(t, "\n");
    }
    text_add(t, "EOD\n");
}

/* Frame 0 is the first with the sun. */
static void step_script(struct text *t, const struct video *v, bool display, const char *svg)
{
    const char *separator = "plot";

    add_head(t, svg, "frames since the sun came out",
             display ? "visible difference (delta E*ab)" : "relative squared error (relMSE)");
    text_add(t, "set xrange [%d:%d]\nset arrow from 0, graph 0 to 0, graph 1 nohead lc rgb '#888888' dt (2,4)\n",
             -VIDEO_BEFORE, VIDEO_AFTER - 1);
    text_add(t, display ? "set yrange [0:*]\n" : "set logscale y\nset yrange [*<0.01:0.1<*]\n");
    for (int w = 0; w < VIDEO_WAYS; w++)
        if (v->takes[w])
            add_step_data(t, "way", w, display ? v->step.display[w] : v->step.error[w], !display);
    if (display) {
        add_step_data(t, "truth", 0, v->step.exposure, false);
        text_add(t, "plot $truth0 using 1:2 with lines lc rgb '#888888' lw 2 dt (2,4) title 'exposure alone'");
        separator = ",";
    }
    for (int w = 0; w < VIDEO_WAYS; w++) {
        if (!v->takes[w])
            continue;
        text_add(t, "%s $way%d using 1:2 with linespoints ", separator, w);
        add_colour(t, &video_ways[w]);
        text_add(t, " title '%s'", video_ways[w].name);
        separator = ",";
    }
    text_add(t, "\n");
}

enum err video_draw(const struct video *v, const char *folder, struct reason *why)
{
    char svg[4352];
    enum err e = ERR_OK;

    for (uint32_t k = 0; k < 2 * v->sequence_count + 2 && !e; k++) {
        struct text script = { .bytes = NULL };
        const bool second = k % 2;
        if (k < 2 * v->sequence_count) {
            snprintf(svg, sizeof(svg), "%s/video-%u-%s.svg", folder, k / 2 + 1, second ? "change" : "flicker");
            sequence_script(&script, v, &v->sequences[k / 2], second, svg);
        } else {
            snprintf(svg, sizeof(svg), "%s/video-step-%s.svg", folder, second ? "display" : "error");
            step_script(&script, v, second, svg);
        }
        e = plot_run(&script, svg, why);
        text_finish(&script);
    }
    return e;
}
