/* What the tests of the light tracer share: scenes of a few shapes, an image made by some seeds, and integrals over a
 * sky. */
#pragma once

#include "scene/geometry/files.h"
#include "support/skies.h"

#include "light/estimators/light_tracer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene_build.h"

#define PICTURE_MAX 64

struct stage { /* a scene, its rays and who looks at it */
    struct scene *scene;
    struct rays *rays;
    struct view view;
};

static inline uint32_t add_kind(struct scene *s, enum material_kind kind, float r, float g, float b, float ior)
{
    const struct material m = { .kind = kind, .diffuse = { r, g, b }, .ior = ior, .texture = MATERIAL_NO_TEXTURE };
    uint32_t index = 0;

    assert_int_equal(scene_add_material(s, &m, &index), ERR_OK);
    return index;
}

/* Quads in the plane across `axis` at `place`, between low and high of the next two axes. */
static inline void add_wall(struct scene *s, uint32_t material, int axis, float place, const float low[2],
                            const float high[2])
{
    float q[4][3];

    for (int k = 0; k < 4; k++) {
        q[k][axis] = place;
        q[k][(axis + 1) % 3] = k == 1 || k == 2 ? high[0] : low[0];
        q[k][(axis + 2) % 3] = k >= 2 ? high[1] : low[1];
    }
    add_quads(s, material, (const float(*)[3])q, 1);
}

/* Gives the last mesh one shading normal all over, which need not be near its own. */
static inline void tilt_last(struct scene *s, float x, float y, float z)
{
    struct mesh *m = &s->meshes[s->mesh_count - 1];
    const struct vec3 n = vec3_normalize(vec3_make(x, y, z));

    m->normals = mem_alloc(m->vertex_count, 3 * sizeof(float));
    for (uint32_t i = 0; i < m->vertex_count; i++)
        memcpy(m->normals + 3 * i, &n, sizeof(n));
}

/* The part of a sphere from polar angle `open` (radians from +Y) to the south pole, of rings x spokes quads; smooth:
 * shading normals are the sphere's. */
static inline void add_bowl(struct scene *s, uint32_t material, struct vec3 centre, float radius, double open,
                            uint32_t rings, uint32_t spokes, bool smooth)
{
    struct mesh m = { .vertex_count = (rings + 1) * spokes, .material = material };

    m.positions = mem_alloc(3 * (size_t)m.vertex_count + 1, sizeof(float));
    m.normals = smooth ? mem_alloc(m.vertex_count, 3 * sizeof(float)) : NULL;
    m.indices = mem_alloc((size_t)rings * spokes, 6 * sizeof(uint32_t));
    for (uint32_t i = 0; i <= rings; i++)
        for (uint32_t k = 0; k < spokes; k++) {
            const double theta = open + (PI - open) * i / rings, phi = 2.0 * PI * k / spokes;
            const float n[3] = { (float)(sin(theta) * sin(phi)), (float)cos(theta), (float)(sin(theta) * cos(phi)) };
            const float c[3] = { centre.x, centre.y, centre.z };
            for (int a = 0; a < 3; a++) {
                m.positions[3 * (i * spokes + k) + (uint32_t)a] = c[a] + radius * n[a];
                if (smooth)
                    m.normals[3 * (i * spokes + k) + (uint32_t)a] = n[a];
            }
        }
    for (uint32_t i = 0; i < rings; i++)
        for (uint32_t k = 0; k < spokes; k++) {
            const uint32_t next = (k + 1) % spokes, a = i * spokes + k, b = i * spokes + next;
            const uint32_t c = a + spokes, d = b + spokes;
            uint32_t *t = m.indices + 3 * (size_t)m.triangle_count;
            if (i > 0 || open > 0.0) { /* else its upper edge is a point */
                memcpy(t, (const uint32_t[3]){ a, d, b }, 3 * sizeof(*t));
                m.triangle_count++;
                t += 3;
            }
            if (i + 1 < rings) {
                memcpy(t, (const uint32_t[3]){ a, c, d }, 3 * sizeof(*t));
                m.triangle_count++;
            }
        }
    assert_int_equal(scene_add_mesh(s, &m), ERR_OK);
}

static inline struct stage stage_make(struct scene *s, struct vec3 from, struct vec3 to, double fov_degrees,
                                      uint32_t width, uint32_t height)
{
    const struct camera c = { "test", from, to, { 0, 1, 0 }, (float)(fov_degrees * PI / 180.0) };
    struct stage out = { .scene = s };
    struct reason why;

    assert_int_equal(scene_finish(s, "test", &why), ERR_OK);
    out.rays = rays_create_for(s, cpu_best());
    assert_non_null(out.rays);
    view_init(&out.view, &c, width, height);
    assert_true(width * height <= PICTURE_MAX);
    return out;
}

static inline void stage_free(struct stage *s)
{
    rays_destroy(s->rays);
    scene_destroy(s->scene);
}

/* Mean and standard error of some numbers over replicates. */
struct tally {
    double sum, squares, count;
};

static inline void tally_add(struct tally *t, double x)
{
    t->sum += x;
    t->squares += x * x;
    t->count += 1.0;
}

static inline double tally_mean(const struct tally *t)
{
    return t->sum / t->count;
}

static inline double tally_error(const struct tally *t)
{
    const double mean = t->sum / t->count;
    return sqrt(fmax(0.0, t->squares / t->count - mean * mean) / (t->count - 1.0));
}

/* Light traced by `seeds` seeds: one tally a pixel (the mean of its three colours), and one of the image's mean. */
static inline struct tally stage_trace(const struct stage *s, const struct environment *e,
                                       struct light_tracer_desc desc, uint32_t seeds, struct tally pixels[PICTURE_MAX])
{
    struct light_tracer *t = light_tracer_create(s->scene, s->rays, &s->view);
    const uint32_t count = s->view.width * s->view.height;
    struct tally whole = { 0 };

    assert_non_null(t);
    memset(pixels, 0, PICTURE_MAX * sizeof(pixels[0]));
    for (uint32_t k = 0; k < seeds; k++) {
        float rgb[3 * PICTURE_MAX] = { 0 };
        struct light_tracer_stats stats;
        double sum = 0.0;
        desc.seed++;
        assert_int_equal(light_tracer_run(t, e, &desc, rgb, &stats), ERR_OK);
        for (uint32_t i = 0; i < count; i++) {
            const double mean = ((double)rgb[3 * i] + rgb[3 * i + 1] + rgb[3 * i + 2]) / 3.0;
            tally_add(&pixels[i], mean);
            sum += mean;
        }
        tally_add(&whole, sum / count);
    }
    light_tracer_destroy(t);
    return whole;
}

/* The integral of L(w) f(w) over a sky, by 4 x 4 points a texel of its cube map; the mean of the three colours. */
static inline double sky_integral(const struct environment *e, double (*f)(const double w[3], const void *),
                                  const void *user)
{
    enum { SUB = 4 };
    double sum = 0.0;

    for (size_t t = 0; t < (size_t)CUBE_FACES * e->n * e->n; t++) {
        const struct texel *x = &e->texels[t];
        const double value = ((double)x->r + x->g + x->b) / 3.0, step = 2.0 / (e->n * SUB);
        const uint32_t face = (uint32_t)(t / (e->n * e->n)), i = (uint32_t)(t / e->n % e->n), j = (uint32_t)(t % e->n);
        for (uint32_t k = 0; value > 0.0 && k < SUB * SUB; k++) {
            const double u = -1.0 + step * (j * SUB + k % SUB + 0.5), v = -1.0 + step * (i * SUB + k / SUB + 0.5);
            const double r2 = 1.0 + u * u + v * v;
            double w[3];
            cube_direction(face, u, v, w);
            for (int c = 0; c < 3; c++)
                w[c] /= sqrt(r2);
            sum += value * f(w, user) * step * step / (r2 * sqrt(r2));
        }
    }
    return sum;
}

/* A black sky with one lit texel of 512 x 256 around a direction: a sun of 0.7 degrees. */
static inline struct environment *sky_sun_only(double elevation_degrees, double phi_degrees, float radiance)
{
    struct frame f = sky_constant(512, 256, 0.0f);
    /* phi = pi - 2 pi u, theta = pi v */
    const double u = 0.5 - phi_degrees / 360.0, v = (90.0 - elevation_degrees) / 180.0;
    sky_paint(&f, (uint32_t)((u - floor(u)) * 512.0), (uint32_t)(v * 256.0), radiance, radiance, radiance);
    return sky_environment(f, 128, 0.0);
}

/* All that a particle may meet: a floor, a glossy wall, a varnished box, and coarse balls whose shading normals are
 * those of true ones: of glass, a mirror, and matte. */
static inline struct stage busy_stage(void)
{
    struct scene *s = scene_create();
    const uint32_t matte = add_kind(s, MATERIAL_LAMBERT, 0.7f, 0.6f, 0.5f, 0.0f);
    const struct material gloss = { .kind = MATERIAL_GGX,
                                    .diffuse = { 0.8f, 0.6f, 0.4f },
                                    .metallic = 0.3f,
                                    .roughness = 0.4f,
                                    .texture = MATERIAL_NO_TEXTURE };
    const struct material polished = { .kind = MATERIAL_GGX,
                                       .diffuse = { 0.3f, 0.6f, 0.8f },
                                       .metallic = 0.0f,
                                       .roughness = 0.01f,
                                       .texture = MATERIAL_NO_TEXTURE };
    uint32_t glossy, varnished;

    assert_int_equal(scene_add_material(s, &gloss, &glossy), ERR_OK);
    assert_int_equal(scene_add_material(s, &polished, &varnished), ERR_OK);
    add_wall(s, matte, 1, 0.0f, (const float[2]){ -2.0f, -2.0f }, (const float[2]){ 2.0f, 2.0f });
    add_wall(s, glossy, 2, -1.0f, (const float[2]){ -1.0f, 0.0f }, (const float[2]){ 1.0f, 1.0f });
    tilt_last(s, 0.5f, 0.2f, 0.8f);
    add_wall(s, matte, 0, -1.0f, (const float[2]){ 0.0f, -1.0f }, (const float[2]){ 1.0f, 1.0f });
    tilt_last(s, 0.5f, 0.8f, 0.3f);
    add_box(s, varnished, (const float[3]){ -0.9f, 0.0f, 0.4f }, (const float[3]){ -0.5f, 0.3f, 0.8f });
    add_bowl(s, add_kind(s, MATERIAL_MIRROR, 0.9f, 0.8f, 0.6f, 0.0f), vec3_make(-0.5f, 0.4f, 0), 0.35f, 0.0, 10, 16,
             true);
    add_bowl(s, add_kind(s, MATERIAL_GLASS, 1.0f, 1.0f, 1.0f, 1.5f), vec3_make(0.5f, 0.5f, 0), 0.35f, 0.0, 20, 32,
             true);
    add_bowl(s, matte, vec3_make(0.0f, 0.25f, 0.6f), 0.25f, 0.0, 8, 12, true);
    return stage_make(s, vec3_make(0.6f, 1.6f, 2.6f), vec3_make(0.0f, 0.2f, 0.0f), 45.0, 8, 8);
}
