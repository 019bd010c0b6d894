/* Outlines: single-sided shells around other meshes that are turned inside out. Viewers cull their near side, so that
 * only a dark rim remains; here all surfaces have two sides, and the shell would hide what it surrounds. */
#include "scene/geometry/scene_build.h"

#include "base/mem.h"
#include "scene/geometry/mesh_read.h"

#include <math.h>

#define THICK 0.01         /* volume over area and diagonal: a sheet has less */
#define FILLED 0.5         /* of a shell's volume that other meshes fill: a room's things fill less */
#define MARGIN 0.1         /* of the diagonal, between a shell's box and that of the meshes inside */
#define CANDIDATES_MAX 256 /* shells that are looked into: each looks at every mesh */

struct body { /* a mesh */
    double low[3], high[3];
    double diagonal, area, volume; /* volume < 0: inside out */
};

/* Of a mesh that is not closed, the volume between its triangles and the middle of its box. */
static void measure(const struct mesh *m, struct body *b)
{
    struct box box = { { INFINITY, INFINITY, INFINITY }, { -INFINITY, -INFINITY, -INFINITY } };
    double middle[3], p[3][3], sum = 0.0;

    mesh_grow_box(m, &box);
    *b = (struct body){ .low = { box.low.x, box.low.y, box.low.z }, .high = { box.high.x, box.high.y, box.high.z } };
    for (int k = 0; k < 3; k++) {
        middle[k] = 0.5 * (b->low[k] + b->high[k]);
        sum += (b->high[k] - b->low[k]) * (b->high[k] - b->low[k]);
    }
    b->diagonal = sqrt(sum);
    for (uint32_t i = 0; i < m->triangle_count; i++) {
        double u[3], v[3], w[3];
        mesh_corners(m, i, p);
        for (int k = 0; k < 3; k++) {
            u[k] = p[1][k] - p[0][k];
            v[k] = p[2][k] - p[0][k];
            w[k] = p[0][k] - middle[k];
        }
        const double n[3] = { u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0] };
        b->area += 0.5 * sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        b->volume += mesh_side(m) * (n[0] * w[0] + n[1] * w[1] + n[2] * w[2]) / 6.0;
    }
}

/* What nothing passes. */
static bool is_opaque(const struct material *m)
{
    return material_has_layers(m) && m->alpha_mode == ALPHA_OPAQUE && !(m->transmits > 0.0f) &&
           !(m->emission.x > 0.0f || m->emission.y > 0.0f || m->emission.z > 0.0f);
}

static bool is_inside_out(const struct body *b)
{
    return b->volume < -THICK * b->area * b->diagonal;
}

static bool contains(const struct body *b, const double low[3], const double high[3])
{
    for (int k = 0; k < 3; k++) {
        if (!(low[k] >= b->low[k] && high[k] <= b->high[k]))
            return false;
    }
    return true;
}

/* Whether the meshes within the shell fill it, and reach almost as far. */
static bool is_filled(const struct body *shell, const struct body *bodies, size_t count)
{
    double low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY }, volume = 0.0;

    for (size_t i = 0; i < count; i++) {
        const struct body *b = &bodies[i];
        if (!(b->volume > 0.0) || !contains(shell, b->low, b->high))
            continue;
        volume += b->volume;
        for (int k = 0; k < 3; k++) {
            low[k] = fmin(low[k], b->low[k]);
            high[k] = fmax(high[k], b->high[k]);
        }
    }
    for (int k = 0; k < 3; k++) {
        if (!(low[k] - shell->low[k] <= MARGIN * shell->diagonal &&
              shell->high[k] - high[k] <= MARGIN * shell->diagonal))
            return false;
    }
    return volume >= -FILLED * shell->volume;
}

static bool holds_a_camera(const struct scene *s, const struct body *shell)
{
    for (size_t i = 0; i < s->camera_count; i++) {
        const struct vec3 c = s->cameras[i].position;
        const double at[3] = { c.x, c.y, c.z };
        if (contains(shell, at, at))
            return true;
    }
    return false;
}

/* Removes the marked of the meshes from `first` on. */
static void remove_marked(struct scene *s, size_t first, const bool *marked)
{
    size_t kept = first;

    for (size_t i = first; i < s->mesh_count; i++) {
        if (marked[i - first])
            mesh_finish(&s->meshes[i]);
        else
            s->meshes[kept++] = s->meshes[i];
    }
    s->mesh_count = kept;
}

static void mark_shells(struct scene *s, size_t first, const bool *single_sided, const struct body *bodies,
                        bool *marked, uint64_t *dropped)
{
    const size_t count = s->mesh_count - first;
    unsigned candidates = 0;

    for (size_t i = 0; i < count && candidates < CANDIDATES_MAX; i++) {
        const struct mesh *m = &s->meshes[first + i];
        if (!is_inside_out(&bodies[i]) || !single_sided[m->material] || !is_opaque(&s->materials[m->material]))
            continue;
        candidates++;
        marked[i] = !holds_a_camera(s, &bodies[i]) && is_filled(&bodies[i], bodies, count);
        dropped[m->material] += marked[i] ? m->triangle_count : 0;
    }
}

enum err scene_drop_outlines(struct scene *s, size_t first, const bool *single_sided, uint64_t *dropped)
{
    const size_t count = s->mesh_count - first;

    /* Instances share arrays and are numbered. */
    for (size_t i = first; i < s->mesh_count; i++) {
        if (s->meshes[i].placed)
            return ERR_OK;
    }
    struct body *bodies = mem_alloc(count, sizeof(*bodies));
    bool *marked = mem_alloc(count, sizeof(*marked));
    const enum err e = bodies && marked ? ERR_OK : ERR_NOMEM;
    for (size_t i = 0; i < count && !e; i++)
        measure(&s->meshes[first + i], &bodies[i]);
    if (!e) {
        mark_shells(s, first, single_sided, bodies, marked, dropped);
        remove_marked(s, first, marked);
    }
    mem_free(bodies);
    mem_free(marked);
    return e;
}
