/* server/tools/relight_bench.c */
/* Stages of the pipeline, and the whole of it, against their bare limits: server/bench measures, this asks and prints.
 */
#include "bench.h"
#include "log.h"
#include "options.h"
#include "threads.h"

#include <stdlib.h>

static struct option_row rows[] = {
    { "scene", "FILE", "scene to light; left out: the built-in one", NULL },
    { "scene-fine", "FILE", "the same with 16 times the triangles; left out: they are made by halving edges", NULL },
    { "source", "S", "its first frame is used; what is no OpenEXR file is written to one in memory", "sky:" },
    { "size", "WxH", "of the pictures, in pixels", "640x360" },
    { "method", "M", "uniform, brdf, light, faces-uniform, faces, mis or auto", "mis" },
    { "samples", "N", "N_s per shade point", "64" },
    { "particles", "N", "of the light tracer", "65536" },
    { "viewers", "N", "that a picture is delivered to, 1 to 64", "8" },
    { "rounds", "N",
      "interleaved rounds, of which the median counts, 3 to 99; fewer for long rows, more for short ones", "9" },
    { "threads", "N", "0: as many as there are processors", "0" },
    { "cpu", "LEVEL", "v3, v4 or baseline; left out: the best this CPU has", NULL },
    { "cached", NULL, "the rows of the cache of light transport as well, which take minutes", NULL },
    { "cached-only", NULL, "these rows alone", NULL },
    { "json", NULL, "print JSON instead of a table", NULL },
    { NULL, NULL, NULL, NULL },
};

static enum err read_desc(const struct options *o, struct bench_desc *d, struct reason *why)
{
    uint64_t samples = 0, particles = 0, viewers = 0, rounds = 0, threads = 0;

    *d = (struct bench_desc){
        .scene = options_get(o, "scene"),
        .scene_fine = options_get(o, "scene-fine"),
        .source = options_get(o, "source"),
        .cpu = options_get(o, "cpu"),
        .cached = options_on(o, "cached-only") ? BENCH_CACHED_ONLY
                  : options_on(o, "cached")    ? BENCH_CACHED_TOO
                                               : BENCH_CACHED_NOT,
        .progress = true,
    };
    enum err e = options_size(o, "size", &d->width, &d->height, why);
    if (!e)
        e = method_parse(options_get(o, "method"), &d->method, why);
    if (!e && method_is_reference(d->method))
        e = err_say(why, ERR_USAGE, "--method %s is a reference: it has no stages", method_name(d->method));
    if (!e && d->method == METHOD_CACHED)
        e = err_say(why, ERR_USAGE, "--method cached has other stages than those of this table");
    if (!e)
        e = options_u64(o, "samples", 1, 4096, &samples, why);
    if (!e)
        e = options_u64(o, "particles", 1, 1 << 24, &particles, why);
    if (!e)
        e = options_u64(o, "viewers", 1, 64, &viewers, why);
    if (!e)
        e = options_u64(o, "rounds", 3, BENCH_ROUNDS_MAX, &rounds, why);
    if (!e)
        e = options_u64(o, "threads", 0, 1024, &threads, why);
    d->samples = (uint32_t)samples;
    d->particles = (uint32_t)particles;
    d->viewers = (uint32_t)viewers;
    d->rounds = (int)rounds;
    d->threads = (int)threads;
    return e;
}

int main(int argc, char **argv)
{
    struct options options = {
        .program = "relight-bench",
        .synopsis = "[--scene FILE] [--source S] [flags]",
        .about =
            "Measures the stages of the pipeline, and the whole of it, against their bare limits, each beside its\n"
            "own in the same run, and prints both, their ratio, and whether it meets the target set for it.\n"
            "For rates the ratio should be near 1, for times it says how many of the limit's a stage takes.",
        .rows = rows,
    };
    static struct bench_report report;
    struct bench_desc desc;
    struct reason why = { "" };
    bool done;

    threads_wait_passively(argv);
    log_init("relight-bench", LOG_WARNING);
    enum err e = options_parse(&options, argc, argv, &done, &why);
    if (!e && done)
        return 0;
    if (!e)
        e = read_desc(&options, &desc, &why);
    if (!e)
        e = bench_run(&desc, &report, &why);
    if (!e)
        (options_on(&options, "json") ? bench_print_json : bench_print_table)(&report, stdout);
    if (e)
        log_error("%s", why.text[0] ? why.text : err_text(e));
    return err_exit_code(e);
}
