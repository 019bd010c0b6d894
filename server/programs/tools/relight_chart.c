/* Charts error against time: the flags; server/measure/chart does the work. */
#include "base/log.h"
#include "base/process.h"
#include "base/setting_table.h"
#include "light/estimators/kernels.h"
#include "measure/chart/chart.h"
#include "relightd/settings/settings.h"
#include "sky/daylight/sky.h"

#include <omp.h>
#include <stdio.h>
#include <string.h>

/* Two skies that could hardly be less alike: a clear noon, and an even grey one without a sun to speak of. */
#define SKIES "noon=sky:hour=12;overcast=sky:hour=12,turbidity=10,sun_ratio=1"

struct chart_program {
    struct setup setup; /* of which size, camera rays, cpu and threads are used */
    struct chart_desc desc;
    bool quick;
    char name[200]; /* of a rank, in the log */
};

#define CHARTED .section = "Scenes and techniques"
#define ACCURACY .section = "Accuracy"
#define OUTPUT .section = "Output"
#define AT(field) SETTING_AT(chart_program, desc.field)

static const struct setting rows[] = {
    { "scenes", "LIST", "scene files or builtin, separated by ;  TITLE=FILE gives one a title", "builtin", CHARTED,
      TEXT, AT(scenes) },
    { "sources", "LIST", "sources separated by ; of which the first frame counts; TITLE=SOURCE gives one a title",
      SKIES, CHARTED, TEXT, AT(sources) },
    { "techniques", "LIST", "names separated by commas; default: all", NULL, CHARTED, TEXT, AT(techniques) },
    { "quick", NULL, "56x32 pixels and fewer samples in the references: two minutes on two cores", NULL, ACCURACY,
      SWITCH, SETTING_AT(chart_program, quick) },
    { "seeds", "N", "runs of each point, 4 to 256", "16", ACCURACY, WHOLE(4, 256), AT(seeds) },
    { "budgets", "LIST", "samples per shading point, ascending, separated by commas", "4,8,16,32,64", ACCURACY, TEXT,
      AT(budgets) },
    { "reference", "N", "samples per pixel of each of the two references; default: 2048, or 512 with --quick", NULL,
      ACCURACY, WHOLE(1, 1 << 20), AT(truth_samples) },
    { "out", "DIR", "folder for chart.csv, runs.csv, index.html and the charts; made if missing", NULL, OUTPUT, TEXT,
      AT(out) },
    { "cache", "DIR", "folder where references are kept; default: relight-chart in the user's cache folder", NULL,
      OUTPUT, TEXT, AT(cache) },
    { .name = NULL },
};

static enum err read_options(const struct command *c, struct chart_program *chart, struct reason *why)
{
    struct chart_desc *d = &chart->desc;
    const struct setup *s = &chart->setup;
    enum err e = command_read(c, why);

    if (!e && !d->out)
        e = err_say(why, ERR_USAGE, "--out is missing: name the folder for the chart");
    if (!e)
        e = kernels_select(s->cpu, &d->kernels, why);
    if (!e && s->threads)
        omp_set_num_threads((int)s->threads);
    d->width = s->size[0] ? s->size[0] : chart->quick ? 56 : 320;
    d->height = s->size[1] ? s->size[1] : chart->quick ? 32 : 180;
    d->truth_samples = d->truth_samples ? d->truth_samples : chart->quick ? 512 : 2048;
    d->reading = s->set_desc.reading;
    d->edge_rays = s->set_desc.edge_rays;
    d->every_pixel = s->set_desc.every_pixel;
    d->progress = true;
    return e;
}

/* Alone, or with the other ranks of a job. */
static enum err run(struct chart_program *chart, int argc, char **argv, struct reason *why)
{
    struct chart_desc *d = &chart->desc;
    const struct ranks_desc job = { "relight-chart", d->kernels->level, argc, argv };
    enum err e = ranks_create(&job, &d->ranks, why);
    const bool together = d->ranks || (e && !why->text[0]);

    d->threads = omp_get_max_threads();
    if (d->ranks) {
        snprintf(chart->name, sizeof(chart->name), "relight-chart, %s", ranks_name(d->ranks));
        log_init(chart->name, LOG_INFO);
        d->progress = ranks_index(d->ranks) == 0;
        if (!chart->setup.threads)
            omp_set_num_threads((int)ranks_threads(d->ranks));
    }
    if (!e)
        e = chart_run(d, why);
    /* Wrong usage is the same on all ranks, and an error that is another rank's is told there. */
    if (e && !(together && (!why->text[0] || (e == ERR_USAGE && ranks_index(d->ranks) > 0))))
        log_error("%s", why->text[0] ? why->text : err_text(e));
    else if (!e && ranks_index(d->ranks) == 0)
        log_info("%s/index.html is the page to open", d->out);
    ranks_destroy(d->ranks);
    return e;
}

int main(int argc, char **argv)
{
    static struct chart_program chart;
    static struct command command = {
        .name = "relight-chart",
        .synopsis = "--out DIR [--quick] [--scenes LIST] [--sources LIST] [flags]",
        .about =
            "Charts the error of every method against its time, over scenes, skies and budgets, and writes a page\n"
            "that says which to choose. References are kept in a cache, so that an interrupted chart continues.\n"
            "Exit code: 0 done, 1 something failed, 2 wrong usage.",
        .epilogue_title = "keys of sky:, with their defaults",
        .program = FOR_CHART,
        .lists = { { settings_table, &chart.setup }, { rows, &chart } },
    };
    struct reason why = { "" };
    bool done;

    process_settle(argv); /* as relightd does, whose frames are timed here */
    log_init("relight-chart", LOG_INFO);
    chart.desc.arguments = argv + 1;
    command.epilogue = sky_help;
    command_begin(&command);
    command_default(&command, "size", NULL);
    enum err e = command_parse(&command, argc, argv, &done, &why);
    if (!e && done)
        return 0;
    if (!e)
        e = read_options(&command, &chart, &why);
    if (!e)
        return err_exit_code(run(&chart, argc, argv, &why));
    log_error("%s", why.text[0] ? why.text : err_text(e));
    return err_exit_code(e);
}
