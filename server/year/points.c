#include "year/points.h"

#include "base/mem.h"
#include "base/sort.h"
#include "base/vec.h"
#include "light/estimators/sunlight.h"
#include "scene/geometry/mesh_read.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static enum err add(struct points *p, const struct sensor *s, const char *name, struct reason *why)
{
    if (p->count == POINTS_MAX)
        return err_say(why, ERR_RANGE, "%s: more than %d sensors", name, POINTS_MAX);
    if (!mem_reserve(&p->at, p->count, &p->capacity, sizeof(*p->at)))
        return err_say(why, ERR_NOMEM, "out of memory");
    p->at[p->count++] = *s;
    return ERR_OK;
}

/* ---- A file ---- */

/* origin: of the scene; the file has its coordinates. */
static enum err take_line(struct points *p, const double origin[3], const char *path, unsigned number, const char *line,
                          struct reason *why)
{
    double v[6], length;
    const char *at = line;

    for (int k = 0; k < 6; k++) {
        char *end;
        v[k] = strtod(at, &end);
        if (end == at || !isfinite(v[k]) || fabs(v[k]) > 1e7)
            return err_say(why, ERR_FORMAT, "%s: line %u: number %d of x y z nx ny nz is missing or not a number", path,
                           number, k + 1);
        at = end + strspn(end, " \t");
        at += k < 5 && *at == ',';
    }
    if (at[strspn(at, " \t\r\n")])
        return err_say(why, ERR_FORMAT, "%s: line %u: more than the six numbers x y z nx ny nz", path, number);
    length = sqrt(dot3(v + 3, v + 3));
    if (!(length > 1e-6))
        return err_say(why, ERR_FORMAT, "%s: line %u: the normal has zero length", path, number);
    const struct sensor s = { vec3_make((float)(v[0] - origin[0]), (float)(v[1] - origin[1]),
                                        (float)(v[2] - origin[2])),
                              vec3_make((float)(v[3] / length), (float)(v[4] / length), (float)(v[5] / length)) };
    return add(p, &s, path, why);
}

static enum err read_file(const char *path, const struct scene *scene, struct points *out, struct reason *why)
{
    char line[512];
    unsigned number = 0;
    enum err e = ERR_OK;
    FILE *f = fopen(path, "r");

    if (!f)
        return err_say(why, ERR_IO, "--sensors %s: %s; expected a file, or grid:NAME", path, strerror(errno));
    while (!e && fgets(line, sizeof(line), f)) {
        number++;
        if (!strchr(line, '\n') && !feof(f))
            e = err_say(why, ERR_FORMAT, "%s: line %u is too long", path, number);
        line[strcspn(line, "#")] = '\0';
        if (!e && line[strspn(line, " \t\r\n")])
            e = take_line(out, scene->origin, path, number, line, why);
    }
    if (!e && ferror(f))
        e = err_say(why, ERR_IO, "%s: %s", path, strerror(errno));
    if (!e && out->count == 0)
        e = err_say(why, ERR_FORMAT, "%s: there is no sensor; expected one line 'x y z nx ny nz' each", path);
    fclose(f);
    return e;
}

/* The median distance to the nearest neighbour. */
static double median_spacing(const struct points *p)
{
    double *near = mem_alloc(p->count, sizeof(*near));
    double median = 0.0;

    for (size_t i = 0; near && i < p->count; i++) {
        near[i] = INFINITY;
        for (size_t k = 0; k < p->count && p->count <= 4000; k++) {
            const struct vec3 d = vec3_sub(p->at[i].position, p->at[k].position);
            if (k != i)
                near[i] = fmin(near[i], (double)vec3_length(d));
        }
    }
    if (near && p->count > 1) {
        sort_doubles(near, p->count);
        median = isfinite(near[p->count / 2]) ? near[p->count / 2] : 0.0;
    }
    mem_free(near);
    return median;
}

/* ---- A grid ---- */

struct grid {
    char name[80];
    double spacing, height, margin;
    double normal[3], u[3], v[3]; /* unit */
    double low[2], high[2];       /* of its corners along u and v, m */
};

static enum err take_key(struct grid *g, const char *key, struct reason *why)
{
    static const struct {
        const char *name;
        double least, most;
    } keys[] = { { "spacing", 0.01, 1000.0 }, { "height", -1000.0, 1000.0 }, { "margin", 0.0, 1000.0 } };
    double *const out[] = { &g->spacing, &g->height, &g->margin };

    for (size_t k = 0; k < 3; k++) {
        const size_t n = strlen(keys[k].name);
        char *end;
        if (strncmp(key, keys[k].name, n) != 0 || key[n] != '=')
            continue;
        *out[k] = strtod(key + n + 1, &end);
        if (end == key + n + 1 || *end || !(*out[k] >= keys[k].least && *out[k] <= keys[k].most))
            return err_say(why, ERR_USAGE, "--sensors: %s is not a number from %g to %g (metres)", key, keys[k].least,
                           keys[k].most);
        return ERR_OK;
    }
    return err_say(why, ERR_USAGE, "--sensors: unknown key '%s'; expected spacing, height or margin", key);
}

static enum err read_spec(const char *spec, struct grid *g, struct reason *why)
{
    const char *at = spec + strlen("grid:");
    size_t length = strcspn(at, ",");

    *g = (struct grid){ .spacing = 0.5, .height = 0.8 };
    if (length == 0 || length >= sizeof(g->name))
        return err_say(why, ERR_USAGE, "--sensors %s: the surface's name is missing; expected grid:NAME", spec);
    memcpy(g->name, at, length);
    for (at += length; *at; at += length) {
        char key[64];
        at++;
        length = strcspn(at, ",");
        snprintf(key, sizeof(key), "%.*s", (int)(length < 63 ? length : 63), at);
        const enum err e = take_key(g, key, why);
        if (e)
            return e;
    }
    return ERR_OK;
}

static bool is_of(const struct scene *s, const struct mesh *m, const char *name)
{
    return strcmp(m->name, name) == 0 || strcmp(s->materials[m->material].name, name) == 0;
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Twice the triangle's area along its normal. */
static void area(const double p[3][3], double out[3])
{
    const double a[3] = { p[1][0] - p[0][0], p[1][1] - p[0][1], p[1][2] - p[0][2] };
    const double b[3] = { p[2][0] - p[0][0], p[2][1] - p[0][1], p[2][2] - p[0][2] };
    cross(a, b, out);
}

/* The sum of the areas of the triangles that face the way of the largest one: a slab has two sides. */
static bool find_normal(const struct scene *s, struct grid *g)
{
    double largest = 0.0, towards[3] = { 0.0, 1.0, 0.0 }, n[3];

    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < s->mesh_count; i++) {
            const struct mesh *m = &s->meshes[i];
            for (uint32_t t = 0; is_of(s, m, g->name) && t < m->triangle_count; t++) {
                double p[3][3];
                mesh_corners(m, t, p);
                area((const double(*)[3])p, n);
                const double size = mesh_side(m) * sqrt(dot3(n, n)), up = mesh_side(m) * n[1];
                if (pass == 0 && fabs(size) + up > largest) { /* of two sides the upper one */
                    largest = fabs(size) + up;
                    for (int k = 0; k < 3; k++)
                        towards[k] = mesh_side(m) * n[k];
                } else if (pass == 1 &&
                           mesh_side(m) * dot3(n, towards) > 0.5 * fabs(size) * sqrt(dot3(towards, towards))) {
                    for (int k = 0; k < 3; k++)
                        g->normal[k] += mesh_side(m) * n[k];
                }
            }
        }
    const double length = sqrt(dot3(g->normal, g->normal));
    for (int k = 0; k < 3 && length > 0.0; k++)
        g->normal[k] /= length;
    return length > 0.0;
}

/* u horizontal where that is possible; on a floor u and v are the axes of x and z. */
static void find_axes(struct grid *g)
{
    const bool flat = fabs(g->normal[1]) > 0.9999;
    const double up[3] = { 0.0, 1.0, 0.0 };

    if (flat) {
        g->u[0] = 1.0;
        g->v[2] = 1.0;
        return;
    }
    cross(up, g->normal, g->u);
    const double length = sqrt(dot3(g->u, g->u));
    for (int k = 0; k < 3; k++)
        g->u[k] /= length;
    cross(g->normal, g->u, g->v);
}

/* Calls for all triangles of the surface that face along its normal: corners along u, v and the normal. */
static bool next_triangle(const struct scene *s, const struct grid *g, size_t *mesh, uint32_t *triangle,
                          double out[3][3])
{
    for (; *mesh < s->mesh_count; (*mesh)++, *triangle = 0) {
        const struct mesh *m = &s->meshes[*mesh];
        if (!is_of(s, m, g->name))
            continue;
        while (*triangle < m->triangle_count) {
            double p[3][3], n[3];
            mesh_corners(m, (*triangle)++, p);
            area((const double(*)[3])p, n);
            if (!(mesh_side(m) * dot3(n, g->normal) > 0.5 * sqrt(dot3(n, n))))
                continue;
            for (int k = 0; k < 3; k++) {
                out[k][0] = dot3(p[k], g->u);
                out[k][1] = dot3(p[k], g->v);
                out[k][2] = dot3(p[k], g->normal);
            }
            return true;
        }
    }
    return false;
}

static void find_bounds(const struct scene *s, struct grid *g)
{
    size_t mesh = 0;
    uint32_t triangle = 0;
    double p[3][3];

    g->low[0] = g->low[1] = INFINITY;
    g->high[0] = g->high[1] = -INFINITY;
    while (next_triangle(s, g, &mesh, &triangle, p))
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 2; a++) {
                g->low[a] = fmin(g->low[a], p[k][a]);
                g->high[a] = fmax(g->high[a], p[k][a]);
            }
}

/* The points of the grid: u = first[0] + i spacing, v = first[1] + j spacing. */
struct lattice {
    uint32_t cells[2];
    double first[2];
    double *height; /* [cells[1]][cells[0]]: of the surface there, the topmost, m; -INFINITY: it is not there */
};

/* Raises the points that lie over one triangle. */
static void raise_points(const struct grid *g, const double p[3][3], struct lattice *l)
{
    const double a[2] = { p[1][0] - p[0][0], p[1][1] - p[0][1] }, b[2] = { p[2][0] - p[0][0], p[2][1] - p[0][1] };
    const double det = a[0] * b[1] - a[1] * b[0];
    int64_t from[2], until[2];

    if (!(fabs(det) > 1e-12))
        return;
    for (int k = 0; k < 2; k++) {
        const double low = fmin(p[0][k], fmin(p[1][k], p[2][k])), high = fmax(p[0][k], fmax(p[1][k], p[2][k]));
        from[k] = (int64_t)fmax(0.0, floor((low - l->first[k]) / g->spacing));
        until[k] = (int64_t)fmin(l->cells[k] - 1.0, ceil((high - l->first[k]) / g->spacing));
    }
    for (int64_t j = from[1]; j <= until[1]; j++)
        for (int64_t i = from[0]; i <= until[0]; i++) {
            const double x = l->first[0] + g->spacing * (double)i - p[0][0];
            const double y = l->first[1] + g->spacing * (double)j - p[0][1];
            const double s = (x * b[1] - y * b[0]) / det, t = (a[0] * y - a[1] * x) / det;
            double *height = &l->height[(size_t)j * l->cells[0] + (size_t)i];
            if (s >= -1e-9 && t >= -1e-9 && s + t <= 1.0 + 1e-9)
                *height = fmax(*height, p[0][2] + s * (p[1][2] - p[0][2]) + t * (p[2][2] - p[0][2]));
        }
}

static enum err add_points(const struct grid *g, const struct lattice *l, struct points *out, struct reason *why)
{
    enum err e = ERR_OK;

    for (uint32_t j = 0; j < l->cells[1] && !e; j++)
        for (uint32_t i = 0; i < l->cells[0] && !e; i++) {
            const double u = l->first[0] + g->spacing * i, v = l->first[1] + g->spacing * j;
            const double h = l->height[(size_t)j * l->cells[0] + i] + g->height;
            if (!isfinite(h))
                continue;
            const struct sensor one = {
                vec3_make((float)(u * g->u[0] + v * g->v[0] + h * g->normal[0]),
                          (float)(u * g->u[1] + v * g->v[1] + h * g->normal[1]),
                          (float)(u * g->u[2] + v * g->v[2] + h * g->normal[2])),
                vec3_make((float)g->normal[0], (float)g->normal[1], (float)g->normal[2]),
            };
            e = add(out, &one, g->name, why);
        }
    return e;
}

/* Points in the middle of whole cells; the rest is left free at either side. */
static enum err lay_grid(const struct scene *s, const struct grid *g, struct points *out, struct reason *why)
{
    struct lattice l = { .height = NULL };
    size_t mesh = 0;
    uint32_t triangle = 0;
    double p[3][3], cells[2];

    for (int a = 0; a < 2; a++) {
        const double length = g->high[a] - g->low[a] - 2.0 * g->margin;
        cells[a] = length > 0.0 ? fmax(1.0, floor(length / g->spacing + 1e-6)) : 0.0;
        l.first[a] = 0.5 * (g->low[a] + g->high[a] - g->spacing * cells[a]) + 0.5 * g->spacing;
    }
    if (cells[0] * cells[1] > 50.0 * POINTS_MAX)
        return err_say(why, ERR_RANGE, "--sensors: %s is %.3g m x %.3g m: more than %d sensors at spacing=%g", g->name,
                       g->high[0] - g->low[0], g->high[1] - g->low[1], POINTS_MAX, g->spacing);
    out->spacing = g->spacing;
    if (!(cells[0] * cells[1] > 0.0))
        return ERR_OK;
    for (int a = 0; a < 2; a++)
        l.cells[a] = (uint32_t)cells[a];
    const size_t count = (size_t)l.cells[0] * l.cells[1];
    l.height = mem_alloc_raw(count, sizeof(*l.height));
    if (!l.height)
        return err_say(why, ERR_NOMEM, "out of memory");
    for (size_t i = 0; i < count; i++)
        l.height[i] = -INFINITY;
    while (next_triangle(s, g, &mesh, &triangle, p))
        raise_points(g, (const double(*)[3])p, &l);
    const enum err e = add_points(g, &l, out, why);
    mem_free(l.height);
    return e;
}

/* "floor, wall and 3 more" */
static void list_names(const struct scene *s, char *out, size_t size)
{
    size_t used = 0, named = 0;

    out[0] = '\0';
    for (size_t i = 0; i < s->mesh_count + s->material_count && used + 80 < size; i++) {
        const char *name = i < s->mesh_count ? s->meshes[i].name : s->materials[i - s->mesh_count].name;
        if (!name[0] || strstr(out, name))
            continue;
        used += (size_t)snprintf(out + used, size - used, "%s%s", named++ ? ", " : "", name);
    }
    if (named == 0)
        snprintf(out, size, "nothing: its surfaces have no names");
}

static enum err make_grid(const char *spec, const struct scene *scene, struct points *out, struct reason *why)
{
    struct grid g;
    char names[200];
    enum err e = read_spec(spec, &g, why);

    if (e)
        return e;
    if (!find_normal(scene, &g)) {
        list_names(scene, names, sizeof(names));
        return err_say(why, ERR_USAGE, "--sensors: the scene has no surface '%s'; it has %s", g.name, names);
    }
    find_axes(&g);
    find_bounds(scene, &g);
    e = lay_grid(scene, &g, out, why);
    if (!e && out->count == 0)
        e = err_say(why, ERR_USAGE,
                    "--sensors %s: no point of the grid lies over the surface, which is %.3g m x %.3g m", spec,
                    g.high[0] - g.low[0], g.high[1] - g.low[1]);
    return e;
}

enum err points_read(const char *spec, const struct scene *scene, struct points *out, struct reason *why)
{
    *out = (struct points){ .count = 0 };
    const bool grid = strncmp(spec, "grid:", 5) == 0;
    const enum err e = grid ? make_grid(spec, scene, out, why) : read_file(spec, scene, out, why);
    if (!e && !grid)
        out->spacing = median_spacing(out);
    if (e)
        points_finish(out);
    return e;
}

void points_finish(struct points *p)
{
    mem_free(p->at);
    *p = (struct points){ .count = 0 };
}

/* ---- Points within solids ---- */

#define LOOKS 64   /* directions; chosen, not measured */
#define NEAR 1e-4f /* m: a point on a surface does not meet it */

/* By directions of the hemisphere, cosine-weighted. */
static bool is_enclosed(const struct scene *scene, const struct rays *rays, const struct sensor *s)
{
    int backs = 0;
    double r;

    for (int k = 0; k < LOOKS; k++) {
        const struct vec3 flat = spiral_place(s->normal, 1.0, k, LOOKS, &r);
        const struct vec3 dir = vec3_normalize(vec3_add(flat, vec3_scale(s->normal, (float)sqrt(1.0 - r * r))));
        struct surface met;
        struct hit h;
        if (!rays_intersect(rays, s->position, dir, NEAR, &h) ||
            scene->materials[scene->meshes[h.mesh].material].kind == MATERIAL_GLASS)
            return false;
        rays_surface(rays, &h, vec3_scale(dir, -1.0f), &met);
        backs += !met.outside;
    }
    return 4 * backs > LOOKS;
}

size_t points_enclosed(const struct points *p, const struct scene *scene, const struct rays *rays, size_t *first)
{
    size_t count = 0;

    for (size_t i = 0; i < p->count; i++)
        if (is_enclosed(scene, rays, &p->at[i]) && count++ == 0)
            *first = i;
    return count;
}
