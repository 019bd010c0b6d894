/* What images state of their error (light/audit/audit.h), and what it is: the first live images, before a cache exists,
 * images with fixed counts, and images by the cache, single and live.
 *
 *     first_images WxH SCENE|builtin SOURCE FIRST-LAST PICTURES PASSES [TRUTH|- [BEFORE]]
 *
 * One row per image and seed of FIRST to LAST: how it was made, relMSE, what is stated, its ratio to the true one, and
 * that of the stated upper bound. PICTURES live ones; then those of `kinds`; then CACHED live ones by the finished
 * cache, under a sky that grows brighter and darker by a thousandth or two, which leaves the relMSE as it is. The
 * truth has PASSES x 64 paths per pixel twice, which the file TRUTH keeps; twice PASSES images without bias tell
 * aliasing. BEFORE is a source that lights four images before the first one: a sky that changes at once. */
#include "base/mem.h"
#include "image/film/film.h"
#include "light/frame/relight.h"
#include "light/resolve/resolve.h"
#include "measure/chart/judge.h"
#include "sky/source/source.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BEFORE 4
#define CACHED 64     /* live images by the cache; */
#define SHOWN 8       /* each so manieth has a row, after the first four */
#define BREATHS 3     /* brightnesses of their sky */
#define AUDIT 0.05    /* the server's share of an image's rays */
#define AUDIT_OWN 1.0 /* that of the others: small images need more of it than large ones */

struct rig {
    struct prepared_scene *set;
    struct environment *sky, *before; /* before: NULL: none */
    struct environment *breath[BREATHS];
    double gain[BREATHS];
    const struct kernels *kernels;
    struct reason why;
    size_t values;
    float *half[2], *rgb; /* the truth, independently twice; an image */
    uint8_t *mask;        /* [height][width]: pixels that see a surface */
    struct frame frame;   /* of `sky` */
};

static struct relight_desc live(uint64_t seed, bool first)
{
    return (struct relight_desc){ .direct = { .method = METHOD_AUTO, .samples = first ? 4 : 8, .seed = seed },
                                  .classes = PATH_ALL,
                                  .eye_paths = 2,
                                  .denoise = true,
                                  .remember = true,
                                  .audit = AUDIT,
                                  .audit_live = true,
                                  .renew = CAUSTIC_PARTS };
}

static bool load_truth(struct rig *r, const char *path)
{
    FILE *f = path && strcmp(path, "-") != 0 ? fopen(path, "rb") : NULL;
    bool all = f != NULL;

    for (int k = 0; k < 2 && all; k++)
        all = fread(r->half[k], sizeof(float), r->values, f) == r->values;
    if (f)
        fclose(f);
    return all;
}

/* By paths with camera rays of their own (measure/chart/judge.h). */
static enum err make_truth(struct rig *r, int passes, const char *path)
{
    const struct truth_desc desc = { .set = r->set,
                                     .environment = r->sky,
                                     .frame = &r->frame,
                                     .classes = PATH_ALL,
                                     .samples = (uint32_t)passes * TRUTH_PART };
    struct truth truth;
    const enum err e = truth_make(&desc, &truth, &r->why);
    FILE *f = !e && path && strcmp(path, "-") != 0 ? fopen(path, "wb") : NULL;

    for (int k = 0; k < 2 && !e; k++) {
        memcpy(r->half[k], truth.half[k], r->values * sizeof(float));
        if (f && fwrite(r->half[k], sizeof(float), r->values, f) != r->values)
            perror(path);
    }
    if (f)
        fclose(f);
    truth_finish(&truth);
    return e;
}

/* Of pixels that see a surface; without the truth's own noise. */
static double error_of(const struct rig *r, const float *rgb)
{
    double mean = 0.0, sum = 0.0;
    size_t count = 0;

    for (size_t v = 0; v < r->values; v++) {
        mean += r->mask[v / 3] ? 0.5 * ((double)r->half[0][v] + (double)r->half[1][v]) : 0.0;
        count += r->mask[v / 3];
    }
    mean /= (double)count;
    for (size_t v = 0; v < r->values; v++) {
        const double x = (double)rgb[v], a = (double)r->half[0][v], b = (double)r->half[1][v];
        if (r->mask[v / 3])
            sum += (x - a) * (x - b) / (0.25 * (a + b) * (a + b) + 1e-2 * mean * mean);
    }
    return sum / (double)count;
}

/* The error of an image without noise, which no audit knows of: one camera ray for each shading point. */
static enum err print_aliasing(struct rig *r, int passes)
{
    struct relighter *relighter = relighter_create(r->set, r->kernels);
    float *sum = mem_alloc(r->values, sizeof(float));
    struct relight_desc light = { .direct = { .method = METHOD_MIS, .samples = 32, .seed = 78, .why = &r->why },
                                  .classes = PATH_ALL,
                                  .eye_paths = 32 };
    struct relight_stats stats;
    enum err e = relighter && sum ? ERR_OK : ERR_NOMEM;

    for (int i = 0; i < 2 * passes && !e; i++) {
        light.direct.pass = (uint64_t)i;
        e = relighter_run(relighter, r->sky, &light, r->rgb, &stats);
        for (size_t v = 0; v < r->values; v++)
            sum[v] += r->rgb[v] / (2.0f * (float)passes);
    }
    if (!e)
        printf("aliasing: relMSE %.2e of the mean of %d passes\n", error_of(r, sum), 2 * passes);
    relighter_destroy(relighter);
    mem_free(sum);
    return e;
}

static const struct kind {
    const char *name;
    enum method method;
    uint32_t samples, eye_paths;
    bool denoise;
} kinds[] = {
    { "mis,4", METHOD_MIS, 4, 0, false },
    { "mis,16", METHOD_MIS, 16, 0, false },
    { "auto,64", METHOD_AUTO, 64, 0, false },
    { "auto,16,denoised", METHOD_AUTO, 16, 4, true },
    { "auto,64,denoised", METHOD_AUTO, 64, 16, true },
    { "cached,16", METHOD_CACHED, 16, 0, false },
};

static void print_row(const struct rig *r, uint64_t seed, const char *kind, const struct relight_stats *stats)
{
    const double is = error_of(r, r->rgb);

    printf("seed %llu %s: relMSE %.2e states %.2e ratio %.2f bound %.2f rays %.1e of %.1e\n", (unsigned long long)seed,
           kind, is, stats->error, stats->error / is, stats->error_at_most / is, (double)stats->audited.rays,
           (double)(stats->direct.rays + stats->eye.rays + stats->light.rays));
    fflush(stdout);
}

static enum err run_live(struct rig *r, uint64_t seed, int images)
{
    struct relighter *relighter = relighter_create(r->set, r->kernels);
    struct relight_stats stats;
    enum err e = relighter ? ERR_OK : ERR_NOMEM;

    for (int k = 0; k < BEFORE && r->before && !e; k++) {
        struct relight_desc light = live(seed + 1000, k == 0);
        e = relighter_run(relighter, r->before, &light, r->rgb, &stats);
    }
    for (int k = 0; k < images && !e; k++) {
        struct relight_desc light = live(seed, k == 0 && !r->before);
        char kind[32];
        light.direct.why = &r->why;
        light.turn = (uint64_t)k;
        e = relighter_run(relighter, r->sky, &light, r->rgb, &stats);
        snprintf(kind, sizeof(kind), "live,%d", k + 1);
        if (!e)
            print_row(r, seed, kind, &stats);
    }
    relighter_destroy(relighter);
    return e;
}

static enum err run_kinds(struct rig *r, struct relighter *relighter, uint64_t seed)
{
    struct relight_stats stats;
    enum err e = ERR_OK;

    for (size_t k = 0; k < sizeof(kinds) / sizeof(kinds[0]) && !e; k++) {
        const struct kind *by = &kinds[k];
        const struct relight_desc light = {
            .direct = { .method = by->method, .samples = by->samples, .seed = seed, .why = &r->why },
            .classes = PATH_ALL,
            .eye_paths = by->eye_paths,
            .denoise = by->denoise,
            .audit = AUDIT_OWN,
            .cache_file = by->method == METHOD_CACHED ? "" : NULL,
        };
        e = relighter_run(relighter, r->sky, &light, r->rgb, &stats);
        if (!e)
            print_row(r, seed, by->name, &stats);
    }
    return e;
}

static enum err run_cached(struct rig *r, uint64_t seed)
{
    struct relighter *relighter = relighter_create(r->set, r->kernels);
    struct relight_stats stats;
    enum err e = relighter ? ERR_OK : ERR_NOMEM;

    for (uint32_t k = 0; k < CACHED && !e; k++) {
        struct relight_desc light = live(seed, false);
        char kind[32];
        light.direct.method = METHOD_CACHED;
        light.direct.samples = 16;
        light.direct.why = &r->why;
        light.denoise = false;
        light.cache_file = "";
        light.turn = k;
        e = relighter_run(relighter, r->breath[k % BREATHS], &light, r->rgb, &stats);
        for (size_t v = 0; v < r->values; v++)
            r->rgb[v] /= (float)r->gain[k % BREATHS];
        snprintf(kind, sizeof(kind), "live cached,%u", k + 1);
        if (!e && (k < BEFORE || (k + 1) % SHOWN == 0))
            print_row(r, seed, kind, &stats);
    }
    relighter_destroy(relighter);
    return e;
}

static enum err run_seeds(struct rig *r, uint64_t first, uint64_t last, int images)
{
    struct relighter *relighter = relighter_create(r->set, r->kernels);
    enum err e = relighter ? ERR_OK : ERR_NOMEM;

    for (uint64_t seed = first; seed <= last && !e; seed++) {
        e = run_live(r, seed, images);
        if (!e)
            e = run_kinds(r, relighter, seed);
        if (!e)
            e = run_cached(r, seed);
    }
    relighter_destroy(relighter);
    return e;
}

static enum err make_sky(struct rig *r, const char *spec, double gain, struct environment **out)
{
    const struct source_desc source = { .spec = spec };
    struct frame frame = { 0 };

    *out = environment_create(&(struct environment_desc){ .n = 0 });
    enum err e = *out ? source_first(&source, &frame, &r->why) : err_say(&r->why, ERR_NOMEM, "out of memory");
    for (size_t i = 0; !e && i < 3 * (size_t)frame.width * frame.height; i++)
        frame.rgb[i] *= (float)gain;
    if (!e)
        e = environment_update(*out, &frame, &r->why);
    if (out == &r->sky)
        r->frame = frame;
    else
        frame_finish(&frame);
    return e;
}

static enum err make(struct rig *r, char **argv)
{
    struct prepared_scene_desc set = { .scene = strcmp(argv[2], "builtin") ? argv[2] : NULL };
    enum err e = kernels_select(NULL, &r->kernels, &r->why);

    if (sscanf(argv[1], "%ux%u", &set.width, &set.height) != 2)
        return err_say(&r->why, ERR_USAGE, "size %s: WxH is right", argv[1]);
    r->values = 3 * (size_t)set.width * set.height;
    for (int k = 0; k < 2; k++)
        r->half[k] = mem_alloc(r->values, sizeof(float));
    r->rgb = mem_alloc(r->values, sizeof(float));
    if (!r->half[0] || !r->half[1] || !r->rgb)
        return err_say(&r->why, ERR_NOMEM, "out of memory");
    if (!e)
        e = make_sky(r, argv[3], 1.0, &r->sky);
    for (int k = 0; k < BREATHS && !e; k++) {
        r->gain[k] = 1.0 + 0.001 * k;
        e = make_sky(r, argv[3], r->gain[k], &r->breath[k]);
    }
    if (!e && argv[7] && argv[8])
        e = make_sky(r, argv[8], 1.0, &r->before);
    if (!e)
        e = set_create(&set, &r->set, &r->why);
    r->mask = mem_alloc(r->values / 3, 1);
    if (!e && r->mask)
        resolve_mask(r->set->gbuffer, r->mask);
    return !e && !r->mask ? ERR_NOMEM : e;
}

int main(int argc, char **argv)
{
    struct rig r = { .set = NULL };
    unsigned long long first, last;

    if (argc < 7 || sscanf(argv[4], "%llu-%llu", &first, &last) != 2) {
        fprintf(stderr,
                "usage: first_pictures WxH SCENE|builtin SOURCE FIRST-LAST PICTURES PASSES [TRUTH|- [BEFORE]]\n");
        return 2;
    }
    enum err e = make(&r, argv);
    if (!e && !load_truth(&r, argv[7]))
        e = make_truth(&r, atoi(argv[6]), argv[7]);
    if (!e)
        e = print_aliasing(&r, atoi(argv[6]));
    if (!e)
        e = run_seeds(&r, first, last, atoi(argv[5]));
    if (e)
        fprintf(stderr, "%s\n", r.why.text[0] ? r.why.text : err_text(e));
    set_destroy(r.set);
    environment_destroy(r.sky);
    environment_destroy(r.before);
    for (int k = 0; k < BREATHS; k++)
        environment_destroy(r.breath[k]);
    mem_free(r.half[0]);
    mem_free(r.half[1]);
    mem_free(r.rgb);
    mem_free(r.mask);
    frame_finish(&r.frame);
    return e != ERR_OK;
}
