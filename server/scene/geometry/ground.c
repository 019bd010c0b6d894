#include "scene/geometry/ground.h"

#include "base/mem.h"
#include "scene/geometry/scene_build.h"

#include <math.h>
#include <string.h>

#define SEGMENTS 64u   /* of the disc; its rim has no coverage */
#define FADE_SIDE 256u /* texels of the image of its coverage */
#define FADE_END 0.97f /* as a share of the radius: no coverage is left at the polygon's chords */
#define BELOW 1e-4f    /* of the model's radius */
#define STEP_BACK 1.4f
#define WIDEST (0.1f * MESH_COORDINATE_MAX)

struct disc {
    struct vec3 centre;
    float radius; /* of the model */
};

static float smooth(float x)
{
    const float t = fminf(fmaxf(x, 0.0f), 1.0f);
    return t * t * (3.0f - 2.0f * t);
}

/* Coverage over the square around the whole disc: 1 to the end of the solid part, 0 from FADE_END on. */
static enum err add_fade(struct scene *s, uint32_t *index)
{
    const float inner = GROUND_SOLID / GROUND_FAR;
    struct texture t;
    enum err e = texture_init(&t, FADE_SIDE, FADE_SIDE, TEXTURE_LINEAR);

    if (e)
        return e;
    t.wrap_u = t.wrap_v = TEXTURE_CLAMP;
    for (uint32_t i = 0; i < FADE_SIDE * FADE_SIDE; i++) {
        const float x = ((float)(i % FADE_SIDE) + 0.5f) / (0.5f * FADE_SIDE) - 1.0f;
        const float y = ((float)(i / FADE_SIDE) + 0.5f) / (0.5f * FADE_SIDE) - 1.0f;
        const float alpha = 1.0f - smooth((sqrtf(x * x + y * y) - inner) / (FADE_END - inner));
        memset(t.texels + 4 * (size_t)i, 255, 3);
        t.texels[4 * (size_t)i + 3] = (uint8_t)lrintf(255.0f * alpha);
    }
    texture_build_levels(&t);
    e = scene_add_texture(s, &t, index);
    if (e)
        texture_finish(&t);
    return e;
}

static void put_vertex(struct mesh *m, uint32_t at, const struct disc *d, float reach, uint32_t segment)
{
    const double angle = 2.0 * PI * (segment % SEGMENTS) / SEGMENTS;
    const float x = reach * (float)sin(angle), z = reach * (float)cos(angle);
    float *p = m->positions + 3 * (size_t)at, *uv = m->uvs + 2 * (size_t)at;

    p[0] = d->centre.x + d->radius * x;
    p[1] = d->centre.y;
    p[2] = d->centre.z + d->radius * z;
    uv[0] = 0.5f + 0.5f * x / GROUND_FAR;
    uv[1] = 0.5f + 0.5f * z / GROUND_FAR;
}

/* The ring between two distances, in radii of the model; from 0: a disc. Seen from above it is counter-clockwise. */
static enum err add_ring(struct scene *s, const struct disc *d, float from, float to, const struct material *material)
{
    const bool whole = from == 0.0f;
    struct mesh m = { .vertex_count = 2 * SEGMENTS, .triangle_count = whole ? SEGMENTS : 2 * SEGMENTS };
    enum err e = scene_add_material(s, material, &m.material);

    if (e)
        return e;
    m.positions = mem_alloc(3 * (size_t)m.vertex_count + 1, sizeof(float));
    m.uvs = mem_alloc(m.vertex_count, 2 * sizeof(float));
    m.indices = mem_alloc(m.triangle_count, 3 * sizeof(uint32_t));
    e = m.positions && m.uvs && m.indices ? ERR_OK : ERR_NOMEM;
    for (uint32_t k = 0; k < SEGMENTS && !e; k++) {
        const uint32_t next = (k + 1) % SEGMENTS, near[3] = { k, SEGMENTS + k, SEGMENTS + next };
        const uint32_t far[3] = { k, SEGMENTS + next, next };
        put_vertex(&m, k, d, from, k);
        put_vertex(&m, SEGMENTS + k, d, to, k);
        memcpy(m.indices + 3 * (size_t)k, near, sizeof(near));
        if (!whole)
            memcpy(m.indices + 3 * (size_t)(SEGMENTS + k), far, sizeof(far));
    }
    if (!e)
        e = scene_add_mesh(s, &m);
    if (e)
        mesh_finish(&m);
    return e;
}

static enum err add_parts(struct scene *s, const struct disc *d)
{
    struct material m = {
        .name = "ground",
        .kind = MATERIAL_LAMBERT,
        .diffuse = { GROUND_ALBEDO, GROUND_ALBEDO, GROUND_ALBEDO },
        .texture = MATERIAL_NO_TEXTURE,
        .alpha = 1.0f,
        .alpha_texture = MATERIAL_NO_TEXTURE,
        .emission_texture = MATERIAL_NO_TEXTURE,
        .ground = 1,
    };
    enum err e = add_ring(s, d, 0.0f, GROUND_SOLID, &m);

    m.alpha_mode = ALPHA_BLEND;
    if (!e)
        e = add_fade(s, &m.alpha_texture);
    return e ? e : add_ring(s, d, GROUND_SOLID, GROUND_FAR, &m);
}

/* Moves a framing camera back to show the ground around the model. */
static void step_back(struct scene *s)
{
    const struct camera framing = scene_framing_camera(s);
    struct camera *c = s->cameras;

    if (s->camera_count != 1 || strcmp(c->name, framing.name) != 0 || c->fov_y != framing.fov_y ||
        vec3_length(vec3_sub(c->position, framing.position)) > 0.0f)
        return;
    c->position = vec3_add(c->look_at, vec3_scale(vec3_sub(c->position, c->look_at), STEP_BACK));
}

enum err scene_add_ground(struct scene *s, const char *name, struct reason *why)
{
    const struct vec3 size = vec3_sub(s->high, s->low), middle = vec3_scale(vec3_add(s->low, s->high), 0.5f);
    const float radius = 0.5f * vec3_length(size);
    const struct disc d = { { middle.x, s->low.y - BELOW * radius, middle.z }, radius };

    if (s->ground.radius > 0.0f)
        return ERR_OK;
    if (!(radius > 0.0f) || !(GROUND_FAR * radius + vec3_length(middle) < WIDEST))
        return err_say(why, ERR_RANGE, "%s: a model of radius %g m is too %s for a ground", name, (double)radius,
                       radius > 1.0f ? "large" : "small");
    const struct ground ground = { d.centre, vec3_scale(vec3_add(s->low, s->high), 0.5f), radius };
    step_back(s);
    enum err e = add_parts(s, &d);
    if (!e)
        e = scene_finish(s, name, why);
    else
        err_say(why, e, "%s: no memory for the ground", name);
    if (!e)
        s->ground = ground;
    return e;
}

enum err ground_check_camera(const struct scene *s, const struct camera *c, const char *name, struct reason *why)
{
    const float above = c->position.y - s->ground.foot.y;

    if (!(s->ground.radius > 0.0f) || above > 0.0f)
        return ERR_OK;
    return err_say(why, ERR_RANGE,
                   "%s: camera '%s' is %.3g m below the ground, which is at the model's lowest point, y = %.3g: choose "
                   "a camera above it, or leave the ground out",
                   name, c->name, -(double)above, (double)s->ground.foot.y);
}
