#include "import/formats/import.h"

#include "base/mem.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static enum err read_transform(const struct spot *s, double out[16])
{
    static const double identity[16] = { [0] = 1.0, [5] = 1.0, [10] = 1.0, [15] = 1.0 };
    const json_t *value = json_object_get(s->object, "transform");

    memcpy(out, identity, sizeof(identity));
    if (!value)
        return ERR_OK;
    if (!json_is_array(value) || json_array_size(value) != 16)
        return err_say(s->why, ERR_FORMAT, "%s: 'transform' is not an array of 16 numbers", s->place);
    for (size_t i = 0; i < 16; i++) {
        const json_t *number = json_array_get(value, i);
        if (!json_is_number(number))
            return err_say(s->why, ERR_FORMAT, "%s: 'transform' is not an array of 16 numbers", s->place);
        out[i] = json_number_value(number);
        if (!(fabs(out[i]) <= 1e15))
            return err_say(s->why, ERR_RANGE, "%s: 'transform' holds %g", s->place, out[i]);
    }
    if (out[3] != 0.0 || out[7] != 0.0 || out[11] != 0.0 || out[15] != 1.0)
        return err_say(s->why, ERR_RANGE,
                       "%s: 'transform' is not affine: the last row of the column-major matrix (numbers 4, 8, 12, "
                       "16) must be 0 0 0 1",
                       s->place);
    const double det = out[0] * (out[5] * out[10] - out[6] * out[9]) - out[4] * (out[1] * out[10] - out[2] * out[9]) +
                       out[8] * (out[1] * out[6] - out[2] * out[5]);
    if (det == 0.0)
        return err_say(s->why, ERR_RANGE, "%s: 'transform' is singular (its determinant is 0)", s->place);
    return ERR_OK;
}

/* By default glTF uses its normals, while OBJ and PLY are flat-shaded. */
static enum err read_smooth(const struct spot *s, bool gltf, enum model_normals *out)
{
    const json_t *value = json_object_get(s->object, "smooth");

    if (value && !json_is_boolean(value))
        return err_say(s->why, ERR_FORMAT, "%s: 'smooth' is neither true nor false", s->place);
    if (value)
        *out = json_is_true(value) ? NORMALS_SMOOTH : NORMALS_FLAT;
    else
        *out = gltf ? NORMALS_FILE : NORMALS_FLAT;
    return ERR_OK;
}

/* Resolves `file` relative to the scene file's folder. */
static enum err join_path(const struct spot *s, const char *file, char out[HOST_PATH_MAX])
{
    const char *slash = strrchr(s->path, '/');
    const int folder = slash && file[0] != '/' ? (int)(slash - s->path) + 1 : 0;

    if (snprintf(out, HOST_PATH_MAX, "%.*s%s", folder, s->path, file) >= HOST_PATH_MAX)
        return err_say(s->why, ERR_RANGE, "%s: the path of the file is too long", s->place);
    return ERR_OK;
}

/* An entry of `models`. */
struct entry {
    double transform[16];
    size_t like;       /* the first entry that differs from it in its transform at most; perhaps itself */
    size_t uses;       /* of such a first entry: how many are like it */
    size_t first, end; /* its meshes in the scene */
    bool shared;       /* entries like it become instances of these meshes */
};

/* What entry `index` says; path is for d->path. */
static enum err read_desc(const struct spot *root, size_t index, const json_t *value, struct spot *s,
                          struct model_desc *d, char path[HOST_PATH_MAX])
{
    const char *file = NULL, *material = NULL;
    float time = (float)root->host->time;
    char label[32];

    snprintf(label, sizeof(label), "models[%zu]", index);
    enum err e = spot_enter(root, value, label, s);
    if (e)
        return e;
    spot_warn_unknown(s, (const char *const[]){ "file", "material", "transform", "smooth", "time", NULL });
    e = spot_string(s, "file", &file);
    if (!e)
        e = join_path(s, file, path);
    if (!e && json_object_get(s->object, "material")) {
        e = spot_string(s, "material", &material);
        if (e)
            return e;
        d->material = scene_find_material(s->scene, material, 0);
        if (d->material == MATERIAL_NONE || d->material >= s->named)
            return err_say(s->why, ERR_FORMAT, "%s: unknown material '%.64s'", s->place, material);
    }
    if (!e)
        e = read_transform(s, d->transform);
    if (!e)
        e = read_smooth(s, path_is_gltf(path), &d->normals);
    if (!e && json_object_get(s->object, "time"))
        e = spot_number(s, "time", NULL, 0.0, ANIMATION_TIME_MAX, &time);
    d->time = (double)time;
    d->host = s->host;
    d->path = path;
    d->place = s->place;
    d->named = s->named;
    return e;
}

/* Lamps of a model are not meshes, so such a model is read again for each place. */
static bool is_shared(const struct scene *s, const struct entry *entry, size_t lights_before)
{
    const size_t meshes = entry->end - entry->first;
    uint64_t triangles = 0;

    for (size_t i = entry->first; i < entry->end; i++)
        triangles += s->meshes[i].triangle_count;
    return s->light_count == lights_before && triangles >= 100 * (uint64_t)meshes &&
           instances_pay((double)entry->uses, (size_t)triangles);
}

static enum err add_model(const struct spot *root, size_t index, const json_t *value, struct entry *entries)
{
    struct model_desc d = { .material = MATERIAL_NONE };
    struct entry *entry = &entries[index], *like = &entries[entry->like];
    char path[HOST_PATH_MAX];
    struct spot s;

    enum err e = read_desc(root, index, value, &s, &d, path);
    if (e)
        return e;
    memcpy(entry->transform, d.transform, sizeof(entry->transform));
    if (like->shared) {
        double from[16], to[16];
        origin_start(s.scene, like->transform, from);
        origin_start(s.scene, entry->transform, to);
        e = meshes_repeat(s.scene, like->first, like->end, from, to);
        if (e != ERR_RANGE)
            return e;
    }
    const size_t lights = s.scene->light_count;
    entry->first = s.scene->mesh_count;
    e = model_load(s.scene, &d, s.why);
    entry->end = s.scene->mesh_count;
    if (!e && like == entry)
        entry->shared = is_shared(s.scene, entry, lights);
    return e;
}

/* Whether both say the same model, perhaps at different places. */
static bool are_alike(const json_t *a, const json_t *b)
{
    static const char *const keys[] = { "file", "material", "smooth", "time" };

    for (size_t i = 0; i < sizeof(keys) / sizeof(keys[0]); i++) {
        const json_t *x = json_object_get(a, keys[i]), *y = json_object_get(b, keys[i]);
        if (x != y && !json_equal(x, y))
            return false;
    }
    return json_object_get(a, "file") != NULL;
}

static void find_alike(const json_t *models, struct entry *entries)
{
    const size_t count = json_array_size(models);

    for (size_t i = 0; i < count; i++) {
        size_t j = 0;
        while (j < i && (entries[j].like != j || !are_alike(json_array_get(models, j), json_array_get(models, i))))
            j++;
        entries[i].like = j;
        entries[j].uses++;
    }
}

/* Only folders that the scene file itself names may be read; a faulty entry is reported when it is read. */
static enum err allow_models(const struct spot *root, const json_t *models)
{
    enum err e = ERR_OK;

    for (size_t i = 0; i < json_array_size(models) && !e; i++) {
        const char *file = json_string_value(json_object_get(json_array_get(models, i), "file"));
        char path[HOST_PATH_MAX];
        if (file && join_path(root, file, path) == ERR_OK)
            e = root->host->allow(root->host->context, path, root->why);
    }
    return e;
}

enum err json_add_models(const struct spot *root)
{
    const json_t *models = json_object_get(root->object, "models");

    if (!models)
        return err_say(root->why, ERR_FORMAT, "%s: the file contains no models", root->path);
    if (!json_is_array(models))
        return err_say(root->why, ERR_FORMAT, "%s: 'models' is not an array", root->path);
    if (json_array_size(models) == 0)
        return err_say(root->why, ERR_FORMAT, "%s: the file contains no models", root->path);
    struct entry *entries = mem_alloc(json_array_size(models), sizeof(*entries));
    if (!entries)
        return ERR_NOMEM;
    find_alike(models, entries);
    enum err e = allow_models(root, models);
    for (size_t i = 0; i < json_array_size(models) && !e; i++) {
        e = add_model(root, i, json_array_get(models, i), entries);
        root->host->step(root->host->context);
    }
    mem_free(entries);
    return e;
}
