/* Nodes of the scene, with their meshes and cameras. */
#include "import/formats/gltf.h"

#include "base/mem.h"
#include "scene/geometry/mesh_read.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define DEPTH_MAX 256      /* of nodes */
#define COPIES_MAX 1000000 /* nodes, where those with several parents count as often */
#define FAR_AHEAD 100.0f   /* m: a camera this far from the origin looks at a point further ahead */
#define NARROW 0.5         /* degrees: angle of the perspective camera in place of an orthographic one */

/* ---- Structure: checked before anything descends ---- */

struct walk { /* over all nodes, parents before children */
    size_t count, *queue;
    uint32_t *parents; /* those that have not been passed */
    uint32_t *depth;   /* of the longest way from a root */
    double *copies;    /* ways from a root of the scene */
};

static enum err count_parents(struct gltf *g, struct walk *w)
{
    for (size_t i = 0; i < w->count; i++) {
        const struct gltf_at node = gltf_element(g, GLTF_NODES, i), children = gltf_key(&node, "children");
        for (size_t k = 0; k < json_array_size(children.value); k++) {
            const struct gltf_at child = gltf_item(&children, k);
            size_t index;
            const enum err e = gltf_index_of(g, &child, GLTF_NODES, &index);
            if (e)
                return e;
            w->parents[index]++;
        }
    }
    return ERR_OK;
}

static enum err pass_node(struct gltf *g, struct walk *w, size_t i, size_t *end)
{
    const struct gltf_at node = gltf_element(g, GLTF_NODES, i);
    const json_t *children = json_object_get(node.value, "children");

    if (w->depth[i] > DEPTH_MAX)
        return gltf_fault(g, NULL, ERR_RANGE, "nodes nested deeper than %d", DEPTH_MAX);
    for (size_t k = 0; k < json_array_size(children); k++) {
        const size_t child = (size_t)json_number_value(json_array_get(children, k));
        w->copies[child] += w->copies[i];
        if (w->depth[child] < w->depth[i] + 1)
            w->depth[child] = w->depth[i] + 1;
        if (--w->parents[child] == 0)
            w->queue[(*end)++] = child;
    }
    return ERR_OK;
}

static enum err walk_nodes(struct gltf *g, struct walk *w)
{
    size_t end = 0, at = 0;
    double copies = 0.0;
    enum err e = ERR_OK;

    for (size_t i = 0; i < w->count; i++) {
        if (w->parents[i] == 0)
            w->queue[end++] = i;
    }
    for (; at < end && !e; at++) {
        const size_t node = w->queue[at];
        copies += w->copies[node];
        gltf_count_uses(g, node, w->copies[node]);
        e = pass_node(g, w, node, &end);
    }
    if (!e && at < w->count)
        e = gltf_fault(g, NULL, ERR_FORMAT, "nodes are their own descendants");
    if (!e && copies > (double)w->count + COPIES_MAX)
        e = gltf_fault(g, NULL, ERR_RANGE, "nodes with several parents make %g nodes, more than %d", copies,
                       COPIES_MAX);
    return e;
}

struct roots { /* where the scene begins */
    struct gltf_at scene, list;
    bool *free; /* of each node: it has no parent. Used if the file has no scenes. */
};

static enum err find_scene(struct gltf *g, struct roots *r)
{
    size_t index;

    enum err e = gltf_index(g, &g->root, "scene", GLTF_SCENES, &index);
    if (e || g->counts[GLTF_SCENES] == 0)
        return e;
    r->scene = gltf_element(g, GLTF_SCENES, index == GLTF_NONE ? 0 : index);
    r->list = gltf_key(&r->scene, "nodes");
    return ERR_OK;
}

/* Calls visit for every root. */
static enum err each_root(struct gltf *g, const struct roots *r, enum err (*visit)(struct gltf *, size_t, void *),
                          void *context)
{
    enum err e = ERR_OK;

    for (size_t i = 0; i < json_array_size(r->list.value) && !e; i++) {
        const struct gltf_at item = gltf_item(&r->list, i);
        size_t node;
        e = gltf_index_of(g, &item, GLTF_NODES, &node);
        if (!e)
            e = visit(g, node, context);
    }
    for (size_t i = 0; g->counts[GLTF_SCENES] == 0 && i < g->counts[GLTF_NODES] && !e; i++)
        e = r->free[i] ? visit(g, i, context) : ERR_OK;
    return e;
}

static enum err count_root(struct gltf *g, size_t node, void *context)
{
    (void)g;
    ((struct walk *)context)->copies[node] += 1.0;
    return ERR_OK;
}

static enum err check_nodes(struct gltf *g, struct roots *r)
{
    struct walk w = { .count = g->counts[GLTF_NODES] };

    g->uses = mem_alloc(g->counts[GLTF_MESHES], sizeof(*g->uses));
    w.queue = mem_alloc(w.count, sizeof(*w.queue));
    w.parents = mem_alloc(w.count, sizeof(*w.parents));
    w.depth = mem_alloc(w.count, sizeof(*w.depth));
    w.copies = mem_alloc(w.count, sizeof(*w.copies));
    enum err e = g->uses && w.queue && w.parents && w.depth && w.copies ? count_parents(g, &w) : ERR_NOMEM;
    for (size_t i = 0; i < w.count && !e; i++)
        r->free[i] = w.parents[i] == 0;
    if (!e)
        e = each_root(g, r, count_root, &w);
    if (!e)
        e = walk_nodes(g, &w);
    mem_free(w.queue);
    mem_free(w.parents);
    mem_free(w.depth);
    mem_free(w.copies);
    return e;
}

/* ---- Traversal ---- */

struct visit { /* called for each node, parents first */
    enum err (*node)(struct gltf *g, size_t node, const double world[16], void *context);
    void *context;
    const double *start; /* matrix of the roots */
};

/* At most DEPTH_MAX deep, see check_nodes. */
static enum err descend(struct gltf *g, size_t index, const double parent[16], const struct visit *v)
{
    const struct gltf_at node = gltf_element(g, GLTF_NODES, index);
    const json_t *children = json_object_get(node.value, "children");
    double local[16], world[16];

    enum err e = gltf_node_matrix(g, &node, local);
    if (e)
        return e;
    matrix_multiply(parent, local, world);
    e = v->node(g, index, world, v->context);
    for (size_t i = 0; i < json_array_size(children) && !e; i++)
        e = descend(g, (size_t)json_number_value(json_array_get(children, i)), world, v);
    return e;
}

static enum err descend_root(struct gltf *g, size_t node, void *context)
{
    const struct visit *v = context;
    return descend(g, node, v->start, v);
}

static enum err keep_world(struct gltf *g, size_t node, const double world[16], void *context)
{
    (void)context;
    memcpy(g->worlds[node], world, sizeof(g->worlds[node]));
    return ERR_OK;
}

/* Skins refer to nodes anywhere, so that all matrices must be known before the first mesh. */
static enum err find_worlds(struct gltf *g, const struct roots *r)
{
    const struct visit v = { .node = keep_world, .start = g->start };
    enum err e = ERR_OK;

    if (g->counts[GLTF_SKINS] == 0)
        return ERR_OK;
    g->worlds = mem_alloc(g->counts[GLTF_NODES], sizeof(*g->worlds));
    if (!g->worlds)
        return ERR_NOMEM;
    for (size_t i = 0; i < g->counts[GLTF_NODES] && !e; i++)
        e = r->free[i] ? descend(g, i, v.start, &v) : ERR_OK;
    return e;
}

/* ---- Where the model lies ---- */

/* The box that the file states for a mesh's positions; false: none in the units of its node. */
static bool stated_box(struct gltf *g, const struct gltf_at *primitive, double low[3], double high[3])
{
    const struct gltf_at attributes = gltf_key(primitive, "attributes");
    size_t index, type = 0;

    if (gltf_index(g, &attributes, "POSITION", GLTF_ACCESSORS, &index) || index == GLTF_NONE)
        return false;
    const struct gltf_at accessor = gltf_element(g, GLTF_ACCESSORS, index);
    return gltf_size(g, &accessor, "componentType", 0, &type) == ERR_OK && type == 5126 && /* float */
           json_array_size(json_object_get(accessor.value, "min")) == 3 &&
           json_array_size(json_object_get(accessor.value, "max")) == 3 &&
           gltf_numbers(g, &accessor, "min", 3, low) == ERR_OK && gltf_numbers(g, &accessor, "max", 3, high) == ERR_OK;
}

/* What is wrong with the mesh is said when it is read. */
static enum err grow_box(struct gltf *g, size_t index, const double world[16], void *context)
{
    static const double middle[3] = { 0.0 };
    const struct gltf_at node = gltf_element(g, GLTF_NODES, index);
    struct reason *const why = g->why, ignored;
    size_t mesh = GLTF_NONE;

    g->why = (struct reason *)&ignored;
    const bool has = gltf_index(g, &node, "mesh", GLTF_MESHES, &mesh) == ERR_OK && mesh != GLTF_NONE;
    const struct gltf_at at = has ? gltf_element(g, GLTF_MESHES, mesh) : node;
    const struct gltf_at primitives = gltf_key(&at, "primitives");
    for (size_t i = 0; has && i < json_array_size(primitives.value); i++) {
        const struct gltf_at primitive = gltf_item(&primitives, i);
        double low[3], high[3];
        const bool stated = stated_box(g, &primitive, low, high);
        wide_box_grow(context, world, stated ? low : middle, stated ? high : middle);
    }
    g->why = why;
    return ERR_OK;
}

/* Before anything is a float. */
static enum err find_origin(struct gltf *g, const struct roots *r)
{
    struct wide_box box = WIDE_BOX_EMPTY;
    struct visit v = { .node = grow_box, .context = &box, .start = g->desc->transform };

    const enum err e = each_root(g, r, descend_root, &v);
    if (e)
        return e;
    origin_choose(g->scene, &box, g->desc->path);
    origin_start(g->scene, g->desc->transform, g->start);
    return ERR_OK;
}

/* ---- Cameras ---- */

struct carrier { /* a node with a camera */
    size_t camera, node, order;
    double world[16];
};

static struct vec3 turn(const double m[16], double x, double y, double z)
{
    return vec3_make((float)(m[0] * x + m[4] * y + m[8] * z), (float)(m[1] * x + m[5] * y + m[9] * z),
                     (float)(m[2] * x + m[6] * y + m[10] * z));
}

/* The node's name, else the camera's, else a number; a number also where the name exists. */
static void name_camera(const struct gltf *g, const struct gltf_at *node, const struct gltf_at *camera,
                        char out[sizeof(((struct camera *)NULL)->name)])
{
    const size_t size = sizeof(((struct camera *)NULL)->name);
    const char *name = gltf_string(node, "name");

    if (!name || !name[0])
        name = gltf_string(camera, "name");
    if (name && name[0])
        snprintf(out, size, "%.63s", name);
    else
        snprintf(out, size, "camera %zu", camera->index);
    for (unsigned n = 2; out[0] && scene_camera(g->scene, out) != NULL; n++)
        snprintf(out, size, "%.50s (%u)", name && name[0] ? name : "camera", n);
}

/* How far the middle of the bounding box of all meshes lies ahead. */
static double depth_of_centre(const struct scene *s, struct vec3 position, struct vec3 ahead)
{
    struct box b = { { INFINITY, INFINITY, INFINITY }, { -INFINITY, -INFINITY, -INFINITY } };

    for (size_t i = 0; i < s->mesh_count; i++)
        mesh_grow_box(&s->meshes[i], &b);
    const struct vec3 centre = vec3_scale(vec3_add(b.low, b.high), 0.5f);
    const double depth = vec3_dot_double(vec3_sub(centre, position), ahead);
    return isfinite(depth) && depth > 0.0 ? depth : 0.0;
}

/* A distant, narrow view that shows the middle of the scene in the same size. */
static enum err read_orthographic(struct gltf *g, const struct gltf_at *camera, struct vec3 ahead, struct camera *c)
{
    const struct gltf_at o = gltf_key(camera, "orthographic");
    double half = 0.0;

    const enum err e = gltf_number(g, &o, "ymag", &half);
    if (e)
        return e;
    c->fov_y = (float)(NARROW * PI / 180.0);
    const double back = fabs(half) / tan(0.5 * NARROW * PI / 180.0) - depth_of_centre(g->scene, c->position, ahead);
    c->position = vec3_sub(c->position, vec3_scale(ahead, (float)back));
    if (!(fabs(half) > 0.0))
        c->fov_y = 0.0f; /* refused below */
    gltf_warn(g, camera, "is orthographic: approximated by a perspective camera of %g degrees", NARROW);
    return ERR_OK;
}

static enum err read_camera(struct gltf *g, const struct gltf_at *node, const struct gltf_at *camera,
                            const double world[16], struct camera *c)
{
    const struct gltf_at perspective = gltf_key(camera, "perspective");
    const struct vec3 ahead = vec3_normalize(turn(world, 0.0, 0.0, -1.0));
    const char *type = gltf_string(camera, "type");
    double fov_y = 0.0;
    enum err e;

    name_camera(g, node, camera, c->name);
    c->position = vec3_make((float)world[12], (float)world[13], (float)world[14]);
    c->up = vec3_normalize(turn(world, 0.0, 1.0, 0.0));
    if (type && strcmp(type, "orthographic") == 0) {
        e = read_orthographic(g, camera, ahead, c);
    } else {
        e = gltf_number(g, &perspective, "yfov", &fov_y);
        c->fov_y = (float)fov_y;
    }
    /* Floats resolve a direction between two points only if these are not much closer to each other than to the
     * origin. */
    const float distance = vec3_length(c->position);
    c->look_at = vec3_add(c->position, vec3_scale(ahead, distance > FAR_AHEAD ? distance : 1.0f));
    return e;
}

/* A camera that is no camera costs a warning. */
static enum err add_camera(struct gltf *g, const struct carrier *k)
{
    const struct gltf_at node = gltf_element(g, GLTF_NODES, k->node);
    const struct gltf_at camera = gltf_element(g, GLTF_CAMERAS, k->camera);
    struct reason cause = { "" };
    struct camera c = { .name = "" };

    const enum err e = read_camera(g, &node, &camera, k->world, &c);
    if (e)
        return e;
    if (camera_check(&c, c.name, &cause) == ERR_OK)
        return scene_add_camera(g->scene, &c);
    gltf_warn(g, &camera, "is left out: %s", cause.text);
    return ERR_OK;
}

/* ---- All together ---- */

struct carriers {
    struct carrier *at;
    size_t count, capacity;
};

static enum err take_node(struct gltf *g, size_t index, const double world[16], void *context)
{
    const struct gltf_at node = gltf_element(g, GLTF_NODES, index);
    struct carriers *all = context;
    size_t mesh, camera;

    enum err e = gltf_index(g, &node, "mesh", GLTF_MESHES, &mesh);
    if (!e && mesh != GLTF_NONE)
        e = gltf_add_mesh(g, mesh, &node, world);
    if (!e)
        e = gltf_add_node_light(g, &node, world);
    if (!e)
        e = gltf_index(g, &node, "camera", GLTF_CAMERAS, &camera);
    if (e || camera == GLTF_NONE || !g->desc->camera)
        return e;
    if (!mem_reserve(&all->at, all->count, &all->capacity, sizeof(*all->at)))
        return ERR_NOMEM;
    struct carrier *k = &all->at[all->count];
    *k = (struct carrier){ .camera = camera, .node = index, .order = all->count };
    memcpy(k->world, world, sizeof(k->world));
    all->count++;
    return ERR_OK;
}

/* As in the file's list of cameras. */
static int by_camera(const void *a, const void *b)
{
    const struct carrier *p = a, *q = b;

    if (p->camera != q->camera)
        return p->camera < q->camera ? -1 : 1;
    return p->order < q->order ? -1 : p->order > q->order;
}

enum err gltf_add_nodes(struct gltf *g)
{
    struct carriers all = { 0 };
    struct roots r = { .free = mem_alloc(g->counts[GLTF_NODES], sizeof(bool)) };
    struct visit v = { .node = take_node, .context = &all, .start = g->start };

    enum err e = r.free ? find_scene(g, &r) : ERR_NOMEM;
    if (!e)
        e = check_nodes(g, &r);
    if (!e)
        e = find_origin(g, &r);
    if (!e)
        e = find_worlds(g, &r);
    if (!e)
        e = each_root(g, &r, descend_root, &v);
    if (!e && all.count > 0)
        qsort(all.at, all.count, sizeof(*all.at), by_camera);
    for (size_t i = 0; i < all.count && !e; i++)
        e = add_camera(g, &all.at[i]);
    mem_free(all.at);
    mem_free(r.free);
    return e;
}
