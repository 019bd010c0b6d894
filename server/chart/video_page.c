/* server/chart/video_page.c: moving pictures for people and for tables (video.h). */
#include "video.h"

#include "jpeg.h"
#include "film.h"
#include "mem.h"
#include "motion.h"
#include "page.h"
#include "plot.h"
#include "ramp.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define QUALITY 85
#define GREY 96
#define SETTLED_TIMES 1.5 /* of the error at the end */
#define NOTICED 1.0       /* delta E */

static void add_row(struct text *t, const char *sequence, const char *way, const char *budget, const char *frame,
                    const char *quantity, const struct band *b)
{
    text_add_field(t, sequence);
    text_add(t, ",");
    text_add_field(t, way);
    text_add(t, ",%s,%s,%s", budget, frame, quantity);
    for (int k = 0; k < 3; k++) {
        const double value = k == 0 ? b->low : k == 1 ? b->median : b->high;
        if (isfinite(value))
            text_add(t, ",%.6g", value);
        else
            text_add(t, ",");
    }
    text_add(t, "\n");
}

static void add_step_rows(struct text *t, const char *way, const char *quantity, const double *values)
{
    char frame[16];

    for (int k = 0; k < VIDEO_BEFORE + VIDEO_AFTER; k++) {
        const struct band b = { NAN, values[k], NAN };
        snprintf(frame, sizeof(frame), "%d", k - VIDEO_BEFORE);
        add_row(t, "step", way, "", frame, quantity, &b);
    }
}

void video_csv(struct text *t, const struct video *v)
{
    char budget[16];

    text_add(t, "sequence,way,budget,frame,quantity,p10,median,p90\n");
    for (uint32_t s = 0; s < v->sequence_count; s++)
        for (int w = 0; w < VIDEO_WAYS; w++)
            for (uint32_t k = 0; k < v->budget_count && v->takes[w]; k++) {
                const struct video_point *p = &v->sequences[s].points[w][k];
                const char *source = v->sequences[s].source, *way = video_ways[w].name;
                snprintf(budget, sizeof(budget), "%u", v->budgets[k]);
                add_row(t, source, way, budget, "", "flicker", &p->flicker);
                add_row(t, source, way, budget, "", "change", &p->change);
                add_row(t, source, way, budget, "", "rel_mse", &p->error);
                add_row(t, source, way, budget, "", "light_ms", &p->milliseconds);
            }
    for (int w = 0; w < VIDEO_WAYS; w++) {
        if (!v->takes[w])
            continue;
        add_step_rows(t, video_ways[w].name, "rel_mse", v->step.error[w]);
        add_step_rows(t, video_ways[w].name, "delta_e_shown", v->step.display[w]);
    }
    add_step_rows(t, "exposure alone", "delta_e_shown", v->step.exposure);
}

static enum err add_chart(struct text *t, const char *folder, const char *name, const char *title, struct reason *why)
{
    char path[4352], prefix[64];

    snprintf(path, sizeof(path), "%s/video-%s.svg", folder, name);
    snprintf(prefix, sizeof(prefix), "v-%s-", name);
    text_add(t, "<figure>");
    const enum err e = plot_inline(t, path, prefix, title, why);
    text_add(t, "<figcaption>%s</figcaption></figure>", title);
    return e;
}

static void add_percent(struct text *t, double share)
{
    const double percent = 100.0 * share;
    text_add(t, percent < 1.0 ? "%.2f %%" : percent < 10.0 ? "%.1f %%" : "%.0f %%", percent);
}

static void add_name(struct text *t, const struct video_way *w)
{
    text_add(t, "<span class=\"name\"><b");
    if (w->colour)
        text_add(t, " style=\"background:#%06x\"", w->colour);
    text_add(t, "></b>%s</span>", w->name);
}

/* The two ways that differ in nothing but whether noise stands still. */
static void add_answer(struct text *t, const struct video *v, const struct video_sequence *s)
{
    const uint32_t k = v->budget_count / 2;
    int fixed = -1, fresh = -1;

    for (int w = 0; w < VIDEO_WAYS; w++)
        if (v->takes[w] && strcmp(video_ways[w].technique, "mis") == 0)
            *(video_ways[w].reseed ? &fresh : &fixed) = w;
    if (fixed < 0 || fresh < 0 || !(s->still_share > 0.0))
        return;
    const double still = s->points[fixed][k].flicker.median, moving = s->points[fresh][k].flicker.median;
    text_add(t, "<p class=\"answer\">At %u samples, where nothing moves, ", v->budgets[k]);
    add_name(t, &video_ways[fixed]);
    text_add(t, " flickers by ");
    add_percent(t, still);
    text_add(t, "; with other random numbers in each frame by ");
    add_percent(t, moving);
    if (still > 0.0)
        text_add(t, ", %.*f times as much", moving < 10.0 * still ? 1 : 0, moving / still);
    text_add(t, ".</p>");
}

/* Auto, at the budget where it flickers most, beside the steadiest of the others there. */
static void add_auto(struct text *t, const struct video *v, const struct video_sequence *s)
{
    int automatic = -1, steady = -1;
    uint32_t worst = 0;

    for (int w = 0; w < VIDEO_WAYS; w++)
        if (v->takes[w] && strcmp(video_ways[w].technique, "auto") == 0)
            automatic = w;
    if (automatic < 0 || !(s->still_share > 0.0))
        return;
    for (uint32_t k = 1; k < v->budget_count; k++)
        if (s->points[automatic][k].flicker.median > s->points[automatic][worst].flicker.median)
            worst = k;
    for (int w = 0; w < VIDEO_WAYS; w++)
        if (v->takes[w] && w != automatic &&
            (steady < 0 || s->points[w][worst].flicker.median < s->points[steady][worst].flicker.median))
            steady = w;
    const double flicker = s->points[automatic][worst].flicker.median;
    text_add(t, "<p>");
    add_name(t, &video_ways[automatic]);
    text_add(t, " flickers by at most ");
    add_percent(t, flicker);
    if (steady >= 0 && flicker > 2.0 * s->points[steady][worst].flicker.median) {
        text_add(t, ", %.1f times as much as ", flicker / s->points[steady][worst].flicker.median);
        add_name(t, &video_ways[steady]);
        text_add(t, " there: when its pilot changes how many samples go where, the noise becomes another");
    }
    text_add(t, ". A pilot's own measurements weigh most in pictures as small as these.</p>");
}

static void add_table(struct text *t, const struct video *v, const struct video_sequence *s)
{
    text_add(t, "<div class=\"wide\"><table><tr><th>way</th>");
    for (uint32_t k = 0; k < v->budget_count; k++)
        text_add(t, "<th>flicker<br>%u samples</th>", v->budgets[k]);
    for (uint32_t k = 0; k < v->budget_count; k++)
        text_add(t, "<th>differences<br>%u samples</th>", v->budgets[k]);
    text_add(t, "<th>each frame<br>%u samples</th></tr>", v->budgets[v->budget_count / 2]);
    for (int w = 0; w < VIDEO_WAYS; w++) {
        if (!v->takes[w])
            continue;
        text_add(t, "<tr><td>");
        add_name(t, &video_ways[w]);
        text_add(t, "</td>");
        for (uint32_t k = 0; k < v->budget_count; k++) {
            text_add(t, "<td>");
            if (isfinite(s->points[w][k].flicker.median))
                add_percent(t, s->points[w][k].flicker.median);
            text_add(t, "</td>");
        }
        for (uint32_t k = 0; k < v->budget_count; k++)
            text_add(t, "<td>%.2g</td>", s->points[w][k].change.median);
        text_add(t, "<td>%.2g</td></tr>", s->points[w][v->budget_count / 2].error.median);
    }
    text_add(t, "</table></div>");
}

static enum err add_jpeg(struct text *t, struct jpeg_encoder *j, const struct video *v, const uint8_t *display)
{
    const uint8_t *bytes;
    size_t size;
    const enum err e = jpeg_encode(j, display, v->width, v->height, QUALITY, &bytes, &size);

    if (e)
        return e;
    text_add(t, "<img src=\"data:image/jpeg;base64,");
    text_add_base64(t, bytes, size);
    return ERR_OK;
}

/* Colours as those of error maps: 0.1 % to 100 %, grey where something moves. */
static void colour_map(const float *map, size_t count, uint8_t *display)
{
    for (size_t i = 0; i < count; i++) {
        if (isnan(map[i]))
            memset(display + 3 * i, GREY, 3);
        else
            ramp_colour((log10(fmax((double)map[i], 1e-6)) + 3.0) / 3.0, display + 3 * i);
    }
}

static enum err add_strip(struct text *t, const struct video *v, const struct video_sequence *s)
{
    const size_t pixels = (size_t)v->width * v->height;
    uint8_t *display = mem_alloc(pixels, 3);
    struct jpeg_encoder *j = jpeg_encoder_create();
    double log2_mean = log2(0.18);
    enum err e = display && j ? ERR_OK : ERR_NOMEM;

    text_add(t, "<div class=\"strip video\">");
    if (!e) {
        (void)exposure_log2_mean(s->picture, NULL, v->width, v->height, &log2_mean);
        tone_map(s->picture, v->width, v->height, &(struct tone_desc){ 0.18 / exp2(log2_mean), TONE_FILMIC, NULL },
                 display);
        text_add(t, "<figure class=\"first\">");
        e = add_jpeg(t, j, v, display);
        text_add(t, "\" alt=\"the first frame\"><figcaption>the first frame, as it should be</figcaption></figure>");
    }
    for (int w = 0; w < VIDEO_WAYS && !e; w++) {
        if (!v->takes[w])
            continue;
        colour_map(s->maps[w], pixels, display);
        text_add(t, "<figure>");
        e = add_jpeg(t, j, v, display);
        text_add(t, "\" alt=\"flicker of %s\"><figcaption>", video_ways[w].name);
        add_name(t, &video_ways[w]);
        text_add(t, "<br>flicker, %u samples</figcaption></figure>", v->budgets[v->budget_count / 2]);
    }
    text_add(t, "</div>");
    jpeg_encoder_destroy(j);
    mem_free(display);
    return e;
}

static enum err add_sequence(struct text *t, const struct video *v, uint32_t number, const char *folder,
                             struct reason *why)
{
    const struct video_sequence *s = &v->sequences[number];
    char name[64];

    text_add(t, "<h3>");
    text_add_escaped(t, v->scene);
    text_add(t, ", ");
    text_add_escaped(t, s->source);
    text_add(t, ", turned by %.3g degrees a frame</h3>", s->degrees);
    add_answer(t, v, s);
    add_auto(t, v, s);
    text_add(t,
             "<p class=\"soft\">Of what sees a surface, %.0f %% stands still: it varies by no more than %.0f %% in %u "
             "frames.</p><div class=\"charts video\">",
             100.0 * s->still_share, 100.0 * v->still, v->frames);
    snprintf(name, sizeof(name), "%u-flicker", number + 1);
    enum err e = add_chart(t, folder, name, "Flicker where nothing moves, over samples", why);
    snprintf(name, sizeof(name), "%u-change", number + 1);
    if (!e)
        e = add_chart(t, folder, name, "Error of what changes from frame to frame, over samples", why);
    text_add(t, "</div>");
    if (e)
        return e;
    e = add_strip(t, v, s);
    add_table(t, v, s);
    return e ? err_say(why, e, "no memory for the page's pictures") : ERR_OK;
}

/* Frames until the error of a way is near that of the last ten. */
static uint32_t frames_to_settle(const struct video *v, int way)
{
    const double *after = v->step.error[way] + VIDEO_BEFORE;
    double end = 0.0;

    for (int k = VIDEO_AFTER - 10; k < VIDEO_AFTER; k++)
        end = fmax(end, after[k]);
    return motion_settled(after, VIDEO_AFTER, SETTLED_TIMES * end);
}

/* Those whose error changes much after the step though neither light nor random numbers do. */
static void add_wanderers(struct text *t, const struct video *v)
{
    for (int w = 0; w < VIDEO_WAYS; w++) {
        double low = INFINITY, high = 0.0;
        if (!v->takes[w] || video_ways[w].reseed)
            continue;
        for (int k = VIDEO_BEFORE; k < VIDEO_BEFORE + VIDEO_AFTER; k++) {
            low = fmin(low, v->step.error[w][k]);
            high = fmax(high, v->step.error[w][k]);
        }
        if (!(high > SETTLED_TIMES * low))
            continue;
        text_add(t, "<p>");
        add_name(t, &video_ways[w]);
        text_add(t, " wanders between an error of %.2g and one of %.2g after that, though nothing changes.</p>", low,
                 high);
    }
}

static enum err add_step(struct text *t, const struct video *v, const char *folder, struct reason *why)
{
    const uint32_t shown = motion_settled(v->step.exposure + VIDEO_BEFORE, VIDEO_AFTER, NOTICED);
    uint32_t longest = 0;
    int slowest = 0;

    for (int w = 0; w < VIDEO_WAYS; w++)
        if (v->takes[w] && frames_to_settle(v, w) > longest) {
            longest = frames_to_settle(v, w);
            slowest = w;
        }
    text_add(t, "<h3>The sun comes out, at %u samples</h3><p class=\"answer\">", v->budgets[v->budget_count / 2]);
    if (longest == 0) {
        text_add(t, "The light answers at once: no method's first frame with the sun is worse than later ones, since "
                    "none keeps light from one frame to the next.");
    } else {
        text_add(t, "The light of ");
        add_name(t, &video_ways[slowest]);
        text_add(t, " needs %u frames until its error is near where it ends.", longest);
    }
    if (shown >= VIDEO_AFTER)
        text_add(t, " What is shown has not settled after %d frames", VIDEO_AFTER);
    else
        text_add(t, " What is shown takes %u frame%s until nobody would notice the rest", shown, shown == 1 ? "" : "s");
    text_add(t, ": exposure follows slowly, so that it does not flicker.</p>");
    add_wanderers(t, v);
    text_add(t, "<div class=\"charts video\">");
    enum err e = add_chart(t, folder, "step-error", "Error of the light, frame by frame", why);
    if (!e)
        e = add_chart(t, folder, "step-display", "What is shown, against how it ends", why);
    text_add(t, "</div>");
    return e;
}

enum err video_add_section(struct text *t, const struct video *v, const char *folder, struct reason *why)
{
    enum err e = ERR_OK;

    text_add(t,
             "<section id=\"video\"><h2>In motion</h2><p class=\"soft\">%ux%u pixels, direct light, %u frames, %u "
             "seeds</p><details class=\"card\"><summary>How to read this</summary><p><b>Flicker</b> is how much a "
             "pixel varies in time though it should not: 10 %% is a pixel whose brightness is that much off now this "
             "way, now that way. Noise may be strong and not flicker at all, if it stands still.</p><p>The <b>error of "
             "frame differences</b> tells whether a picture changes as it should from one frame to the next, in the "
             "measure of relMSE. Noise that is new in every frame has twice the relMSE of one frame; noise that "
             "stands still has next to none, but sticks to the picture like dirt on a window: each frame's own error, "
             "in the last column, is the same.</p><p>The shade about a line is 10 %% to 90 %% of the seeds.</p>",
             v->width, v->height, v->frames, v->seeds);
    for (int w = 0; w < VIDEO_WAYS; w++) {
        if (!v->takes[w])
            continue;
        text_add(t, "<p>");
        add_name(t, &video_ways[w]);
        text_add(t, ": %s</p>", video_ways[w].about);
    }
    text_add(t, "</details>");
    for (uint32_t k = 0; k < v->sequence_count && !e; k++)
        e = add_sequence(t, v, k, folder, why);
    if (!e)
        e = add_step(t, v, folder, why);
    text_add(t,
             "<p>All numbers of moving pictures are in <a href=\"video.csv\">video.csv</a>; they took %.0f s.</p>"
             "</section>",
             v->seconds);
    return e;
}
