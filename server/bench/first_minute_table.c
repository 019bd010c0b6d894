/* relight-bench --first-minute: every scene under every sky, a curve of each, and one table with the targets. */
#include "bench/first_minute.h"

#include "base/log.h"
#include "base/mem.h"
#include "cache/cache_folder.h"
#include "chart/chart.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define LONG_S 20.0 /* of pictures, at least: the targets end there */
#define CURVE_LEFT 1e-1
#define CURVE_DECADES 2.0
#define CURVE_WIDTH 30
#define CASES 16

struct first_case {
    char scene[128], sky[128];
    struct first_minute_result result;
};

/* Two folders: of the cache that the first sky of a scene leaves complete, and of starts without any. */
struct folders {
    char kept[64], fresh[64];
};

static enum err make_folder(char out[64], struct reason *why)
{
    strcpy(out, "/tmp/relight-bench-XXXXXX");
    if (mkdtemp(out))
        return ERR_OK;
    out[0] = '\0';
    return err_say(why, ERR_IO, "/tmp: no folder for the cache can be made");
}

static void remove_folder(char folder[64])
{
    struct reason why;

    if (folder[0] && (cache_folder_trim(folder, NULL, 0, 0, &why) || rmdir(folder)))
        log_warning("%s could not be removed", folder);
    folder[0] = '\0';
}

/* The relMSE as a mark between 1e-1 and 1e-3. */
static void draw(double error, char out[CURVE_WIDTH + 1])
{
    const double at = error > 0.0 ? log10(CURVE_LEFT / error) / CURVE_DECADES : 1.0;

    memset(out, ' ', CURVE_WIDTH);
    out[CURVE_WIDTH] = '\0';
    out[(int)(fmin(fmax(at, 0.0), 1.0) * (CURVE_WIDTH - 1))] = '*';
}

static void print_curve(const struct first_case *c, FILE *to)
{
    char curve[CURVE_WIDTH + 1], flicker[16], stated[16];

    fprintf(to, "\n%s, %s\n%9s %11s  %-8s %8s %8s %8s %7s  |1e-1 %*s|\n", c->scene, c->sky, "seconds", "processor s",
            "by", "computed", "relMSE", "stated", "flicker", CURVE_WIDTH - 6, "1e-3");
    for (size_t k = 0; k < c->result.count; k++) {
        const struct first_minute_row *r = &c->result.rows[k];
        draw(r->error, curve);
        snprintf(flicker, sizeof(flicker), r->flicker < 0 ? "-" : "%d", r->flicker);
        snprintf(stated, sizeof(stated), r->stated > 0.0 ? "%.1e" : "-", r->stated);
        fprintf(to, "%9.2f %11.2f  %-8s %6.0f %% %8.1e %8s %7s  |%s|\n", r->wall_s, r->processor_s, r->by,
                100.0 * r->share, r->error, stated, flicker, curve);
    }
    fflush(to);
}

/* "3.1", or "-" where it was not reached, with a mark where it is above the target. */
static const char *text_of(double v, double target, char out[16])
{
    if (v < 0.0)
        return "-";
    snprintf(out, 16, "%.3g%s", v, v > target ? " !" : "");
    return out;
}

static void print_summary(const struct first_case *cases, size_t count, const struct bench_desc *d, FILE *to)
{
    char cell[6][16];

    fprintf(
        to,
        "\nthe first minute, %ux%u, all light, relMSE over all pixels; seconds since the start; !: above the target;\n"
        "flicker: 99 %% of the second differences in time are at most so many 8-bit codes\n"
        "%-16s %-16s %8s %8s %8s %10s %8s %9s %8s %10s\n%-16s %-16s %8s %8s %8s %10s %8s %9s %8s %10s\n",
        d->width, d->height, "scene", "sky", "first", "2e-2", "5e-3", "as good as", "second", "its", "flicker",
        "stated in", "target", "", "1", "3", "10", "cache, 20", "start, 2", "relMSE", "1", "0.67..1.5");
    for (size_t k = 0; k < count; k++) {
        const struct first_minute_result *r = &cases[k].result;
        snprintf(cell[5], 16, r->finished_error < 0.0 ? "-" : "%.1e", r->finished_error);
        fprintf(to, "%-16.16s %-16.16s %8s %8s %8s %10s %8s %9s %6d%2s ", cases[k].scene, cases[k].sky,
                text_of(r->first_s, 1.0, cell[0]), text_of(r->good_s, 3.0, cell[1]),
                text_of(r->better_s, 10.0, cell[2]), text_of(r->equal_s, 20.0, cell[3]),
                text_of(r->again_s, 2.0, cell[4]), cell[5], r->flicker, r->flicker > 1 ? " !" : "");
        if (r->stated > 0)
            fprintf(to, "%7.0f %%\n", 100.0 * (double)r->held / (double)r->stated);
        else
            fputs("        -\n", to);
    }
}

/* When the pictures were as good as the finished cache, from the rows: its error is known last. */
static void find_equal(struct first_minute_result *r)
{
    for (size_t k = 0; k < r->count && r->finished_error > 0.0; k++)
        if (r->rows[k].error > FIRST_MINUTE_EQUAL * r->finished_error)
            r->equal_s = -1.0;
        else if (r->equal_s < 0.0)
            r->equal_s = r->rows[k].wall_s;
}

/* All skies over one scene. Only the first waits for the cache, which the others share for their second start. */
static enum err run_scene(const struct bench_desc *desc, const char *scene, struct first_case *cases, size_t *count,
                          FILE *to, struct reason *why)
{
    struct folders f = { "", "" };
    struct bench_desc own = *desc;
    const char *skies = desc->sources;
    char spec[4096];
    enum err e = make_folder(f.kept, why);
    bool complete = false;

    own.scene = strcmp(scene, "builtin") == 0 ? NULL : scene;
    own.source = spec;
    for (bool first = true; !e && *count < CASES && chart_next_item(&skies, cases[*count].sky, spec); first = false) {
        struct first_case *c = &cases[*count];
        if (*count > 0)
            memcpy(c->scene, c->scene[0] ? c->scene : cases[*count - 1].scene, sizeof(c->scene));
        if (!first)
            e = make_folder(f.fresh, why);
        if (!e)
            e = first_minute_run(&own, first ? f.kept : f.fresh, first || complete ? f.kept : NULL, LONG_S, first,
                                 &c->result, why);
        remove_folder(f.fresh);
        complete |= first && c->result.complete;
        if (e)
            break;
        find_equal(&c->result);
        print_curve(c, to);
        ++*count;
    }
    remove_folder(f.kept);
    return e;
}

enum err bench_first_minute(const struct bench_desc *desc, FILE *to, struct reason *why)
{
    struct first_case *cases = mem_alloc(CASES + 1, sizeof(*cases));
    const char *scenes = desc->scenes;
    char spec[4096];
    size_t count = 0;
    enum err e = cases ? ERR_OK : err_say(why, ERR_NOMEM, "out of memory");

    while (!e && count < CASES && chart_next_item(&scenes, cases[count].scene, spec))
        e = run_scene(desc, spec, cases, &count, to, why);
    if (!e)
        print_summary(cases, count, desc, to);
    mem_free(cases);
    return e;
}
