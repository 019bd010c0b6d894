/* Scenes of quads, seen from the front. */
#pragma once

#include "scene/geometry/files.h"
#include "support/gbuffers.h"

/* 64 x 64 pixels that span -1..1 at distance 1: a pixel is 1/32 m there. The camera looks along -z, x to the right. */
static const struct camera front = { "front", { 0, 0, 1 }, { 0, 0, 0 }, { 0, 1, 0 }, (float)PI / 2.0f };

struct view {
    struct scene *scene;
    struct rays *rays;
    struct gbuffer *g;
};

/* A scene of one grey mesh of quads, seen from the front. */
static inline struct view view_quads(const float (*corners)[3], uint32_t quads, uint32_t edge_rays)
{
    const struct gbuffer_desc d = { .camera = &front, .width = 64, .height = 64, .edge_rays = edge_rays };
    struct view v = { .scene = scene_create() };

    add_quads(v.scene, add_lambert(v.scene, 0.5f), corners, quads);
    assert_int_equal(scene_finish(v.scene, "quads", NULL), ERR_OK);
    v.rays = rays_create_for(v.scene, cpu_best());
    v.g = gbuffer_of(v.scene, v.rays, &d);
    return v;
}

static inline void view_end(struct view *v)
{
    gbuffer_destroy(v->g);
    rays_destroy(v->rays);
    scene_destroy(v->scene);
}

static inline float weight_of_points(const struct gbuffer *g, uint32_t x, uint32_t y)
{
    const size_t i = (size_t)y * g->width + x;
    float sum = 0.0f;

    for (uint32_t k = g->entry_first[i]; k < g->entry_first[i + 1]; k++)
        sum += g->entries[k].weight[1];
    return sum;
}
