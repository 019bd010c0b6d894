#include "import/reader/shape.h"

#include "base/mem.h"

#include <assert.h>
#include <math.h>

void shape_place(struct shape *s, float x, float y, float z, float turn)
{
    s->origin = vec3_make(x, y, z);
    s->turn = turn;
}

static struct vec3 turned(const struct shape *s, struct vec3 v)
{
    const float c = cosf(s->turn), n = sinf(s->turn);
    return vec3_make(c * v.x + n * v.z, v.y, c * v.z - n * v.x);
}

/* Reserves vertices and triangles; false once an allocation has failed. */
static bool reserve(struct shape *s, uint32_t vertices, uint32_t triangles)
{
    struct mesh *m = &s->mesh;

    if (m->vertex_count + vertices > s->vertex_room) {
        const uint32_t room = 2 * (m->vertex_count + vertices);
        /* one float of padding: Embree reads 16 bytes at the last vertex */
        float *p = mem_grow(m->positions, 3 * (size_t)m->vertex_count, 3 * (size_t)room + 1, sizeof(*p));
        if (p)
            m->positions = p;
        float *n = mem_grow(m->normals, 3 * (size_t)m->vertex_count, 3 * (size_t)room, sizeof(*n));
        if (n)
            m->normals = n;
        s->failed |= !p || !n;
        s->vertex_room = p && n ? room : s->vertex_room;
    }
    if (m->triangle_count + triangles > s->triangle_room) {
        const uint32_t room = 2 * (m->triangle_count + triangles);
        uint32_t *i = mem_grow(m->indices, 3 * (size_t)m->triangle_count, 3 * (size_t)room, sizeof(*i));
        if (i)
            m->indices = i;
        s->failed |= !i;
        s->triangle_room = i ? room : s->triangle_room;
    }
    return !s->failed;
}

static void add_vertex(struct shape *s, struct vec3 position, struct vec3 normal)
{
    const size_t at = 3 * (size_t)s->mesh.vertex_count++;
    const struct vec3 p = vec3_add(turned(s, position), s->origin), n = turned(s, normal);

    s->mesh.positions[at] = p.x;
    s->mesh.positions[at + 1] = p.y;
    s->mesh.positions[at + 2] = p.z;
    s->mesh.normals[at] = n.x;
    s->mesh.normals[at + 1] = n.y;
    s->mesh.normals[at + 2] = n.z;
}

static void add_triangle(struct shape *s, uint32_t a, uint32_t b, uint32_t c)
{
    const size_t at = 3 * (size_t)s->mesh.triangle_count++;

    s->mesh.indices[at] = a;
    s->mesh.indices[at + 1] = b;
    s->mesh.indices[at + 2] = c;
}

/* Four corners, counter-clockwise seen from outside, each with a normal. */
static void add_quad(struct shape *s, const struct vec3 p[4], const struct vec3 n[4])
{
    if (!reserve(s, 4, 2))
        return;
    const uint32_t first = s->mesh.vertex_count;
    for (int k = 0; k < 4; k++)
        add_vertex(s, p[k], n[k]);
    add_triangle(s, first, first + 1, first + 2);
    add_triangle(s, first, first + 2, first + 3);
}

static void add_flat_quad(struct shape *s, struct vec3 a, struct vec3 b, struct vec3 c, struct vec3 d)
{
    /* the diagonals span the plane even if two corners coincide */
    const struct vec3 n = vec3_normalize(vec3_cross(vec3_sub(c, a), vec3_sub(d, b)));
    add_quad(s, (const struct vec3[4]){ a, b, c, d }, (const struct vec3[4]){ n, n, n, n });
}

void shape_box(struct shape *s, struct vec3 low, struct vec3 high)
{
    struct vec3 c[8]; /* bit 0: x, bit 1: y, bit 2: z */

    for (int i = 0; i < 8; i++)
        c[i] = vec3_make(i & 1 ? high.x : low.x, i & 2 ? high.y : low.y, i & 4 ? high.z : low.z);
    add_flat_quad(s, c[0], c[4], c[6], c[2]); /* -x */
    add_flat_quad(s, c[1], c[3], c[7], c[5]); /* +x */
    add_flat_quad(s, c[0], c[1], c[5], c[4]); /* -y */
    add_flat_quad(s, c[2], c[6], c[7], c[3]); /* +y */
    add_flat_quad(s, c[0], c[2], c[3], c[1]); /* -z */
    add_flat_quad(s, c[4], c[5], c[7], c[6]); /* +z */
}

static struct vec3 on_circle(float radius, float angle, float y)
{
    return vec3_make(radius * sinf(angle), y, radius * cosf(angle));
}

/* A straight segment: its two curved sides, top and bottom. */
static void sector_piece(struct shape *s, const struct sector *k, float a, float b)
{
    const struct vec3 na = on_circle(1.0f, a, 0.0f), nb = on_circle(1.0f, b, 0.0f);
    const struct vec3 ma = vec3_scale(na, -1.0f), mb = vec3_scale(nb, -1.0f);
    const struct vec3 outer[4] = { on_circle(k->outer, a, k->low), on_circle(k->outer, b, k->low),
                                   on_circle(k->outer, b, k->high), on_circle(k->outer, a, k->high) };
    const struct vec3 inner[4] = { on_circle(k->inner, b, k->low), on_circle(k->inner, a, k->low),
                                   on_circle(k->inner, a, k->high), on_circle(k->inner, b, k->high) };

    add_quad(s, outer, (const struct vec3[4]){ na, nb, nb, na });
    if (k->inner > 0.0f)
        add_quad(s, inner, (const struct vec3[4]){ mb, ma, ma, mb });
    add_flat_quad(s, inner[2], outer[3], outer[2], inner[3]);
    add_flat_quad(s, outer[0], inner[1], inner[0], outer[1]);
}

void shape_sector(struct shape *s, const struct sector *k)
{
    const float step = (k->to - k->from) / (float)k->parts;

    for (uint32_t i = 0; i < k->parts; i++)
        sector_piece(s, k, k->from + step * (float)i, k->from + step * (float)(i + 1));
    if (k->to - k->from > 6.2831f)
        return;
    for (int end = 0; end < 2; end++) {
        const float a = end ? k->to : k->from;
        const struct vec3 p[4] = { on_circle(k->inner, a, k->low), on_circle(k->outer, a, k->low),
                                   on_circle(k->outer, a, k->high), on_circle(k->inner, a, k->high) };
        if (end)
            add_flat_quad(s, p[1], p[0], p[3], p[2]);
        else
            add_flat_quad(s, p[0], p[1], p[2], p[3]);
    }
}

static struct vec3 grid_normal(const struct surface_map *m, float u, float v)
{
    const float h = 1e-3f;
    /* a step inside at the rims, where the surface may converge to a point */
    const float v0 = fminf(fmaxf(v, 2.0f * h), 1.0f - 2.0f * h);
    const float u0 = m->wrap_u ? u : fminf(fmaxf(u, h), 1.0f - h);
    const struct vec3 du = vec3_sub(m->at(u0 + h, v0, m->data), m->at(u0 - h, v0, m->data));
    const struct vec3 dv = vec3_sub(m->at(u0, v0 + h, m->data), m->at(u0, v0 - h, m->data));
    return vec3_normalize(vec3_cross(du, dv));
}

void shape_grid(struct shape *s, uint32_t columns, uint32_t rows, const struct surface_map *map)
{
    const uint32_t across = columns + 1;

    if (!reserve(s, across * (rows + 1), 2 * columns * rows))
        return;
    const uint32_t first = s->mesh.vertex_count;
    for (uint32_t j = 0; j <= rows; j++) {
        for (uint32_t i = 0; i <= columns; i++) {
            /* the seam's two columns of vertices must be identical */
            const float u = map->wrap_u && i == columns ? 0.0f : (float)i / (float)columns;
            const float v = (float)j / (float)rows;
            add_vertex(s, map->at(u, v, map->data), grid_normal(map, u, v));
        }
    }
    for (uint32_t j = 0; j < rows; j++) {
        for (uint32_t i = 0; i < columns; i++) {
            const uint32_t a = first + j * across + i;
            add_triangle(s, a, a + 1, a + across + 1);
            add_triangle(s, a, a + across + 1, a + across);
        }
    }
}

void shape_plate(struct shape *s, const float (*outline)[2], uint32_t n, float thickness)
{
    const float x = 0.5f * thickness;
    struct vec3 left[8], right[8];

    assert(n >= 3 && n <= 8);
    for (uint32_t i = 0; i < n; i++) {
        left[i] = vec3_make(-x, outline[i][1], outline[i][0]);
        right[i] = vec3_make(x, outline[i][1], outline[i][0]);
    }
    for (uint32_t i = 0; i < n; i++) {
        const uint32_t j = (i + 1) % n;
        add_flat_quad(s, left[i], left[j], right[j], right[i]);
    }
    for (uint32_t i = 1; i + 1 < n; i++) {
        add_flat_quad(s, left[0], left[i + 1], left[i], left[i]);
        add_flat_quad(s, right[0], right[i], right[i + 1], right[i + 1]);
    }
}

enum err shape_finish(struct shape *s, struct scene *scene, uint32_t material)
{
    enum err e = s->failed ? ERR_NOMEM : ERR_OK;

    s->mesh.material = material;
    (void)mesh_drop_degenerate(&s->mesh); /* halves of quads with coinciding corners, as at a pole */
    if (!e && s->mesh.triangle_count > 0)
        e = scene_add_mesh(scene, &s->mesh);
    if (e)
        mesh_finish(&s->mesh);
    *s = (struct shape){ 0 };
    return e;
}
