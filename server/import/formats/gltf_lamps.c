/* Lights of glTF: emission of materials, and KHR_lights_punctual. The numbers of its photometric units are used
 * unchanged: 1 cd/m^2 becomes a radiance of 1, 1 candela an intensity of 1, 1 lux an irradiance of 1. */
#include "import/formats/gltf.h"

#include <math.h>
#include <string.h>

#define OUTER_DEFAULT (PI / 4.0)

static float emitted(float factor, double strength)
{
    const double x = factor * strength;

    return x > 0.0 ? (float)fmin(x, (double)EMISSION_MAX) : 0.0f; /* 0 for NaN, too */
}

void gltf_set_emission(struct material *m, struct vec3 factor, double strength)
{
    m->emission = vec3_make(emitted(factor.x, strength), emitted(factor.y, strength), emitted(factor.z, strength));
}

enum err gltf_add_light(struct scene *s, const struct gltf_light *l, const double world[16], const char *place,
                        struct reason *why)
{
    const double z = sqrt(world[8] * world[8] + world[9] * world[9] + world[10] * world[10]);
    struct punctual_light out = { .kind = l->kind, .intensity = vec3_scale(l->colour, (float)l->intensity) };

    out.position = vec3_make((float)world[12], (float)world[13], (float)world[14]);
    out.direction = vec3_make((float)(-world[8] / z), (float)(-world[9] / z), (float)(-world[10] / z));
    light_set_cone(&out, l->inner, l->outer);
    const enum err e = light_check(&out, place, why);
    return e ? e : scene_add_light(s, &out);
}

static enum err read_light(const struct gltf *g, const struct gltf_at *at, struct gltf_light *l)
{
    const char *type = gltf_string(at, "type");
    double colour[3] = { 1.0, 1.0, 1.0 };

    *l = (struct gltf_light){ .kind = LIGHT_POINT, .intensity = 1.0 };
    enum err e = gltf_numbers(g, at, "color", 3, colour);
    if (!e)
        e = gltf_number(g, at, "intensity", &l->intensity);
    l->colour = vec3_make((float)colour[0], (float)colour[1], (float)colour[2]);
    if (e)
        return e;
    if (type && strcmp(type, "spot") == 0) {
        const struct gltf_at spot = gltf_key(at, "spot");

        l->kind = LIGHT_SPOT;
        l->outer = OUTER_DEFAULT;
        e = gltf_number(g, &spot, "innerConeAngle", &l->inner);
        return e ? e : gltf_number(g, &spot, "outerConeAngle", &l->outer);
    }
    if (type && strcmp(type, "directional") == 0)
        l->kind = LIGHT_DIRECTIONAL;
    else if (!type || strcmp(type, "point") != 0)
        return gltf_fault(g, at, ERR_FORMAT, "is neither a point, a spot nor a directional light");
    return ERR_OK;
}

enum err gltf_add_node_light(struct gltf *g, const struct gltf_at *node, const double world[16])
{
    const struct gltf_at extension = gltf_extension(&g->root, "KHR_lights_punctual");
    const struct gltf_at list = gltf_key(&extension, "lights"), own = gltf_extension(node, "KHR_lights_punctual");
    struct reason cause = { "" };
    struct gltf_light l;
    size_t index;

    if (!own.value)
        return ERR_OK;
    enum err e = gltf_size(g, &own, "light", GLTF_NONE, &index);
    if (!e && index >= json_array_size(list.value))
        e = gltf_fault(g, &own, ERR_FORMAT, "names a light that does not exist; the file has %zu",
                       json_array_size(list.value));
    if (e)
        return e;
    const struct gltf_at at = gltf_item(&list, index);
    e = read_light(g, &at, &l);
    if (!e)
        e = gltf_add_light(g->scene, &l, world, "light", &cause);
    if (e != ERR_RANGE)
        return e;
    gltf_warn(g, &at, "is left out: %s", cause.text);
    return ERR_OK;
}
