#include "relight.h"

#include "clock.h"
#include "mem.h"
#include "progress.h"
#include "resolve.h"

#include <stdio.h>

struct relighter {
    const struct set *set;
    struct direct *direct;
    float *lo; /* [packet_count][3][16] */
};

static enum err load_scene(struct set *s, const struct set_desc *desc, struct reason *why)
{
    struct progress line;
    enum err e = ERR_OK;

    snprintf(s->name, sizeof(s->name), "%s", desc->scene ? desc->scene : "the built-in scene");
    progress_begin(&line, "loading the scene", 0, desc->progress ? stderr : NULL);
    const double start = clock_seconds();
    if (desc->scene) {
        e = scene_load(desc->scene, &s->scene, &line, why);
    } else {
        s->scene = scene_create_builtin();
        if (!s->scene)
            e = err_say(why, ERR_NOMEM, "no memory for the built-in scene");
    }
    s->load_ms = 1e3 * (clock_seconds() - start);
    progress_end(&line);
    return e;
}

static enum err build_bvh(struct set *s, const struct set_desc *desc, struct reason *why)
{
    struct progress line;

    progress_begin(&line, "building the BVH", 0, desc->progress ? stderr : NULL);
    const double start = clock_seconds();
    s->rays = rays_create(s->scene);
    s->bvh_ms = 1e3 * (clock_seconds() - start);
    progress_end(&line);
    return s->rays ? ERR_OK : err_say(why, ERR_NOMEM, "%s: the ray structure could not be built", s->name);
}

static enum err build_gbuffer(struct set *s, const struct set_desc *desc, struct reason *why)
{
    const struct camera *camera = scene_camera(s->scene, desc->camera);
    struct progress line;

    if (!camera)
        return err_say(why, ERR_USAGE, "%s: there is no camera '%s'", s->name, desc->camera);
    progress_begin(&line, "building the G-buffer", desc->height, desc->progress ? stderr : NULL);
    const double start = clock_seconds();
    const struct gbuffer_desc g = {
        .camera = camera,
        .width = desc->width,
        .height = desc->height,
        .edge_rays = desc->edge_rays,
        .every_pixel = desc->every_pixel,
        .progress = &line,
    };
    const enum err e = gbuffer_create(s->scene, s->rays, &g, &s->gbuffer, why);
    s->gbuffer_ms = 1e3 * (clock_seconds() - start);
    progress_end(&line);
    return e;
}

enum err set_create(const struct set_desc *desc, struct set **out, struct reason *why)
{
    *out = NULL;
    struct set *s = mem_alloc(1, sizeof(*s));
    if (!s)
        return err_say(why, ERR_NOMEM, "out of memory");
    enum err e = load_scene(s, desc, why);
    if (!e)
        e = build_bvh(s, desc, why);
    if (!e)
        e = build_gbuffer(s, desc, why);
    if (e) {
        set_destroy(s);
        return e;
    }
    *out = s;
    return ERR_OK;
}

void set_destroy(struct set *s)
{
    if (!s)
        return;
    gbuffer_destroy(s->gbuffer);
    rays_destroy(s->rays);
    scene_destroy(s->scene);
    mem_free(s);
}

struct relighter *relighter_create(const struct set *set, const struct kernels *kernels)
{
    struct relighter *r = mem_alloc(1, sizeof(*r));
    if (!r)
        return NULL;
    r->set = set;
    r->direct = direct_create(kernels);
    r->lo = mem_alloc(set->gbuffer->packet_count, 3 * PACKET * sizeof(float));
    if (!r->direct || !r->lo) {
        relighter_destroy(r);
        return NULL;
    }
    return r;
}

void relighter_destroy(struct relighter *r)
{
    if (!r)
        return;
    direct_destroy(r->direct);
    mem_free(r->lo);
    mem_free(r);
}

enum err relighter_run(struct relighter *r, const struct environment *e, const struct direct_desc *desc, float *rgb,
                       struct relight_stats *stats)
{
    const double start = clock_seconds();

    const enum err result = direct_shade(r->direct, r->set->gbuffer, r->set->rays, e, desc, r->lo, &stats->direct);
    if (result)
        return result;
    const double shaded = clock_seconds();
    resolve_pixels(r->set->gbuffer, r->lo, e, rgb);
    stats->shade_ms = 1e3 * (shaded - start);
    stats->resolve_ms = 1e3 * (clock_seconds() - shaded);
    return ERR_OK;
}

const float *relighter_points(const struct relighter *r)
{
    return r->lo;
}
