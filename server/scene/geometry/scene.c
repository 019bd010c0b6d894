#include "scene/geometry/scene.h"

#include "base/log.h"
#include "base/mem.h"
#include "scene/geometry/mesh_read.h"
#include "scene/geometry/scene_build.h"
#include "scene/surface/scatter.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

/* The camera that frames a model without one: field of view in radians, and the narrowest aspect ratio it fits. */
#define FRAMING_FOV (35.0f * (float)PI / 180.0f)
#define FRAMING_ASPECT (4.0f / 3.0f)

const char *scene_feature_name(enum scene_feature feature)
{
    switch (feature) {
    case FEATURE_BUMP_MAP: return "bump maps; the surfaces are smooth";
    case FEATURE_ALPHA: return "alpha masks and blending; the surfaces are opaque";
    case FEATURE_SPECULAR_MAP: return "specular and transmission textures; their factors alone count";
    case FEATURE_SHEEN: return "sheen on glass; the glass has none";
    case FEATURE_COAT_NORMAL: return "a normal map of its own of a clear coat; the coat is smooth";
    case FEATURE_COATED_GLASS: return "clear coats on glass; the glass has none";
    case FEATURE_ROUGH_GLASS: return "rough glass; up to a roughness of 0.4 it is smooth, above it transmits diffusely";
    case FEATURE_TINTED_GLASS: return "tinted glass; it is clear";
    case FEATURE_PARTIAL_GLASS:
        return "partial transmission; a factor of 0.5 or more counts as 1, a smaller one as holes";
    case FEATURE_VERTEX_COLOUR: return "vertex colours beside textures or in this format; the materials alone count";
    case FEATURE_TEXTURE_TRANSFORM:
        return "a third set of texture coordinates or texture transform in one material; its roughness counts by the "
               "mean, its normal map not at all, its colours as if at the base colour's coordinates";
    case FEATURE_SPECULAR_GLOSSINESS:
        return "a specular-glossiness texture with other coordinates than the diffuse texture; its means count";
    case FEATURE_LIGHTS: return "lights of this format; there are none, but a JSON scene may have some";
    case FEATURE_ANIMATION: return "animation of this format; the model is at rest";
    case FEATURE_COUNT: break;
    }
    assert(!"invalid scene feature");
    return "";
}

struct scene *scene_create(void)
{
    return mem_alloc(1, sizeof(struct scene));
}

void scene_destroy(struct scene *s)
{
    if (!s)
        return;
    for (size_t i = 0; i < s->mesh_count; i++)
        mesh_finish(&s->meshes[i]);
    for (size_t i = 0; i < s->texture_count; i++)
        texture_finish(&s->textures[i]);
    mem_free(s->meshes);
    mem_free(s->materials);
    mem_free(s->textures);
    mem_free(s->cameras);
    mem_free(s->lights);
    mem_free(s);
}

/* Appends a copy of an element to an array, whose address is `array`; the capacity is the next power of two. */
static enum err append(void *array, size_t *count, const void *element, size_t size)
{
    void *grown;

    memcpy(&grown, array, sizeof(grown));
    if (!grown || (*count & (*count - 1)) == 0) {
        grown = mem_grow(grown, *count, *count ? 2 * *count : 1, size);
        if (!grown)
            return ERR_NOMEM;
        memcpy(array, &grown, sizeof(grown));
    }
    memcpy((char *)grown + (*count)++ * size, element, size);
    return ERR_OK;
}

enum err scene_add_material(struct scene *s, const struct material *m, uint32_t *index)
{
    if (index)
        *index = (uint32_t)s->material_count;
    return append(&s->materials, &s->material_count, m, sizeof(*m));
}

enum err scene_add_mesh(struct scene *s, const struct mesh *m)
{
    return append(&s->meshes, &s->mesh_count, m, sizeof(*m));
}

enum err scene_add_instance(struct scene *s, uint32_t of, const char *name, const float matrix[3][4])
{
    struct mesh m = s->meshes[of];

    assert(m.placed);
    if (m.source == 0)
        m.source = of + 1;
    snprintf(m.name, sizeof(m.name), "%.63s", name);
    const enum err e = mesh_place(&m, matrix);
    return e ? e : scene_add_mesh(s, &m);
}

/* Without memory for a smaller copy, a texture stays as it is. */
static void limit_textures(struct scene *s)
{
    for (;;) {
        struct texture *largest = NULL;
        uint64_t bytes = 0, most = 0;
        for (size_t i = 0; i < s->texture_count; i++) {
            struct texture *t = &s->textures[i];
            const uint64_t own = 4 * texture_texel_count(t->width, t->height);
            bytes += own;
            if (own > most && (t->width > TEXTURE_SIDE_KEPT || t->height > TEXTURE_SIDE_KEPT)) {
                most = own;
                largest = t;
            }
        }
        if (bytes <= s->texture_bytes || !largest || texture_coarsen(largest))
            return;
    }
}

enum err scene_add_texture(struct scene *s, const struct texture *t, uint32_t *index)
{
    if (index)
        *index = (uint32_t)s->texture_count;
    const enum err e = append(&s->textures, &s->texture_count, t, sizeof(*t));
    if (!e && s->texture_bytes > 0)
        limit_textures(s);
    return e;
}

enum err scene_add_camera(struct scene *s, const struct camera *c)
{
    return append(&s->cameras, &s->camera_count, c, sizeof(*c));
}

enum err scene_add_light(struct scene *s, const struct punctual_light *l)
{
    return append(&s->lights, &s->light_count, l, sizeof(*l));
}

uint32_t scene_find_material(const struct scene *s, const char *name, uint32_t first)
{
    for (size_t i = first; i < s->material_count; i++) {
        if (strcmp(s->materials[i].name, name) == 0)
            return (uint32_t)i;
    }
    return MATERIAL_NONE;
}

void scene_note_unmodelled(struct scene *s, enum scene_feature feature, const char *file)
{
    const uint32_t bit = UINT32_C(1) << feature;

    if (!(s->unmodelled & bit))
        log_warning("%s: not supported: %s", file, scene_feature_name(feature));
    s->unmodelled |= bit;
}

void scene_camera_names(const struct scene *s, char *out, size_t size)
{
    size_t used = 0;

    out[0] = '\0';
    for (size_t i = 0; i < s->camera_count && used < size; i++)
        used += (size_t)snprintf(out + used, size - used, "%s%s",
                                 i == 0                     ? ""
                                 : i + 1 == s->camera_count ? " and "
                                                            : ", ",
                                 s->cameras[i].name);
}

const struct camera *scene_camera(const struct scene *s, const char *name)
{
    for (size_t i = 0; i < s->camera_count; i++) {
        if (!name || strcmp(s->cameras[i].name, name) == 0)
            return &s->cameras[i];
    }
    return NULL;
}

static const struct box no_box = { { INFINITY, INFINITY, INFINITY }, { -INFINITY, -INFINITY, -INFINITY } };

enum err scene_finish(struct scene *s, const char *file, struct reason *why)
{
    struct box all = no_box;

    s->triangle_count = 0;
    for (size_t i = 0; i < s->mesh_count; i++) {
        s->triangle_count += s->meshes[i].triangle_count;
        mesh_grow_box(&s->meshes[i], &all);
    }
    s->low = all.low;
    s->high = all.high;
    if (s->triangle_count == 0)
        return err_say(why, ERR_FORMAT, "%s: the scene contains no triangles", file);
    return ERR_OK;
}

struct camera scene_framing_camera(const struct scene *s)
{
    const struct vec3 centre = vec3_scale(vec3_add(s->low, s->high), 0.5f);
    const struct vec3 half = vec3_scale(vec3_sub(s->high, s->low), 0.5f);
    const float tan_y = tanf(0.5f * FRAMING_FOV), tan_x = FRAMING_ASPECT * tan_y;
    /* slightly above eye level and off the axes, so that three sides are visible */
    const struct vec3 from = vec3_normalize(vec3_make(0.62f, 0.42f, 1.0f));
    const struct vec3 right = vec3_normalize(vec3_cross(vec3_make(0.0f, 1.0f, 0.0f), from));
    const struct vec3 up = vec3_cross(from, right);
    float distance = 0.0f;

    /* The smallest distance from which every corner of the box is in the image, with a margin. */
    for (int i = 0; i < 8; i++) {
        const struct vec3 corner = { i & 1 ? half.x : -half.x, i & 2 ? half.y : -half.y, i & 4 ? half.z : -half.z };
        const float across = fabsf(vec3_dot(corner, right)) / tan_x, along = fabsf(vec3_dot(corner, up)) / tan_y;
        distance = fmaxf(distance, vec3_dot(corner, from) + 1.1f * fmaxf(across, along));
    }
    struct camera c = {
        .name = "framed",
        .position = vec3_add(centre, vec3_scale(from, fmaxf(distance, 1e-6f))),
        .look_at = centre,
        .up = { 0.0f, 1.0f, 0.0f },
        .fov_y = FRAMING_FOV,
    };
    return c;
}

static bool finite3(struct vec3 v)
{
    return isfinite(v.x) && isfinite(v.y) && isfinite(v.z);
}

enum err camera_check(const struct camera *c, const char *place, struct reason *why)
{
    const struct vec3 ahead = vec3_sub(c->look_at, c->position);

    if (!finite3(c->position) || !finite3(c->look_at) || !finite3(c->up) || !finite3(ahead))
        return err_say(why, ERR_RANGE, "%s: a number is not finite", place);
    const bool fisheye = c->projection == PROJECTION_EQUIDISTANT || c->projection == PROJECTION_EQUISOLID;
    if (!fisheye && c->projection != PROJECTION_PERSPECTIVE)
        return err_say(why, ERR_RANGE, "%s: unknown projection", place);
    if (!(c->fov_y > 0.0f && (fisheye ? c->fov_y <= (float)(2.0 * PI) : c->fov_y < (float)PI)))
        return err_say(why, ERR_RANGE, "%s: --fov or fov_y_degrees is %g, not between 0 and %d", place,
                       (double)c->fov_y * 180.0 / PI, fisheye ? 360 : 180);
    if (vec3_length(ahead) == 0.0f)
        return err_say(why, ERR_RANGE, "%s: position and look_at are equal", place);
    const struct vec3 right = vec3_cross(vec3_normalize(ahead), vec3_normalize(c->up));
    if (!(vec3_length(right) > 1e-4f))
        return err_say(why, ERR_RANGE, "%s: up is parallel to the viewing direction", place);
    return ERR_OK;
}

void light_set_cone(struct punctual_light *l, double inner, double outer)
{
    l->inner_cos = (float)cos(inner);
    l->outer_cos = (float)fmax(0.0, cos(outer)); /* the cosine of a right angle is rounded */
}

static bool is_unit(struct vec3 v)
{
    return fabsf(vec3_length(v) - 1.0f) < 1e-4f; /* false for NaN, too */
}

static bool is_intensity(float x)
{
    return x >= 0.0f && x <= LIGHT_INTENSITY_MAX;
}

enum err light_check(const struct punctual_light *l, const char *place, struct reason *why)
{
    const struct vec3 i = l->intensity;

    if (!is_intensity(i.x) || !is_intensity(i.y) || !is_intensity(i.z))
        return err_say(why, ERR_RANGE, "%s: its intensity is not within 0 to %g", place, (double)LIGHT_INTENSITY_MAX);
    if (l->kind != LIGHT_DIRECTIONAL && !finite3(l->position))
        return err_say(why, ERR_RANGE, "%s: its position is not finite", place);
    if (l->kind != LIGHT_POINT && !is_unit(l->direction))
        return err_say(why, ERR_RANGE, "%s: it has no direction", place);
    if (l->kind == LIGHT_SPOT && !(l->inner_cos <= 1.0f && l->outer_cos >= 0.0f && l->inner_cos >= l->outer_cos))
        return err_say(why, ERR_RANGE, "%s: the half angles must satisfy 0 <= inner <= outer <= 90 degrees", place);
    return ERR_OK;
}

static bool is_black(struct vec3 v)
{
    return !(v.x > 0.0f || v.y > 0.0f || v.z > 0.0f);
}

bool scene_has_lamps(const struct scene *s)
{
    for (size_t i = 0; i < s->light_count; i++)
        if (!is_black(s->lights[i].intensity))
            return true;
    for (size_t i = 0; i < s->mesh_count; i++)
        if (!is_black(s->materials[s->meshes[i].material].emission))
            return true;
    return false;
}

struct vec3 scene_emission(const struct scene *s, uint32_t material, const float uv[2], const float (*uv_step)[2])
{
    const struct material *m = &s->materials[material];

    if (is_black(m->emission) || m->emission_texture == MATERIAL_NO_TEXTURE)
        return m->emission;
    return vec3_mul(m->emission, texture_read(&s->textures[m->emission_texture], uv, uv_step));
}

size_t scene_casters(const struct scene *s, struct box *out, size_t room)
{
    size_t count = 0;

    for (size_t i = 0; i < s->mesh_count; i++) {
        if (s->meshes[i].triangle_count == 0 || !material_is_delta(&s->materials[s->meshes[i].material]))
            continue;
        if (count < room) {
            out[count] = no_box;
            mesh_grow_box(&s->meshes[i], &out[count]);
        }
        count++;
    }
    return count;
}
