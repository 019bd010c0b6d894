/* server/tools/relight_bench.c */
/* Stages of the pipeline against their bare limits, measured side by side in one process: medians of interleaved
 * rounds, so that a noisy machine does not decide. */
#include "clock.h"
#include "environment.h"
#include "film.h"
#include "jpeg.h"
#include "log.h"
#include "mem.h"
#include "options.h"
#include "progress.h"
#include "relight.h"
#include "rng.h"
#include "source.h"

#include <inttypes.h>
#include <jansson.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ROUNDS_MAX 99
#define CHUNK 64 /* packets of rays that a thread takes at a time from the bare loop */

struct bench {
    struct set *set;
    struct environment *environment;
    struct direct *direct;
    struct direct_desc desc;
    const struct kernels *kernels;
    int rounds;
    struct gbuffer part; /* some of the set's packets, so that their rays can be written down */
    struct ray_log log;
    float *lo;
    struct frame frame;
};

struct row {
    const char *name, *unit;
    double ours, bare; /* medians */
};

static struct option_row rows[] = {
    { "scene", "FILE", "scene to light; left out: the built-in one", NULL },
    { "source", "S", "its first frame is used", "sky:" },
    { "size", "WxH", "of the pictures, in pixels", "640x360" },
    { "method", "M", "uniform, brdf, light, faces-uniform, faces, mis or auto", "mis" },
    { "samples", "N", "N_s per shade point", "64" },
    { "rounds", "N", "interleaved rounds, of which the median counts, 3 to 99", "9" },
    { "threads", "N", "0: as many as there are processors", "0" },
    { "cpu", "LEVEL", "v3, v4 or baseline; left out: the best this CPU has", NULL },
    { "json", NULL, "print JSON instead of a table", NULL },
    { NULL, NULL, NULL, NULL },
};

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *v, int n)
{
    qsort(v, (size_t)n, sizeof(*v), ascending);
    return n % 2 ? v[n / 2] : 0.5 * (v[n / 2 - 1] + v[n / 2]);
}

static void replay_all(const struct bench *b)
{
    uint64_t occluded = 0;

#pragma omp parallel for schedule(dynamic, 1) reduction(+ : occluded)
    for (size_t i = 0; i < b->log.count; i += CHUNK)
        occluded += rays_replay(b->set->rays, &b->log, i, i + CHUNK < b->log.count ? i + CHUNK : b->log.count);
    if (occluded == UINT64_MAX) /* never: the sum must be made */
        log_info("all occluded");
}

/* Every eighth run of 32 packets: about an eighth of the picture, spread over it, with its coherence kept. */
static enum err take_part(struct bench *b, struct reason *why)
{
    const struct gbuffer *g = b->set->gbuffer;

    b->part.packets = mem_alloc(g->packet_count, sizeof(*b->part.packets));
    if (!b->part.packets)
        return err_say(why, ERR_NOMEM, "no memory for the packets");
    for (uint32_t i = 0; i < g->packet_count; i++)
        if (i / 32 % 8 == 0) {
            b->part.packets[b->part.packet_count++] = g->packets[i];
            b->part.point_count += g->packets[i].count;
        }
    b->log.capacity = (size_t)b->part.packet_count * (2 * b->desc.samples + 16);
    b->log.packets = mem_alloc(b->log.capacity, sizeof(*b->log.packets));
    b->log.valid = mem_alloc(b->log.capacity, sizeof(*b->log.valid));
    if (!b->log.packets || !b->log.valid)
        return err_say(why, ERR_NOMEM, "no memory to write down the rays of %" PRIu64 " points", b->part.point_count);
    return ERR_OK;
}

static enum err bench_shadow_rays(struct bench *b, struct row *row, struct reason *why)
{
    double ours[ROUNDS_MAX], bare[ROUNDS_MAX];
    struct direct_stats stats;
    const int threads = omp_get_max_threads();
    enum err e = take_part(b, why);

    if (e)
        return e;
    omp_set_num_threads(1);
    rays_set_log(b->set->rays, &b->log);
    e = direct_shade(b->direct, &b->part, b->set->rays, b->environment, &b->desc, b->lo, &stats);
    rays_set_log(b->set->rays, NULL);
    omp_set_num_threads(threads);
    if (e)
        return err_say(why, e, "no memory for the light samples");
    for (int i = 0; i < b->rounds; i++) {
        double start = clock_seconds();
        if (direct_shade(b->direct, &b->part, b->set->rays, b->environment, &b->desc, b->lo, &stats))
            return err_say(why, ERR_NOMEM, "no memory for the light samples");
        ours[i] = (double)stats.rays / (clock_seconds() - start) / 1e6;
        start = clock_seconds();
        replay_all(b);
        bare[i] = (double)stats.rays / (clock_seconds() - start) / 1e6;
    }
    *row = (struct row){ "shadow rays", "Mrays/s", median(ours, b->rounds), median(bare, b->rounds) };
    return ERR_OK;
}

static enum err bench_rebuild(struct bench *b, struct row *row, struct reason *why)
{
    double ours[ROUNDS_MAX], bare[ROUNDS_MAX];
    const size_t bytes = 3 * sizeof(float) * (size_t)b->environment->image.width * b->environment->image.height;
    char *copy = mem_alloc(bytes, 1);
    struct light_samples samples = { 0 };
    enum err e = copy ? ERR_OK : err_say(why, ERR_NOMEM, "no memory");

    for (int i = 0; i < b->rounds && !e; i++) {
        double start = clock_seconds();
        memcpy(copy, b->environment->image.rgb, bytes);
        bare[i] = 1e3 * (clock_seconds() - start);
        start = clock_seconds();
        e = environment_rebuild(b->environment, why);
        if (!e)
            e = samples_draw(b->environment, STRATA_FACES, b->desc.samples / 2, (uint64_t)i, &samples);
        ours[i] = 1e3 * (clock_seconds() - start);
    }
    if (!e)
        *row = (struct row){ "resample, tables, samples", "ms", median(ours, b->rounds), median(bare, b->rounds) };
    samples_finish(&samples);
    mem_free(copy);
    return e;
}

static enum err bench_tone(struct bench *b, struct row *row, struct reason *why)
{
    const uint32_t width = b->set->gbuffer->width, height = b->set->gbuffer->height;
    const size_t values = 3 * (size_t)width * height;
    double ours[ROUNDS_MAX], bare[ROUNDS_MAX];
    float *rgb = mem_alloc(values, sizeof(float)), *copy = mem_alloc(values, sizeof(float));
    uint8_t *out = mem_alloc(values, 1);
    struct rng r = { 1 };
    enum err e = ERR_OK;

    if (!rgb || !copy || !out)
        e = err_say(why, ERR_NOMEM, "no memory");
    for (size_t i = 0; i < values && !e; i++)
        rgb[i] = (float)rng_next(&r);
    for (int i = 0; i < b->rounds && !e; i++) {
        double start = clock_seconds();
        memcpy(copy, rgb, values * sizeof(float));
        bare[i] = 1e3 * (clock_seconds() - start);
        start = clock_seconds();
        tone_map(rgb, width, height, 1.0, TONE_FILMIC, out);
        ours[i] = 1e3 * (clock_seconds() - start);
    }
    if (!e)
        *row = (struct row){ "tone map", "ms", median(ours, b->rounds), median(bare, b->rounds) };
    mem_free(rgb);
    mem_free(copy);
    mem_free(out);
    return e;
}

static enum err set_up(struct bench *b, const struct options *o, struct reason *why)
{
    uint64_t samples = 0, rounds = 0, threads = 0;
    struct set_desc set = { .scene = options_get(o, "scene"), .progress = true };
    struct source_desc source = { .spec = options_get(o, "source") };

    enum err e = options_size(o, "size", &set.width, &set.height, why);
    if (!e)
        e = method_parse(options_get(o, "method"), &b->desc.method, why);
    if (!e && method_is_reference(b->desc.method))
        e = err_say(why, ERR_USAGE, "--method %s is a reference: it has no stages", method_name(b->desc.method));
    if (!e)
        e = options_u64(o, "samples", 1, 4096, &samples, why);
    if (!e)
        e = options_u64(o, "rounds", 3, ROUNDS_MAX, &rounds, why);
    if (!e)
        e = options_u64(o, "threads", 0, 1024, &threads, why);
    if (!e)
        e = kernels_select(options_get(o, "cpu"), &b->kernels, why);
    if (!e)
        e = source_first(&source, &b->frame, why);
    if (!e)
        e = set_create(&set, &b->set, why);
    if (e)
        return e;
    if (threads)
        omp_set_num_threads((int)threads);
    b->desc.samples = (uint32_t)samples;
    b->rounds = (int)rounds;
    b->environment = environment_create(&(struct environment_desc){ .n = 0 });
    b->direct = direct_create(b->kernels);
    b->lo = mem_alloc(b->set->gbuffer->packet_count, 3 * PACKET * sizeof(float));
    if (!b->environment || !b->direct || !b->lo)
        return err_say(why, ERR_NOMEM, "out of memory");
    return environment_update(b->environment, &b->frame, why);
}

static void print_table(const struct bench *b, const struct row *table, size_t count)
{
    printf("%s, %s, %ux%u, %s, %u samples, %d threads, kernels %s, median of %d\n", b->set->name, b->environment->name,
           b->set->gbuffer->width, b->set->gbuffer->height, method_name(b->desc.method), b->desc.samples,
           omp_get_max_threads(), b->kernels->level, b->rounds);
    printf("%-28s %12s %12s %9s\n", "stage", "relightd", "bare limit", "ratio");
    for (size_t i = 0; i < count; i++)
        printf("%-28s %8.2f %-9s %5.2f %-9s %6.2f\n", table[i].name, table[i].ours, table[i].unit, table[i].bare,
               table[i].unit, table[i].ours / table[i].bare);
}

static void print_json(const struct bench *b, const struct row *table, size_t count)
{
    json_t *stages = json_object();

    for (size_t i = 0; i < count; i++)
        json_object_set_new(stages, table[i].name,
                            json_pack("{s:f, s:f, s:s, s:f}", "ours", table[i].ours, "bare", table[i].bare, "unit",
                                      table[i].unit, "ratio", table[i].ours / table[i].bare));
    json_t *j =
        json_pack("{s:s, s:s, s:i, s:i, s:s, s:i, s:i, s:s, s:o}", "scene", b->set->name, "environment",
                  b->environment->name, "width", (int)b->set->gbuffer->width, "height", (int)b->set->gbuffer->height,
                  "method", method_name(b->desc.method), "samples", (int)b->desc.samples, "threads",
                  omp_get_max_threads(), "kernels", b->kernels->level, "stages", stages);
    json_dumpf(j, stdout, JSON_INDENT(1) | JSON_REAL_PRECISION(6));
    printf("\n");
    json_decref(j);
}

static void tear_down(struct bench *b)
{
    mem_free(b->part.packets);
    mem_free(b->log.packets);
    mem_free(b->log.valid);
    mem_free(b->lo);
    frame_finish(&b->frame);
    direct_destroy(b->direct);
    environment_destroy(b->environment);
    set_destroy(b->set);
}

int main(int argc, char **argv)
{
    struct options options = {
        .program = "relight-bench",
        .synopsis = "[--scene FILE] [--source S] [flags]",
        .about = "Measures stages of the pipeline against their bare limits in one run and prints both.\n"
                 "For rates the ratio should be near 1 or above, for times it says how many copies a stage takes.",
        .rows = rows,
    };
    struct bench b = { 0 };
    struct row table[3];
    struct reason why = { "" };
    bool done;

    log_init("relight-bench", LOG_INFO);
    enum err e = options_parse(&options, argc, argv, &done, &why);
    if (!e && done)
        return 0;
    if (!e)
        e = set_up(&b, &options, &why);
    if (!e)
        e = bench_shadow_rays(&b, &table[0], &why);
    if (!e)
        e = bench_rebuild(&b, &table[1], &why);
    if (!e)
        e = bench_tone(&b, &table[2], &why);
    if (!e)
        (options_on(&options, "json") ? print_json : print_table)(&b, table, 3);
    tear_down(&b);
    if (e)
        log_error("%s", why.text[0] ? why.text : err_text(e));
    return err_exit_code(e);
}
