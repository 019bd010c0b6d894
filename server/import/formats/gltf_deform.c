#include "import/formats/gltf.h"

#include "base/mem.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define INFLUENCES 4 /* joints in one set of attributes */
#define SETS_MAX 4   /* JOINTS_0 to JOINTS_3 */

/* ---- Skins ---- */

/* Without matrices of its own a joint's is the identity. */
static enum err read_bind(struct gltf *g, const struct gltf_at *at, size_t joints, struct gltf_accessor *out)
{
    const enum err e = gltf_accessor_vector(g, at, 16, 16, out);

    if (!e && out->count < joints)
        return gltf_fault(g, at, ERR_FORMAT, "accessors[%zu] has %zu matrices for %zu joints", out->index, out->count,
                          joints);
    return e;
}

static enum err read_joint(struct gltf *g, const struct gltf_at *joint, const struct gltf_accessor *bind, size_t i,
                           double out[16])
{
    double inverse[16] = { [0] = 1.0, [5] = 1.0, [10] = 1.0, [15] = 1.0 };
    float numbers[16];
    size_t node;

    const enum err e = gltf_index_of(g, joint, GLTF_NODES, &node);
    if (e)
        return e;
    if (bind->count > 0) {
        gltf_accessor_floats(bind, i, 1, 16, numbers);
        for (int k = 0; k < 16; k++)
            inverse[k] = numbers[k];
    }
    matrix_multiply(g->worlds[node], inverse, out);
    return ERR_OK;
}

enum err skin_load(struct gltf *g, const struct gltf_at *node, struct skin *out)
{
    struct gltf_accessor bind = { 0 };
    size_t index;

    enum err e = gltf_index(g, node, "skin", GLTF_SKINS, &index);
    if (e || index == GLTF_NONE)
        return e;
    const struct gltf_at at = gltf_element(g, GLTF_SKINS, index), joints = gltf_key(&at, "joints");
    const struct gltf_at matrices = gltf_key(&at, "inverseBindMatrices");
    const size_t count = json_array_size(joints.value);
    if (count == 0)
        return gltf_fault(g, &at, ERR_FORMAT, "has no joints");
    if (matrices.value)
        e = read_bind(g, &matrices, count, &bind);
    if (!e) {
        out->matrices = mem_alloc(count, sizeof(*out->matrices));
        e = out->matrices ? ERR_OK : ERR_NOMEM;
    }
    for (size_t i = 0; i < count && !e; i++) {
        const struct gltf_at joint = gltf_item(&joints, i);
        e = read_joint(g, &joint, &bind, i, out->matrices[i]);
    }
    if (!e)
        out->count = count;
    return e;
}

struct influence {           /* of joints on each vertex */
    float *joints, *weights; /* [sets][count][INFLUENCES] */
    size_t sets, count;
};

static enum err read_set(struct gltf *g, const struct primitive *p, size_t set, struct influence *f, bool *found)
{
    const size_t begin = set * p->count * INFLUENCES;
    struct gltf_accessor joints, weights;
    char name[2][16];

    snprintf(name[0], sizeof(name[0]), "JOINTS_%zu", set);
    snprintf(name[1], sizeof(name[1]), "WEIGHTS_%zu", set);
    const struct gltf_at j = gltf_key(&p->attributes, name[0]), w = gltf_key(&p->attributes, name[1]);
    *found = j.value && w.value;
    if (!*found)
        return ERR_OK;
    enum err e = primitive_attribute(g, p, &j, INFLUENCES, INFLUENCES, &joints);
    if (!e)
        e = primitive_attribute(g, p, &w, INFLUENCES, INFLUENCES, &weights);
    if (e)
        return e;
    gltf_accessor_floats(&joints, p->first, p->count, INFLUENCES, f->joints + begin);
    gltf_accessor_floats(&weights, p->first, p->count, INFLUENCES, f->weights + begin);
    return ERR_OK;
}

/* A primitive without joints follows the first. */
static enum err read_influence(struct gltf *g, const struct primitive *p, struct influence *f)
{
    bool found = true;
    enum err e = ERR_OK;

    f->count = p->count;
    for (; f->sets < SETS_MAX && found && !e; f->sets += found && !e) {
        const size_t before = f->sets * p->count, after = before + p->count, size = INFLUENCES * sizeof(float);
        float *joints = mem_grow(f->joints, before, after, size);
        f->joints = joints ? joints : f->joints;
        float *weights = mem_grow(f->weights, before, after, size);
        f->weights = weights ? weights : f->weights;
        e = joints && weights ? read_set(g, p, f->sets, f, &found) : ERR_NOMEM;
    }
    for (size_t i = 0; f->sets == 0 && i < p->count && !e; i++)
        f->weights[INFLUENCES * i] = 1.0f;
    f->sets += f->sets == 0;
    return e;
}

/* The mean of the matrices of the joints of vertex i. False: a joint does not exist. */
static bool blend(const struct skin *s, const struct influence *f, size_t i, double out[16])
{
    double sum = 0.0;

    memset(out, 0, 16 * sizeof(*out));
    for (size_t n = 0; n < f->sets * INFLUENCES; n++) {
        const size_t at = (n / INFLUENCES * f->count + i) * INFLUENCES + n % INFLUENCES;
        const float joint = f->joints[at], weight = f->weights[at];
        if (!(weight > 0.0f))
            continue;
        if (!(joint >= 0.0f && joint < (float)s->count))
            return false;
        for (int k = 0; k < 16; k++)
            out[k] += weight * s->matrices[(size_t)joint][k];
        sum += weight;
    }
    for (int k = 0; k < 16 && sum > 0.0; k++)
        out[k] /= sum;
    if (!(sum > 0.0))
        memcpy(out, s->matrices[0], 16 * sizeof(*out));
    return true;
}

static enum err move_by_skin(struct gltf *g, const struct primitive *p, const struct influence *f, struct mesh *m)
{
    bool mirrored = false;

    for (size_t i = 0; i < p->count; i++) {
        double matrix[16], c[9];
        if (!blend(p->skin, f, i, matrix))
            return gltf_fault(g, &p->attributes, ERR_FORMAT, "a joint of vertex %zu is not below %zu", p->first + i,
                              p->skin->count);
        const double side = matrix_cofactors(matrix, c) < 0.0 ? -1.0 : 1.0;
        gltf_transform_point(matrix, m->positions + 3 * i);
        if (m->normals)
            gltf_transform_normal(c, side, m->normals + 3 * i);
        mirrored = i == 0 ? side < 0.0 : mirrored;
    }
    if (mirrored)
        mesh_turn_over(m);
    return ERR_OK;
}

static enum err apply_skin(struct gltf *g, const struct primitive *p, struct mesh *m)
{
    struct influence f = { 0 };

    enum err e = read_influence(g, p, &f);
    if (!e)
        e = move_by_skin(g, p, &f, m);
    mem_free(f.joints);
    mem_free(f.weights);
    return e;
}

/* ---- Morph targets ---- */

/* Weight i of the node, else of the mesh, else 0. */
static double weight_of(const struct primitive *p, size_t i)
{
    const json_t *own = json_object_get(p->node->value, "weights");
    const json_t *list = own ? own : json_object_get(p->mesh->value, "weights");
    const double w = json_number_value(json_array_get(list, i));

    return isfinite(w) ? w : 0.0;
}

static enum err add_target(struct gltf *g, const struct primitive *p, const struct gltf_at *at, double weight,
                           float *out)
{
    struct gltf_accessor a;

    if (!at->value || !out)
        return ERR_OK;
    const enum err e = primitive_attribute(g, p, at, 3, 3, &a);
    if (e)
        return e;
    float *delta = mem_alloc_raw(p->count, 3 * sizeof(*delta));
    if (!delta)
        return ERR_NOMEM;
    gltf_accessor_floats(&a, p->first, p->count, 3, delta);
    for (size_t i = 0; i < 3 * p->count; i++)
        out[i] = (float)(out[i] + weight * delta[i]);
    mem_free(delta);
    return ERR_OK;
}

static enum err apply_targets(struct gltf *g, const struct primitive *p, struct mesh *m)
{
    const struct gltf_at targets = gltf_key(p->at, "targets");
    enum err e = ERR_OK;

    for (size_t i = 0; i < json_array_size(targets.value) && !e; i++) {
        const double weight = weight_of(p, i);
        if (weight == 0.0)
            continue;
        const struct gltf_at target = gltf_item(&targets, i);
        const struct gltf_at position = gltf_key(&target, "POSITION"), normal = gltf_key(&target, "NORMAL");
        e = add_target(g, p, &position, weight, m->positions);
        if (!e)
            e = add_target(g, p, &normal, weight, m->normals);
    }
    return e;
}

enum err primitive_deform(struct gltf *g, const struct primitive *p, struct mesh *m)
{
    enum err e = apply_targets(g, p, m);

    if (!e && p->skin->count > 0)
        e = apply_skin(g, p, m);
    return e;
}
