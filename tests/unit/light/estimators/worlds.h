/* Small scenes under small skies for those who follow paths, and sums over blocks of their images: the replicates are
 * seeds. */
#pragma once

#include "light/estimators/baselines/path.h"
#include "scene/geometry/files.h"
#include "support/skies.h"

#include <math.h>

struct world { /* owns what .path borrows */
    struct scene *scene;
    struct rays *rays;
    struct environment *environment;
    struct view view;
    struct path_world path;
};

/* Takes the scene and the sky. Do not move it: .path points into it. */
static inline void world_make(struct world *w, struct scene *scene, const struct camera *camera, uint32_t width,
                              uint32_t height, struct environment *sky)
{
    if (scene->triangle_count == 0) /* made by hand: its bounds are still to be found */
        assert_int_equal(scene_finish(scene, "a scene made by hand", NULL), ERR_OK);
    w->scene = scene;
    w->rays = rays_create_for(scene, cpu_best());
    w->environment = sky;
    assert_true(w->scene && w->rays && w->environment);
    view_init(&w->view, camera, width, height);
    w->path = (struct path_world){ scene, w->rays, &w->view, sky, NULL };
}

static inline void world_finish(struct world *w)
{
    rays_destroy(w->rays);
    scene_destroy(w->scene);
    environment_destroy(w->environment);
}

static inline uint32_t add_stuff(struct scene *s, struct material m)
{
    uint32_t index = 0;

    m.texture = MATERIAL_NO_TEXTURE;
    assert_int_equal(scene_add_material(s, &m, &index), ERR_OK);
    return index;
}

static const struct camera corner_camera = { "corner", { 3.0f, 2.5f, 4.0f }, { 0, 0.6f, 0 }, { 0, 1, 0 }, 0.6f };

/* A floor and a wall, boxes of mirror and glass on it, and a matte card inside the glass. Flat, so that albedo 1 keeps
 * all light: smooth normals would lose some. No narrow gaps, in which white walls would pass light on for ever. */
static inline struct scene *corner_scene(float albedo, float reflectance)
{
    static const float sides[2][4][3] = { { { -3, 0, -2 }, { -3, 0, 3 }, { 3, 0, 3 }, { 3, 0, -2 } },
                                          { { -3, 0, -2 }, { 3, 0, -2 }, { 3, 3, -2 }, { -3, 3, -2 } } };
    static const float card[4][3] = {
        { 0.7f, 0.4f, 0.2f }, { 1.1f, 0.4f, 0.2f }, { 1.1f, 0.9f, 0.1f }, { 0.7f, 0.9f, 0.1f }
    };
    struct scene *s = scene_create();

    const uint32_t matte = add_lambert(s, albedo);
    const uint32_t mirror = add_stuff(
        s, (struct material){ .kind = MATERIAL_MIRROR, .diffuse = { reflectance, reflectance, reflectance } });
    const uint32_t glass =
        add_stuff(s, (struct material){ .kind = MATERIAL_GLASS, .diffuse = { 1, 1, 1 }, .ior = 1.5f });
    add_quads(s, matte, sides[0], 2);
    add_quads(s, matte, card, 1);
    add_box(s, mirror, (const float[3]){ -1.2f, -0.5f, -0.7f }, (const float[3]){ -0.3f, 1.2f, 0.3f });
    add_box(s, glass, (const float[3]){ 0.4f, 0.25f, -0.4f }, (const float[3]){ 1.4f, 1.1f, 0.6f });
    return s;
}

/* Means over blocks of an image, and how they vary from seed to seed. */
#define BLOCKS_MAX 64
struct blocks {
    uint32_t across, down; /* of the image */
    uint32_t seeds;
    double sum[BLOCKS_MAX], squares[BLOCKS_MAX];
};

/* Adds one seed's image: luminance, masked where mask (may be NULL) is 0. */
static inline void blocks_add(struct blocks *b, const float *rgb, const uint8_t *mask, uint32_t width, uint32_t height)
{
    double sum[BLOCKS_MAX] = { 0 }, count[BLOCKS_MAX] = { 0 };

    assert_true(b->across * b->down <= BLOCKS_MAX);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const size_t i = (size_t)y * width + x;
            const uint32_t k = y * b->down / height * b->across + x * b->across / width;
            if (mask && !mask[i])
                continue;
            sum[k] += rgb_luminance(rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]);
            count[k] += 1.0;
        }
    for (uint32_t k = 0; k < b->across * b->down; k++) {
        const double mean = count[k] > 0.0 ? sum[k] / count[k] : 0.0;
        b->sum[k] += mean;
        b->squares[k] += mean * mean;
    }
    b->seeds++;
}

static inline double blocks_mean(const struct blocks *b, uint32_t k)
{
    return b->sum[k] / b->seeds;
}

/* Standard error of the mean. */
static inline double blocks_error(const struct blocks *b, uint32_t k)
{
    const double mean = blocks_mean(b, k);
    return sqrt(fmax(0.0, b->squares[k] / b->seeds - mean * mean) / (b->seeds - 1));
}

/* The largest of |a - b| / standard error over the blocks; prints those beyond `limit`. */
static inline double blocks_worst(const char *what, const struct blocks *a, const struct blocks *b, double limit)
{
    double worst = 0.0;

    for (uint32_t k = 0; k < a->across * a->down; k++) {
        const double ma = blocks_mean(a, k), mb = blocks_mean(b, k);
        const double error = sqrt(pow(blocks_error(a, k), 2.0) + pow(blocks_error(b, k), 2.0)) + 1e-12;
        const double z = fabs(ma - mb) / error;
        if (z > limit)
            printf("%s, block %u: %.6f against %.6f, standard error %.2e\n", what, k, ma, mb, error);
        worst = fmax(worst, z);
    }
    return worst;
}

/* Mean over the image and its error, relative. */
static inline double blocks_precision(const struct blocks *b)
{
    double mean = 0.0, square = 0.0;

    for (uint32_t k = 0; k < b->across * b->down; k++) {
        mean += blocks_mean(b, k);
        square += pow(blocks_error(b, k), 2.0);
    }
    return sqrt(square) / mean;
}
