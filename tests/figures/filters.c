/* The filter beside another: edge-avoiding a-trous wavelets (light/denoise/denoise.h) and dual-buffer non-local means
 * with the same surfaces [Rousselle et al. 2012], 7 x 7 patches within 21 x 21 pixels, k = 0.45.
 *
 *     filters WxH SCENE|builtin SOURCE TRUTH SEEDS
 *
 * TRUTH is a file that first_images wrote for the same image. For 1, 4 and 16 eye paths of both halves together,
 * and four times as many light samples: processor seconds of the halves and of each filter, relMSE and FLIP. Light
 * paths are left out of images and must not matter to the truth. */
#include "base/mem.h"
#include "light/denoise/denoise.h"
#include "light/frame/relight.h"
#include "light/resolve/resolve.h"
#include "measure/compare/metrics.h"
#include "sky/source/source.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define WINDOW 10 /* pixels to either side, likewise */
#define PATCH 3
#define K 0.45f
#define LEAST 0.02f /* reflectance */

struct rig {
    struct prepared_scene *set;
    struct environment *sky;
    const struct kernels *kernels;
    struct reason why;
    size_t floats, pixels;
    float *truth[2], *mean, *half[2], *lo, *rgb;
    uint32_t *point; /* [height][width]: the one with the largest weight */
    /* Non-local means: planes of pixels. */
    float *light[2][3], *out[2][3], *weight[2], *variance, *distance[2], *row;
};

static double processor_s(void)
{
    struct timespec t;

    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static size_t at(uint32_t point, int c)
{
    return ((size_t)(point / PACKET) * 3 + (size_t)c) * PACKET + point % PACKET;
}

static float reflectance(const struct shade_packet *p, int c, uint32_t lane)
{
    return fmaxf(p->diffuse[c][lane] + p->specular[c][lane], LEAST);
}

/* ---- Non-local means ---- */

/* Means over (2 PATCH + 1)^2 pixels, in place. */
static void box(const struct rig *r, float *plane)
{
    const int w = (int)r->set->gbuffer->width, h = (int)r->set->gbuffer->height;

    for (int pass = 0; pass < 2; pass++) {
        const int lines = pass ? w : h, length = pass ? h : w, step = pass ? w : 1, next = pass ? 1 : w;
        for (int l = 0; l < lines; l++) {
            float *at_line = plane + (ptrdiff_t)l * next, sum = 0.0f;
            for (int i = 0; i < length; i++)
                r->row[i] = at_line[(ptrdiff_t)i * step];
            for (int i = -PATCH; i < length; i++) {
                if (i + PATCH < length)
                    sum += r->row[i + PATCH];
                if (i > PATCH)
                    sum -= r->row[i - PATCH - 1];
                const int first = i > PATCH ? i - PATCH : 0, last = i + PATCH < length ? i + PATCH : length - 1;
                if (i >= 0)
                    at_line[(ptrdiff_t)i * step] = sum / (float)(last - first + 1);
            }
        }
    }
}

static float likeness(const struct rig *r, uint32_t a, uint32_t b, float reach)
{
    const struct gbuffer *g = r->set->gbuffer;
    const struct shade_packet *p = &g->packets[a / PACKET], *q = &g->packets[b / PACKET];
    const uint32_t i = a % PACKET, k = b % PACKET;
    const double *eye = r->set->view.origin;

    if (p->kind != q->kind || p->behind[i] != q->behind[k] || p->layer[i] != q->layer[k] ||
        (p->kind != LOBE_LAMBERT && p->material[i] != q->material[k]))
        return 0.0f;
    float c = fmaxf(p->ns_x[i] * q->ns_x[k] + p->ns_y[i] * q->ns_y[k] + p->ns_z[i] * q->ns_z[k], 0.0f);
    const float off =
        p->ns_x[i] * (q->x[k] - p->x[i]) + p->ns_y[i] * (q->y[k] - p->y[i]) + p->ns_z[i] * (q->z[k] - p->z[i]);
    const float dx = p->x[i] - (float)eye[0], dy = p->y[i] - (float)eye[1], dz = p->z[i] - (float)eye[2];
    const float s = off / (reach * sqrtf(dx * dx + dy * dy + dz * dz) * (float)g->pixel_angle + 1e-20f);
    for (int k2 = 0; k2 < 6; k2++)
        c *= c;
    return c * fmaxf(1.0f - s * s, 0.0f);
}

static void add_offset(struct rig *r, int dx, int dy)
{
    const int w = (int)r->set->gbuffer->width, h = (int)r->set->gbuffer->height;
    const float reach = 2.0f * fmaxf(1.0f, (float)abs(dx) > (float)abs(dy) ? (float)abs(dx) : (float)abs(dy));

    for (int half = 0; half < 2; half++) {
        memset(r->distance[half], 0, r->pixels * sizeof(float));
        for (int y = dy < 0 ? -dy : 0; y < h && y + dy < h; y++)
            for (int x = dx < 0 ? -dx : 0; x < w && x + dx < w; x++) {
                const size_t p = (size_t)(y * w + x), q = (size_t)((y + dy) * w + x + dx);
                const float v = r->variance[p], u = r->variance[q];
                float d = 0.0f;
                for (int c = 0; c < 3; c++) {
                    const float off = r->light[half][c][p] - r->light[half][c][q];
                    d += off * off;
                }
                r->distance[half][p] = (d - (v + fminf(v, u))) / (1e-10f + K * K * (v + u));
            }
        box(r, r->distance[half]);
    }
    for (int y = dy < 0 ? -dy : 0; y < h && y + dy < h; y++)
        for (int x = dx < 0 ? -dx : 0; x < w && x + dx < w; x++) {
            const size_t p = (size_t)(y * w + x), q = (size_t)((y + dy) * w + x + dx);
            if (r->point[p] == UINT32_MAX || r->point[q] == UINT32_MAX)
                continue;
            const float like = likeness(r, r->point[p], r->point[q], reach);
            for (int half = 0; half < 2 && like > 1e-3f; half++) {
                const float k = like * expf(-fmaxf(r->distance[1 - half][p], 0.0f));
                r->weight[half][p] += k;
                for (int c = 0; c < 3; c++)
                    r->out[half][c][p] += k * r->light[half][c][q];
            }
        }
}

/* Writes each pixel's main point to lo; other points keep their values. */
static void non_local_means(struct rig *r)
{
    const struct gbuffer *g = r->set->gbuffer;

    for (int half = 0; half < 2; half++) {
        memset(r->weight[half], 0, r->pixels * sizeof(float));
        for (int c = 0; c < 3; c++) {
            memset(r->out[half][c], 0, r->pixels * sizeof(float));
            for (size_t p = 0; p < r->pixels; p++)
                r->light[half][c][p] = r->point[p] == UINT32_MAX ? 0.0f
                                                                 : r->half[half][at(r->point[p], c)] /
                                                                       reflectance(&g->packets[r->point[p] / PACKET], c,
                                                                                   r->point[p] % PACKET);
        }
    }
    for (size_t p = 0; p < r->pixels; p++) {
        r->variance[p] = 0.0f;
        for (int c = 0; c < 3; c++) {
            const float off = r->light[0][c][p] - r->light[1][c][p];
            r->variance[p] += 0.5f * off * off;
        }
    }
    box(r, r->variance);
    for (int dy = -WINDOW; dy <= WINDOW; dy++)
        for (int dx = -WINDOW; dx <= WINDOW; dx++)
            add_offset(r, dx, dy);
    for (size_t p = 0; p < r->pixels; p++)
        for (int c = 0; c < 3 && r->point[p] != UINT32_MAX; c++)
            r->lo[at(r->point[p], c)] = reflectance(&g->packets[r->point[p] / PACKET], c, r->point[p] % PACKET) * 0.5f *
                                        (r->out[0][c][p] / r->weight[0][p] + r->out[1][c][p] / r->weight[1][p]);
}

/* ---- Images ---- */

static void choose_points(struct rig *r)
{
    const struct gbuffer *g = r->set->gbuffer;

    for (size_t p = 0; p < r->pixels; p++) {
        float most = 0.0f;
        r->point[p] = UINT32_MAX;
        for (uint32_t k = g->entry_first[p]; k < g->entry_first[p + 1]; k++) {
            const float *w = g->entries[k].weight;
            if (w[0] + w[1] + w[2] > most) {
                most = w[0] + w[1] + w[2];
                r->point[p] = g->entries[k].point;
            }
        }
    }
}

static void show(const struct rig *r, const char *name, double seconds)
{
    double mean = 0.0, sum = 0.0, flip = 0.0;

    resolve_pixels(r->set->gbuffer, r->lo, r->sky, r->rgb);
    for (size_t v = 0; v < 3 * r->pixels; v++)
        mean += (double)r->mean[v] / (3.0 * (double)r->pixels);
    for (size_t v = 0; v < 3 * r->pixels; v++) {
        const double x = (double)r->rgb[v], t = (double)r->mean[v];
        sum += (x - (double)r->truth[0][v]) * (x - (double)r->truth[1][v]) / (t * t + 1e-2 * mean * mean);
    }
    if (!flip_compare(r->rgb, r->mean, NULL, r->set->gbuffer->width, r->set->gbuffer->height, FLIP_PIXELS_PER_DEGREE,
                      NULL, &flip))
        flip = -1.0;
    printf("  %-8s %.2e %.3f %6.2f s\n", name, sum / (3.0 * (double)r->pixels), flip, seconds);
}

static enum err make_halves(struct rig *r, uint32_t paths, uint64_t seed)
{
    struct relighter *relighter = relighter_create(r->set, r->kernels);
    struct relight_desc light = {
        .direct = { .method = METHOD_AUTO, .samples = 4 * paths, .scatter = true, .why = &r->why },
        .classes = PATH_BACKGROUND | PATH_DIRECT | PATH_INDIRECT_LIT,
        .eye_paths = paths
    };
    struct relight_stats stats;
    enum err e = relighter ? ERR_OK : ERR_NOMEM;

    for (uint64_t k = 0; k < 2 && !e; k++) {
        light.direct.seed = 2 * seed + k;
        e = relighter_run(relighter, r->sky, &light, r->rgb, &stats);
        memcpy(r->half[k], relighter_points(relighter), r->floats * sizeof(float));
    }
    relighter_destroy(relighter);
    return e;
}

static enum err run(struct rig *r, uint32_t paths, uint64_t seed)
{
    struct filter *f = filter_create(r->set->gbuffer, &r->set->view, NULL);
    const double start = processor_s();
    enum err e = f ? make_halves(r, paths, seed) : ERR_NOMEM;
    const double made = processor_s();

    if (!e) {
        printf("%u eye paths, seed %llu\n", 2 * paths, (unsigned long long)seed);
        for (size_t i = 0; i < r->floats; i++)
            r->lo[i] = 0.5f * (r->half[0][i] + r->half[1][i]);
        show(r, "none", made - start);
        const double before = processor_s();
        filter_run(f, (const float *const[]){ r->half[0], r->half[1] }, r->lo);
        show(r, "a-trous", processor_s() - before);
        const double between = processor_s();
        non_local_means(r);
        show(r, "nlm", processor_s() - between);
    }
    filter_destroy(f);
    return e;
}

static bool load_truth(struct rig *r, const char *path)
{
    FILE *f = fopen(path, "rb");
    bool all = f != NULL;

    for (int k = 0; k < 2 && all; k++)
        all = fread(r->truth[k], sizeof(float), 3 * r->pixels, f) == 3 * r->pixels;
    if (f)
        fclose(f);
    for (size_t v = 0; v < 3 * r->pixels; v++)
        r->mean[v] = 0.5f * (r->truth[0][v] + r->truth[1][v]);
    return all;
}

static enum err make(struct rig *r, char **argv)
{
    struct prepared_scene_desc set = { .scene = strcmp(argv[2], "builtin") ? argv[2] : NULL };
    const struct source_desc source = { .spec = argv[3] };
    struct frame frame = { 0 };
    enum err e = kernels_select(NULL, &r->kernels, &r->why);

    if (sscanf(argv[1], "%ux%u", &set.width, &set.height) != 2)
        return err_say(&r->why, ERR_USAGE, "size %s: WxH is right", argv[1]);
    r->sky = environment_create(&(struct environment_desc){ .n = 0 });
    if (!e)
        e = source_first(&source, &frame, &r->why);
    if (!e)
        e = r->sky ? environment_update(r->sky, &frame, &r->why) : ERR_NOMEM;
    frame_finish(&frame);
    if (!e)
        e = set_create(&set, &r->set, &r->why);
    if (e)
        return e;
    r->pixels = (size_t)set.width * set.height;
    r->floats = (size_t)r->set->gbuffer->packet_count * 3 * PACKET;
    float **const planes[] = { &r->light[0][0], &r->light[0][1], &r->light[0][2], &r->light[1][0], &r->light[1][1],
                               &r->light[1][2], &r->out[0][0],   &r->out[0][1],   &r->out[0][2],   &r->out[1][0],
                               &r->out[1][1],   &r->out[1][2],   &r->weight[0],   &r->weight[1],   &r->variance,
                               &r->distance[0], &r->distance[1], &r->row };
    bool all = true;
    for (size_t k = 0; k < sizeof(planes) / sizeof(planes[0]); k++)
        all = (*planes[k] = mem_alloc(r->pixels, sizeof(float))) && all;
    float **const wide[] = { &r->truth[0], &r->truth[1], &r->mean, &r->rgb },
                  **const points[] = { &r->half[0], &r->half[1], &r->lo };
    for (size_t k = 0; k < sizeof(wide) / sizeof(wide[0]); k++)
        all = (*wide[k] = mem_alloc(r->pixels, 3 * sizeof(float))) && all;
    for (size_t k = 0; k < sizeof(points) / sizeof(points[0]); k++)
        all = (*points[k] = mem_alloc(r->floats, sizeof(float))) && all;
    r->point = mem_alloc(r->pixels, sizeof(*r->point));
    return all && r->point ? ERR_OK : err_say(&r->why, ERR_NOMEM, "out of memory");
}

int main(int argc, char **argv)
{
    struct rig r = { .set = NULL };

    if (argc < 6) {
        fprintf(stderr, "usage: filters WxH SCENE|builtin SOURCE TRUTH SEEDS\n");
        return 2;
    }
    enum err e = make(&r, argv);
    if (!e && !load_truth(&r, argv[4]))
        e = err_say(&r.why, ERR_IO, "%s: is not a truth of this size", argv[4]);
    if (!e)
        choose_points(&r);
    for (uint32_t paths = 1; paths <= 16 && !e; paths *= 4)
        for (int seed = 1; seed <= atoi(argv[5]) && !e; seed++)
            e = run(&r, (paths + 1) / 2, (uint64_t)seed);
    if (e)
        fprintf(stderr, "%s\n", r.why.text[0] ? r.why.text : err_text(e));
    return e != ERR_OK; /* the process ends: its memory goes with it */
}
