#include "import/formats/gltf.h"

#include "base/log.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define PATH_TEXT 160  /* bytes for a path such as meshes[3].primitives[0] */
#define EXACT_MAX 9e15 /* integers up to here are exact as JSON's numbers */

/* Appends the path to `out`; too long a one is cut. */
static void put_path(const struct gltf_at *at, char out[PATH_TEXT])
{
    if (!at || (!at->above && !at->key))
        return;
    put_path(at->above, out);
    const size_t n = strlen(out);
    if (at->key)
        snprintf(out + n, PATH_TEXT - n, "%s%s", n ? "." : "", at->key);
    else
        snprintf(out + n, PATH_TEXT - n, "[%zu]", at->index);
}

/* "FILE: PATH: TEXT", where a JSON scene's place comes first. */
static void compose(const struct gltf *g, const struct gltf_at *at, const char *format, va_list args,
                    struct reason *out)
{
    const char *place = g->desc->place;
    char path[PATH_TEXT] = "";
    struct reason text;

    vsnprintf(text.text, sizeof(text.text), format, args);
    put_path(at, path);
    err_say(out, ERR_OK, "%s%s%s: %s%s%s", place ? place : "", place ? ": " : "", g->desc->path, path,
            path[0] ? ": " : "", text.text);
}

enum err gltf_fault(const struct gltf *g, const struct gltf_at *at, enum err e, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    compose(g, at, format, args, g->why);
    va_end(args);
    return e;
}

void gltf_warn(const struct gltf *g, const struct gltf_at *at, const char *format, ...)
{
    struct reason text;
    va_list args;

    va_start(args, format);
    compose(g, at, format, args, &text);
    va_end(args);
    log_warning("%s", text.text);
}

struct gltf_at gltf_key(const struct gltf_at *above, const char *key)
{
    return (struct gltf_at){ json_object_get(above->value, key), above, key, 0 };
}

struct gltf_at gltf_item(const struct gltf_at *above, size_t index)
{
    return (struct gltf_at){ json_array_get(above->value, index), above, NULL, index };
}

struct gltf_at gltf_element(const struct gltf *g, enum gltf_list list, size_t index)
{
    return gltf_item(&g->lists[list], index);
}

struct gltf_at gltf_extension(const struct gltf_at *at, const char *name)
{
    return (struct gltf_at){ json_object_get(json_object_get(at->value, "extensions"), name), at, name, 0 };
}

enum err gltf_number(const struct gltf *g, const struct gltf_at *at, const char *key, double *out)
{
    const struct gltf_at v = gltf_key(at, key);

    if (!v.value)
        return ERR_OK;
    if (!json_is_number(v.value))
        return gltf_fault(g, &v, ERR_FORMAT, "is not a number");
    *out = json_number_value(v.value);
    return ERR_OK;
}

enum err gltf_numbers(const struct gltf *g, const struct gltf_at *at, const char *key, size_t count, double *out)
{
    const struct gltf_at v = gltf_key(at, key);

    if (!v.value)
        return ERR_OK;
    if (json_array_size(v.value) != count)
        return gltf_fault(g, &v, ERR_FORMAT, "is not an array of %zu numbers", count);
    for (size_t i = 0; i < count; i++) {
        const json_t *number = json_array_get(v.value, i);
        if (!json_is_number(number))
            return gltf_fault(g, &v, ERR_FORMAT, "is not an array of %zu numbers", count);
        out[i] = json_number_value(number);
    }
    return ERR_OK;
}

/* Some writers give integers a decimal point. */
static bool is_size(const json_t *v, size_t *out)
{
    const double number = json_number_value(v);

    if (!json_is_number(v) || !(number >= 0.0 && number <= EXACT_MAX) || number != floor(number))
        return false;
    *out = (size_t)number;
    return true;
}

enum err gltf_size(const struct gltf *g, const struct gltf_at *at, const char *key, size_t fallback, size_t *out)
{
    const struct gltf_at v = gltf_key(at, key);

    *out = fallback;
    if (v.value && !is_size(v.value, out))
        return gltf_fault(g, &v, ERR_FORMAT, "is not a whole number from 0 on");
    return ERR_OK;
}

enum err gltf_index_of(const struct gltf *g, const struct gltf_at *at, enum gltf_list list, size_t *out)
{
    if (!is_size(at->value, out))
        return gltf_fault(g, at, ERR_FORMAT, "is not an index");
    if (*out >= g->counts[list])
        return gltf_fault(g, at, ERR_FORMAT, "%s[%zu] does not exist; the file has %zu", g->lists[list].key, *out,
                          g->counts[list]);
    return ERR_OK;
}

enum err gltf_index(const struct gltf *g, const struct gltf_at *at, const char *key, enum gltf_list list, size_t *out)
{
    const struct gltf_at v = gltf_key(at, key);

    *out = GLTF_NONE;
    return v.value ? gltf_index_of(g, &v, list, out) : ERR_OK;
}

const char *gltf_string(const struct gltf_at *at, const char *key)
{
    return json_string_value(json_object_get(at->value, key));
}
