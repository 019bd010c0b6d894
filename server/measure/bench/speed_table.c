/* relight-bench --speed: every scene by both CPU levels at two sizes, and one table with the targets. */
#include "measure/bench/speed.h"

#include "measure/chart/chart.h"
#include "measure/chart/machine.h"

#include <string.h>

#define MB 1e-6

/* Targets by size, of the usual two sizes only: bare over shading (noon, overcast), milliseconds from EXR to JPEG. */
static const struct target {
    uint32_t width, height;
    double bare[2], jpeg[2], exr, seconds, bytes; /* [0]: with a sun; 0: there is none */
} targets[] = {
    { 640, 360, { 60.0, 250.0 }, { 0.0, 0.0 }, 40.0, 5.0, 0.0 },
    { 1280, 720, { 80.0, 300.0 }, { 66.0, 33.0 }, 0.0, 0.0, 50e6 },
};

#define MOST_ALL 2.0    /* all light over direct light */
#define MOST_PIXELS 3.1 /* times the time */
#define MOST_GROWTH 1.7
#define MOST_BIAS 2e-4 /* the bias floor's relMSE, */
#define MOST_COLOUR 0.2
#define MOST_SEAMS 1.0 /* % */
#define MOST_CODES 0.2 /* of second differences */

static void print_target(const struct target *t, FILE *to)
{
    fprintf(to, "targets at %ux%u: bare/all %g with a sun, %g without;", t->width, t->height, t->bare[0],
            t->bare[1]);
    if (t->jpeg[0] > 0.0)
        fprintf(to, " to JPEG %g; %g;", t->jpeg[0], t->jpeg[1]);
    if (t->exr > 0.0)
        fprintf(to, " to EXR without a sun %g;", t->exr);
    if (t->seconds > 0.0)
        fprintf(to, " precomputation %g s;", t->seconds);
    if (t->bytes > 0.0)
        fprintf(to, " %g MB of direct light;", MB * t->bytes);
    fputc('\n', to);
}

static const struct target *target_of(const struct speed_case *c)
{
    static const struct target none = { .width = 0 };

    for (size_t k = 0; k < sizeof(targets) / sizeof(targets[0]); k++)
        if (targets[k].width == c->width && targets[k].height == c->height)
            return &targets[k];
    return &none;
}

/* "41.2", with a mark where a target is missed: "<" below the least, ">" above the most; 0: there is no target. */
static const char *text_of(double v, double least, double most, char out[16])
{
    snprintf(out, 16, "%.3g%s", v, least > 0.0 && v < least ? " <" : most > 0.0 && v > most ? " >" : "");
    return out;
}

static const char *error_text(double v, double most, char out[16])
{
    if (v < 0.0)
        return "-";
    snprintf(out, 16, "%.1e%s", v, v > most ? " >" : "");
    return out;
}

static void print_skies(const struct speed_case *c, FILE *to)
{
    const struct target *t = target_of(c);
    char cell[10][16];

    for (size_t k = 0; k < c->count; k++) {
        const struct speed_sky *s = &c->skies[k];
        const int kind = s->sun ? 0 : 1;
        fprintf(to, "%-10.10s %4ux%-4u %-8.8s %-10.10s %8s %8s %8s %8s %8s %8s %8s %8s %9s %9s %8s %8s\n", c->scene,
                c->width, c->height, c->level, s->title, text_of(s->all_ms, 0, 0, cell[0]),
                text_of(s->direct_ms, 0, 0, cell[1]), text_of(s->bare_all, t->bare[kind], 0, cell[2]),
                text_of(s->bare_direct, 0, 0, cell[3]), text_of(s->all_over_direct, 0, MOST_ALL, cell[4]),
                text_of(s->jpeg_all, 0, t->jpeg[kind], cell[5]), text_of(s->jpeg_direct, 0, 0, cell[6]),
                text_of(s->exr_direct, 0, kind ? t->exr : 0.0, cell[7]),
                error_text(s->error_direct, s->mis_direct, cell[8]), error_text(s->error_all, s->mis_all, cell[9]),
                s->error_direct < 0.0 ? "-" : error_text(s->mis_direct, 1e30, (char[16]){ "" }),
                s->error_all < 0.0 ? "-" : error_text(s->mis_all, 1e30, (char[16]){ "" }));
    }
}

static void print_growth(const struct bench_row *r, double most, FILE *to)
{
    char cell[16];

    if (!r->name)
        return;
    if (r->skipped[0])
        fprintf(to, "; %s: %s", r->name, r->skipped);
    else
        fprintf(to, "; %s: %s times the time", r->name, text_of(r->ratio, 0, most, cell));
}

/* A row of the bias, or why there is none. */
static void print_bias(const char *name, const struct bench_row *r, double most, FILE *to)
{
    char cell[16];

    if (r->skipped[0])
        fprintf(to, "; %s: %s", name, r->skipped);
    else
        fprintf(to, "; %s %s", name, text_of(r->ours, 0, most, cell));
}

static void print_biases(const struct speed_case *c, FILE *to)
{
    for (size_t k = 0; k < c->count; k++) {
        const struct speed_sky *s = &c->skies[k];
        if (!s->judged)
            continue;
        fprintf(to, "%-10.10s %4ux%-4u %-8.8s %-10.10s direct light without the sky's sun", c->scene, c->width,
                c->height, c->level, s->title);
        print_bias("relMSE", &s->bias, MOST_BIAS, to);
        print_bias("delta E", &s->colour, MOST_COLOUR, to);
        print_bias("% of seams", &s->seams, MOST_SEAMS, to);
        print_bias("second differences in codes", &s->motion, MOST_CODES, to);
        fputc('\n', to);
    }
}

static void print_caches(const struct speed_case *c, FILE *to)
{
    const struct target *t = target_of(c);
    char cell[2][16];

    fprintf(
        to,
        "%-10.10s %4ux%-4u %-8.8s precomputation of all light %s s, %.3g s of processor time; %s MB of direct light, "
        "%.3g of all",
        c->scene, c->width, c->height, c->level, text_of(c->wall_s, 0, t->seconds, cell[0]), c->processor_s,
        text_of(MB * (double)c->direct_bytes, 0, MB * t->bytes, cell[1]), MB * (double)c->bytes);
    print_growth(&c->pixels, MOST_PIXELS, to);
    print_growth(&c->growth, MOST_GROWTH, to);
    fputc('\n', to);
}

static void print_heads(const char *level, FILE *to)
{
    static const char *const heads[2][12] = {
        { "shading", "shading", "bare/", "bare/", "all/", "to JPEG", "to JPEG", "to EXR", "relMSE", "relMSE", "mis 256",
          "mis 256" },
        { "all", "direct", "all", "direct", "direct", "all", "direct", "direct", "direct", "all", "direct", "all" },
    };
    struct machine m;

    machine_describe(&m, level);
    fprintf(
        to,
        "%s, commit %s, %s\n"
        "milliseconds; shading: the clock's, all threads; bare: 64 shadow rays at each shade point; to JPEG: "
        "processor\n"
        "time from EXR to JPEG; to EXR: from EXR to a float EXR on one thread; < and >: below or above the target\n",
        m.cpu, m.commit, m.date);
    for (size_t k = 0; k < sizeof(targets) / sizeof(targets[0]); k++)
        print_target(&targets[k], to);
    fprintf(
        to,
        "  all sizes: all/direct at most %g; relMSE, of surfaces against paths with camera rays of their own, at most "
        "that of mis;\n  four times the pixels %g, 16 times the triangles %g of the time; bias, against the same "
        "shading points: relMSE %g, delta E %g, seams %g %%, second differences %g codes\n",
        MOST_ALL, MOST_PIXELS, MOST_GROWTH, MOST_BIAS, MOST_COLOUR, MOST_SEAMS, MOST_CODES);
    for (int line = 0; line < 2; line++) {
        fprintf(to, "%-10s %-9s %-8s %-10s", line ? "" : "scene", line ? "" : "size", line ? "" : "kernels",
                line ? "" : "sky");
        for (int k = 0; k < 12; k++)
            fprintf(to, " %*s", k == 8 || k == 9 ? 9 : 8, heads[line][k]);
        fputc('\n', to);
    }
}

/* One scene: by the best kernels first, then by those for AVX2, each at both sizes; each is printed when it is done.
 * *printed: the heads are. */
static enum err run_scene(const struct bench_desc *desc, const char *title, const char *scene, bool *printed, FILE *to,
                          struct reason *why)
{
    struct speed_case c = { .level = "" };
    enum err e = ERR_OK;

    for (int run = 0; run < 4 && !e; run++) {
        struct bench_desc own = *desc;
        own.scene = strcmp(scene, "builtin") == 0 ? NULL : scene;
        own.width <<= run % 2;
        own.height <<= run % 2;
        if (run >= 2 && (desc->cpu || strcmp(c.level, "v3") == 0))
            break; /* there is one level only */
        own.cpu = run >= 2 ? "v3" : desc->cpu;
        c = (struct speed_case){ .level = "" };
        snprintf(c.scene, sizeof(c.scene), "%.*s", SPEED_TITLE - 1, title);
        e = speed_measure(&own, run == 0, &c, why);
        if (e)
            break;
        if (!*printed)
            print_heads(c.level, to);
        *printed = true;
        print_skies(&c, to);
        print_biases(&c, to);
        print_caches(&c, to);
        fflush(to);
    }
    return e;
}

enum err bench_speed(const struct bench_desc *desc, FILE *to, struct reason *why)
{
    const char *scenes = desc->scenes;
    char title[128], spec[4096];
    bool printed = false;
    enum err e = ERR_OK;

    while (!e && chart_next_item(&scenes, title, spec))
        e = run_scene(desc, title, spec, &printed, to, why);
    return e;
}
