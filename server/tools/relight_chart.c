/* server/tools/relight_chart.c */
/* Error against time, drawn: the flags of server/chart. */
#include "chart.h"
#include "kernels.h"
#include "log.h"
#include "options.h"
#include "sky.h"
#include "threads.h"

#include <omp.h>
#include <stdio.h>
#include <string.h>

/* Two skies that could hardly be less alike: a clear noon, and an even grey one without a sun to speak of. */
#define SKIES "noon=sky:hour=12;overcast=sky:hour=12,turbidity=10,sun_ratio=1"

static struct option_row rows[] = {
    { "", NULL, "what is charted", NULL },
    { "scenes", "LIST", "scene files with ; between, or builtin; TITLE=FILE gives one a title", "builtin" },
    { "sources", "LIST", "sources with ; between, of which the first frame counts; TITLE=SOURCE likewise", SKIES },
    { "techniques", "LIST", "names with commas between; left out: all", NULL },
    { "", NULL, "how well", NULL },
    { "quick", NULL, "56x32 pixels and fewer samples in the references: two minutes on two cores", NULL },
    { "size", "WxH", "of the pictures, in pixels; left out: 320x180", NULL },
    { "edge-rays", "K", "K x K camera rays where geometry has edges, 1 to 16", "4" },
    { "every-pixel", NULL, "K x K camera rays in all pixels", NULL },
    { "seeds", "N", "runs of each point, 4 to 256", "16" },
    { "budgets", "LIST", "samples N_s per shade point, ascending, with commas between", "4,8,16,32,64" },
    { "reference", "N", "samples per pixel of each of the two references; left out: 2048, or 512 if quick", NULL },
    { "no-video", NULL, "leave out moving pictures: flicker, frame differences, and the answer to a step", NULL },
    { "threads", "N", "at most; 0: as many as there are processors", "0" },
    { "cpu", "LEVEL", "v3, v4 or baseline; left out: the best this CPU has", NULL },
    { "", NULL, "where to", NULL },
    { "out", "DIR", "folder of chart.csv, runs.csv, video.csv, index.html and the charts; made if it is missing",
      NULL },
    { "cache", "DIR", "folder where references are kept; left out: relight-chart in the user's cache", NULL },
    { NULL, NULL, NULL, NULL },
};

static enum err read_size(const struct options *o, bool quick, struct chart_desc *d, struct reason *why)
{
    d->width = quick ? 56 : 320;
    d->height = quick ? 32 : 180;
    return options_get(o, "size") ? options_size(o, "size", &d->width, &d->height, why) : ERR_OK;
}

static enum err read_options(const struct options *o, struct chart_desc *d, struct reason *why)
{
    const bool quick = options_on(o, "quick");
    uint64_t seeds = 0, threads = 0, edge = 0, reference = quick ? 512 : 2048;

    d->scenes = options_get(o, "scenes");
    d->sources = options_get(o, "sources");
    d->techniques = options_get(o, "techniques");
    d->budgets = options_get(o, "budgets");
    d->out = options_get(o, "out");
    d->cache = options_get(o, "cache");
    d->progress = true;
    d->quick = quick;
    d->video = !options_on(o, "no-video");
    enum err e = d->out ? ERR_OK : err_say(why, ERR_USAGE, "--out is missing: the folder that the chart goes to");
    if (!e)
        e = read_size(o, quick, d, why);
    if (!e)
        e = options_u64(o, "seeds", 4, 256, &seeds, why);
    if (!e && options_get(o, "reference"))
        e = options_u64(o, "reference", 1, 1 << 20, &reference, why);
    if (!e)
        e = options_u64(o, "edge-rays", 1, 16, &edge, why);
    if (!e)
        e = options_u64(o, "threads", 0, 1024, &threads, why);
    if (!e)
        e = kernels_select(options_get(o, "cpu"), &d->kernels, why);
    if (!e && threads)
        omp_set_num_threads((int)threads);
    d->edge_rays = (uint32_t)edge;
    d->every_pixel = options_on(o, "every-pixel");
    d->seeds = (uint32_t)seeds;
    d->truth_samples = (uint32_t)reference;
    return e;
}

/* The command line again, for the page. */
static void join(int argc, char **argv, char *text, size_t size)
{
    size_t used = (size_t)snprintf(text, size, "relight-chart");

    for (int i = 1; i < argc && used < size; i++) {
        const char *quote = strpbrk(argv[i], " ;*?$&<>|()") ? "'" : "";
        used += (size_t)snprintf(text + used, size - used, " %s%s%s", quote, argv[i], quote);
    }
}

int main(int argc, char **argv)
{
    struct options options = {
        .program = "relight-chart",
        .synopsis = "--out DIR [--quick] [--scenes LIST] [--sources LIST] [flags]",
        .about =
            "Charts the error of every method against its time, over scenes, skies and budgets, and writes a page\n"
            "that says which to choose. References are kept in a cache, so that a chart goes on where it was\n"
            "interrupted. Exit code: 0 done, 1 something failed, 2 wrong usage.",
        .epilogue_title = "keys of sky:, with their defaults",
        .epilogue = sky_help,
        .rows = rows,
    };
    struct chart_desc desc = { .scenes = NULL };
    struct reason why = { "" };
    char command[2048];
    bool done;

    threads_wait_passively(argv); /* as relightd does, whose frames are timed here */
    log_init("relight-chart", LOG_INFO);
    join(argc, argv, command, sizeof(command));
    desc.command = command;
    enum err e = options_parse(&options, argc, argv, &done, &why);
    if (!e && done)
        return 0;
    if (!e)
        e = read_options(&options, &desc, &why);
    if (!e)
        e = chart_run(&desc, &why);
    if (e)
        log_error("%s", why.text[0] ? why.text : err_text(e));
    else
        log_info("%s/index.html is the page to open", desc.out);
    return err_exit_code(e);
}
