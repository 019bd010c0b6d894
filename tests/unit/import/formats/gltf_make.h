/* glTF files put together from arrays and JSON text. */
#pragma once

#include "scene/geometry/files.h"
#include "scene/geometry/load.h"

#include <stdarg.h>

struct make {
    struct folder folder;
    uint8_t bytes[1 << 20];
    size_t size;
    size_t unpacked;     /* bytes of views that are compressed: those of a second buffer, which has no data */
    const char *packing; /* their extension */
    char views[8192], accessors[8192];
    int view_count, accessor_count;
};

static inline void make_begin(struct make *m)
{
    memset(m, 0, sizeof(*m));
    folder_make(&m->folder);
}

static inline void make_end(struct make *m)
{
    folder_remove(&m->folder);
}

/* Appends text to a JSON array. */
static inline void make_append(char *array, size_t size, const char *text)
{
    const size_t n = strlen(array);
    assert_true((size_t)snprintf(array + n, size - n, "%s%s", n ? "," : "", text) < size - n);
}

/* A buffer view of these bytes; `more` holds further members, such as ,"byteStride":16. */
static inline int make_view(struct make *m, const void *bytes, size_t size, const char *more)
{
    char text[512];

    m->size = (m->size + 3) & ~(size_t)3;
    assert_true(m->size + size <= sizeof(m->bytes));
    memcpy(m->bytes + m->size, bytes, size);
    snprintf(text, sizeof(text), "{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu%s}", m->size, size, more);
    make_append(m->views, sizeof(m->views), text);
    m->size += size;
    return m->view_count++;
}

/* An accessor from its members. */
static inline int make_accessor(struct make *m, const char *format, ...) PRINTF_LIKE(2, 3);

static inline int make_accessor(struct make *m, const char *format, ...)
{
    char text[512] = "{", *at = text + 1;
    va_list args;

    va_start(args, format);
    vsnprintf(at, sizeof(text) - 2, format, args);
    va_end(args);
    strcat(text, "}");
    make_append(m->accessors, sizeof(m->accessors), text);
    return m->accessor_count++;
}

/* One component of an accessor, as it stands in the file. */
static inline double make_component(const uint8_t *at, int type)
{
    float f;
    int16_t s;

    memcpy(&f, at, type == 5126 ? sizeof(f) : 0);
    memcpy(&s, at, type == 5122 || type == 5123 ? sizeof(s) : 0);
    switch (type) {
    case 5120: return (int8_t)*at;
    case 5121: return *at;
    case 5122: return s;
    case 5123: return (uint16_t)s;
    default: return (double)f;
    }
}

/* ,"min":[..],"max":[..] of vectors of three, which glTF requires of positions. Static storage. */
static inline const char *make_bounds(const void *bytes, int type, size_t stride, size_t count)
{
    static char text[256];
    const size_t size = type == 5126 ? 4 : type <= 5121 ? 1 : 2;
    double low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };

    for (size_t i = 0; i < 3 * count; i++) {
        const double x = make_component((const uint8_t *)bytes + i / 3 * stride + i % 3 * size, type);
        low[i % 3] = fmin(low[i % 3], x);
        high[i % 3] = fmax(high[i % 3], x);
    }
    snprintf(text, sizeof(text), ",\"min\":[%.9g,%.9g,%.9g],\"max\":[%.9g,%.9g,%.9g]", low[0], low[1], low[2], high[0],
             high[1], high[2]);
    return text;
}

static inline int make_array(struct make *m, const void *bytes, size_t size, int type, const char *shape, size_t count)
{
    const int view = make_view(m, bytes, size, "");
    const char *bounds = type == 5126 && strcmp(shape, "VEC3") == 0 ? make_bounds(bytes, type, 12, count) : "";
    return make_accessor(m, "\"bufferView\":%d,\"componentType\":%d,\"type\":\"%s\",\"count\":%zu%s", view, type, shape,
                         count, bounds);
}

#define FLOATS(m, array, shape, count) make_array(m, array, sizeof(array), 5126, shape, count)

/* "extensionsUsed":[..], with those that occur in a text that does not declare them itself. Static storage. */
static inline const char *make_declaration(const struct make *m, const char *rest)
{
    static const char *const names[] = {
        "EXT_mesh_gpu_instancing",
        "EXT_meshopt_compression",
        "EXT_texture_webp",
        "KHR_draco_mesh_compression",
        "KHR_mesh_quantization",
        "KHR_materials_clearcoat",
        "KHR_materials_sheen",
        "KHR_materials_transmission",
        "KHR_materials_ior",
        "KHR_materials_specular",
        "KHR_materials_unlit",
        "KHR_meshopt_compression",
        "KHR_texture_transform",
        "KHR_materials_volume",
        "KHR_materials_diffuse_transmission",
        "KHR_materials_pbrSpecularGlossiness",
    };
    static char text[512];
    const char *head = ",\"extensionsUsed\":[";

    text[0] = '\0';
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]) && !strstr(rest, "extensionsUsed"); i++) {
        if (!strstr(rest, names[i]) && !strstr(m->views, names[i]))
            continue;
        const size_t n = strlen(text);
        snprintf(text + n, sizeof(text) - n, "%s\"%s\"", n ? "," : head, names[i]);
    }
    return strcat(text, text[0] ? "]" : "");
}

/* Writes made.gltf and data.bin; `rest` holds the other members. Returns the path, static storage. */
static inline const char *make_gltf(struct make *m, const char *rest)
{
    static char text[1 << 16];

    folder_write(&m->folder, "data.bin", m->bytes, m->size);
    char fallback[128] = "";
    if (m->packing)
        snprintf(fallback, sizeof(fallback), ",{\"byteLength\":%zu,\"extensions\":{\"%s\":{\"fallback\":true}}}",
                 m->unpacked, m->packing);
    snprintf(text, sizeof(text),
             "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"uri\":\"data.bin\",\"byteLength\":%zu}%s],"
             "\"bufferViews\":[%s],\"accessors\":[%s],%s%s}",
             m->size, fallback, m->views, m->accessors, rest, make_declaration(m, rest));
    return folder_text(&m->folder, "made.gltf", text);
}

static inline struct scene *make_scene(struct make *m, const char *rest)
{
    return load_or_fail(make_gltf(m, rest));
}

/* What is said of a file that is refused, static storage. */
static inline const char *make_refused(const char *path, enum err expected)
{
    static struct reason why;
    struct scene *s = NULL;

    why.text[0] = '\0';
    const enum err e = load_here(path, &s, &why);
    if (e != expected)
        fail_msg("%d, not %d: %s", (int)e, (int)expected, why.text);
    assert_null(s);
    return why.text;
}

static inline void assert_near(struct vec3 v, float x, float y, float z)
{
    if (fabsf(v.x - x) > 1e-5f || fabsf(v.y - y) > 1e-5f || fabsf(v.z - z) > 1e-5f)
        fail_msg("(%g, %g, %g), not (%g, %g, %g)", (double)v.x, (double)v.y, (double)v.z, (double)x, (double)y,
                 (double)z);
}

static inline struct vec3 vertex(const struct mesh *m, uint32_t i)
{
    return vec3_make(m->positions[3 * i], m->positions[3 * i + 1], m->positions[3 * i + 2]);
}

/* Sum over the triangles of half the cross products: area times normal. */
static inline struct vec3 area_of(const struct mesh *m)
{
    struct vec3 sum = { 0 };

    for (uint32_t i = 0; i < m->triangle_count; i++) {
        const uint32_t *t = m->indices + 3 * i;
        const struct vec3 a = vertex(m, t[0]), b = vertex(m, t[1]), c = vertex(m, t[2]);
        sum = vec3_add(sum, vec3_scale(vec3_cross(vec3_sub(b, a), vec3_sub(c, a)), 0.5f));
    }
    return sum;
}
