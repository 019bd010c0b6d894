#include "import/formats/import.h"

#include "base/log.h"
#include "scene/geometry/view.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const struct vec3 white = { 1.0f, 1.0f, 1.0f };
static const double none = 0.0, whole = 1.0;

enum err spot_enter(const struct spot *s, const json_t *value, const char *name, struct spot *out)
{
    *out = *s;
    out->object = value;
    snprintf(out->place, sizeof(out->place), "%.220s: %.90s", s->path, name);
    if (!json_is_object(value))
        return err_say(s->why, ERR_FORMAT, "%s: is not an object", out->place);
    return ERR_OK;
}

/* A misspelt key would otherwise silently leave a default in place. */
void spot_warn_unknown(const struct spot *s, const char *const *known)
{
    const char *key;
    json_t *value;

    json_object_foreach((json_t *)s->object, key, value)
    {
        const char *const *k = known;
        while (*k && strcmp(*k, key) != 0)
            k++;
        if (!*k)
            log_warning("%s: unknown key '%s' is ignored", s->place, key);
    }
}

static enum err missing(const struct spot *s, const char *key)
{
    return err_say(s->why, ERR_FORMAT, "%s: '%s' is missing", s->place, key);
}

enum err spot_number(const struct spot *s, const char *key, const double *fallback, double least, double most,
                     float *out)
{
    const json_t *value = json_object_get(s->object, key);

    if (!value && !fallback)
        return missing(s, key);
    if (value && !json_is_number(value))
        return err_say(s->why, ERR_FORMAT, "%s: '%s' is not a number", s->place, key);
    const double number = value ? json_number_value(value) : *fallback;
    if (!(number >= least && number <= most))
        return err_say(s->why, ERR_RANGE, "%s: '%s' is %g, not within %g to %g", s->place, key, number, least, most);
    *out = (float)number;
    return ERR_OK;
}

static enum err read_vec3(const struct spot *s, const char *key, const struct vec3 *fallback, double least, double most,
                          struct vec3 *out)
{
    const json_t *value = json_object_get(s->object, key);
    float v[3];

    if (!value && !fallback)
        return missing(s, key);
    if (!value) {
        *out = *fallback;
        return ERR_OK;
    }
    if (!json_is_array(value) || json_array_size(value) != 3)
        return err_say(s->why, ERR_FORMAT, "%s: '%s' is not an array of three numbers", s->place, key);
    for (size_t i = 0; i < 3; i++) {
        const json_t *number = json_array_get(value, i);
        if (!json_is_number(number))
            return err_say(s->why, ERR_FORMAT, "%s: '%s' is not an array of three numbers", s->place, key);
        const double x = json_number_value(number);
        if (!(x >= least && x <= most))
            return err_say(s->why, ERR_RANGE, "%s: '%s' holds %g, not within %g to %g", s->place, key, x, least, most);
        v[i] = (float)x;
    }
    *out = vec3_make(v[0], v[1], v[2]);
    return ERR_OK;
}

/* A point in the file's coordinates becomes one of the scene's, before it is a float. */
static enum err read_position(const struct spot *s, const char *key, struct vec3 *out)
{
    const enum err e = read_vec3(s, key, NULL, -1e15, 1e15, out);
    const json_t *value = json_object_get(s->object, key);
    double v[3];

    for (size_t i = 0; i < 3 && !e; i++)
        v[i] = json_number_value(json_array_get(value, i)) - s->scene->origin[i];
    if (!e)
        *out = vec3_make((float)v[0], (float)v[1], (float)v[2]);
    return e;
}

enum err spot_string(const struct spot *s, const char *key, const char **out)
{
    const json_t *value = json_object_get(s->object, key);

    if (!value)
        return missing(s, key);
    if (!json_is_string(value) || json_string_length(value) == 0)
        return err_say(s->why, ERR_FORMAT, "%s: '%s' is not a name", s->place, key);
    *out = json_string_value(value);
    return ERR_OK;
}

/* Materials */

static enum err read_lambert(const struct spot *s, struct material *m)
{
    spot_warn_unknown(
        s, (const char *const[]){ "type", "alpha", "albedo", "transmission", "transmission_color", "emission", NULL });
    m->kind = MATERIAL_LAMBERT;
    m->through_texture = MATERIAL_NO_TEXTURE;
    enum err e = read_vec3(s, "albedo", NULL, 0.0, 1.0, &m->diffuse);
    if (!e)
        e = spot_number(s, "transmission", &none, 0.0, 1.0, &m->transmits);
    return e ? e : read_vec3(s, "transmission_color", &white, 0.0, 1.0, &m->through);
}

static enum err read_phong(const struct spot *s, struct material *m)
{
    spot_warn_unknown(s, (const char *const[]){ "type", "alpha", "diffuse", "specular", "exponent", "emission", NULL });
    m->kind = MATERIAL_PHONG;
    enum err e = read_vec3(s, "diffuse", NULL, 0.0, 1.0, &m->diffuse);
    if (!e)
        e = read_vec3(s, "specular", NULL, 0.0, 1.0, &m->specular);
    if (!e)
        e = spot_number(s, "exponent", NULL, 0.0, 1e6, &m->exponent);
    if (e)
        return e;
    const struct vec3 sum = vec3_add(m->diffuse, m->specular);
    const float most = fmaxf(sum.x, fmaxf(sum.y, sum.z));
    if (most > 1.0f + 1e-4f)
        return err_say(s->why, ERR_RANGE, "%s: diffuse + specular is %g, more than 1, which would create energy",
                       s->place, (double)most);
    return ERR_OK;
}

static enum err read_ggx(const struct spot *s, struct material *m)
{
    spot_warn_unknown(
        s, (const char *const[]){ "type", "alpha", "base_color", "metallic", "roughness", "emission", NULL });
    m->kind = MATERIAL_GGX;
    enum err e = read_vec3(s, "base_color", &white, 0.0, 1.0, &m->diffuse);
    if (!e)
        e = spot_number(s, "metallic", &whole, 0.0, 1.0, &m->metallic);
    if (!e)
        e = spot_number(s, "roughness", &whole, 0.0, 1.0, &m->roughness);
    return e;
}

static enum err read_mirror(const struct spot *s, struct material *m)
{
    spot_warn_unknown(s, (const char *const[]){ "type", "alpha", "reflectance", "emission", NULL });
    m->kind = MATERIAL_MIRROR;
    return read_vec3(s, "reflectance", &white, 0.0, 1.0, &m->diffuse);
}

static enum err read_glass(const struct spot *s, struct material *m)
{
    const double crown = 1.5;

    struct vec3 left;
    float distance;

    spot_warn_unknown(s, (const char *const[]){ "type", "alpha", "ior", "tint", "attenuation_color",
                                                "attenuation_distance", "thin", "emission", NULL });
    m->kind = MATERIAL_GLASS;
    const json_t *thin = json_object_get(s->object, "thin");
    if (thin && !json_is_boolean(thin))
        return err_say(s->why, ERR_FORMAT, "%s: 'thin' is neither true nor false", s->place);
    m->thin = json_is_true(thin);
    enum err e = read_vec3(s, "tint", &white, 0.0, 1.0, &m->diffuse);
    if (!e)
        e = spot_number(s, "ior", &crown, 0.25, 4.0, &m->ior);
    if (!e)
        e = read_vec3(s, "attenuation_color", &white, 0.0, 1.0, &left);
    if (!e)
        e = spot_number(s, "attenuation_distance", &whole, 1e-6, 1e15, &distance);
    if (!e)
        m->attenuation = attenuation_from(left, (double)distance);
    return e;
}

/* The fraction of the surface that is there. */
static enum err read_alpha(const struct spot *s, struct material *m)
{
    m->alpha_texture = MATERIAL_NO_TEXTURE;
    const enum err e = spot_number(s, "alpha", &whole, 0.0, 1.0, &m->alpha);
    if (!e && m->alpha < 1.0f)
        m->alpha_mode = ALPHA_BLEND;
    return e;
}

static enum err read_material(const struct spot *root, const char *name, const json_t *value)
{
    static const struct {
        const char *type;
        enum err (*read)(const struct spot *s, struct material *m);
    } kinds[] = {
        { "lambert", read_lambert }, { "phong", read_phong }, { "ggx", read_ggx },
        { "mirror", read_mirror },   { "glass", read_glass },
    };
    const struct vec3 black = { 0.0f, 0.0f, 0.0f };
    struct material m = { .texture = MATERIAL_NO_TEXTURE, .emission_texture = MATERIAL_NO_TEXTURE };
    char label[96];
    const char *type = NULL;
    struct spot s;
    enum err e;

    snprintf(label, sizeof(label), "materials '%.70s'", name);
    e = spot_enter(root, value, label, &s);
    if (e)
        return e;
    if (strlen(name) >= sizeof(m.name))
        return err_say(s.why, ERR_RANGE, "%s: the name is longer than %zu bytes", s.place, sizeof(m.name) - 1);
    snprintf(m.name, sizeof(m.name), "%s", name);
    e = spot_string(&s, "type", &type);
    if (e)
        return e;
    for (size_t i = 0; i < sizeof(kinds) / sizeof(kinds[0]); i++) {
        if (strcmp(kinds[i].type, type) == 0) {
            e = kinds[i].read(&s, &m);
            if (!e)
                e = read_alpha(&s, &m);
            if (!e)
                e = read_vec3(&s, "emission", &black, 0.0, (double)EMISSION_MAX, &m.emission);
            return e ? e : scene_add_material(s.scene, &m, NULL);
        }
    }
    return err_say(s.why, ERR_FORMAT, "%s: unknown type '%.40s'; expected lambert, phong, ggx, mirror or glass",
                   s.place, type);
}

static enum err read_materials(const struct spot *root)
{
    const json_t *all = json_object_get(root->object, "materials");
    const char *name;
    json_t *value;

    if (!all)
        return ERR_OK;
    if (!json_is_object(all))
        return err_say(root->why, ERR_FORMAT, "%s: 'materials' is not an object", root->path);
    json_object_foreach((json_t *)all, name, value)
    {
        const enum err e = read_material(root, name, value);
        if (e)
            return e;
    }
    return ERR_OK;
}

/* Cameras */

static enum err read_projection(const struct spot *s, enum camera_projection *out)
{
    const char *name = NULL;
    int value = PROJECTION_PERSPECTIVE;

    if (!json_object_get(s->object, "projection"))
        return ERR_OK;
    enum err e = spot_string(s, "projection", &name);
    if (!e && choice_parse(projection_choices, 0, "projection", name, &value, NULL))
        e = err_say(s->why, ERR_FORMAT, "%s: projection is '%.40s'; expected perspective, equidistant or equisolid",
                    s->place, name);
    *out = (enum camera_projection)value;
    return e;
}

static enum err read_camera(const struct spot *root, const char *label, const char *name, const json_t *value)
{
    const struct vec3 y = { 0.0f, 1.0f, 0.0f };
    struct camera c = { .name = "" };
    float degrees = 0.0f;
    struct spot s;

    enum err e = spot_enter(root, value, label, &s);
    if (e)
        return e;
    spot_warn_unknown(
        &s, (const char *const[]){ "name", "position", "look_at", "up", "fov_y_degrees", "projection", NULL });
    if (!name) {
        e = spot_string(&s, "name", &name);
        if (e)
            return e;
    }
    if (strlen(name) >= sizeof(c.name))
        return err_say(s.why, ERR_RANGE, "%s: the name is longer than %zu bytes", s.place, sizeof(c.name) - 1);
    snprintf(c.name, sizeof(c.name), "%s", name);
    e = read_position(&s, "position", &c.position);
    if (!e)
        e = read_position(&s, "look_at", &c.look_at);
    if (!e)
        e = read_vec3(&s, "up", &y, -1e15, 1e15, &c.up);
    if (!e)
        e = spot_number(&s, "fov_y_degrees", NULL, -1e15, 1e15, &degrees);
    if (!e)
        e = read_projection(&s, &c.projection);
    if (e)
        return e;
    c.fov_y = (float)(degrees * (PI / 180.0));
    e = camera_check(&c, s.place, s.why);
    return e ? e : scene_add_camera(s.scene, &c);
}

/* `camera` is a single camera called "main"; `cameras` is an object of cameras by name, or an array of named cameras.
 */
static enum err read_cameras(const struct spot *root)
{
    const json_t *one = json_object_get(root->object, "camera");
    const json_t *named = json_object_get(root->object, "cameras");
    char label[96];
    enum err e = ERR_OK;

    if (one)
        e = read_camera(root, "camera", "main", one);
    if (!e && json_is_object(named)) {
        const char *name;
        json_t *value;
        json_object_foreach((json_t *)named, name, value)
        {
            snprintf(label, sizeof(label), "cameras '%.70s'", name);
            e = read_camera(root, label, name, value);
            if (e)
                return e;
        }
    } else if (!e && json_is_array(named)) {
        for (size_t i = 0; i < json_array_size(named) && !e; i++) {
            snprintf(label, sizeof(label), "cameras[%zu]", i);
            e = read_camera(root, label, NULL, json_array_get(named, i));
        }
    } else if (!e && named) {
        e = err_say(root->why, ERR_FORMAT, "%s: 'cameras' is neither an object nor an array", root->path);
    }
    return e;
}

/* Lights */

static enum err read_direction(const struct spot *s, struct vec3 *out)
{
    const enum err e = read_vec3(s, "direction", NULL, -1e15, 1e15, out);

    if (!e && !(vec3_length(*out) > 0.0f))
        return err_say(s->why, ERR_RANGE, "%s: 'direction' is zero", s->place);
    *out = vec3_normalize(*out);
    return e;
}

static enum err read_point(const struct spot *s, struct punctual_light *l)
{
    spot_warn_unknown(s, (const char *const[]){ "type", "position", "intensity", NULL });
    const enum err e = read_position(s, "position", &l->position);
    return e ? e : read_vec3(s, "intensity", NULL, 0.0, (double)LIGHT_INTENSITY_MAX, &l->intensity);
}

static enum err read_cone(const struct spot *s, struct punctual_light *l)
{
    const double inner = 0.0, outer = 45.0; /* glTF's defaults */
    float degrees[2];

    enum err e = spot_number(s, "inner_degrees", &inner, 0.0, 90.0, &degrees[0]);
    if (!e)
        e = spot_number(s, "outer_degrees", &outer, 0.0, 90.0, &degrees[1]);
    if (e)
        return e;
    if (degrees[0] > degrees[1])
        return err_say(s->why, ERR_RANGE, "%s: 'inner_degrees' is %g, more than 'outer_degrees', %g", s->place,
                       (double)degrees[0], (double)degrees[1]);
    light_set_cone(l, degrees[0] * (PI / 180.0), degrees[1] * (PI / 180.0));
    return ERR_OK;
}

static enum err read_spot(const struct spot *s, struct punctual_light *l)
{
    spot_warn_unknown(s, (const char *const[]){ "type", "position", "direction", "intensity", "inner_degrees",
                                                "outer_degrees", NULL });
    enum err e = read_position(s, "position", &l->position);
    if (!e)
        e = read_direction(s, &l->direction);
    if (!e)
        e = read_vec3(s, "intensity", NULL, 0.0, (double)LIGHT_INTENSITY_MAX, &l->intensity);
    return e ? e : read_cone(s, l);
}

static enum err read_directional(const struct spot *s, struct punctual_light *l)
{
    spot_warn_unknown(s, (const char *const[]){ "type", "direction", "illuminance", NULL });
    const enum err e = read_direction(s, &l->direction);
    return e ? e : read_vec3(s, "illuminance", NULL, 0.0, (double)LIGHT_INTENSITY_MAX, &l->intensity);
}

static enum err read_light(const struct spot *root, size_t index, const json_t *value)
{
    static const struct {
        const char *type;
        enum light_kind kind;
        enum err (*read)(const struct spot *s, struct punctual_light *l);
    } kinds[] = {
        { "point", LIGHT_POINT, read_point },
        { "spot", LIGHT_SPOT, read_spot },
        { "directional", LIGHT_DIRECTIONAL, read_directional },
    };
    struct punctual_light l = { .kind = LIGHT_POINT };
    const char *type = NULL;
    char label[96];
    struct spot s;

    snprintf(label, sizeof(label), "lights[%zu]", index);
    enum err e = spot_enter(root, value, label, &s);
    if (!e)
        e = spot_string(&s, "type", &type);
    if (e)
        return e;
    for (size_t i = 0; i < sizeof(kinds) / sizeof(kinds[0]); i++) {
        if (strcmp(kinds[i].type, type) != 0)
            continue;
        l.kind = kinds[i].kind;
        e = kinds[i].read(&s, &l);
        if (!e)
            e = light_check(&l, s.place, s.why);
        return e ? e : scene_add_light(s.scene, &l);
    }
    return err_say(s.why, ERR_FORMAT, "%s: unknown type '%.40s'; expected point, spot or directional", s.place, type);
}

static enum err read_lights(const struct spot *root)
{
    const json_t *all = json_object_get(root->object, "lights");
    enum err e = ERR_OK;

    if (all && !json_is_array(all))
        return err_say(root->why, ERR_FORMAT, "%s: 'lights' is not an array", root->path);
    for (size_t i = 0; i < json_array_size(all) && !e; i++)
        e = read_light(root, i, json_array_get(all, i));
    return e;
}

static enum err read_root(struct spot *s)
{
    const json_t *ground = json_object_get(s->object, "ground");

    if (!json_is_object(s->object))
        return err_say(s->why, ERR_FORMAT, "%s: is not a JSON object", s->path);
    spot_warn_unknown(s, (const char *const[]){ "camera", "cameras", "models", "materials", "lights", "ground", NULL });
    if (ground && !json_is_boolean(ground))
        return err_say(s->why, ERR_FORMAT, "%s: 'ground' is neither true nor false", s->path);
    s->scene->wants_ground = json_is_true(ground);
    enum err e = read_materials(s);
    s->named = (uint32_t)s->scene->material_count;
    if (!e)
        e = json_add_models(s); /* they may move the origin */
    if (!e)
        e = read_cameras(s);
    return e ? e : read_lights(s);
}

enum err json_load_scene(struct scene *scene, const char *path, const struct host *host, struct reason *why)
{
    struct spot s = { .scene = scene, .path = path, .host = host, .why = why };
    struct bytes text;
    json_error_t fault;

    enum err e = host_read(host, path, &text, why);
    if (e)
        return e;
    json_t *root = json_loadb((const char *)text.at, text.size, JSON_REJECT_DUPLICATES, &fault);
    bytes_finish(&text);
    if (!root && json_error_code(&fault) == json_error_out_of_memory)
        return ERR_NOMEM;
    if (!root)
        return err_say(why, ERR_FORMAT, "%s: line %d, column %d: %s", path, fault.line, fault.column, fault.text);
    s.object = root;
    snprintf(s.place, sizeof(s.place), "%.300s", path);
    e = read_root(&s);
    json_decref(root);
    return e;
}
