/* A set under one sky, where in its image caustics are seen, and how far images of them are from the truth: for
 * the figures that compare how fast caustics are found. The truth is the light tracer's own mean over other seeds. */
#pragma once

#include "base/mem.h"
#include "light/estimators/baselines/path.h"
#include "light/estimators/kernels.h"
#include "light/frame/relight.h"
#include "light/resolve/resolve.h"
#include "sky/source/source.h"
#include "sky/tables/environment.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Seeds of references have this bit; those that are compared with them have not. */
#define SEEN_REFERENCE (UINT64_C(1) << 62)

struct seen {
    struct prepared_scene *set;
    struct environment *environment;
    struct light_tracer *tracer;
    struct path_world world;
    uint32_t width, height, pixels;
    float *caustics; /* [pixels][3]: their reference */
    float *whole;    /* [pixels][3]: of all light */
    float *lo;       /* of shade points, for eye paths */
    uint8_t *plain;  /* [pixels]: rough surfaces that are seen directly, two pixels from any edge of geometry */
};

/* Who may find caustics. */
enum seen_by { SEEN_PATH, SEEN_MLT, SEEN_EYE, SEEN_LIGHT, SEEN_BY_COUNT };

static const char *const seen_names[] = { "path", "mlt", "eye paths", "light tracer" };

/* An error here is the figure's end. */
static inline void seen_must(enum err e, const struct reason *why)
{
    if (!e)
        return;
    fprintf(stderr, "%s\n", why->text[0] ? why->text : err_text(e));
    exit(1);
}

/* Pixel i is an edge, or shows the sky, a mirror or glass. */
static inline bool seen_is_mixed(const struct gbuffer *g, size_t i)
{
    const uint32_t first = g->entry_first[i], count = g->entry_first[i + 1] - first;
    const uint32_t point = count ? g->entries[first].point : 0;

    return count != 1 || g->miss_first[i + 1] > g->miss_first[i] || g->packets[point / PACKET].behind[point % PACKET];
}

static inline void seen_find_plain(struct seen *s)
{
    const int reach = 2, w = (int)s->width, h = (int)s->height;

    for (int y = 0; y < h; y++)
        for (int x = 0; x < w; x++) {
            bool plain = true;
            for (int v = y - reach; v <= y + reach; v++)
                for (int u = x - reach; u <= x + reach; u++)
                    if (u >= 0 && u < w && v >= 0 && v < h && plain)
                        plain = !seen_is_mixed(s->set->gbuffer, (size_t)v * (size_t)w + (size_t)u);
            s->plain[y * w + x] = plain;
        }
}

static inline void seen_open(struct seen *s, const char *scene, const char *sky, uint32_t width, uint32_t height)
{
    const struct prepared_scene_desc set = { .scene = scene, .width = width, .height = height };
    const struct source_desc from = { .spec = sky };
    struct source *source = NULL;
    struct frame frame = { 0 };
    struct reason why = { { 0 } };

    *s = (struct seen){ .width = width, .height = height, .pixels = width * height };
    seen_must(set_create(&set, &s->set, &why), &why);
    s->environment = environment_create(&(struct environment_desc){ 0 });
    seen_must(source_open(&from, &source, &why), &why);
    seen_must(source_next(source, &frame, &why), &why);
    seen_must(environment_update(s->environment, &frame, &why), &why);
    frame_finish(&frame);
    source_close(source);
    s->tracer = light_tracer_create(s->set->scene, s->set->rays, &s->set->view);
    s->world = (struct path_world){ s->set->scene, s->set->rays, &s->set->view, s->environment, NULL };
    s->caustics = mem_alloc(s->pixels, 3 * sizeof(float));
    s->whole = mem_alloc(s->pixels, 3 * sizeof(float));
    s->lo = mem_alloc(s->set->gbuffer->packet_count, 3 * PACKET * sizeof(float));
    s->plain = mem_alloc(s->pixels, 1);
    seen_find_plain(s);
}

static inline void seen_close(struct seen *s)
{
    mem_free(s->plain);
    mem_free(s->lo);
    mem_free(s->whole);
    mem_free(s->caustics);
    light_tracer_destroy(s->tracer);
    environment_destroy(s->environment);
    set_destroy(s->set);
}

/* Caustics alone, by one of them: `samples` a pixel (path), mutations a pixel (mlt), paths a shade point that is seen
 * directly (eye paths) or particles a pixel (light tracer). Returns the rays. */
static inline uint64_t seen_caustics(const struct seen *s, enum seen_by by, uint32_t samples, uint64_t seed, float *rgb)
{
    const struct path_desc path = { .classes = PATH_CAUSTICS, .samples = samples, .seed = seed };
    const struct eye_paths_desc eye = { .classes = PATH_CAUSTICS, .paths = samples, .seed = seed };
    const struct light_tracer_desc light = { .classes = PATH_CAUSTICS,
                                             .particles = (uint64_t)samples * s->pixels,
                                             .seed = seed };
    const struct gbuffer *g = s->set->gbuffer;
    const struct reason none = { { 0 } };
    struct path_stats path_stats;
    struct eye_paths_stats eye_stats;
    struct light_tracer_stats light_stats;

    switch (by) {
    case SEEN_PATH: seen_must(path_render(&s->world, &path, rgb, &path_stats), &none); return path_stats.rays;
    case SEEN_MLT: seen_must(mlt_render(&s->world, &path, rgb, &path_stats), &none); return path_stats.rays;
    case SEEN_EYE:
        memset(s->lo, 0, (size_t)g->packet_count * 3 * PACKET * sizeof(float));
        seen_must(eye_paths_shade(s->set->scene, s->set->rays, g, s->environment, &eye, s->lo, &eye_stats), &none);
        resolve_pixels(g, s->lo, NULL, rgb);
        return eye_stats.rays;
    default:
        memset(rgb, 0, (size_t)s->pixels * 3 * sizeof(*rgb));
        seen_must(light_tracer_run(s->tracer, s->environment, &light, rgb, &light_stats), &none);
        return light_stats.rays;
    }
}

/* Adds an image to a mean of `count`. */
static inline void seen_add(const struct seen *s, double *mean, const float *rgb, uint32_t count)
{
    for (size_t i = 0; i < 3 * (size_t)s->pixels; i++)
        mean[i] += (double)rgb[i] / count;
}

/* The references: means over `seeds` seeds of the light tracer's caustics with so many particles a pixel; and of all
 * light, from nine points a pixel with so many eye paths each, and 16 times as many particles a pixel for caustics and
 * what they light. */
static inline void seen_refer(struct seen *s, const char *scene, uint32_t seeds, uint32_t particles, uint32_t eye_paths)
{
    const struct prepared_scene_desc desc = {
        .scene = scene, .width = s->width, .height = s->height, .edge_rays = 3, .every_pixel = true
    };
    struct relight_desc all = {
        .direct = { .method = METHOD_MIS, .samples = 8 * eye_paths },
        .classes = PATH_DIRECT | PATH_CAUSTICS | PATH_INDIRECT,
        .caustics = PLAN_LIGHT,
        .indirect = PLAN_EYE,
        .particles = UINT64_C(16) * eye_paths * s->pixels,
        .eye_paths = eye_paths,
    };
    const size_t values = 3 * (size_t)s->pixels;
    const struct kernels *kernels;
    struct relight_stats stats;
    struct prepared_scene *fine;
    struct reason why = { { 0 } };
    double *caustics = mem_alloc(values, sizeof(double)), *whole = mem_alloc(values, sizeof(double));
    float *one = mem_alloc(values, sizeof(float));

    seen_must(kernels_select(NULL, &kernels, &why), &why);
    seen_must(set_create(&desc, &fine, &why), &why);
    struct relighter *relighter = relighter_create(fine, kernels);
    for (uint32_t k = 0; k < seeds; k++) {
        seen_caustics(s, SEEN_LIGHT, particles, SEEN_REFERENCE + k, one);
        seen_add(s, caustics, one, seeds);
        all.direct.seed = SEEN_REFERENCE + k;
        seen_must(relighter_run(relighter, s->environment, &all, one, &stats), &why);
        seen_add(s, whole, one, seeds);
    }
    for (size_t i = 0; i < values; i++) {
        s->caustics[i] = (float)caustics[i];
        s->whole[i] = (float)whole[i];
    }
    relighter_destroy(relighter);
    set_destroy(fine);
    mem_free(one);
    mem_free(whole);
    mem_free(caustics);
}

/* The region: plain pixels to which caustics bring at least `share` of their light. Returns how many. */
static inline uint32_t seen_region(const struct seen *s, double share, uint8_t *mask)
{
    uint32_t count = 0;

    for (size_t i = 0; i < s->pixels; i++) {
        const float *c = s->caustics + 3 * i, *w = s->whole + 3 * i;
        mask[i] = s->plain[i] && rgb_luminance(c[0], c[1], c[2]) >= share * rgb_luminance(w[0], w[1], w[2]);
        count += mask[i];
    }
    return count;
}

/* relMSE of x against the reference r over the pixels of a mask: mean((x - r)^2 / (r^2 + 1e-2 mean(r)^2)). */
static inline double seen_error(const struct seen *s, const uint8_t *mask, const float *x, const float *r)
{
    double mean = 0.0, sum = 0.0, count = 0.0;

    for (size_t i = 0; i < 3 * (size_t)s->pixels; i++) {
        mean += mask[i / 3] ? (double)r[i] : 0.0;
        count += mask[i / 3] != 0;
    }
    mean /= count;
    for (size_t i = 0; i < 3 * (size_t)s->pixels; i++) {
        const double d = (double)x[i] - (double)r[i];
        sum += mask[i / 3] ? d * d / ((double)r[i] * (double)r[i] + 1e-2 * mean * mean) : 0.0;
    }
    return sum / count;
}
