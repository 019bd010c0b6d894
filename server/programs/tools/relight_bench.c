/* Benchmarks the stages of the pipeline, and all of it, against the limits of the machine: the flags;
 * server/measure/bench measures, and a script prints. */
#include "base/log.h"
#include "base/process.h"
#include "base/setting_table.h"
#include "import/sandbox/helper_process.h"
#include "measure/bench/bench.h"
#include "measure/chart/script.h"
#include "relightd/settings/settings.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct bench_program {
    struct setup setup; /* of which size, scene, source, cpu and threads are used */
    struct bench_desc desc;
    bool json, live, first_minute, speed;
};

#define AT(field) SETTING_AT(bench_program, field)

static const struct setting rows[] = {
    { "scene-fine", "FILE", "the same scene with 16 times the triangles; default: made by halving edges", NULL,
      .section = "Scene and environment", TEXT, AT(desc.scene_fine) },
    { "method", "M", "estimator", "mis", .section = "Rendering", CHOICE(method_choices), AT(desc.method) },
    { "samples", "N", "samples per shading point", "64", .section = "Rendering", WHOLE(1, 4096), AT(desc.samples) },
    { "particles", "N", "particles of the light tracer", "65536", .section = "Rendering", WHOLE(1, 1 << 24),
      AT(desc.particles) },
    { "viewers", "N", "viewers that an image is sent to, 1 to 64", "8", .section = "Measurement", WHOLE(1, 64),
      AT(desc.viewers) },
    { "rounds", "N", "interleaved rounds, 3 to 99; the median counts; long rows take fewer; above 3, short ones more",
      "9", .section = "Measurement", WHOLE(3, BENCH_ROUNDS_MAX), AT(desc.rounds) },
    { "live", NULL, "measure what a viewer of relightd gets under a moving sky, instead; has flags of its own (--help)",
      NULL, .section = "Measurement", SWITCH, AT(live) },
    { "first-minute", NULL,
      "measure how the error of a live image falls while its cache is computed, instead; has flags of its own (--help)",
      NULL, .section = "Measurement", SWITCH, AT(first_minute) },
    { "speed", NULL, "measure the cost of images by the cache for several scenes and skies in one table, instead", NULL,
      .section = "Measurement", SWITCH, AT(speed) },
    { "scenes", "LIST",
      "with --live, --first-minute or --speed: scene files or builtin, separated by ;  TITLE=FILE gives one a title",
      "builtin", .section = "Measurement", TEXT, AT(desc.scenes) },
    { "sources", "LIST",
      "with --live, --first-minute or --speed: sources, separated by ;  TITLE=SOURCE gives one a title",
      "noon=sky:hour=12", .section = "Measurement", TEXT, AT(desc.sources) },
    { "json", NULL, "print JSON instead of a table", NULL, .section = "Output", SWITCH, AT(json) },
    { .name = NULL },
};

static enum err read_options(const struct command *c, struct bench_program *b, struct reason *why)
{
    struct bench_desc *d = &b->desc;
    enum err e = command_read(c, why);

    d->scene = b->setup.set_desc.scene;
    d->reading = b->setup.set_desc.reading;
    d->source = b->setup.source_desc.spec;
    d->cpu = b->setup.cpu;
    d->width = b->setup.size[0];
    d->height = b->setup.size[1];
    d->threads = (int)b->setup.threads;
    d->progress = true;
    return e;
}

/* Measures relightd from outside: replaces this process by the script, which has flags of its own. */
static enum err run_script(char **argv, struct reason *why)
{
    enum { MOST = 256 };
    char script[4096], *arguments[MOST + 4] = { (char[]){ "python3" }, (char[]){ "-B" }, script };
    size_t count = 3;

    const enum err e = child_find("relight-scripts/live.py", NULL, script, sizeof(script), why);
    if (e)
        return e;
    for (size_t i = 1; argv[i] && count < MOST; i++)
        arguments[count++] = argv[i];
    execvp(arguments[0], arguments);
    return err_say(why, ERR_IO, "python3 cannot be started: %s", strerror(errno));
}

static bool wants_script(char **argv)
{
    for (size_t i = 1; argv[i]; i++)
        if (strcmp(argv[i], "--live") == 0 || strcmp(argv[i], "--first-minute") == 0)
            return true;
    return false;
}

int main(int argc, char **argv)
{
    static struct bench_program b;
    static struct command command = {
        .name = "relight-bench",
        .synopsis = "[--scene FILE] [--source S] [flags]",
        .about = "Measures the stages of the pipeline, and all of it, against their bare limits, each next to its\n"
                 "limit in the same run, and prints both, their ratio, and whether it meets its target.\n"
                 "For rates the ratio should be near 1; for times it says how many times the limit a stage takes.",
        .program = FOR_BENCH,
        .lists = { { settings_table, &b.setup }, { rows, &b } },
    };
    struct script script = { .pid = 0 };
    struct reason why = { "" };
    bool done;

    log_init("relight-bench", LOG_WARNING);
    if (wants_script(argv)) {
        const enum err failed = run_script(argv, &why);
        log_error("%s", why.text);
        return err_exit_code(failed);
    }
    process_settle(argv);
    command_begin(&command);
    enum err e = command_parse(&command, argc, argv, &done, &why);
    if (!e && done)
        return 0;
    if (!e)
        e = read_options(&command, &b, &why);
    if (!e)
        e = script_start(&script, "bench.py", b.json ? "--json" : NULL, &why);
    if (!e)
        e = (b.speed ? bench_speed : bench_run)(&b.desc, &script, &why);
    script_end(&script);
    if (e)
        log_error("%s", why.text[0] ? why.text : err_text(e));
    return err_exit_code(e);
}
