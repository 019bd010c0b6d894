#include "measure/chart/chart.h"

#include "base/clock.h"
#include "base/file_store.h"
#include "base/progress.h"
#include "base/setting.h"
#include "measure/chart/script.h"
#include "measure/compare/error_map.h"
#include "sky/source/source.h"

#include <errno.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define BUILTIN "builtin"
#define LIST_SEPARATOR ";"
#define RAMP 9 /* colours of the error maps' legend */

struct chart {
    const struct chart_desc *desc;
    char cache[4096];
    uint32_t budgets[BUDGETS_MAX], budget_count;
    struct script script; /* chart.py, which writes the files */
    struct progress line;
    bool ahead;          /* of a job: the references of panels are made, */
    uint64_t cell, mine; /* the next panel, and the next one of this rank */
};

bool chart_next_item(const char **list, char title[128], char spec[4096])
{
    const char *at = *list + strspn(*list, LIST_SEPARATOR " ");
    const size_t n = strcspn(at, LIST_SEPARATOR);

    *list = at + n;
    if (n == 0)
        return false;
    snprintf(spec, 4096, "%.*s", (int)n, at);
    const size_t name = strcspn(spec, "=:/");
    if (name > 0 && spec[name] == '=' && access(spec, F_OK) != 0) {
        snprintf(title, 128, "%.*s", (int)(name < 127 ? name : 127), spec);
        memmove(spec, spec + name + 1, strlen(spec + name + 1) + 1);
        return true;
    }
    const char *slash = strrchr(spec, '/'), *shown = slash && !strchr(spec, ':') ? slash + 1 : spec;
    const char *dot = strrchr(shown, '.');
    const size_t length = dot && dot > shown && !strchr(spec, ':') ? (size_t)(dot - shown) : strlen(shown);
    snprintf(title, 128, "%.*s", (int)(length < 127 ? length : 127), shown);
    return true;
}

enum err chart_read_budgets(const char *list, uint32_t *out, uint32_t room, uint32_t *count, struct reason *why)
{
    const char *at = list;

    for (*count = 0; *at; at += *at == ',') {
        char *end;
        errno = 0;
        const unsigned long v = strtoul(at, &end, 10);
        if (end == at || *at < '0' || *at > '9' || (*end && *end != ',') || errno || v < 1 || v > 65536)
            return err_say(why, ERR_USAGE, "--budgets '%s': numbers from 1 to 65536, separated by commas, are expected",
                           list);
        if (*count == room)
            return err_say(why, ERR_USAGE, "--budgets '%s': at most %u numbers", list, room);
        if (*count && v <= out[*count - 1])
            return err_say(why, ERR_USAGE, "--budgets '%s': %lu does not ascend", list, v);
        out[(*count)++] = (uint32_t)v;
        at = end;
    }
    return *count >= 2 ? ERR_OK
                       : err_say(why, ERR_USAGE, "--budgets '%s': at least two numbers are needed for a line", list);
}

static size_t count_items(const char *list)
{
    char title[128], spec[4096];
    size_t n = 0;

    while (chart_next_item(&list, title, spec))
        n++;
    return n;
}

/* Whether any requested technique is of this class. */
static bool has_class(const struct chart_desc *d, enum light_class light_class)
{
    size_t count;
    const struct technique *all = technique_all(&count);

    for (size_t t = 0; t < count; t++)
        if (all[t].light_class == light_class && technique_listed(d->techniques, &all[t]))
            return true;
    return false;
}

static struct panel_desc panel_desc_of(const struct chart *c, enum light_class light_class)
{
    return (struct panel_desc){
        .kernels = c->desc->kernels,
        .light_class = light_class,
        .budgets = c->budgets,
        .budget_count = c->budget_count,
        .seeds = c->desc->seeds,
        .techniques = c->desc->techniques,
        .truth_samples = c->desc->truth_samples,
        .cache = c->cache,
    };
}

/* Starts the script, and says what is the same for all panels. */
static enum err begin_page(struct chart *c, struct reason *why)
{
    const enum err e = script_start(&c->script, "chart.py", c->desc->out, why);
    uint8_t rgb[3];

    if (e)
        return e;
    json_t *first = json_pack("{s:[], s:[], s:o}", "command", "ramp", "machine",
                              script_machine(c->desc->threads, c->desc->kernels->level));
    for (char *const *a = c->desc->arguments; *a; a++)
        json_array_append_new(json_object_get(first, "command"), words_to_json(*a));
    for (int k = 0; k < RAMP; k++) {
        ramp_colour(k / (RAMP - 1.0), rgb);
        json_array_append_new(json_object_get(first, "ramp"), json_sprintf("#%02x%02x%02x", rgb[0], rgb[1], rgb[2]));
    }
    return script_tell(&c->script, first, why);
}

struct light { /* a sky, decoded and resampled */
    struct frame frame;
    struct environment *environment;
    double table_ms;
};

/* The first rebuild takes longer than the second by the resampling table. */
static enum err light_init(struct light *l, const char *spec, struct reason *why)
{
    const struct source_desc d = { .spec = spec };

    *l = (struct light){ .environment = environment_create(&(struct environment_desc){ .n = 0 }) };
    if (!l->environment)
        return err_say(why, ERR_NOMEM, "no memory for a sky");
    enum err e = source_first(&d, &l->frame, why);
    if (!e)
        e = environment_decode(l->environment, &l->frame, why);
    const double start = clock_seconds();
    if (!e)
        e = environment_rebuild(l->environment, why);
    const double middle = clock_seconds();
    if (!e)
        e = environment_rebuild(l->environment, why);
    const double once = middle - start, again = clock_seconds() - middle;
    l->table_ms = once > again ? 1e3 * (once - again) : 0.0;
    return e;
}

/* The references of the next panel, if it is this rank's. Rank 0 finds them in the cache later. */
static enum err make_ahead(struct chart *c, const struct panel_desc *d, struct reason *why)
{
    struct truth_desc t = panel_truth(d);
    struct truth truth;

    if (c->cell++ != c->mine)
        return ERR_OK;
    t.line = NULL;
    const enum err e = truth_make(&t, &truth, why);
    if (!e)
        truth_finish(&truth);
    c->mine = ranks_take(c->desc->ranks);
    return e;
}

/* Both classes of light. */
static enum err run_sky(struct chart *c, const struct prepared_scene *set, const char *scene, const char *source,
                        const char *spec, struct reason *why)
{
    struct light l;
    enum err e = light_init(&l, spec, why);

    for (int k = 0; k < LIGHT_CLASSES && !e; k++) {
        struct panel_desc d = panel_desc_of(c, (enum light_class)k);
        if (!has_class(c->desc, d.light_class))
            continue;
        d.scene = scene;
        d.source = source;
        d.set = set;
        d.environment = l.environment;
        d.frame = &l.frame;
        d.table_ms = l.table_ms;
        d.line = &c->line;
        if (c->ahead) {
            e = make_ahead(c, &d, why);
            continue;
        }
        json_t *panel;
        e = panel_measure(&d, &panel, why);
        if (!e)
            e = script_tell(&c->script, panel, why);
        else
            json_decref(panel);
    }
    frame_finish(&l.frame);
    environment_destroy(l.environment);
    return e;
}

static enum err run_scene(struct chart *c, const char *scene, const char *spec, struct reason *why)
{
    const struct prepared_scene_desc d = {
        .scene = strcmp(spec, BUILTIN) == 0 ? NULL : spec,
        .reading = c->desc->reading,
        .width = c->desc->width,
        .height = c->desc->height,
        .edge_rays = c->desc->edge_rays,
        .every_pixel = c->desc->every_pixel,
        .kernels = c->desc->kernels,
    };
    const char *list = c->desc->sources;
    char source[128], source_spec[4096];
    struct prepared_scene *set;

    enum err e = set_create(&d, &set, why);
    if (!e && set->scene->ground.radius > 0.0f) /* its references light shade points, not images */
        e = err_say(why, ERR_UNSUPPORTED, "%s: scenes with \"ground\" cannot be charted; leave it out", spec);
    while (!e && chart_next_item(&list, source, source_spec))
        e = run_sky(c, set, scene, source, source_spec, why);
    if (set)
        set_destroy(set);
    return e;
}

/* The folder of references: --cache, or the user's own. */
static enum err find_cache(struct chart *c, struct reason *why)
{
    const char *asked = c->desc->cache;

    if (asked && asked[0]) {
        if (snprintf(c->cache, sizeof(c->cache), "%s", asked) >= (int)sizeof(c->cache))
            return err_say(why, ERR_IO, "%.200s...: the path is too long", asked);
    } else if (folder_cache("relight-chart", c->cache, sizeof(c->cache), NULL)) {
        return err_say(why, ERR_USAGE, "neither XDG_CACHE_HOME nor HOME is set: use --cache DIR for the references");
    }
    return folder_make(c->cache, why);
}

/* Finds all usage errors before the work. */
static enum err check(struct chart *c, struct reason *why)
{
    const struct chart_desc *d = c->desc;
    uint64_t work = 0;
    const size_t skies = count_items(d->scenes) * count_items(d->sources);

    enum err e = chart_read_budgets(d->budgets, c->budgets, BUDGETS_MAX, &c->budget_count, why);
    if (!e)
        e = technique_check_list(d->techniques, why);
    if (!e && skies == 0)
        e = err_say(why, ERR_USAGE, "--scenes and --sources: at least one of each");
    if (!e)
        e = folder_make(d->out, why);
    if (!e && access(d->out, W_OK) != 0)
        e = err_say(why, ERR_IO, "--out %s: %s", d->out, strerror(errno));
    if (!e)
        e = find_cache(c, why);
    if (!e && ranks_index(d->ranks) == 0)
        e = begin_page(c, why);
    if (e)
        return e;
    for (int k = 0; k < LIGHT_CLASSES; k++) {
        const struct panel_desc p = panel_desc_of(c, (enum light_class)k);
        if (has_class(d, p.light_class))
            work += panel_work(&p);
    }
    progress_begin(&c->line, "charting", skies * work, d->progress ? stderr : NULL);
    return ERR_OK;
}

static enum err run_all(struct chart *c, struct reason *why)
{
    const char *list = c->desc->scenes;
    char title[128], spec[4096];
    enum err e = ERR_OK;

    while (!e && chart_next_item(&list, title, spec))
        e = run_scene(c, title, spec, why);
    return e;
}

/* Of a job. */
static enum err run_ahead(struct chart *c, struct reason *why)
{
    c->ahead = true;
    c->mine = ranks_take(c->desc->ranks);
    const enum err e = ranks_agree(c->desc->ranks, run_all(c, why), why);
    c->ahead = false;
    omp_set_num_threads(c->desc->threads);
    return e;
}

enum err chart_run(const struct chart_desc *desc, struct reason *why)
{
    struct chart c = { .desc = desc };

    enum err e = ranks_agree(desc->ranks, check(&c, why), why);
    if (!e && desc->ranks)
        e = run_ahead(&c, why);
    if (!e && ranks_index(desc->ranks) == 0)
        e = run_all(&c, why);
    progress_end(&c.line);
    script_end(&c.script);
    return e && !why->text[0] && !desc->ranks ? err_say(why, e, "%s", err_text(e)) : e;
}
