#include "measure/chart/winners.h"

#include "base/mem.h"
#include "base/sort.h"

#include <math.h>
#include <stdlib.h>

static const double mark_shares[MARKS] = { 0.25, 0.5, 0.75 };

struct lines { /* medians of all curves: [curve][budget] */
    double *seconds, *errors;
};

static bool is_there(const struct panel *p, size_t c)
{
    return !p->curves[c].left_out.text[0];
}

static bool is_ranked(const struct technique *t)
{
    return t->kind != TECHNIQUE_PREPARED && t->kind != TECHNIQUE_FILTERED;
}

/* Whether it can win: techniques that are not ranked cannot, unless there are no others. */
static bool competes(const struct panel *p, size_t c)
{
    bool alone = true;

    for (size_t k = 0; k < p->curve_count; k++)
        alone &= !is_there(p, k) || !is_ranked(p->curves[k].technique);
    return is_there(p, c) && (alone || is_ranked(p->curves[c].technique));
}

/* Times at quantiles of those of all points. */
static enum err place_marks(const struct panel *p, const struct lines *l, struct winners *w)
{
    double *times = mem_alloc(p->curve_count * p->budget_count, sizeof(*times));
    size_t n = 0;

    if (!times)
        return ERR_NOMEM;
    for (size_t c = 0; c < p->curve_count; c++)
        for (uint32_t k = 0; k < p->budget_count && competes(p, c); k++)
            times[n++] = l->seconds[c * p->budget_count + k];
    sort_doubles(times, n);
    for (int m = 0; m < MARKS; m++)
        w->seconds[m] = n ? times[(size_t)(mark_shares[m] * (double)(n - 1) + 0.5)] : 0.0;
    mem_free(times);
    return ERR_OK;
}

static void compare_errors(const struct panel *p, const struct lines *l, int mark, struct winners *w)
{
    w->by_error[mark] = -1;
    w->error[mark] = 0.0;
    for (size_t c = 0; c < p->curve_count; c++) {
        const size_t at = c * p->budget_count;
        struct standing *s = &w->of[c];
        const double last = l->errors[at + p->budget_count - 1];
        s->has_error[mark] = is_there(p, c) && series_at(l->seconds + at, l->errors + at, p->budget_count,
                                                         w->seconds[mark], &s->error[mark]);
        if (is_there(p, c) && l->seconds[at + p->budget_count - 1] < w->seconds[mark] && last > 0.0 && isfinite(last)) {
            s->has_error[mark] = s->error_at_most[mark] = true;
            s->error[mark] = last;
        }
        if (s->has_error[mark] && competes(p, c) && (w->by_error[mark] < 0 || s->error[mark] < w->error[mark])) {
            w->by_error[mark] = (int)c;
            w->error[mark] = s->error[mark];
        }
    }
}

static void compare_seconds(const struct panel *p, const struct lines *l, int mark, struct winners *w)
{
    w->by_seconds[mark] = -1;
    for (size_t c = 0; c < p->curve_count && w->by_error[mark] >= 0; c++) {
        const size_t at = c * p->budget_count;
        struct standing *s = &w->of[c];
        /* A hair above, so that rounding does not keep the one that set the goal from reaching it. */
        s->reached[mark] =
            is_there(p, c) && series_reach(l->seconds + at, l->errors + at, p->budget_count,
                                           w->error[mark] * (1.0 + 1e-9), &s->seconds[mark], &s->at_most[mark]);
        if (s->reached[mark] && competes(p, c) &&
            (w->by_seconds[mark] < 0 || s->seconds[mark] < w->of[w->by_seconds[mark]].seconds[mark]))
            w->by_seconds[mark] = (int)c;
    }
}

static void break_even(const struct panel *p, struct winners *w)
{
    const int first = w->by_seconds[MARK_MIDDLE];

    for (size_t c = 0; c < p->curve_count && first >= 0; c++) {
        struct standing *s = &w->of[c];
        const double saved = w->of[first].seconds[MARK_MIDDLE] - s->seconds[MARK_MIDDLE];
        if (p->curves[c].technique->kind == TECHNIQUE_PREPARED && s->reached[MARK_MIDDLE] && saved > 0.0)
            s->break_even = ceil(1e-3 * p->curves[c].prepared_ms / saved);
    }
}

static enum err judge_auto(const struct panel *p, enum error_kind kind, uint32_t rounds, struct winners *w)
{
    struct curve fixed[TECHNIQUES_MAX];
    uint32_t count = 0;
    int automatic = -1;

    for (size_t c = 0; c < p->curve_count; c++) {
        if (!is_there(p, c))
            continue;
        if (p->curves[c].technique->kind == TECHNIQUE_FIXED)
            fixed[count++] = panel_curve_of(p, c, kind);
        else if (p->curves[c].technique->kind == TECHNIQUE_AUTO)
            automatic = (int)c;
    }
    w->auto_known = automatic >= 0 && count > 0;
    if (!w->auto_known)
        return ERR_OK;
    const struct curve tested = panel_curve_of(p, (size_t)automatic, kind);
    const enum err e = series_envelope(fixed, count, &tested, ENVELOPE_LIMIT, rounds, 1, &w->automatic);
    w->auto_known = w->automatic.known;
    return e;
}

/* The curve of the technique that a filtered one filters; -1: it was not run. */
static int unfiltered(const struct panel *p, const struct technique *filtered)
{
    for (size_t c = 0; c < p->curve_count; c++) {
        const struct technique *t = p->curves[c].technique;
        if (is_there(p, c) && t->kind == TECHNIQUE_FIXED && t->light_class == filtered->light_class &&
            t->light.direct.method == filtered->light.direct.method)
            return (int)c;
    }
    return -1;
}

static enum err judge_filtered(const struct panel *p, uint32_t rounds, struct winners *w)
{
    enum err e = ERR_OK;

    for (size_t c = 0; c < p->curve_count; c++) {
        if (!is_there(p, c) || p->curves[c].technique->kind != TECHNIQUE_FILTERED)
            continue;
        const int plain = unfiltered(p, p->curves[c].technique);
        for (int k = 0; k < ERROR_KINDS && plain >= 0 && !e; k++) {
            const struct curve from = panel_curve_of(p, (size_t)plain, (enum error_kind)k);
            const struct curve tested = panel_curve_of(p, c, (enum error_kind)k);
            e = series_envelope(&from, 1, &tested, 1.0, rounds, 1, &w->filtered[k]);
        }
    }
    return e;
}

enum err winners_find(const struct panel *p, enum error_kind kind, uint32_t rounds, struct winners *out)
{
    const size_t points = p->curve_count * p->budget_count;
    struct lines l = { mem_alloc(points, sizeof(double)), mem_alloc(points, sizeof(double)) };
    enum err e = l.seconds && l.errors ? ERR_OK : ERR_NOMEM;

    *out = (struct winners){ .auto_known = false };
    for (size_t c = 0; c < p->curve_count && !e; c++) {
        const struct curve curve = panel_curve_of(p, c, kind);
        if (is_there(p, c))
            e = series_medians(&curve, l.seconds + c * p->budget_count, l.errors + c * p->budget_count);
    }
    if (!e)
        e = place_marks(p, &l, out);
    for (int m = 0; m < MARKS && !e; m++) {
        compare_errors(p, &l, m, out);
        compare_seconds(p, &l, m, out);
    }
    if (!e)
        break_even(p, out);
    if (!e)
        e = judge_auto(p, kind, rounds, out);
    if (!e)
        e = judge_filtered(p, rounds, out);
    mem_free(l.seconds);
    mem_free(l.errors);
    return e;
}

static void add_ranking(struct ranking *r, const struct winners *w, size_t curve, size_t panel)
{
    if (!w->of[curve].has_error[MARK_MIDDLE])
        return;
    const double ratio = w->of[curve].error[MARK_MIDDLE] / w->error[MARK_MIDDLE];
    r->mean_ratio += log(ratio);
    r->panels++;
    r->wins += ratio <= WIN_MARGIN;
    if (ratio > r->worst_ratio) {
        r->worst_ratio = ratio;
        r->worst_panel = panel;
    }
}

static int by_worst(const void *a, const void *b)
{
    const struct ranking *x = a, *y = b;

    if (x->panels != y->panels)
        return x->panels < y->panels ? 1 : -1;
    return (x->worst_ratio > y->worst_ratio) - (x->worst_ratio < y->worst_ratio);
}

size_t winners_rank(const struct panel *const *panels, const struct winners *winners, size_t panel_count,
                    enum light_class light_class, struct ranking out[TECHNIQUES_MAX])
{
    size_t techniques, count = 0;
    const struct technique *all = technique_all(&techniques);

    for (size_t t = 0; t < techniques && count < TECHNIQUES_MAX; t++) {
        struct ranking r = { .technique = &all[t], .worst_ratio = 0.0 };
        if (!is_ranked(&all[t]))
            continue;
        for (size_t k = 0; k < panel_count; k++)
            for (size_t c = 0; c < panels[k]->curve_count; c++)
                if (panels[k]->light_class == light_class && panels[k]->curves[c].technique == &all[t])
                    add_ranking(&r, &winners[k], c, k);
        if (r.panels == 0)
            continue;
        r.mean_ratio = exp(r.mean_ratio / r.panels);
        out[count++] = r;
    }
    qsort(out, count, sizeof(*out), by_worst);
    return count;
}
