/* The built-in scene: a court with a sundial that shows the hour under the built-in sky. North is +Z, as in the sky:
 * the sun rises at -X, is over -Z at noon and sets at +X; the colonnade opens to the south. */
#include "import/reader/reader.h"

#include "import/reader/shape.h"
#include "scene/geometry/scene_build.h"

#include <math.h>

#define TAU (2.0f * (float)PI)
#define LATITUDE (45.0f * (float)PI / 180.0f) /* the sundial's latitude, the sky's default */

enum stuff {
    STUFF_GROUND,
    STUFF_PAVING_PALE,
    STUFF_PAVING_DARK,
    STUFF_STONE,
    STUFF_MARBLE,
    STUFF_PLASTER,
    STUFF_BRONZE,
    STUFF_GLAZE,
    STUFF_CLAY,
    STUFF_LEAVES,
    STUFF_COUNT
};

static const struct material stuffs[STUFF_COUNT] = {
    [STUFF_GROUND] = { .name = "ground", .diffuse = { 0.47f, 0.38f, 0.28f } },
    [STUFF_PAVING_PALE] = { .name = "pale paving", .diffuse = { 0.62f, 0.54f, 0.43f } },
    [STUFF_PAVING_DARK] = { .name = "dark paving", .diffuse = { 0.50f, 0.40f, 0.30f } },
    [STUFF_STONE] = { .name = "stone", .diffuse = { 0.66f, 0.59f, 0.49f } },
    [STUFF_MARBLE] = { .name = "marble", .diffuse = { 0.76f, 0.73f, 0.67f } },
    [STUFF_PLASTER] = { .name = "plaster", .diffuse = { 0.52f, 0.17f, 0.10f } },
    [STUFF_BRONZE] = { .name = "bronze",
                       .kind = MATERIAL_PHONG,
                       .diffuse = { 0.20f, 0.12f, 0.05f },
                       .specular = { 0.62f, 0.44f, 0.20f },
                       .exponent = 100.0f },
    [STUFF_GLAZE] = { .name = "glaze",
                      .kind = MATERIAL_PHONG,
                      .diffuse = { 0.02f, 0.11f, 0.28f },
                      .specular = { 0.35f, 0.37f, 0.40f },
                      .exponent = 300.0f },
    [STUFF_CLAY] = { .name = "clay",
                     .kind = MATERIAL_PHONG,
                     .diffuse = { 0.50f, 0.20f, 0.09f },
                     .specular = { 0.10f, 0.10f, 0.10f },
                     .exponent = 40.0f },
    [STUFF_LEAVES] = { .name = "leaves", .diffuse = { 0.07f, 0.13f, 0.05f } },
};

static struct vec3 sphere_at(float u, float v, const void *data)
{
    const float r = *(const float *)data, a = TAU * u, b = (float)PI * v;
    return vec3_make(r * sinf(b) * sinf(a), -r * cosf(b), r * sinf(b) * cosf(a));
}

struct torus {
    float ring, tube;
    struct vec3 axis_a, axis_b; /* unit, span the ring's plane */
};

static struct vec3 torus_at(float u, float v, const void *data)
{
    const struct torus *t = data;
    const float a = TAU * u, b = TAU * v;
    const struct vec3 out = vec3_add(vec3_scale(t->axis_a, cosf(a)), vec3_scale(t->axis_b, sinf(a)));
    const struct vec3 across = vec3_cross(t->axis_a, t->axis_b);
    return vec3_add(vec3_scale(out, t->ring + t->tube * cosf(b)), vec3_scale(across, t->tube * sinf(b)));
}

/* A profile of radii and heights, interpolated by a Catmull-Rom spline and rotated about Y. */
struct lathe {
    const float (*points)[2]; /* radius, height; from bottom to top */
    uint32_t count;
};

static float spline(float a, float b, float c, float d, float t)
{
    return b + 0.5f * t * (c - a + t * (2.0f * a - 5.0f * b + 4.0f * c - d + t * (3.0f * (b - c) + d - a)));
}

static struct vec3 lathe_at(float u, float v, const void *data)
{
    const struct lathe *l = data;
    const float x = fminf(fmaxf(v, 0.0f), 1.0f) * (float)(l->count - 1);
    const uint32_t i = x >= (float)(l->count - 1) ? l->count - 2 : (uint32_t)x;
    const uint32_t before = i > 0 ? i - 1 : 0, after = i + 2 < l->count ? i + 2 : l->count - 1;
    const float t = x - (float)i, a = TAU * u;
    const float r = spline(l->points[before][0], l->points[i][0], l->points[i + 1][0], l->points[after][0], t);
    const float y = spline(l->points[before][1], l->points[i][1], l->points[i + 1][1], l->points[after][1], t);
    return vec3_make(r * sinf(a), y, r * cosf(a));
}

static void add_lathe(struct shape *s, const float (*points)[2], uint32_t count, uint32_t columns, uint32_t rows)
{
    const struct lathe l = { points, count };
    shape_grid(s, columns, rows, &(struct surface_map){ lathe_at, &l, true });
}

/* A fluted shaft that tapers upwards, slightly convex (entasis). */
static struct vec3 shaft_at(float u, float v, const void *data)
{
    const float height = *(const float *)data;
    const float taper = 0.30f - 0.05f * v + 0.018f * sinf((float)PI * v);
    const float flute = 0.022f * fabsf(sinf(0.5f * 20.0f * TAU * u)) - 0.011f;
    const float a = TAU * u, r = taper - flute;
    return vec3_make(r * sinf(a), height * v, r * cosf(a));
}

static void add_column(struct shape *s, float radius, float angle)
{
    static const float base[][2] = { { 0.40f, 0.12f }, { 0.43f, 0.17f }, { 0.40f, 0.22f }, { 0.34f, 0.24f },
                                     { 0.33f, 0.27f }, { 0.36f, 0.30f }, { 0.33f, 0.33f }, { 0.30f, 0.34f } };
    static const float capital[][2] = { { 0.25f, 3.48f }, { 0.28f, 3.52f }, { 0.27f, 3.56f },
                                        { 0.31f, 3.63f }, { 0.38f, 3.70f }, { 0.40f, 3.74f } };
    const float height = 3.2f, x = radius * sinf(angle), z = radius * cosf(angle);

    shape_place(s, x, 0.36f, z, angle);
    shape_box(s, vec3_make(-0.45f, 0.0f, -0.45f), vec3_make(0.45f, 0.12f, 0.45f));
    add_lathe(s, base, 8, 32, 12);
    add_lathe(s, capital, 6, 32, 8);
    shape_box(s, vec3_make(-0.43f, 3.74f, -0.43f), vec3_make(0.43f, 3.88f, 0.43f));
    shape_place(s, x, 0.36f + 0.33f, z, angle);
    shape_grid(s, 120, 4, &(struct surface_map){ shaft_at, &height, true });
    shape_place(s, 0.0f, 0.0f, 0.0f, 0.0f);
}

static enum err add_ground(struct scene *scene)
{
    struct shape s = { 0 };

    shape_box(&s, vec3_make(-80.0f, -0.5f, -80.0f), vec3_make(80.0f, 0.0f, 80.0f));
    return shape_finish(&s, scene, STUFF_GROUND);
}

/* Rings of paving stones around the dial, with open joints. */
static enum err add_paving(struct scene *scene, bool dark)
{
    static const float radii[] = { 3.9f, 4.75f, 5.6f, 6.45f };
    struct shape s = { 0 };

    for (uint32_t ring = 0; ring + 1 < sizeof(radii) / sizeof(radii[0]); ring++) {
        const uint32_t stones = 24;
        for (uint32_t i = 0; i < stones; i++) {
            if (((i + ring) % 2 == 1) != dark)
                continue;
            const float joint = 0.02f / radii[ring];
            const struct sector k = {
                .inner = radii[ring] + 0.02f,
                .outer = radii[ring + 1] - 0.02f,
                .from = TAU * (float)i / (float)stones + joint,
                .to = TAU * (float)(i + 1) / (float)stones - joint,
                .low = -0.1f,
                .high = 0.03f,
                .parts = 4,
            };
            shape_sector(&s, &k);
        }
    }
    return shape_finish(&s, scene, dark ? STUFF_PAVING_DARK : STUFF_PAVING_PALE);
}

/* Three round steps up to the dial, and the two long steps of the colonnade. */
static enum err add_steps(struct scene *scene)
{
    struct shape s = { 0 };

    for (int i = 0; i < 3; i++) {
        const struct sector step = {
            .outer = 3.7f - 0.4f * (float)i,
            .to = TAU,
            .low = 0.16f * (float)i - (i ? 0.0f : 0.1f),
            .high = 0.16f * (float)(i + 1),
            .parts = 96,
        };
        shape_sector(&s, &step);
    }
    for (int i = 0; i < 2; i++) {
        const struct sector step = {
            .inner = 6.9f + 0.35f * (float)i,
            .outer = 10.2f,
            .from = -1.75f,
            .to = 1.75f,
            .low = 0.18f * (float)i - (i ? 0.0f : 0.1f),
            .high = 0.18f * (float)(i + 1),
            .parts = 64,
        };
        shape_sector(&s, &step);
    }
    return shape_finish(&s, scene, STUFF_STONE);
}

static enum err add_colonnade(struct scene *scene)
{
    const struct sector beam = { 7.62f, 8.38f, -1.66f, 1.66f, 4.24f, 4.62f, 64 };
    const struct sector cornice = { 7.48f, 8.52f, -1.675f, 1.675f, 4.62f, 4.78f, 64 };
    struct shape s = { 0 };

    for (int i = 0; i < 11; i++)
        add_column(&s, 8.0f, 1.6f * (float)(i - 5) / 5.0f);
    shape_sector(&s, &beam);
    shape_sector(&s, &cornice);
    return shape_finish(&s, scene, STUFF_MARBLE);
}

static enum err add_wall(struct scene *scene)
{
    const struct sector wall = { 9.6f, 9.9f, -1.68f, 1.68f, 0.3f, 3.0f, 64 };
    struct shape s = { 0 };

    shape_sector(&s, &wall);
    return shape_finish(&s, scene, STUFF_PLASTER);
}

/* The gnomon's edge points at the celestial pole. Hour lines satisfy tan(line) = sin(latitude) tan(hour angle) [Waugh
 * 1973, chapter 4], from six to six. */
static enum err add_sundial(struct scene *scene)
{
    const float foot = -1.1f, top = 2.3f;
    const float blade[][2] = { { foot, 0.48f },
                               { foot + top / tanf(LATITUDE), 0.48f + top },
                               { foot + top / tanf(LATITUDE) + 0.12f, 0.48f + top },
                               { foot + 1.7f, 0.48f } };
    const struct sector rim = { 2.55f, 2.65f, 0.0f, TAU, 0.47f, 0.51f, 96 };
    struct shape s = { 0 };

    shape_plate(&s, blade, 4, 0.16f);
    shape_sector(&s, &rim);
    for (int hour = -6; hour <= 6; hour++) {
        const float h = (float)hour * (float)PI / 12.0f;
        /* the shadow falls away from the sun: to the west, +X, in the morning */
        const float line = atan2f(sinf(LATITUDE) * sinf(h), cosf(h));
        const float width = hour % 3 == 0 ? 0.045f : 0.022f;
        shape_place(&s, 0.0f, 0.48f, foot, -line);
        const float a = foot * cosf(line);
        const float reach = -a + sqrtf(a * a - foot * foot + 2.55f * 2.55f); /* from the foot to the rim */
        shape_box(&s, vec3_make(-width, -0.01f, 0.55f * reach), vec3_make(width, 0.02f, reach));
    }
    return shape_finish(&s, scene, STUFF_BRONZE);
}

static enum err add_plinths(struct scene *scene)
{
    static const float places[][2] = { { 4.3f, -3.3f }, { -4.4f, -1.0f }, { -3.0f, -5.0f } };
    static const float heights[] = { 1.0f, 0.85f, 0.45f };
    struct shape s = { 0 };

    for (int i = 0; i < 3; i++) {
        const float h = heights[i];
        shape_place(&s, places[i][0], 0.0f, places[i][1], 0.4f * (float)i + 0.3f);
        shape_box(&s, vec3_make(-0.55f, -0.1f, -0.55f), vec3_make(0.55f, 0.14f, 0.55f));
        shape_box(&s, vec3_make(-0.44f, 0.14f, -0.44f), vec3_make(0.44f, h - 0.1f, 0.44f));
        shape_box(&s, vec3_make(-0.52f, h - 0.1f, -0.52f), vec3_make(0.52f, h, 0.52f));
    }
    return shape_finish(&s, scene, STUFF_MARBLE);
}

/* Rings for the equator, the meridian and the ecliptic around a small globe. */
static enum err add_armillary(struct scene *scene)
{
    const float c = cosf(LATITUDE), n = sinf(LATITUDE), globe = 0.16f;
    const struct vec3 east = { 1.0f, 0.0f, 0.0f };
    const struct torus rings[] = {
        { 0.72f, 0.035f, { 0.0f, 1.0f, 0.0f }, { 0.0f, 0.0f, 1.0f } },
        { 0.64f, 0.045f, east, { 0.0f, c, -n } },
        { 0.56f, 0.030f, { 0.92f, 0.0f, 0.39f }, { -0.25f, 0.77f, 0.59f } },
        { 0.72f, 0.035f, { 0.7071f, 0.7071f, 0.0f }, { 0.0f, 0.0f, 1.0f } },
    };
    static const float stand[][2] = { { 0.30f, 0.0f },  { 0.28f, 0.05f }, { 0.12f, 0.09f }, { 0.06f, 0.16f },
                                      { 0.05f, 0.22f }, { 0.09f, 0.25f }, { 0.05f, 0.28f } };
    struct shape s = { 0 };

    shape_place(&s, 4.3f, 2.0f, -3.3f, 0.5f);
    for (size_t i = 0; i < sizeof(rings) / sizeof(rings[0]); i++)
        shape_grid(&s, 80, 12, &(struct surface_map){ torus_at, &rings[i], true });
    shape_grid(&s, 32, 16, &(struct surface_map){ sphere_at, &globe, true });
    shape_place(&s, 4.3f, 1.0f, -3.3f, 0.0f);
    add_lathe(&s, stand, 7, 40, 18);
    return shape_finish(&s, scene, STUFF_BRONZE);
}

static enum err add_vase(struct scene *scene)
{
    static const float profile[][2] = { { 0.20f, 0.0f },  { 0.24f, 0.04f }, { 0.34f, 0.22f }, { 0.45f, 0.48f },
                                        { 0.47f, 0.70f }, { 0.38f, 0.92f }, { 0.22f, 1.08f }, { 0.17f, 1.20f },
                                        { 0.19f, 1.32f }, { 0.28f, 1.42f }, { 0.27f, 1.45f }, { 0.17f, 1.34f },
                                        { 0.14f, 1.20f }, { 0.20f, 1.02f } };
    struct shape s = { 0 };

    shape_place(&s, -4.4f, 0.85f, -1.0f, 0.0f);
    add_lathe(&s, profile, 14, 64, 56);
    return shape_finish(&s, scene, STUFF_CLAY);
}

static enum err add_ball(struct scene *scene)
{
    const float radius = 0.55f;
    struct shape s = { 0 };

    shape_place(&s, -3.0f, 0.45f + radius, -5.0f, 0.0f);
    shape_grid(&s, 72, 36, &(struct surface_map){ sphere_at, &radius, true });
    return shape_finish(&s, scene, STUFF_GLAZE);
}

static enum err add_cypresses(struct scene *scene)
{
    static const float profile[][2] = { { 0.02f, 0.0f }, { 0.75f, 0.5f }, { 0.95f, 1.6f }, { 0.85f, 3.2f },
                                        { 0.6f, 4.8f },  { 0.28f, 6.2f }, { 0.0f, 7.0f } };
    struct shape s = { 0 };

    for (int i = 0; i < 7; i++) {
        float scaled[7][2];
        const float tall = 0.85f + 0.09f * (float)((i * 5) % 4),
                    angle = 0.40f * (float)(i - 3) + 0.03f * (float)(i % 2);
        for (int k = 0; k < 7; k++) {
            scaled[k][0] = profile[k][0] * (0.9f + 0.05f * (float)(i % 3));
            scaled[k][1] = profile[k][1] * tall;
        }
        shape_place(&s, 12.4f * sinf(angle), 0.0f, 12.4f * cosf(angle), 0.0f);
        add_lathe(&s, scaled, 7, 24, 16);
    }
    return shape_finish(&s, scene, STUFF_LEAVES);
}

static enum err add_cameras(struct scene *scene)
{
    static const struct camera cameras[] = {
        { "main", { 5.2f, 2.9f, -13.2f }, { -0.45f, 1.75f, 0.0f }, { 0.0f, 1.0f, 0.0f }, 0.575f, 0 },
        { "sundial", { 2.6f, 5.2f, -4.2f }, { 0.0f, 0.55f, 0.5f }, { 0.0f, 1.0f, 0.0f }, 0.72f, 0 },
        { "gallery", { 7.1f, 1.95f, 5.5f }, { 0.9f, 1.75f, 8.7f }, { 0.0f, 1.0f, 0.0f }, 0.95f, 0 },
    };

    for (size_t i = 0; i < sizeof(cameras) / sizeof(cameras[0]); i++) {
        const enum err e = scene_add_camera(scene, &cameras[i]);
        if (e)
            return e;
    }
    return ERR_OK;
}

static enum err furnish(struct scene *scene)
{
    static enum err (*const parts[])(struct scene *) = { add_ground,  add_steps,     add_colonnade, add_wall,
                                                         add_sundial, add_plinths,   add_armillary, add_vase,
                                                         add_ball,    add_cypresses, add_cameras };
    enum err e = ERR_OK;

    for (int i = 0; i < STUFF_COUNT && !e; i++) {
        struct material m = stuffs[i];
        m.texture = MATERIAL_NO_TEXTURE;
        e = scene_add_material(scene, &m, NULL);
    }
    for (size_t i = 0; i < sizeof(parts) / sizeof(parts[0]) && !e; i++)
        e = parts[i](scene);
    for (int dark = 0; dark < 2 && !e; dark++)
        e = add_paving(scene, dark == 1);
    return e ? e : scene_finish(scene, "built-in scene", NULL);
}

struct scene *scene_create_builtin(void)
{
    struct scene *scene = scene_create();

    if (scene && furnish(scene)) {
        scene_destroy(scene);
        scene = NULL;
    }
    return scene;
}
