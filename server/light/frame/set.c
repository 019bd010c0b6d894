/* Creates a scene as seen by one camera: light/frame/relight.h. */
#include "light/frame/relight.h"

#include "base/clock.h"
#include "base/mem.h"
#include "base/progress.h"
#include "import/reader/reader.h"
#include "light/frame/frame_plan.h"
#include "scene/geometry/ground.h"

#include <omp.h>
#include <stdio.h>
#include <string.h>

static enum err load_scene(struct prepared_scene *s, const struct prepared_scene_desc *desc, struct reason *why)
{
    struct progress line;
    enum err e = ERR_OK;

    snprintf(s->name, sizeof(s->name), "%s", desc->scene ? desc->scene : "the built-in scene");
    if (desc->scene && strlen(desc->scene) < sizeof(s->file))
        strcpy(s->file, desc->scene);
    progress_begin(&line, "loading the scene", 0, desc->progress ? stderr : NULL);
    const double start = clock_seconds();
    if (desc->scene) {
        e = scene_load(desc->scene, &desc->reading, &s->scene, &line, why);
    } else {
        s->scene = scene_create_builtin();
        if (!s->scene)
            e = err_say(why, ERR_NOMEM, "no memory for the built-in scene");
    }
    if (!e && (desc->ground || s->scene->wants_ground))
        e = scene_add_ground(s->scene, s->name, why);
    s->load_ms = 1e3 * (clock_seconds() - start);
    progress_end(&line);
    return e;
}

static enum err build_bvh(struct prepared_scene *s, const struct prepared_scene_desc *desc, struct reason *why)
{
    struct progress line;

    progress_begin(&line, "building the BVH", 0, desc->progress ? stderr : NULL);
    const double start = clock_seconds();
    s->rays = rays_create_for(s->scene, desc->kernels ? desc->kernels->cpu : cpu_best());
    s->bvh_ms = 1e3 * (clock_seconds() - start);
    progress_end(&line);
    return s->rays ? ERR_OK : err_say(why, ERR_NOMEM, "%s: the ray structure could not be built", s->name);
}

static enum err choose_camera(const struct prepared_scene *s, const struct prepared_scene_desc *desc,
                              struct camera *out, struct reason *why)
{
    if (desc->camera && free_view_is(desc->camera)) {
        const enum err e = free_view_read(desc->camera, out, why);
        return e ? e : view_change_apply(&desc->change, s->scene, out, why);
    }
    const struct camera *camera = scene_camera(s->scene, desc->camera);
    char names[300];

    if (!camera) {
        scene_camera_names(s->scene, names, sizeof(names));
        return err_say(why, ERR_USAGE, "%s: there is no camera '%s'; expected %s", s->name, desc->camera, names);
    }
    *out = *camera;
    return view_change_apply(&desc->change, s->scene, out, why);
}

static bool has_glass(const struct scene *s)
{
    for (size_t i = 0; i < s->material_count; i++)
        if (s->materials[i].kind == MATERIAL_GLASS && !s->materials[i].thin)
            return true;
    return false;
}

static enum err build_gbuffer(struct prepared_scene *s, const struct prepared_scene_desc *desc, struct progress *line,
                              struct reason *why)
{
    struct camera camera;
    enum err e = choose_camera(s, desc, &camera, why);

    if (e)
        return e;
    const double start = clock_seconds(), used = clock_processor();
    s->coarse = desc->soon && desc->edge_rays != 1 && !desc->every_pixel && has_glass(s->scene);
    const struct gbuffer_desc g = {
        .camera = &camera,
        .width = desc->width,
        .height = desc->height,
        .edge_rays = s->coarse ? 1 : desc->edge_rays,
        .every_pixel = desc->every_pixel,
        .progress = line,
    };
    e = ground_check_camera(s->scene, &camera, s->name, why);
    if (!e)
        e = gbuffer_create(s->scene, s->rays, &g, &s->gbuffer, why);
    s->gbuffer_ms = 1e3 * (clock_seconds() - start);
    s->gbuffer_cost_s = (clock_processor() - used) / omp_get_max_threads();
    snprintf(s->camera, sizeof(s->camera), "%s", camera.name);
    free_view_write(&camera, s->placed);
    view_init(&s->view, &camera, desc->width, desc->height);
    if (!e)
        facts_of_set(s->scene, s->gbuffer, &s->facts);
    return e;
}

static enum err build_view(struct prepared_scene *s, const struct prepared_scene_desc *desc, struct reason *why)
{
    struct progress line;

    progress_begin(&line, "building the G-buffer", desc->height, desc->progress ? stderr : NULL);
    const enum err e = build_gbuffer(s, desc, &line, why);
    progress_end(&line);
    return e;
}

enum err set_create(const struct prepared_scene_desc *desc, struct prepared_scene **out, struct reason *why)
{
    *out = NULL;
    struct prepared_scene *s = mem_alloc(1, sizeof(*s));
    if (!s)
        return err_say(why, ERR_NOMEM, "out of memory");
    enum err e = load_scene(s, desc, why);
    if (!e)
        e = build_bvh(s, desc, why);
    if (!e)
        e = build_view(s, desc, why);
    if (e) {
        set_destroy(s);
        return e;
    }
    *out = s;
    return ERR_OK;
}

enum err set_create_complete(const struct prepared_scene *of, const struct prepared_scene_desc *desc,
                             struct progress *line, struct prepared_scene **out, struct reason *why)
{
    *out = NULL;
    struct prepared_scene *s = mem_alloc(1, sizeof(*s));
    if (!s)
        return err_say(why, ERR_NOMEM, "out of memory");
    memcpy(s->name, of->name, sizeof(s->name));
    memcpy(s->file, of->file, sizeof(s->file));
    s->scene = of->scene;
    s->rays = of->rays;
    s->load_ms = of->load_ms;
    s->bvh_ms = of->bvh_ms;
    s->borrowed = true;
    const enum err e = build_gbuffer(s, desc, line, why);
    if (e) {
        set_destroy(s);
        return e;
    }
    *out = s;
    return ERR_OK;
}

enum err set_create_view(const struct prepared_scene *of, const struct prepared_scene_desc *desc, struct progress *line,
                         struct prepared_scene **out, struct reason *why)
{
    struct prepared_scene_desc own = *desc;

    own.change = (struct view_change){ .has_position = false };
    return set_create_complete(of, &own, line, out, why);
}

void set_hand_over(struct prepared_scene *from, struct prepared_scene *to)
{
    from->borrowed = true;
    to->borrowed = false;
}

void set_destroy(struct prepared_scene *s)
{
    if (!s)
        return;
    gbuffer_destroy(s->gbuffer);
    if (!s->borrowed) {
        rays_destroy(s->rays);
        scene_destroy(s->scene);
    }
    mem_free(s);
}
