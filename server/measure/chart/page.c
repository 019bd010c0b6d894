#include "measure/chart/page.h"

#include "measure/compare/ramp.h"

#include <math.h>
#include <stdio.h>

void page_svg_name(const struct panel *p, size_t number, enum error_kind kind, char *name, size_t size)
{
    char words[256], *to = words;

    panel_title(p, words, sizeof(words));
    for (const char *from = words; *from; from++) { /* letters and digits, one dash for all between them */
        const char c = *from;
        if ((c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'))
            *to++ = c;
        else if (to > words && to[-1] != '-')
            *to++ = '-';
    }
    *to = '\0';
    snprintf(name, size, "%02zu-%.80s.%s.svg", number + 1, words, error_about(kind)->name);
}

void page_add_swatch(struct text *t, const struct technique *q)
{
    text_add(t, "<span class=\"name\"><b");
    if (q->colour)
        text_add(t, " style=\"background:#%06x\"", q->colour);
    text_add(t, "></b>%s</span>", q->name);
}

/* "1.30 times". */
static void add_times(struct text *t, double ratio)
{
    text_add(t, ratio < 2.0 ? "%.2f times" : ratio < 10.0 ? "%.1f times" : "%.0f times", ratio);
}

static void add_title(struct text *t, const struct panel *p)
{
    text_add_escaped(t, p->scene);
    text_add(t, ", ");
    text_add_escaped(t, p->source);
}

/* The short answer. */
static void add_answer(struct text *t, const struct page *p, const struct ranking *r, size_t count, size_t everywhere)
{
    const struct ranking *best = &r[0], *worst = &r[0], *automatic = NULL;

    for (size_t k = 0; k < count; k++) {
        if (r[k].worst_ratio > worst->worst_ratio)
            worst = &r[k];
        if (r[k].technique->kind == TECHNIQUE_AUTO)
            automatic = &r[k];
    }
    text_add(t, "<p class=\"answer\">Choose ");
    page_add_swatch(t, best->technique);
    text_add(t, ": it takes %s. ", best->technique->about);
    text_add(t, "In %u of %zu comparisons it is the best or within %.0f %% of it", best->wins, everywhere,
             100.0 * (WIN_MARGIN - 1.0));
    if (best->wins < everywhere) {
        text_add(t, "; at worst it has ");
        add_times(t, best->worst_ratio);
        text_add(t, " the best one's error");
    }
    text_add(t, ".</p>");
    if (automatic && automatic != best) {
        text_add(t, "<p>");
        page_add_swatch(t, automatic->technique);
        text_add(t, " is the server's default: typically ");
        add_times(t, automatic->mean_ratio);
        text_add(t, " the best error, at worst ");
        add_times(t, automatic->worst_ratio);
        text_add(t, ".</p>");
    }
    text_add(t, "<p><span class=\"bad\">Worst case:</span> ");
    page_add_swatch(t, worst->technique);
    text_add(t, " on ");
    add_title(t, p->panels[worst->worst_panel]);
    text_add(t, ", with ");
    add_times(t, worst->worst_ratio);
    text_add(t, " the error of the best in the same time.</p>");
}

static void add_ranking(struct text *t, const struct page *p, const struct ranking *r, double longest)
{
    const double share = longest > 1.0 ? log(fmax(r->worst_ratio, 1.0)) / log(longest) : 0.0;

    text_add(t, "<tr><td>");
    page_add_swatch(t, r->technique);
    text_add(t, "</td><td class=\"words\">%s</td><td>%u of %u</td><td>%.3g</td>", r->technique->about, r->wins,
             r->panels, r->mean_ratio);
    text_add(t, "<td class=\"bar\"><i style=\"width:calc((100%% - .6rem) * %.3f)\"></i>%.3g</td><td class=\"words\">",
             share, r->worst_ratio);
    if (r->worst_ratio >= 1.005)
        add_title(t, p->panels[r->worst_panel]);
    text_add(t, "</td></tr>");
}

static void add_choice(struct text *t, const struct page *p, enum light_class light_class)
{
    struct ranking r[TECHNIQUES_MAX];
    const size_t count = winners_rank(p->panels, p->winners, p->count, light_class, r);
    size_t everywhere = 0;
    double longest = 1.0;

    for (size_t k = 0; k < p->count; k++)
        everywhere += p->panels[k]->light_class == light_class;
    for (size_t k = 0; k < count; k++)
        longest = fmax(longest, r[k].worst_ratio);
    if (count == 0)
        return;
    text_add(t, "<section class=\"card\"><h3>%s</h3>",
             light_class == LIGHT_DIRECT ? "Direct light: the sky and the surfaces that it lights"
                                         : "All light: with indirect light, mirrors and glass");
    add_answer(t, p, r, count, everywhere);
    text_add(t, "<details><summary>All of them, by their worst case</summary><div class=\"wide\"><table><tr>"
                "<th>method</th><th class=\"left\">takes</th><th>best, or<br>nearly</th><th>error over the "
                "best's,<br>typical</th>"
                "<th>at<br>worst</th><th class=\"left\">where</th></tr>");
    for (size_t k = 0; k < count; k++)
        add_ranking(t, p, &r[k], longest);
    text_add(t, "</table></div><p class=\"soft\">Compared at equal time, the median of each panel's times; typical is "
                "the geometric mean over panels.</p></details></section>");
}

static void add_how_to_read(struct text *t)
{
    uint8_t c[3];

    text_add(t,
             "<details class=\"card\"><summary>How to read this</summary>"
             "<p>Every line is one way of lighting the image. Time increases to the right, the error decreases "
             "downwards: <b>choose the lowest line at the time you have.</b> The shaded band about a line contains "
             "eight of ten runs with other random numbers. A line parallel to the dotted guide turns more time into "
             "proportionally more samples; one that becomes level has an error that no time removes.</p>"
             "<p>Time is that of a whole frame of a stream: reading the sky, making its tables, lighting, tone curve "
             "and JPEG. Precomputation for a scene is stated separately.</p>");
    for (int k = 0; k < ERROR_KINDS; k++)
        text_add(t, "<p><b>%s</b>: %s</p>", error_about((enum error_kind)k)->title,
                 error_about((enum error_kind)k)->plain);
    text_add(t, "<p>In error maps black is 0.1 %% off or less<span class=\"ramp\" "
                "style=\"background:linear-gradient(90deg");
    for (int k = 0; k <= 8; k++) {
        ramp_colour(k / 8.0, c);
        text_add(t, ",#%02x%02x%02x", c[0], c[1], c[2]);
    }
    text_add(t, ")\"></span>100 %% or more.</p></details>");
}

static void add_row(struct text *t, const char *what, const char *value)
{
    text_add(t, "<dt>%s</dt><dd>", what);
    text_add_escaped(t, value);
    text_add(t, "</dd>");
}

static void add_machine(struct text *t, const struct page *p)
{
    const struct machine *m = &p->machine;
    const struct panel *q = p->panels[0];
    char value[256];

    text_add(t, "<h2 id=\"made\">How it was measured</h2><dl>");
    add_row(t, "machine", m->cpu);
    snprintf(value, sizeof(value), "%d of %d processors, kernels of level %s", m->threads, m->processors, m->level);
    add_row(t, "threads", value);
    snprintf(value, sizeof(value), "%ux%u", q->width, q->height);
    add_row(t, "images", value);
    snprintf(value, sizeof(value),
             "%u seeds per point; the runs of all methods alternate, after one run of each that is not counted",
             q->seeds);
    add_row(t, "repeated", value);
    add_row(t, "date", m->date);
    snprintf(value, sizeof(value), "%s, commit %s", m->version, m->commit);
    add_row(t, "program", value);
    add_row(t, "command", p->command);
    snprintf(value, sizeof(value), "%.0f s", p->seconds);
    add_row(t, "took", value);
    text_add(t,
             "</dl><p>The truth is two references made from different random numbers. An error is the mean of (x - "
             "a)(x - b) relative to brightness, so that the noise of the references cancels; no pixel that sees a "
             "surface is left out. It holds the whole pixel, while all methods but <code>path</code> and its like "
             "light one point of a plain pixel: the bias that is left to them at many samples is that. A method that "
             "finds the sun once in many images looks dark and biased in most of "
             "them, and far too bright in the others.</p>"
             "<p>All numbers are in <a href=\"chart.csv\">chart.csv</a>, single runs in <a "
             "href=\"runs.csv\">runs.csv</a>.</p>");
}

enum err page_write(const struct page *p, struct text *t, struct reason *why)
{
    text_add(t,
             "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
             "content=\"width=device-width, initial-scale=1\"><title>relight-chart: error against time</title>"
             "<style>%s</style></head><body><header><h1>Error against time</h1><p class=\"soft\">%zu panel%s, %ux%u "
             "pixels, %u seeds, %s, %s</p></header>",
             page_style, p->count, p->count == 1 ? "" : "s", p->panels[0]->width, p->panels[0]->height,
             p->panels[0]->seeds, p->machine.cpu, p->machine.date);
    text_add(t, "<main><h2 style=\"margin-top:1.2rem\">Which to choose</h2><div class=\"choice\">");
    for (int c = 0; c < LIGHT_CLASSES; c++)
        add_choice(t, p, (enum light_class)c);
    text_add(t, "</div>");
    add_how_to_read(t);
    text_add(t, "<nav aria-label=\"panels\">");
    for (size_t k = 0; k < p->count; k++) {
        text_add(t, "<a href=\"#p%zu\">", k + 1);
        add_title(t, p->panels[k]);
        text_add(t, ": %s</a>", light_class_title(p->panels[k]->light_class));
    }
    text_add(t, "<a href=\"#made\">how it was measured</a></nav>");
    for (size_t k = 0; k < p->count; k++) {
        text_add_bytes(t, p->sections[k].bytes, p->sections[k].size);
        t->failed |= p->sections[k].failed;
    }
    add_machine(t, p);
    text_add(t, "</main></body></html>\n");
    return t->failed ? err_say(why, ERR_NOMEM, "no memory for the page") : ERR_OK;
}
