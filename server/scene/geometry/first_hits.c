#include "scene/geometry/view.h"

#include "base/mem.h"
#include "scene/geometry/coverage.h"
#include "scene/geometry/scatter_hit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define EDGE_RAYS 4   /* as the G-buffer's default */
#define PARTS_MAX 64  /* meshes of a pixel; further ones are left out */
#define LAYERS_MAX 32 /* partly transparent surfaces of a ray */

struct tracing {
    const struct scene *scene;
    const struct rays *rays;
    const struct gbuffer *g;
    const struct view *view;
    uint32_t side;
    struct first_hits *out;
};

/* The parts of one pixel. */
struct pile {
    struct first_part at[PARTS_MAX];
    uint32_t count;
};

static void add_share(struct pile *p, uint32_t mesh, float share)
{
    uint32_t k = 0;

    while (k < p->count && p->at[k].mesh != mesh)
        k++;
    if (k == p->count) {
        if (p->count == PARTS_MAX)
            return;
        p->at[p->count++] = (struct first_part){ mesh, 0.0f };
    }
    p->at[k].share += share;
}

/* Adds the first hit of the ray through (x, y), one of side^2; *seen is the hit that leaves less than half of the ray
 * to surfaces behind it. False: there is none. */
static bool trace(const struct tracing *t, double x, double y, uint32_t side, struct pile *p, struct hit *seen)
{
    const struct view *v = t->view;
    const struct vec3 origin = vec3_make((float)v->origin[0], (float)v->origin[1], (float)v->origin[2]);
    const struct vec3 dir = view_direction(v, x, y);
    const float angle = (float)(sqrt(view_solid_angle(v, dir)) / side);
    const float sharp[2][2] = { { 0.0f } };
    float left = view_sees(v, x, y) ? 1.0f : 0.0f, from = 0.0f;
    bool found = false, varies;
    struct hit h;

    for (int k = 0; k < LAYERS_MAX && left > 1e-3f && rays_see(t->rays, origin, dir, from, angle, &h, &varies); k++) {
        struct scatter at;
        float passed[3];
        rays_surface(t->rays, &h, vec3_scale(dir, -1.0f), &at.surface);
        scatter_on(t->scene, &h, NULL, &at);
        const float covered = coverage_seen(t->scene, &h, &at, dir, sharp, passed);
        add_share(p, h.mesh, left * covered / (float)(side * side));
        left *= covered < 1.0f ? fminf(1.0f - covered, fmaxf(passed[0], fmaxf(passed[1], passed[2]))) : 0.0f;
        if (!found && left < 0.5f) {
            *seen = h;
            found = true;
        }
        from = nextafterf(h.t, INFINITY);
    }
    return found;
}

static void put_surface(const struct tracing *t, size_t pixel, struct vec3 dir, const struct hit *h)
{
    const double *ahead = t->view->ahead;
    struct surface s;

    rays_surface(t->rays, h, vec3_scale(dir, -1.0f), &s);
    memcpy(t->out->position + 3 * pixel, (const float[]){ s.position.x, s.position.y, s.position.z },
           3 * sizeof(float));
    memcpy(t->out->normal + 3 * pixel, (const float[]){ s.shading.x, s.shading.y, s.shading.z }, 3 * sizeof(float));
    t->out->depth[pixel] = (float)((double)h->t * (ahead[0] * dir.x + ahead[1] * dir.y + ahead[2] * dir.z));
}

static int by_share(const void *a, const void *b)
{
    const struct first_part *p = a, *q = b;

    if (p->share != q->share)
        return p->share < q->share ? 1 : -1;
    return p->mesh < q->mesh ? -1 : p->mesh > q->mesh;
}

static bool is_plain(const struct gbuffer *g, size_t pixel)
{
    const uint32_t first = g->entry_first[pixel], entries = g->entry_first[pixel + 1] - first;
    const uint32_t misses = g->miss_first[pixel + 1] - g->miss_first[pixel];

    if (entries + misses != 1)
        return false;
    return misses == 1 || !g->packets[g->entries[first].point / PACKET].behind[g->entries[first].point % PACKET];
}

/* One ray through the centre; for shares, side^2 rays as the G-buffer's in pixels with edges. */
static void see_pixel(const struct tracing *t, uint32_t x, uint32_t y, struct pile *p)
{
    const size_t pixel = (size_t)y * t->g->width + x;
    struct hit h;

    p->count = 0;
    if (trace(t, x + 0.5, y + 0.5, 1, p, &h))
        put_surface(t, pixel, view_direction(t->view, x + 0.5, y + 0.5), &h);
    else
        t->out->depth[pixel] = FIRST_HITS_FAR;
    if (is_plain(t->g, pixel) || t->side < 2)
        return;
    p->count = 0;
    for (uint32_t i = 0; i < t->side * t->side; i++) {
        double at[2];
        view_ray_in_pixel(i, t->side, at);
        trace(t, x + at[0], y + at[1], t->side, p, &h);
    }
    qsort(p->at, p->count, sizeof(p->at[0]), by_share);
}

/* The parts of a row, until all rows are there. */
struct row_parts {
    struct first_part *at;
    size_t count, room;
};

static bool see_row(const struct tracing *t, uint32_t y, struct row_parts *row)
{
    struct pile p;

    for (uint32_t x = 0; x < t->g->width; x++) {
        see_pixel(t, x, y, &p);
        for (uint32_t k = 0; k < p.count; k++) {
            if (!mem_reserve(&row->at, row->count, &row->room, sizeof(*row->at)))
                return false;
            row->at[row->count++] = p.at[k];
        }
        t->out->first[(size_t)y * t->g->width + x + 1] = p.count;
    }
    return true;
}

static enum err join(struct first_hits *f, const struct gbuffer *g, const struct row_parts *rows)
{
    const size_t pixels = (size_t)g->width * g->height;
    size_t at = 0;

    for (size_t i = 0; i < pixels; i++)
        f->first[i + 1] += f->first[i];
    f->parts = mem_alloc(f->first[pixels] + 1, sizeof(*f->parts));
    if (!f->parts)
        return ERR_NOMEM;
    for (uint32_t y = 0; y < g->height; at += rows[y++].count)
        if (rows[y].count > 0)
            memcpy(f->parts + at, rows[y].at, rows[y].count * sizeof(*f->parts));
    return ERR_OK;
}

enum err first_hits_create(const struct scene *scene, const struct rays *rays, const struct gbuffer *g,
                           const struct view *view, uint32_t edge_rays, struct first_hits **out)
{
    const size_t pixels = (size_t)g->width * g->height;
    struct row_parts *rows = mem_alloc(g->height, sizeof(*rows));
    struct first_hits *f = mem_alloc(1, sizeof(*f));
    bool failed = !rows || !f;

    *out = NULL;
    if (!failed) {
        f->position = mem_alloc(pixels, 3 * sizeof(float));
        f->normal = mem_alloc(pixels, 3 * sizeof(float));
        f->depth = mem_alloc(pixels, sizeof(float));
        f->first = mem_alloc(pixels + 1, sizeof(*f->first));
        failed = !f->position || !f->normal || !f->depth || !f->first;
    }
    if (!failed) {
        const struct tracing t = { scene, rays, g, view, edge_rays ? edge_rays : EDGE_RAYS, f };
#pragma omp parallel for schedule(dynamic, 4) reduction(|| : failed)
        for (uint32_t y = 0; y < g->height; y++)
            failed = failed || !see_row(&t, y, &rows[y]);
    }
    if (!failed)
        failed = join(f, g, rows) != ERR_OK;
    for (uint32_t y = 0; rows && y < g->height; y++)
        mem_free(rows[y].at);
    mem_free(rows);
    if (failed) {
        first_hits_destroy(f);
        return ERR_NOMEM;
    }
    *out = f;
    return ERR_OK;
}

void first_hits_destroy(struct first_hits *f)
{
    if (!f)
        return;
    mem_free(f->position);
    mem_free(f->normal);
    mem_free(f->depth);
    mem_free(f->parts);
    mem_free(f->first);
    mem_free(f);
}
