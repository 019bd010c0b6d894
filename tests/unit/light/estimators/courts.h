/* Flat scenes made for tests of paths: boxes and balls of any material, shaded by eye paths; and sums over seeds. */
#pragma once

#include "light/estimators/eye_paths.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/scene.h"
#include "support/skies.h"

/* An empty scene with a camera. */
static inline struct scene *scene_from(struct vec3 eye, struct vec3 target, float fov_y)
{
    struct scene *s = mem_alloc(1, sizeof(*s));
    s->meshes = mem_alloc(16, sizeof(*s->meshes));
    s->materials = mem_alloc(16, sizeof(*s->materials));
    s->cameras = mem_alloc(1, sizeof(*s->cameras));
    s->cameras[0] = (struct camera){ .position = eye, .look_at = target, .up = { 0, 1, 0 }, .fov_y = fov_y };
    s->camera_count = 1;
    return s;
}

/* Each mesh has a material of its own; flat. */
static inline struct mesh *add_mesh(struct scene *s, struct material m, uint32_t vertices, uint32_t triangles)
{
    struct mesh *out = &s->meshes[s->mesh_count++];
    assert_true(s->mesh_count <= 16);
    m.texture = MATERIAL_NO_TEXTURE;
    out->material = (uint32_t)s->material_count;
    s->materials[s->material_count++] = m;
    out->positions = mem_alloc(3 * (size_t)vertices + 1, sizeof(float));
    out->indices = mem_alloc(3 * (size_t)triangles, sizeof(uint32_t));
    out->vertex_count = vertices;
    out->triangle_count = triangles;
    s->triangle_count += triangles;
    return out;
}

static inline void add_box(struct scene *s, struct material m, struct vec3 low, struct vec3 high)
{
    static const uint32_t faces[6][4] = { { 0, 4, 6, 2 }, { 1, 3, 7, 5 }, { 0, 1, 5, 4 },
                                          { 2, 6, 7, 3 }, { 0, 2, 3, 1 }, { 4, 5, 7, 6 } };
    struct mesh *b = add_mesh(s, m, 8, 12);
    for (int i = 0; i < 8; i++) {
        b->positions[3 * i] = i & 1 ? high.x : low.x;
        b->positions[3 * i + 1] = i & 2 ? high.y : low.y;
        b->positions[3 * i + 2] = i & 4 ? high.z : low.z;
    }
    for (uint32_t f = 0; f < 6; f++) {
        const uint32_t *q = faces[f], two[6] = { q[0], q[1], q[2], q[0], q[2], q[3] };
        memcpy(b->indices + 6 * f, two, sizeof(two));
    }
}

/* Rows of latitude from `first` on: with first > 0 the top is open. Counter-clockwise from outside. */
static inline void add_sphere(struct scene *s, struct material m, struct vec3 centre, float radius, uint32_t rows,
                              uint32_t first)
{
    const uint32_t columns = 2 * rows;
    struct mesh *b = add_mesh(s, m, (rows + 1) * columns, 2 * rows * columns);
    uint32_t triangles = 0;
    for (uint32_t i = 0; i <= rows; i++)
        for (uint32_t j = 0; j < columns; j++) {
            const double theta = PI * i / rows, phi = 2.0 * PI * j / columns;
            float *v = b->positions + 3 * (i * columns + j);
            v[0] = centre.x + radius * (float)(sin(theta) * sin(phi));
            v[1] = centre.y + radius * (float)cos(theta);
            v[2] = centre.z + radius * (float)(sin(theta) * cos(phi));
        }
    for (uint32_t i = first; i < rows; i++)
        for (uint32_t j = 0; j < columns; j++) {
            const uint32_t a = i * columns + j, next = i * columns + (j + 1) % columns;
            const uint32_t upper[3] = { a, a + columns, next }, lower[3] = { next, a + columns, next + columns };
            if (i > 0) /* at the poles one of the two has no area */
                memcpy(b->indices + 3 * triangles++, upper, sizeof(upper));
            if (i < rows - 1)
                memcpy(b->indices + 3 * triangles++, lower, sizeof(lower));
        }
    s->triangle_count += triangles;
    s->triangle_count -= b->triangle_count;
    b->triangle_count = triangles;
}

static inline struct material lambert(float albedo)
{
    return (struct material){ .kind = MATERIAL_LAMBERT, .diffuse = { albedo, albedo, albedo } };
}

static inline struct material mirror(float r, float g, float b)
{
    return (struct material){ .kind = MATERIAL_MIRROR, .diffuse = { r, g, b } };
}

static inline struct material glass(float ior)
{
    return (struct material){ .kind = MATERIAL_GLASS, .diffuse = { 1, 1, 1 }, .ior = ior };
}

struct lit {
    struct scene *scene;
    struct rays *rays;
    struct gbuffer *gbuffer;
    size_t size; /* of lo */
    float *lo;
};

static inline struct lit lit_create(struct scene *scene, uint32_t width, uint32_t height)
{
    struct lit x = { .scene = scene, .rays = rays_create_for(scene, cpu_best()) };
    struct reason why;
    const struct gbuffer_desc desc = { .camera = scene->cameras, .width = width, .height = height, .edge_rays = 1 };
    assert_non_null(x.rays);
    assert_int_equal(gbuffer_create(scene, x.rays, &desc, &x.gbuffer, &why), ERR_OK);
    x.size = (size_t)x.gbuffer->packet_count * 3 * PACKET;
    x.lo = mem_alloc(x.size, sizeof(float));
    return x;
}

static inline void lit_destroy(struct lit *x)
{
    mem_free(x->lo);
    gbuffer_destroy(x->gbuffer);
    rays_destroy(x->rays);
    scene_destroy(x->scene);
}

/* Adds eye paths to x->lo. */
static inline struct eye_paths_stats walk(struct lit *x, const struct environment *e, uint32_t classes,
                                          uint32_t behind_classes, uint32_t paths, uint64_t seed)
{
    struct eye_paths_stats stats;
    const struct eye_paths_desc desc = {
        .classes = classes, .behind_classes = behind_classes, .paths = paths, .seed = seed
    };
    assert_int_equal(eye_paths_shade(x->scene, x->rays, x->gbuffer, e, &desc, x->lo, &stats), ERR_OK);
    return stats;
}

static inline void clear(struct lit *x)
{
    memset(x->lo, 0, x->size * sizeof(float));
}

/* Sums of a quantity over replicates. */
struct tally {
    double sum, squares;
    uint32_t count;
};

static inline void tally_add(struct tally *t, double v)
{
    t->sum += v;
    t->squares += v * v;
    t->count++;
}

static inline double tally_mean(const struct tally *t)
{
    return t->sum / t->count;
}

/* Standard error of the mean; never below what float sums leave. */
static inline double tally_error(const struct tally *t)
{
    const double mean = tally_mean(t);
    return sqrt(fmax(0.0, t->squares / t->count - mean * mean) / (t->count - 1)) + 2e-6;
}

/* Whether the mean is `want` within `limit` standard errors, these being below `error_limit` of it. */
static inline void check_mean(const char *what, const struct tally *t, double want, double limit, double error_limit)
{
    const double mean = tally_mean(t), error = tally_error(t);
    printf("%s: %.5f +- %.5f, want %.5f\n", what, mean, error, want);
    assert_true(error < error_limit * want);
    assert_true(fabs(mean - want) < limit * error);
}

/* A court with walls, a block, a mirror and a ball of glass, all of which send back or let through what comes. */
static inline struct scene *white_court(void)
{
    struct scene *s = scene_from(vec3_make(0.5f, 2.2f, 4.5f), vec3_make(0, 0.5f, 0), 0.8f);
    add_box(s, lambert(1), vec3_make(-3, -0.2f, -3), vec3_make(3, 0, 3));
    add_box(s, lambert(1), vec3_make(-3, 0, -2.2f), vec3_make(3, 2, -2));
    add_box(s, lambert(1), vec3_make(-2.2f, 0, -2), vec3_make(-2, 2, 2));
    add_box(s, lambert(1), vec3_make(-0.5f, 0.3f, -1.5f), vec3_make(0.5f, 1.2f, -0.6f));
    add_box(s, mirror(1, 1, 1), vec3_make(1.4f, 0, -1.5f), vec3_make(1.5f, 1.6f, 1.5f));
    add_sphere(s, glass(1.5f), vec3_make(0, 0.6f, 0.8f), 0.5f, 12, 0);
    return s;
}

/* Every kind of surface: matte, shiny, rough metal, a glazed one with both lobes, mirror, glass, a glass shell about a
 * matte ball; smooth normals nowhere. */
static inline struct scene *mixed_court(void)
{
    struct scene *s = white_court();
    s->materials[0].diffuse = vec3_make(0.6f, 0.5f, 0.3f);
    s->materials[1].diffuse = vec3_make(0.2f, 0.7f, 0.4f);
    s->materials[2] = (struct material){ .kind = MATERIAL_PHONG,
                                         .diffuse = { 0.4f, 0.3f, 0.2f },
                                         .specular = { 0.4f, 0.5f, 0.5f },
                                         .exponent = 40.0f,
                                         .texture = MATERIAL_NO_TEXTURE };
    s->materials[3] = (struct material){
        .kind = MATERIAL_GGX, .diffuse = { 0.7f, 0.4f, 0.5f }, .metallic = 0.5f, .texture = MATERIAL_NO_TEXTURE
    };
    s->materials[4].diffuse = vec3_make(0.9f, 0.8f, 0.7f);
    add_sphere(s, lambert(0.7f), vec3_make(0, 0.6f, 0.8f), 0.3f, 10, 0);
    add_box(
        s, (struct material){ .kind = MATERIAL_GGX, .diffuse = { 0.9f, 0.7f, 0.4f }, .metallic = 1, .roughness = 0.5f },
        vec3_make(-1.6f, 0, 0.2f), vec3_make(-0.9f, 0.7f, 0.9f));
    return s;
}
