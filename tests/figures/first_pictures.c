/* The first live pictures, before a cache exists: their relMSE against the truth, and what they state of it
 * (history/stated.h).
 *
 *     first_pictures WxH SCENE|builtin SOURCE SEEDS PICTURES PASSES [TRUTH [BEFORE]]
 *
 * One row per picture and seed: relMSE, stated error, their ratio. The last row tells how many pictures that state an
 * error are within 0.67 to 1.5 of the true one. PASSES pairs of 32 samples and 32 eye paths make the truth, which the
 * file TRUTH keeps. BEFORE is a source that lights four pictures before the first one: a sky that changes at once. No
 * clock is read but by the store of light paths, where there are mirrors or glass. */
#include "base/mem.h"
#include "film/film.h"
#include "light/relight.h"
#include "source/source.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BEFORE 4

struct rig {
    struct set *set;
    struct environment *sky, *before; /* before: NULL: none */
    const struct kernels *kernels;
    struct reason why;
    size_t values;
    float *half[2], *rgb; /* the truth, independently twice; a picture */
};

static struct relight_desc live(uint64_t seed, bool first)
{
    return (struct relight_desc){ .direct = { .method = METHOD_AUTO, .samples = first ? 4 : 8, .seed = seed },
                                  .classes = PATH_ALL,
                                  .eye_paths = 2,
                                  .denoise = true,
                                  .remember = true,
                                  .renew = CAUSTIC_PARTS };
}

static bool load_truth(struct rig *r, const char *path)
{
    FILE *f = path ? fopen(path, "rb") : NULL;
    bool all = f != NULL;

    for (int k = 0; k < 2 && all; k++)
        all = fread(r->half[k], sizeof(float), r->values, f) == r->values;
    if (f)
        fclose(f);
    return all;
}

static enum err make_truth(struct rig *r, int passes, const char *path)
{
    struct relighter *relighter = relighter_create(r->set, r->kernels);
    struct relight_desc light = { .direct = { .method = METHOD_MIS, .samples = 32, .seed = 77, .why = &r->why },
                                  .classes = PATH_ALL,
                                  .eye_paths = 32 };
    struct relight_stats stats;
    enum err e = relighter ? ERR_OK : ERR_NOMEM;

    for (int i = 0; i < 2 * passes && !e; i++) {
        light.direct.pass = (uint64_t)i;
        e = relighter_run(relighter, r->sky, &light, r->rgb, &stats);
        for (size_t v = 0; v < r->values; v++)
            r->half[i % 2][v] += r->rgb[v] / (float)passes;
    }
    relighter_destroy(relighter);
    FILE *f = !e && path ? fopen(path, "wb") : NULL;
    for (int k = 0; k < 2 && f; k++)
        if (fwrite(r->half[k], sizeof(float), r->values, f) != r->values)
            perror(path);
    if (f)
        fclose(f);
    return e;
}

/* Without the truth's own noise. */
static double error_of(const struct rig *r)
{
    double mean = 0.0, sum = 0.0;

    for (size_t v = 0; v < r->values; v++)
        mean += 0.5 * ((double)r->half[0][v] + (double)r->half[1][v]) / (double)r->values;
    for (size_t v = 0; v < r->values; v++) {
        const double x = (double)r->rgb[v], a = (double)r->half[0][v], b = (double)r->half[1][v];
        sum += (x - a) * (x - b) / (0.25 * (a + b) * (a + b) + 1e-2 * mean * mean);
    }
    return sum / (double)r->values;
}

static enum err run_seed(struct rig *r, uint64_t seed, int pictures, int *stated, int *within)
{
    struct relighter *relighter = relighter_create(r->set, r->kernels);
    struct relight_stats stats;
    enum err e = relighter ? ERR_OK : ERR_NOMEM;

    for (int k = 0; k < BEFORE && r->before && !e; k++) {
        struct relight_desc light = live(seed + 1000, k == 0);
        e = relighter_run(relighter, r->before, &light, r->rgb, &stats);
    }
    for (int k = 0; k < pictures && !e; k++) {
        struct relight_desc light = live(seed, k == 0 && !r->before);
        light.direct.why = &r->why;
        light.turn = (uint64_t)k;
        e = relighter_run(relighter, r->sky, &light, r->rgb, &stats);
        if (e)
            break;
        const double is = error_of(r);
        printf("seed %llu picture %d: relMSE %.2e, states %.2e, ratio %.2f\n", (unsigned long long)seed, k + 1, is,
               stats.error, stats.error / is);
        *stated += stats.error > 0.0;
        *within += stats.error >= 0.67 * is && stats.error <= 1.5 * is;
    }
    relighter_destroy(relighter);
    return e;
}

static enum err make_sky(struct rig *r, const char *spec, struct environment **out)
{
    const struct source_desc source = { .spec = spec };
    struct frame frame = { 0 };

    *out = environment_create(&(struct environment_desc){ .n = 0 });
    enum err e = *out ? source_first(&source, &frame, &r->why) : err_say(&r->why, ERR_NOMEM, "out of memory");
    if (!e)
        e = environment_update(*out, &frame, &r->why);
    frame_finish(&frame);
    return e;
}

static enum err make(struct rig *r, char **argv)
{
    struct set_desc set = { .scene = strcmp(argv[2], "builtin") ? argv[2] : NULL };
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
        e = make_sky(r, argv[3], &r->sky);
    if (!e && argv[7] && argv[8])
        e = make_sky(r, argv[8], &r->before);
    return e ? e : set_create(&set, &r->set, &r->why);
}

int main(int argc, char **argv)
{
    struct rig r = { .set = NULL };
    int stated = 0, within = 0;

    if (argc < 7) {
        fprintf(stderr, "usage: first_pictures WxH SCENE|builtin SOURCE SEEDS PICTURES PASSES [TRUTH [BEFORE]]\n");
        return 2;
    }
    enum err e = make(&r, argv);
    if (!e && !load_truth(&r, argv[7]))
        e = make_truth(&r, atoi(argv[6]), argv[7]);
    for (int seed = 1; seed <= atoi(argv[4]) && !e; seed++)
        e = run_seed(&r, (uint64_t)seed, atoi(argv[5]), &stated, &within);
    if (e)
        fprintf(stderr, "%s\n", r.why.text[0] ? r.why.text : err_text(e));
    else
        printf("%d of %d within 0.67 and 1.5\n", within, stated);
    set_destroy(r.set);
    environment_destroy(r.sky);
    environment_destroy(r.before);
    mem_free(r.half[0]);
    mem_free(r.half[1]);
    mem_free(r.rgb);
    return e != ERR_OK;
}
