/* What the scene tests share: files in a folder of their own, scenes made of a few quads, and what was logged. */
#pragma once

#include "support/unit.h"

#include "base/mem.h"
#include "scene/geometry/scene.h"
#include "scene/geometry/scene_build.h"

#include <math.h>
#include <unistd.h>

#define FOLDER_PREFIX "/tmp/relight-scene-"

/* A folder that lasts as long as the process's temporary files do; remove it with folder_remove. */
struct folder {
    char path[64];
    char names[16][64];
    int count;
};

static inline void folder_make(struct folder *f)
{
    memset(f, 0, sizeof(*f));
    strcpy(f->path, FOLDER_PREFIX "XXXXXX");
    assert_non_null(mkdtemp(f->path));
}

/* Writes a file into it and returns its path, static storage. */
static inline const char *folder_write(struct folder *f, const char *name, const void *bytes, size_t count)
{
    static char path[256];

    int known = 0;
    while (known < f->count && strcmp(f->names[known], name) != 0)
        known++;
    assert_true(known < 16);
    snprintf(f->names[known], sizeof(f->names[0]), "%s", name);
    f->count = known < f->count ? f->count : known + 1;
    snprintf(path, sizeof(path), "%s/%s", f->path, name);
    FILE *out = fopen(path, "wb");
    assert_non_null(out);
    assert_int_equal(fwrite(bytes, 1, count, out), count);
    fclose(out);
    return path;
}

static inline const char *folder_text(struct folder *f, const char *name, const char *text)
{
    return folder_write(f, name, text, strlen(text));
}

static inline void folder_remove(struct folder *f)
{
    char path[256];

    for (int i = 0; i < f->count; i++) {
        snprintf(path, sizeof(path), "%s/%s", f->path, f->names[i]);
        unlink(path);
    }
    rmdir(f->path);
}

/* Standard error goes to a file between begin and end; end returns what was written, static storage. */
static int log_saved;

static inline void log_begin(void)
{
    FILE *f = tmpfile();

    assert_non_null(f);
    fflush(stderr);
    log_saved = dup(STDERR_FILENO);
    dup2(fileno(f), STDERR_FILENO);
    fclose(f);
}

static inline const char *log_end(void)
{
    static char text[8192];

    fflush(stderr);
    lseek(STDERR_FILENO, 0, SEEK_SET);
    const ssize_t n = read(STDERR_FILENO, text, sizeof(text) - 1);
    text[n > 0 ? n : 0] = '\0';
    dup2(log_saved, STDERR_FILENO);
    close(log_saved);
    return text;
}

static inline int count_of(const char *text, const char *part)
{
    int n = 0;

    for (const char *p = strstr(text, part); p; p = strstr(p + 1, part))
        n++;
    return n;
}

/* Appends a mesh of quads, four corners each, counter-clockwise from outside. */
static inline void add_quads(struct scene *s, uint32_t material, const float (*corners)[3], uint32_t quads)
{
    struct mesh m = { .vertex_count = 4 * quads, .triangle_count = 2 * quads, .material = material };

    m.positions = mem_alloc(3 * (size_t)m.vertex_count + 1, sizeof(float));
    m.indices = mem_alloc(m.triangle_count, 3 * sizeof(uint32_t));
    assert_true(m.positions && m.indices);
    memcpy(m.positions, corners, 3 * sizeof(float) * m.vertex_count);
    for (uint32_t i = 0; i < quads; i++) {
        const uint32_t t[6] = { 4 * i, 4 * i + 1, 4 * i + 2, 4 * i, 4 * i + 2, 4 * i + 3 };
        memcpy(m.indices + 6 * (size_t)i, t, sizeof(t));
    }
    assert_int_equal(scene_add_mesh(s, &m), ERR_OK);
}

static inline uint32_t add_lambert(struct scene *s, float albedo)
{
    const struct material m = { .diffuse = { albedo, albedo, albedo }, .texture = MATERIAL_NO_TEXTURE };
    uint32_t index = 0;

    assert_int_equal(scene_add_material(s, &m, &index), ERR_OK);
    return index;
}

/* The six sides of a box. */
static inline void add_box(struct scene *s, uint32_t material, const float a[3], const float b[3])
{
    const float q[24][3] = {
        { a[0], a[1], a[2] }, { a[0], a[1], b[2] }, { a[0], b[1], b[2] }, { a[0], b[1], a[2] }, /* -x */
        { b[0], a[1], a[2] }, { b[0], b[1], a[2] }, { b[0], b[1], b[2] }, { b[0], a[1], b[2] }, /* +x */
        { a[0], a[1], a[2] }, { b[0], a[1], a[2] }, { b[0], a[1], b[2] }, { a[0], a[1], b[2] }, /* -y */
        { a[0], b[1], a[2] }, { a[0], b[1], b[2] }, { b[0], b[1], b[2] }, { b[0], b[1], a[2] }, /* +y */
        { a[0], a[1], a[2] }, { a[0], b[1], a[2] }, { b[0], b[1], a[2] }, { b[0], a[1], a[2] }, /* -z */
        { a[0], a[1], b[2] }, { b[0], a[1], b[2] }, { b[0], b[1], b[2] }, { a[0], b[1], b[2] }, /* +z */
    };
    add_quads(s, material, q, 6);
}

/* A ball about the origin with its true normals, of 2 rows x rows quads. */
static inline void add_ball(struct scene *s, uint32_t material, float radius, uint32_t rows)
{
    const uint32_t columns = 2 * rows;
    struct mesh m = { .vertex_count = (rows + 1) * columns, .triangle_count = 2 * (rows - 1) * columns };
    uint32_t *t;

    m.material = material;
    m.positions = mem_alloc(3 * (size_t)m.vertex_count + 1, sizeof(float));
    m.normals = mem_alloc(3 * (size_t)m.vertex_count, sizeof(float));
    m.indices = t = mem_alloc(m.triangle_count, 3 * sizeof(uint32_t));
    assert_true(m.positions && m.normals && m.indices);
    for (uint32_t k = 0; k < m.vertex_count; k++) {
        const double theta = PI * (k / columns) / rows, phi = 2.0 * PI * (k % columns) / columns;
        const double n[3] = { sin(theta) * sin(phi), cos(theta), sin(theta) * cos(phi) };
        for (int c = 0; c < 3; c++) {
            m.normals[3 * (size_t)k + (size_t)c] = (float)n[c];
            m.positions[3 * (size_t)k + (size_t)c] = (float)(radius * n[c]);
        }
    }
    for (uint32_t i = 0; i < rows; i++)
        for (uint32_t j = 0; j < columns; j++) {
            const uint32_t a = i * columns + j, b = i * columns + (j + 1) % columns, c = a + columns, d = b + columns;
            const uint32_t lower[3] = { a, c, d }, upper[3] = { a, d, b }; /* at the poles one of them is a line */
            memcpy(t, lower, i + 1 < rows ? sizeof(lower) : 0);
            t += i + 1 < rows ? 3 : 0;
            memcpy(t, upper, i > 0 ? sizeof(upper) : 0);
            t += i > 0 ? 3 : 0;
        }
    assert_int_equal(scene_add_mesh(s, &m), ERR_OK);
}
