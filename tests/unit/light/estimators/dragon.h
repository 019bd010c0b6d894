/* The scene `dragon` under a captured sky, as RELIGHT_TEST_DATA has them. */
#pragma once

#include "scene/geometry/gbuffer.h"
#include "scene/geometry/load.h"
#include "support/skies.h"

/* `dragon` under one frame of the day. */
struct dragon_view {
    struct scene *scene;
    struct rays *rays;
    struct gbuffer *g;
    struct environment *e;
};

static inline struct environment *load_sky(const char *path, uint32_t n)
{
    struct reason why = { "" };
    struct frame f = { 0 };
    struct environment *e = environment_create(&(struct environment_desc){ .n = n });
    FILE *file = fopen(path, "rb");

    assert_non_null(e);
    assert_non_null(file);
    assert_int_equal(fseek(file, 0, SEEK_END), 0);
    const size_t size = (size_t)ftell(file);
    rewind(file);
    assert_int_equal(frame_reserve_bytes(&f, size), ERR_OK);
    assert_int_equal(fread(f.bytes, 1, size, file), size);
    fclose(file);
    snprintf(f.name, sizeof(f.name), "%.200s", path);
    if (environment_update(e, &f, &why))
        fail_msg("%s", why.text);
    frame_finish(&f);
    return e;
}

static inline struct dragon_view view_load(uint32_t width, uint32_t height, const char *sky)
{
    struct dragon_view v = { .e = load_sky(unit_data(sky), 256),
                             .scene = load_or_fail(unit_data("../scenes/dragon.json")) };
    struct reason why = { "" };

    v.rays = rays_create_for(v.scene, cpu_best());
    assert_non_null(v.rays);
    const struct gbuffer_desc d = {
        .camera = scene_camera(v.scene, NULL), .width = width, .height = height, .edge_rays = 1
    };
    assert_int_equal(gbuffer_create(v.scene, v.rays, &d, &v.g, &why), ERR_OK);
    return v;
}

static inline void view_free(struct dragon_view *v)
{
    gbuffer_destroy(v->g);
    rays_destroy(v->rays);
    scene_destroy(v->scene);
    environment_destroy(v->e);
}
