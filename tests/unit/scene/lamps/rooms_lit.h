/* Small scenes with lamps of their own before a camera, and the images of their light. */
#pragma once

#include "light/estimators/worlds.h"
#include "light/frame/relight_lamps.h"
#include "support/gbuffers.h"

#include <time.h>

struct lit { /* a scene before a camera */
    struct prepared_scene set;
    bool denoise; /* of the lamps' part; false at first */
};

/* Takes the scene. Without `edges` every pixel has the ray through its centre alone. */
static inline void lit_make(struct lit *l, struct scene *scene, const struct camera *camera, uint32_t width,
                            uint32_t height, bool edges)
{
    const struct gbuffer_desc desc = { .camera = camera, .width = width, .height = height, .edge_rays = edges ? 0 : 1 };

    assert_int_equal(scene_finish(scene, "a scene made by hand", NULL), ERR_OK);
    *l = (struct lit){
        .set = { .name = "a scene made by hand", .scene = scene, .rays = rays_create_for(scene, cpu_best()) }
    };
    assert_non_null(l->set.rays);
    l->set.gbuffer = gbuffer_of(scene, l->set.rays, &desc);
    view_init(&l->set.view, camera, width, height);
}

static inline void lit_finish(struct lit *l)
{
    gbuffer_destroy(l->set.gbuffer);
    rays_destroy(l->set.rays);
    scene_destroy(l->set.scene);
}

static inline struct relight_lamps *lit_part_begin(const struct lit *l, uint32_t samples, uint64_t seed)
{
    const struct relight_lamps_desc desc = { .set = &l->set, .samples = samples, .seed = seed, .denoise = l->denoise };
    struct relight_lamps *part = NULL;
    struct reason why = { "" };

    assert_int_equal(relight_lamps_create(&desc, &part, &why), ERR_OK);
    assert_non_null(part);
    return part;
}

/* The lamps' part after so many samples. */
static inline struct relight_lamps *lit_part(const struct lit *l, uint32_t samples, uint64_t seed)
{
    struct relight_lamps *part = lit_part_begin(l, samples, seed);
    struct reason why = { "" };

    assert_int_equal(relight_lamps_complete(part, false, &why), ERR_OK);
    return part;
}

static inline void lit_take(const struct lit *l, struct relight_lamps *part, float *rgb)
{
    memset(rgb, 0, 3 * sizeof(float) * l->set.gbuffer->width * l->set.gbuffer->height);
    relight_lamps_add(part, 1.0, rgb);
    relight_lamps_destroy(part);
}

static inline void lit_render(const struct lit *l, uint32_t samples, uint64_t seed, float *rgb)
{
    lit_take(l, lit_part(l, samples, seed), rgb);
}

/* As lit_render, on a thread of the part's own. */
static inline void lit_render_beside(const struct lit *l, uint32_t samples, uint64_t seed, float *rgb)
{
    struct relight_lamps *part = lit_part_begin(l, samples, seed);
    struct reason why = { "" };

    assert_int_equal(relight_lamps_start(part, &why), ERR_OK);
    while (!relight_lamps_is_complete(part))
        nanosleep(&(struct timespec){ .tv_nsec = 1000000 }, NULL);
    assert_int_equal(relight_lamps_samples(part), samples);
    lit_take(l, part, rgb);
}

/* The point that a pixel shows, if it is a single one. */
static inline bool lit_point(const struct lit *l, size_t pixel, struct vec3 *at)
{
    const struct gbuffer *g = l->set.gbuffer;

    if (g->entry_first[pixel + 1] - g->entry_first[pixel] != 1)
        return false;
    const uint32_t point = g->entries[g->entry_first[pixel]].point;
    const struct shade_packet *p = &g->packets[point / PACKET];
    *at = vec3_make(p->x[point % PACKET], p->y[point % PACKET], p->z[point % PACKET]);
    return true;
}

static inline uint32_t add_glowing(struct scene *s, float albedo, struct vec3 emission)
{
    return add_stuff(s, (struct material){ .diffuse = { albedo, albedo, albedo },
                                           .emission = emission,
                                           .emission_texture = MATERIAL_NO_TEXTURE });
}

static inline void add_light(struct scene *s, struct punctual_light l)
{
    assert_int_equal(light_check(&l, "a light made by hand", NULL), ERR_OK);
    assert_int_equal(scene_add_light(s, &l), ERR_OK);
}

/* A floor at y = 0, seen from above. */
static const float floor_corners[4][3] = { { -9, 0, -9 }, { -9, 0, 9 }, { 9, 0, 9 }, { 9, 0, -9 } };
static const struct camera above = { "above", { 0, 6, 4 }, { 0, 0, 0 }, { 0, 1, 0 }, 0.7f, PROJECTION_PERSPECTIVE };

/* A rectangle at height y that faces down, from (x0, z0) to (x1, z1). */
static inline void add_panel(struct scene *s, uint32_t material, const float x[2], float y, const float z[2])
{
    const float q[4][3] = { { x[0], y, z[0] }, { x[1], y, z[0] }, { x[1], y, z[1] }, { x[0], y, z[1] } };

    add_quads(s, material, q, 1);
}

/* The irradiance of a horizontal surface at `at` by a panel of radiance 1 above: pi times the form factor, which is a
 * sum over the rectangles between its corners and the foot of the normal [Howell, A Catalog of Radiation Heat Transfer
 * Configuration Factors, C-11]. */
static inline double panel_irradiance(const float x[2], float y, const float z[2], struct vec3 at)
{
    double sum = 0.0;

    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++) {
            const double a = (x[i] - at.x) / (y - at.y), b = (z[j] - at.z) / (y - at.y);
            const double ra = sqrt(1.0 + a * a), rb = sqrt(1.0 + b * b);
            sum += (i == j ? 0.5 : -0.5) * (a / ra * atan(b / ra) + b / rb * atan(a / rb));
        }
    return fabs(sum);
}
