/* Applies an animation at one time: the values of its channels replace those of the nodes in the JSON text, before
 * other code reads them. So nodes, skins, weights, cameras and lights need no code for animation. */
#include "import/formats/gltf.h"

#include "base/mem.h"

#include <math.h>
#include <string.h>

#define WEIGHTS_MAX 65536 /* morph targets of one node */

enum interpolation { /* between keys */
                     LINEAR,
                     STEP,
                     CUBIC, /* key values lie between an in-tangent and an out-tangent */
};

struct sampler {
    const struct gltf_at *at;
    enum interpolation kind;
    struct gltf_accessor input, output;
    float *times; /* [input.count] */
};

struct channel {
    struct gltf_at node;
    const char *path; /* the node's member that it moves */
    size_t width;     /* numbers of a value */
};

/* Two keys and the place between them. */
struct interval {
    size_t first, second; /* may be the same */
    double share, span;   /* 0..1; s */
};

static enum err read_kind(const struct gltf *g, const struct gltf_at *at, enum interpolation *out)
{
    static const char *const names[] = { [LINEAR] = "LINEAR", [STEP] = "STEP", [CUBIC] = "CUBICSPLINE" };
    const char *name = gltf_string(at, "interpolation");

    *out = LINEAR;
    for (int i = LINEAR; name && i <= CUBIC; i++) {
        *out = (enum interpolation)i;
        if (strcmp(name, names[i]) == 0)
            return ERR_OK;
    }
    return name ? gltf_fault(g, at, ERR_FORMAT, "interpolation is '%.40s'; expected LINEAR, STEP or CUBICSPLINE", name)
                : ERR_OK;
}

static enum err read_times(struct gltf *g, struct sampler *s)
{
    const struct gltf_at input = gltf_key(s->at, "input");

    enum err e = gltf_accessor_vector(g, &input, 1, 1, &s->input);
    if (e)
        return e;
    if (s->input.elements.type != GLTF_FLOAT || s->input.count == 0)
        return gltf_fault(g, &input, ERR_FORMAT, "accessors[%zu] holds no key times: expected floats", s->input.index);
    s->times = mem_alloc_raw(s->input.count, sizeof(*s->times));
    if (!s->times)
        return ERR_NOMEM;
    gltf_accessor_floats(&s->input, 0, s->input.count, 1, s->times);
    for (size_t i = 0; i < s->input.count; i++) {
        if (!isfinite(s->times[i]) || (i > 0 && !(s->times[i] > s->times[i - 1])))
            return gltf_fault(g, &input, ERR_FORMAT, "key times do not increase: key %zu is at %g s%s", i,
                              (double)s->times[i], i > 0 ? ", no later than the one before" : "");
    }
    return ERR_OK;
}

static enum err read_sampler(struct gltf *g, const struct channel *c, struct sampler *s)
{
    const struct gltf_at output = gltf_key(s->at, "output");
    const size_t components = strcmp(c->path, "weights") == 0 ? 1 : c->width;

    enum err e = read_kind(g, s->at, &s->kind);
    if (!e)
        e = read_times(g, s);
    if (!e)
        e = gltf_accessor_vector(g, &output, components, components, &s->output);
    if (e)
        return e;
    const size_t values = s->input.count * (s->kind == CUBIC ? 3 : 1) * (c->width / components);
    if (s->output.count != values)
        return gltf_fault(g, &output, ERR_FORMAT, "accessors[%zu] has %zu elements for %zu keys; expected %zu",
                          s->output.index, s->output.count, s->input.count, values);
    return ERR_OK;
}

/* Before the first key and after the last the value is theirs. */
static struct interval find_interval(const struct sampler *s, double time)
{
    size_t low = 0, high = s->input.count - 1;

    if (!(time > (double)s->times[low]))
        return (struct interval){ low, low, 0.0, 0.0 };
    if (time >= (double)s->times[high])
        return (struct interval){ high, high, 0.0, 0.0 };
    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (time >= (double)s->times[middle])
            low = middle;
        else
            high = middle;
    }
    const double span = (double)s->times[high] - (double)s->times[low];
    return (struct interval){ low, high, (time - (double)s->times[low]) / span, span };
}

/* The value of a key, or with CUBIC its in-tangent (part 0), value (1) or out-tangent (2). */
static void read_value(const struct sampler *s, const struct channel *c, size_t key, size_t part, float *out)
{
    const size_t values = c->width / s->output.components; /* elements that make one */
    const size_t first = (s->kind == CUBIC ? 3 * key + part : key) * values;

    gltf_accessor_floats(&s->output, first, values, s->output.components, out);
}

/* The share of the second of two quaternions, and of the first, on the shorter arc between them. They become unit. */
static void arc_shares(float *a, float *b, double t, double *first, double *second)
{
    double la = 0.0, lb = 0.0, dot = 0.0;

    for (int k = 0; k < 4; k++) {
        la += (double)a[k] * (double)a[k];
        lb += (double)b[k] * (double)b[k];
    }
    for (int k = 0; k < 4; k++) {
        a[k] = la > 0.0 ? (float)(a[k] / sqrt(la)) : 0.0f;
        b[k] = lb > 0.0 ? (float)(b[k] / sqrt(lb)) : 0.0f;
        dot += (double)a[k] * (double)b[k];
    }
    const double angle = acos(fmin(fabs(dot), 1.0)), whole = sin(angle);
    const bool close = whole < 1e-6;
    *first = close ? 1.0 - t : sin((1.0 - t) * angle) / whole;
    *second = (close ? t : sin(t * angle) / whole) * (dot < 0.0 ? -1.0 : 1.0);
}

/* [glTF 2.0, appendix C]. work: float[4][width]; the result is in its first row. */
static void interpolate(const struct sampler *s, const struct channel *c, double time, float *work)
{
    const struct interval i = find_interval(s, time);
    float *a = work, *b = work + c->width, *leaving = b + c->width, *arriving = leaving + c->width;
    const double t = i.share, t2 = t * t, t3 = t2 * t;
    double first = 1.0 - t, second = t;

    read_value(s, c, i.first, 1, a);
    if (s->kind == STEP || i.first == i.second)
        return;
    read_value(s, c, i.second, 1, b);
    if (s->kind == CUBIC) {
        read_value(s, c, i.first, 2, leaving);
        read_value(s, c, i.second, 0, arriving);
        for (size_t k = 0; k < c->width; k++)
            a[k] = (float)((2.0 * t3 - 3.0 * t2 + 1.0) * a[k] + i.span * (t3 - 2.0 * t2 + t) * leaving[k] +
                           (3.0 * t2 - 2.0 * t3) * b[k] + i.span * (t3 - t2) * arriving[k]);
        return;
    }
    if (strcmp(c->path, "rotation") == 0)
        arc_shares(a, b, t, &first, &second);
    for (size_t k = 0; k < c->width; k++)
        a[k] = (float)(first * a[k] + second * b[k]);
}

/* ---- Into the nodes ---- */

static enum err replace(struct gltf *g, const struct channel *c, const float *value, const struct sampler *s)
{
    json_t *all = json_array();

    for (size_t k = 0; k < c->width; k++) {
        if (!isfinite(value[k])) {
            json_decref(all);
            return gltf_fault(g, s->at, ERR_FORMAT, "accessors[%zu] holds a number that is not finite",
                              s->output.index);
        }
        if (json_array_append_new(all, json_real((double)value[k])) != 0) {
            json_decref(all);
            return ERR_NOMEM;
        }
    }
    return json_object_set_new((json_t *)c->node.value, c->path, all) == 0 ? ERR_OK : ERR_NOMEM;
}

static enum err move_node(struct gltf *g, const struct channel *c, const struct gltf_at *sampler)
{
    struct sampler s = { .at = sampler };

    enum err e = read_sampler(g, c, &s);
    float *work = e ? NULL : mem_alloc(c->width, 4 * sizeof(*work));
    if (!e && !work)
        e = ERR_NOMEM;
    if (!e) {
        interpolate(&s, c, g->desc->time, work);
        e = replace(g, c, work, &s);
    }
    mem_free(work);
    mem_free(s.times);
    return e;
}

/* How many weights the node's mesh has. */
static enum err count_targets(const struct gltf *g, const struct gltf_at *target, const struct gltf_at *node,
                              size_t *out)
{
    size_t mesh;

    const enum err e = gltf_index(g, node, "mesh", GLTF_MESHES, &mesh);
    if (e)
        return e;
    const json_t *m = mesh == GLTF_NONE ? NULL : gltf_element(g, GLTF_MESHES, mesh).value;
    const json_t *first = json_array_get(json_object_get(m, "primitives"), 0);
    *out = json_array_size(json_object_get(first, "targets"));
    if (*out == 0 || *out > WEIGHTS_MAX)
        return gltf_fault(g, target, ERR_FORMAT, "weights are animated of a node without morph targets");
    return ERR_OK;
}

/* Sets c->width; 0: nothing that is known. */
static enum err find_width(const struct gltf *g, const struct gltf_at *target, struct channel *c)
{
    c->path = gltf_string(target, "path");
    c->width = 0;
    if (!c->path)
        return gltf_fault(g, target, ERR_FORMAT, "has no path");
    if (strcmp(c->path, "weights") == 0)
        return count_targets(g, target, &c->node, &c->width);
    if (strcmp(c->path, "rotation") == 0)
        c->width = 4;
    else if (strcmp(c->path, "translation") == 0 || strcmp(c->path, "scale") == 0)
        c->width = 3;
    if (c->width > 0 && json_object_get(c->node.value, "matrix"))
        return gltf_fault(g, target, ERR_FORMAT, "nodes[%zu] has a matrix, which cannot be animated", c->node.index);
    return ERR_OK;
}

/* A channel without a node belongs to an extension. */
static enum err apply_channel(struct gltf *g, const struct gltf_at *at, const struct gltf_at *samplers)
{
    const struct gltf_at target = gltf_key(at, "target");
    struct channel c;
    size_t node, index;

    enum err e = gltf_index(g, &target, "node", GLTF_NODES, &node);
    if (e || node == GLTF_NONE)
        return e;
    c.node = gltf_element(g, GLTF_NODES, node);
    e = find_width(g, &target, &c);
    if (e || c.width == 0)
        return e;
    e = gltf_size(g, at, "sampler", GLTF_NONE, &index);
    if (e)
        return e;
    if (index >= json_array_size(samplers->value))
        return gltf_fault(g, at, ERR_FORMAT, "names a sampler that does not exist; the animation has %zu",
                          json_array_size(samplers->value));
    const struct gltf_at sampler = gltf_item(samplers, index);
    return move_node(g, &c, &sampler);
}

enum err gltf_animate(struct gltf *g)
{
    const size_t count = g->counts[GLTF_ANIMATIONS];
    enum err e = ERR_OK;

    if (count == 0)
        return ERR_OK;
    g->scene->animated = true;
    if (isnan(g->desc->time)) {
        gltf_warn(g, NULL, "is animated, but shown at rest; use --time SECONDS");
        return ERR_OK;
    }
    const struct gltf_at first = gltf_element(g, GLTF_ANIMATIONS, 0);
    const struct gltf_at channels = gltf_key(&first, "channels"), samplers = gltf_key(&first, "samplers");
    const char *name = gltf_string(&first, "name");
    for (size_t i = 0; i < json_array_size(channels.value) && !e; i++) {
        const struct gltf_at channel = gltf_item(&channels, i);
        e = apply_channel(g, &channel, &samplers);
    }
    if (!e && count > 1)
        gltf_warn(g, &first, "the first of %zu animations%s%.60s%s is used, the others are ignored", count,
                  name ? ", '" : "", name ? name : "", name ? "'," : "");
    return e;
}
