/* One panel of the page. */
#include "measure/chart/page.h"

#include "measure/chart/plot.h"
#include "measure/chart/thumb.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>

/* About three figures, without an exponent where that can be. */
static void add_figure(struct text *t, double v)
{
    if (v == 0.0)
        text_add(t, "0");
    else if (fabs(v) >= 100.0)
        text_add(t, "%.0f", v);
    else if (fabs(v) >= 1e-3)
        text_add(t, "%.*f", 2 - (int)floor(log10(fabs(v))), v);
    else
        text_add(t, "%.1e", v);
}

static enum err add_charts(struct text *t, const struct panel *p, size_t number, const char *folder, struct reason *why)
{
    char name[256], path[4352], prefix[32], label[512];
    enum err e = ERR_OK;

    text_add(t, "<div class=\"charts\">");
    for (int k = 0; k < ERROR_KINDS && !e; k++) {
        const struct error_about *about = error_about((enum error_kind)k);
        page_svg_name(p, number, (enum error_kind)k, name, sizeof(name));
        snprintf(path, sizeof(path), "%s/%s", folder, name);
        snprintf(prefix, sizeof(prefix), "p%zu-%d-", number + 1, k);
        snprintf(label, sizeof(label), "%s over milliseconds a frame, a line for each method", about->title);
        text_add(t, "<figure>");
        e = plot_inline(t, path, prefix, label, why);
        text_add(t, "<figcaption>%s</figcaption></figure>", about->title);
    }
    text_add(t, "</div>");
    return e;
}

/* The budget whose time is nearest to the middle mark. */
static uint32_t nearest_budget(const struct panel *p, const struct panel_curve *c, double seconds)
{
    uint32_t best = 0;

    for (uint32_t k = 1; k < p->budget_count; k++)
        if (fabs(log(c->points[k].seconds.median / seconds)) < fabs(log(c->points[best].seconds.median / seconds)))
            best = k;
    return best;
}

static enum err add_thumb(struct text *t, const struct panel *p, const struct winners *w, size_t curve,
                          struct jpeg_encoder *jpeg)
{
    const struct panel_curve *c = &p->curves[curve];
    const uint32_t k = nearest_budget(p, c, w->seconds[MARK_MIDDLE]);
    const float *image = c->images + (size_t)k * 3 * p->width * p->height;

    text_add(t, "<figure%s><img alt=\"image by %s\" src=\"",
             w->by_error[MARK_MIDDLE] == (int)curve ? " class=\"first\"" : "", c->technique->name);
    enum err e = thumb_image(t, jpeg, p, image);
    text_add(t, "\"><img alt=\"its errors\" src=\"");
    if (!e)
        e = thumb_errors(t, jpeg, p, image);
    text_add(t, "\"><figcaption>");
    page_add_swatch(t, c->technique);
    text_add(t, "<br>");
    add_figure(t, 1e3 * c->points[k].seconds.median);
    text_add(t, " ms, error ");
    add_figure(t, c->points[k].errors[ERROR_REL_MSE].median);
    text_add(t, "</figcaption></figure>");
    return e;
}

static enum err add_strip(struct text *t, const struct panel *p, const struct winners *w, struct jpeg_encoder *jpeg)
{
    text_add(t, "<h3>Images and errors at about ");
    add_figure(t, 1e3 * w->seconds[MARK_MIDDLE]);
    text_add(t, " ms</h3><div class=\"strip\"><figure><img alt=\"the truth\" src=\"");
    enum err e = thumb_image(t, jpeg, p, p->judge.mean);
    text_add(t, "\"><figcaption><span class=\"name\">the truth</span><br>%u samples a pixel</figcaption></figure>",
             p->truth.samples[0] + p->truth.samples[1]);
    for (size_t c = 0; c < p->curve_count && !e; c++)
        if (!p->curves[c].left_out.text[0])
            e = add_thumb(t, p, w, c, jpeg);
    text_add(t, "</div>");
    return e;
}

static void add_head(struct text *t, const struct winners *w)
{
    text_add(t,
             "<tr><th rowspan=\"2\">method</th><th colspan=\"%d\">error at equal time</th><th colspan=\"%d\">"
             "milliseconds to equal error</th><th rowspan=\"2\">bias floor<br><small>at its most samples</small></th>"
             "<th rowspan=\"2\">brightness<br><small>over the truth's</small></th></tr><tr>",
             MARKS, MARKS);
    for (int m = 0; m < MARKS; m++) {
        text_add(t, "<th>");
        add_figure(t, 1e3 * w->seconds[m]);
        text_add(t, " ms</th>");
    }
    for (int m = 0; m < MARKS; m++) {
        text_add(t, "<th>");
        add_figure(t, w->error[m]);
        text_add(t, "</th>");
    }
    text_add(t, "</tr>");
}

/* A number, and how many times the best one it is; the best is marked. */
static void add_cell(struct text *t, bool known, bool at_most, double v, double best, bool is_best)
{
    if (!known) {
        text_add(t, "<td class=\"soft\">&ndash;</td>");
        return;
    }
    text_add(t, is_best ? "<td class=\"best\">%s" : "<td>%s", at_most ? "&le; " : "");
    add_figure(t, v);
    if (!is_best && best > 0.0)
        text_add(t,
                 v / best < 10.0 ? " <span class=\"times\">%.1f&times;</span>"
                                 : " <span class=\"times\">%.0f&times;</span>",
                 v / best);
    text_add(t, "</td>");
}

static void add_curve(struct text *t, const struct panel *p, const struct winners *w, size_t curve)
{
    const struct panel_curve *c = &p->curves[curve];
    const struct standing *s = &w->of[curve];
    const struct judge_floor *f = &c->points[p->budget_count - 1].floor;

    text_add(t, "<tr><td>");
    page_add_swatch(t, c->technique);
    text_add(t, "</td>");
    for (int m = 0; m < MARKS; m++)
        add_cell(t, s->has_error[m], s->error_at_most[m], s->error[m], w->error[m], w->by_error[m] == (int)curve);
    for (int m = 0; m < MARKS; m++)
        add_cell(t, s->reached[m], s->at_most[m], 1e3 * s->seconds[m],
                 w->by_seconds[m] >= 0 ? 1e3 * w->of[w->by_seconds[m]].seconds[m] : 0.0,
                 w->by_seconds[m] == (int)curve);
    text_add(t, "<td>");
    if (f->z >= 3.0)
        add_figure(t, f->bias);
    else
        text_add(t, "<span class=\"soft\">none seen</span>");
    text_add(t, " <span class=\"times\">z %.1f</span></td><td>%.4f <span class=\"times\">&plusmn; %.4f</span></td>",
             f->z, f->energy, f->energy_doubt);
    text_add(t, "</tr>");
}

static void add_automatic(struct text *t, const struct winners *w)
{
    const struct envelope_verdict *v = &w->automatic;

    text_add(
        t,
        "<p><b>auto</b> %s within %.1f times the best of the fixed methods: at worst it had %.2f times their error, "
        "at ",
        v->within                    ? "stays"
        : v->worst <= ENVELOPE_LIMIT ? "may or may not stay"
                                     : "<span class=\"bad\">does not stay</span>",
        ENVELOPE_LIMIT, v->worst);
    add_figure(t, 1e3 * v->worst_seconds);
    text_add(t, " ms. Nine of ten bootstrap rounds stay below %.2f; %.0f %% of them hold the limit.</p>", v->upper,
             100.0 * v->confidence);
}

static void add_filtered(struct text *t, const struct winners *w)
{
    const struct envelope_verdict *flip = &w->filtered[ERROR_FLIP], *square = &w->filtered[ERROR_REL_MSE];

    text_add(t,
             "<p><b>denoised</b> has at most %.2f times the FLIP and %.2f times the relMSE of the same samples "
             "unfiltered, at equal time; nine of ten bootstrap rounds stay below %.2f and %.2f. It is biased, and "
             "therefore not ranked.</p>",
             flip->worst, square->worst, flip->upper, square->upper);
}

/* The share of the best error at the middle time that is bias. */
static void add_floor(struct text *t, const struct panel *p, const struct winners *w)
{
    const int best = w->by_error[MARK_MIDDLE];

    if (best < 0)
        return;
    const struct panel_curve *c = &p->curves[best];
    const struct judge_floor *f = &c->points[nearest_budget(p, c, w->seconds[MARK_MIDDLE])].floor;
    const double share = f->bias / f->error;
    if (share > 0.2 && !method_is_reference(c->technique->light.direct.method))
        text_add(
            t,
            "<p>Of the best error at the middle time, %.0f %% is not noise but the bias of one shading point per "
            "pixel, "
            "the same for all methods that shade points. More camera rays reduce it (<code>--every-pixel</code>), more "
            "samples do not.</p>",
            100.0 * fmin(share, 1.0));
}

static void add_times(struct text *t, const struct panel *p)
{
    double common = 0.0;

    text_add(t, "<p class=\"soft\">Of every frame's time");
    for (int k = 0; k < COMMON_PARTS; k++) {
        text_add(t, "%s %s ", k ? "," : "", common_name((enum common_part)k));
        add_figure(t, p->common_ms[k]);
        common += p->common_ms[k];
    }
    text_add(t, " = ");
    add_figure(t, common);
    text_add(t, " ms are common to all methods. Once per scene: loading ");
    add_figure(t, p->load_ms);
    text_add(t, ", ray structure ");
    add_figure(t, p->bvh_ms);
    text_add(t, ", G-buffer ");
    add_figure(t, p->gbuffer_ms);
    text_add(t, ", resampling table ");
    add_figure(t, p->table_ms);
    text_add(t,
             " ms; the G-buffer's %" PRIu64 " shade points take %.1f MB. Relative squared errors below %.1e cannot be "
             "told from 0 by these references.</p>",
             p->points, 1e-6 * (double)p->gbuffer_bytes, 2.0 * p->judge.doubt);
}

/* How well auto estimates its error. */
static void add_estimate(struct text *t, const struct panel *p, const struct panel_curve *c)
{
    if (c->left_out.text[0] || c->technique->kind != TECHNIQUE_AUTO)
        return;
    text_add(t, "<p class=\"soft\"><b>%s</b> got the time of <b>%s</b>, for its measurements too. It expected noise of",
             c->technique->name, technique_pace(p->light_class)->name);
    for (uint32_t k = 0; k < p->budget_count; k++) {
        text_add(t, k ? ", " : " ");
        add_figure(t, c->points[k].expected);
    }
    text_add(t, "; measured:");
    for (uint32_t k = 0; k < p->budget_count; k++) {
        text_add(t, k ? ", " : " ");
        add_figure(t, c->points[k].floor.variance);
    }
    text_add(t, ".</p>");
}

/* A method's precomputation, and when it pays off. */
static void add_prepared(struct text *t, const struct panel *p, const struct winners *w, size_t curve)
{
    const struct panel_curve *c = &p->curves[curve];
    const struct standing *s = &w->of[curve];

    if (c->left_out.text[0] || c->technique->kind != TECHNIQUE_PREPARED)
        return;
    text_add(t, "<p><b>%s</b> first computes for ", c->technique->name);
    add_figure(t, 1e-3 * c->prepared_ms);
    text_add(
        t, " s and keeps %.0f MB, for this scene, camera and size. No time above includes that, and it is not ranked. ",
        1e-6 * (double)c->prepared_bytes);
    if (s->break_even > 0.0)
        text_add(t, "At the best error at the middle time it pays off after %.0f frames, compared with <b>%s</b>.</p>",
                 s->break_even, p->curves[w->by_seconds[MARK_MIDDLE]].technique->name);
    else
        text_add(t, "At the best error at the middle time it does not pay off.</p>");
}

/* Notes on single methods. */
static void add_notes(struct text *t, const struct panel *p, const struct winners *w)
{
    for (size_t k = 0; k < p->curve_count; k++) {
        const struct panel_curve *c = &p->curves[k];
        add_estimate(t, p, c);
        add_prepared(t, p, w, k);
        const struct judge_floor *f = &c->points[p->budget_count - 1].floor;
        if (c->left_out.text[0] || c->bias) {
            text_add(t, "<p class=\"soft\"><b>%s</b>%s ", c->technique->name,
                     c->left_out.text[0] ? " is left out:" : " is biased:");
            text_add_escaped(t, c->left_out.text[0] ? c->left_out.text : c->bias);
            text_add(t, ".</p>");
        } else if (f->energy < 0.9) {
            text_add(t,
                     "<p class=\"soft\"><b>%s</b> shows %.0f %% of the light: the rest comes in pixels that are rare "
                     "and very bright, and %u seeds have met too few of them. It is not wrong in the mean.</p>",
                     c->technique->name, 100.0 * f->energy, p->seeds);
        }
    }
}

enum err page_add_panel(struct text *t, const struct panel *p, const struct winners *w, size_t number,
                        const char *folder, struct reason *why)
{
    struct jpeg_encoder *jpeg = jpeg_encoder_create();

    text_add(t, "<section id=\"p%zu\"><h2>", number + 1);
    text_add_escaped(t, p->scene);
    text_add(t, ", ");
    text_add_escaped(t, p->source);
    text_add(t, ": %s</h2>", light_class_title(p->light_class));
    enum err e = jpeg ? add_charts(t, p, number, folder, why) : err_say(why, ERR_NOMEM, "no memory for JPEG");
    if (!e) {
        text_add(t, "<h3>Winners</h3><div class=\"wide\"><table>");
        add_head(t, w);
        for (size_t c = 0; c < p->curve_count; c++)
            if (!p->curves[c].left_out.text[0])
                add_curve(t, p, w, c);
        text_add(t, "</table></div>");
        if (w->auto_known)
            add_automatic(t, w);
        if (w->filtered[ERROR_FLIP].known)
            add_filtered(t, w);
        add_floor(t, p, w);
        add_times(t, p);
        add_notes(t, p, w);
        e = add_strip(t, p, w, jpeg);
        if (e)
            e = err_say(why, e, "no memory for the page's images");
    }
    text_add(t, "</section>");
    jpeg_encoder_destroy(jpeg);
    return e;
}
