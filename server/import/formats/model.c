#include "import/formats/import.h"

#include "base/log.h"
#include "base/luminance.h"
#include "base/mem.h"
#include "import/parts/obj_text.h"

#include <assimp/cfileio.h>
#include <assimp/cimport.h>
#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define DEPTH_MAX 257                 /* of nodes: 256 of the file below a root */
#define ASSIMPS_OWN "DefaultMaterial" /* of faces without a material */
#define CORNERS_MAX 1000 /* of a face: the time to cut it into triangles grows with their square or faster */

/* A message that begins with the place, if there is one, and the path. */
static enum err fault(const struct model_desc *d, struct reason *why, enum err e, const char *format, ...)
    PRINTF_LIKE(4, 5);

static enum err fault(const struct model_desc *d, struct reason *why, enum err e, const char *format, ...)
{
    struct reason text;
    va_list args;

    va_start(args, format);
    vsnprintf(text.text, sizeof(text.text), format, args);
    va_end(args);
    return err_say(why, e, "%s%s%s: %s", d->place ? d->place : "", d->place ? ": " : "", d->path, text.text);
}

/* A mesh of the file in the scene. */
struct standing {
    unsigned uses;    /* by nodes */
    bool added;       /* it is in the scene: */
    size_t mesh;      /* there, */
    double world[16]; /* of its first node */
};

/* State of the node traversal. */
struct import {
    struct scene *scene;
    const struct model_desc *desc;
    const struct aiScene *ai;
    uint32_t *materials;       /* in the scene, for each of the file's; see model_add_materials */
    bool plain;                /* these are Assimp's defaults */
    bool coloured;             /* a mesh has colours of its vertices */
    size_t dropped;            /* degenerate triangles */
    double start[16];          /* matrix of the root; before the scene has its origin, in the file's coordinates */
    struct standing *standing; /* of each of the file's meshes */
    struct reason *why;
};

static void node_matrix(const struct aiMatrix4x4 *m, double out[16])
{
    const double columns[16] = { m->a1, m->b1, m->c1, m->d1, m->a2, m->b2, m->c2, m->d2,
                                 m->a3, m->b3, m->c3, m->d3, m->a4, m->b4, m->c4, m->d4 };
    memcpy(out, columns, sizeof(columns));
}

static void put_positions(const struct aiMesh *ai, const double m[16], float *out)
{
    for (size_t i = 0; i < ai->mNumVertices; i++) {
        const struct aiVector3D *p = &ai->mVertices[i];
        for (size_t row = 0; row < 3; row++)
            out[3 * i + row] = (float)(m[row] * p->x + m[4 + row] * p->y + m[8 + row] * p->z + m[12 + row]);
    }
}

static void put_normals(const struct aiMesh *ai, const double m[16], float *out)
{
    double c[9];
    const double side = matrix_cofactors(m, c) < 0.0 ? -1.0 : 1.0;

    for (size_t i = 0; i < ai->mNumVertices; i++) {
        const struct aiVector3D *n = &ai->mNormals[i];
        double v[3];
        for (int row = 0; row < 3; row++)
            v[row] = side * (c[row] * n->x + c[3 + row] * n->y + c[6 + row] * n->z);
        const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        const double scale = isfinite(length) && length > 0.0 ? 1.0 / length : 0.0;
        for (size_t row = 0; row < 3; row++)
            out[3 * i + row] = scale > 0.0 ? (float)(v[row] * scale) : 0.0f;
    }
}

static void put_uvs(const struct aiMesh *ai, float *out)
{
    for (size_t i = 0; i < ai->mNumVertices; i++) {
        out[2 * i] = ai->mTextureCoords[0][i].x;
        out[2 * i + 1] = ai->mTextureCoords[0][i].y;
    }
}

/* Skips faces that are not triangles (points and lines that Assimp let pass). */
static uint32_t put_indices(const struct aiMesh *ai, bool mirrored, uint32_t *out)
{
    uint32_t count = 0;

    for (size_t i = 0; i < ai->mNumFaces; i++) {
        const struct aiFace *f = &ai->mFaces[i];
        if (f->mNumIndices != 3)
            continue;
        uint32_t *t = out + 3 * (size_t)count++;
        t[0] = f->mIndices[0];
        t[1] = f->mIndices[mirrored ? 2 : 1]; /* a reflection turns triangles inside out: restore the winding */
        t[2] = f->mIndices[mirrored ? 1 : 2];
    }
    return count;
}

static bool wants_uvs(const struct material *m)
{
    return m->texture != MATERIAL_NO_TEXTURE || m->maps ||
           (m->alpha_mode != ALPHA_OPAQUE && m->alpha_texture != MATERIAL_NO_TEXTURE);
}

/* The vertices' colours are those of the surface in .obj and .ply files; others use them for data, too. Where a file
 * has both, they repeat the texture, as of a scan. */
static bool uses_colours(const struct import *in, const struct aiMesh *ai, uint32_t material)
{
    return ai->mColors[0] && (path_ends_in(in->desc->path, ".obj") || path_ends_in(in->desc->path, ".ply")) &&
           material >= in->desc->named && in->scene->materials[material].texture == MATERIAL_NO_TEXTURE;
}

static enum err add_colours(struct import *in, const struct aiMesh *ai, struct mesh *m)
{
    m->colours = mem_alloc(ai->mNumVertices, 4 * sizeof(float));
    if (!m->colours)
        return ERR_NOMEM;
    for (size_t i = 0; i < ai->mNumVertices; i++) {
        const struct aiColor4D *c = &ai->mColors[0][i];
        const float own[3] = { c->r, c->g, c->b };
        for (size_t k = 0; k < 3; k++)
            m->colours[4 * i + k] = own[k] > 0.0f ? (float)srgb_decode(fminf(own[k], 1.0f)) : 0.0f; /* NaN becomes 0 */
        m->colours[4 * i + 3] = 1.0f;
    }
    if (in->plain)
        in->scene->materials[m->material].diffuse = vec3_make(1.0f, 1.0f, 1.0f);
    in->coloured = true;
    return ERR_OK;
}

static enum err fill_mesh(struct import *in, const struct aiMesh *ai, const double matrix[16], struct mesh *m)
{
    double c[9];

    m->vertex_count = ai->mNumVertices;
    m->positions = mem_alloc(3 * (size_t)ai->mNumVertices + 1, sizeof(float));
    m->indices = mem_alloc(ai->mNumFaces, 3 * sizeof(uint32_t));
    if (!m->positions || !m->indices)
        return ERR_NOMEM;
    put_positions(ai, matrix, m->positions);
    m->triangle_count = put_indices(ai, matrix_cofactors(matrix, c) < 0.0, m->indices);
    if (in->desc->normals != NORMALS_FLAT && ai->mNormals) {
        m->normals = mem_alloc(ai->mNumVertices, 3 * sizeof(float));
        if (!m->normals)
            return ERR_NOMEM;
        put_normals(ai, matrix, m->normals);
    }
    if (ai->mTextureCoords[0] && wants_uvs(&in->scene->materials[m->material])) {
        m->uvs = mem_alloc(ai->mNumVertices, 2 * sizeof(float));
        if (!m->uvs)
            return ERR_NOMEM;
        put_uvs(ai, m->uvs);
    }
    return uses_colours(in, ai, m->material) ? add_colours(in, ai, m) : ERR_OK;
}

/* The mesh's own name, the node's, or that of the file. */
static void name_mesh(const struct import *in, const struct aiNode *node, const struct aiMesh *ai, struct mesh *m)
{
    const char *slash = strrchr(in->desc->path, '/'), *file = slash ? slash + 1 : in->desc->path;

    snprintf(m->name, sizeof(m->name), "%.63s",
             ai->mName.length > 0     ? ai->mName.data
             : node->mName.length > 0 ? node->mName.data
                                      : file);
}

static enum err add_copy(struct import *in, const struct aiNode *node, const struct aiMesh *ai, const double matrix[16])
{
    struct mesh m = { .name = "" };
    enum err e;

    if (!(ai->mPrimitiveTypes & aiPrimitiveType_TRIANGLE))
        return ERR_OK;
    if (ai->mNumVertices > MESH_ELEMENTS_MAX || ai->mNumFaces > MESH_ELEMENTS_MAX)
        return fault(in->desc, in->why, ERR_RANGE, "a mesh has %u vertices and %u faces, too many", ai->mNumVertices,
                     ai->mNumFaces);
    name_mesh(in, node, ai, &m);
    m.material = in->desc->material != MATERIAL_NONE ? in->desc->material : in->materials[ai->mMaterialIndex];
    e = fill_mesh(in, ai, matrix, &m);
    if (!e) {
        in->dropped += mesh_drop_degenerate(&m);
        e = mesh_join_vertices(&m);
        if (!e && in->desc->normals == NORMALS_SMOOTH && !m.normals)
            e = mesh_make_normals(&m);
        if (!e && (in->scene->materials[m.material].maps & MAP_NORMAL))
            e = mesh_make_tangents(&m, false);
    }
    if (!e && m.triangle_count > 0) {
        if (in->desc->material == MATERIAL_NONE && ai->mColors[0] && !m.colours)
            scene_note_unmodelled(in->scene, FEATURE_VERTEX_COLOUR, in->desc->path);
        e = scene_add_mesh(in->scene, &m);
        if (!e)
            return ERR_OK; /* the scene now owns its arrays */
    }
    mesh_finish(&m);
    return e;
}

/* Adds a mesh of the file at a node: where many nodes have it, an instance of the first. */
static enum err add_mesh(struct import *in, const struct aiNode *node, unsigned index, const double world[16])
{
    const struct aiMesh *ai = in->ai->mMeshes[index];
    struct standing *standing = &in->standing[index];
    const size_t before = in->scene->mesh_count;

    if (standing->added && instances_pay(standing->uses, ai->mNumFaces)) {
        const enum err e = meshes_repeat(in->scene, standing->mesh, standing->mesh + 1, standing->world, world);
        if (e != ERR_RANGE)
            return e;
    }
    const enum err e = add_copy(in, node, ai, world);
    if (!e && in->scene->mesh_count > before && !standing->added) {
        standing->added = true;
        standing->mesh = before;
        memcpy(standing->world, world, sizeof(standing->world));
    }
    return e;
}

static void count_uses(struct import *in, const struct aiNode *node)
{
    for (unsigned i = 0; i < node->mNumMeshes; i++)
        in->standing[node->mMeshes[i]].uses++;
    for (unsigned i = 0; i < node->mNumChildren; i++)
        count_uses(in, node->mChildren[i]);
}

/* Nodes are at most DEPTH_MAX deep, see check_node. */
static enum err add_node(struct import *in, const struct aiNode *node, const double parent[16])
{
    double local[16], world[16];
    enum err e = ERR_OK;

    node_matrix(&node->mTransformation, local);
    matrix_multiply(parent, local, world);
    for (unsigned i = 0; i < node->mNumMeshes && !e; i++)
        e = add_mesh(in, node, node->mMeshes[i], world);
    for (unsigned i = 0; i < node->mNumChildren && !e; i++)
        e = add_node(in, node->mChildren[i], world);
    return e;
}

/* The box of all meshes, in the coordinates of the file's world. */
static void grow_box(const struct import *in, const struct aiNode *node, const double parent[16], struct wide_box *box)
{
    double local[16], world[16];

    node_matrix(&node->mTransformation, local);
    matrix_multiply(parent, local, world);
    for (unsigned i = 0; i < node->mNumMeshes; i++) {
        const struct aiMesh *ai = in->ai->mMeshes[node->mMeshes[i]];
        double low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };
        for (unsigned v = 0; v < ai->mNumVertices; v++) {
            const double p[3] = { ai->mVertices[v].x, ai->mVertices[v].y, ai->mVertices[v].z };
            for (int k = 0; k < 3; k++) {
                low[k] = fmin(low[k], p[k]);
                high[k] = fmax(high[k], p[k]);
            }
        }
        if (ai->mNumVertices > 0)
            wide_box_grow(box, world, low, high);
    }
    for (unsigned i = 0; i < node->mNumChildren; i++)
        grow_box(in, node->mChildren[i], world, box);
}

/* The file's materials, unless the scene gives one for the whole model. */
static enum err add_materials(struct import *in)
{
    const struct model_desc *d = in->desc;

    if (d->material != MATERIAL_NONE)
        return ERR_OK;
    in->materials = mem_alloc((size_t)in->ai->mNumMaterials + 1, sizeof(*in->materials));
    if (!in->materials)
        return ERR_NOMEM;
    return model_add_materials(in->scene, in->ai, d, in->materials, in->why);
}

static enum err take(struct import *in)
{
    const size_t meshes_before = in->scene->mesh_count;

    in->standing = mem_alloc((size_t)in->ai->mNumMeshes + 1, sizeof(*in->standing));
    if (!in->standing)
        return ERR_NOMEM;
    count_uses(in, in->ai->mRootNode);
    struct wide_box box = WIDE_BOX_EMPTY;
    grow_box(in, in->ai->mRootNode, in->start, &box);
    origin_choose(in->scene, &box, in->desc->path);
    origin_start(in->scene, in->start, in->start);
    enum err e = add_materials(in);
    if (!e)
        e = add_node(in, in->ai->mRootNode, in->start);
    if (e)
        return e;
    if (in->ai->mNumLights > 0)
        scene_note_unmodelled(in->scene, FEATURE_LIGHTS, in->desc->path);
    if (in->ai->mNumAnimations > 0)
        scene_note_unmodelled(in->scene, FEATURE_ANIMATION, in->desc->path);
    if (in->dropped > 0)
        log_warning("%s: dropped %zu degenerate or non-finite triangles", in->desc->path, in->dropped);
    if (in->scene->mesh_count == meshes_before)
        return fault(in->desc, in->why, ERR_FORMAT,
                     "the model contains no triangles; points and lines are not rendered");
    return ERR_OK;
}

/* Imports without post-processing, which trusts every index. */
static const struct aiScene *import_file(const struct model_desc *d, struct assimp_files *files)
{
    int unwanted = aiComponent_TANGENTS_AND_BITANGENTS | aiComponent_BONEWEIGHTS;
    struct aiFileIO io;

    struct aiPropertyStore *p = aiCreatePropertyStore();
    if (!p)
        return NULL;
    if (d->normals == NORMALS_FLAT)
        unwanted |= aiComponent_NORMALS;
    if (d->material != MATERIAL_NONE)
        unwanted |= aiComponent_COLORS | aiComponent_TEXCOORDS;
    aiSetImportPropertyInteger(p, AI_CONFIG_PP_RVC_FLAGS, unwanted);
    assimp_files_init(files, &io);
    const struct aiScene *ai = aiImportFileExWithProperties(d->path, 0, &io, p);
    aiReleasePropertyStore(p);
    return ai;
}

/* After an import that failed. */
static enum err import_fault(const struct model_desc *d, struct reason *why)
{
    const char *text = aiGetErrorString();

    if (strstr(text, "bad_alloc"))
        return ERR_NOMEM;
    return fault(d, why, ERR_FORMAT, "%s", text[0] ? text : "cannot be read");
}

static enum err check_mesh(const struct aiScene *ai, const struct aiMesh *m, const struct model_desc *d,
                           struct reason *why)
{
    if (m->mMaterialIndex >= ai->mNumMaterials)
        return fault(d, why, ERR_FORMAT, "a mesh refers to material %u of %u", m->mMaterialIndex, ai->mNumMaterials);
    if (m->mNumVertices > 0 && !m->mVertices)
        return fault(d, why, ERR_FORMAT, "a mesh has no positions");
    for (unsigned i = 0; i < m->mNumFaces; i++) {
        const struct aiFace *f = &m->mFaces[i];
        if (f->mNumIndices == 0) /* Assimp treats it as a polygon */
            return fault(d, why, ERR_FORMAT, "face %u of a mesh has no vertices", i);
        if (f->mNumIndices > CORNERS_MAX)
            return fault(d, why, ERR_RANGE, "face %u of a mesh has %u corners, more than %d", i, f->mNumIndices,
                         CORNERS_MAX);
        for (unsigned k = 0; k < f->mNumIndices; k++) {
            if (f->mIndices[k] >= m->mNumVertices)
                return fault(d, why, ERR_FORMAT, "face %u of a mesh refers to vertex %u of %u", i, f->mIndices[k],
                             m->mNumVertices);
        }
    }
    return ERR_OK;
}

static enum err check_node(const struct aiScene *ai, const struct aiNode *node, const struct model_desc *d, int depth,
                           struct reason *why)
{
    enum err e = ERR_OK;

    if (depth > DEPTH_MAX)
        return fault(d, why, ERR_RANGE, "nodes are nested more than %d deep", DEPTH_MAX);
    for (unsigned i = 0; i < node->mNumMeshes; i++) {
        if (node->mMeshes[i] >= ai->mNumMeshes)
            return fault(d, why, ERR_FORMAT, "a node refers to mesh %u of %u", node->mMeshes[i], ai->mNumMeshes);
    }
    for (unsigned i = 0; i < node->mNumChildren && !e; i++)
        e = check_node(ai, node->mChildren[i], d, depth + 1, why);
    return e;
}

/* Checks all indices of the file before anything uses them. */
static enum err check_scene(const struct aiScene *ai, const struct model_desc *d, struct reason *why)
{
    if (!ai->mRootNode)
        return fault(d, why, ERR_FORMAT, "the model contains no triangles; points and lines are not rendered");
    enum err e = check_node(ai, ai->mRootNode, d, 0, why);
    for (unsigned i = 0; i < ai->mNumMeshes && !e; i++)
        e = check_mesh(ai, ai->mMeshes[i], d, why);
    return e;
}

enum err model_check_format(const char *path, struct reason *why)
{
    static const char *const endings[] = { ".gltf", ".glb", ".obj", ".ply", ".stl", ".fbx", ".dae", ".3ds" };

    for (size_t i = 0; i < sizeof(endings) / sizeof(endings[0]); i++) {
        if (path_ends_in(path, endings[i]))
            return ERR_OK;
    }
    if (path_ends_in(path, ".usd") || path_ends_in(path, ".usda") || path_ends_in(path, ".usdc") ||
        path_ends_in(path, ".usdz"))
        return err_say(why, ERR_UNSUPPORTED,
                       "USD is not supported; convert it to .glb, for instance with Blender (import USD, export glTF)");
    if (path_ends_in(path, ".blend"))
        return err_say(why, ERR_UNSUPPORTED, "Blender's own format is not supported; export it as glTF (.glb)");
    if (path_ends_in(path, ".hdr") || path_ends_in(path, ".exr") || path_ends_in(path, ".jpg") ||
        path_ends_in(path, ".png"))
        return err_say(why, ERR_UNSUPPORTED,
                       "an image lights a scene: give it with --source, and a model with --scene");
    return err_say(
        why, ERR_UNSUPPORTED,
        "unknown format; expected a .json scene or a .gltf, .glb, .obj, .ply, .stl, .fbx, .dae or .3ds model");
}

/* Reads the file and checks what Assimp does not. */
static enum err read_checked(const struct model_desc *d, struct bytes *out, struct reason *why)
{
    const bool ply = path_ends_in(d->path, ".ply");
    struct reason cause = { "" };

    *out = (struct bytes){ 0 };
    enum err e = model_check_format(d->path, &cause);
    if (e)
        return fault(d, why, e, "%s", cause.text);
    e = host_read(d->host, d->path, out, &cause);
    if (e) /* the reason begins with the path */
        return d->place ? err_say(why, e, "%s: %s", d->place, cause.text) : err_say(why, e, "%s", cause.text);
    if (out->size == 0)
        e = err_say(&cause, ERR_FORMAT, "is empty");
    else if (ply)
        e = ply_check(out, &cause);
    return e ? fault(d, why, e, "%s", cause.text) : ERR_OK;
}

static bool mtl_defines(const char *names, const char *name)
{
    const size_t length = strlen(name);

    for (const char *p = names; p && *p; p = strchr(p, '\n') ? strchr(p, '\n') + 1 : NULL)
        if (strncmp(p, name, length) == 0 && p[length] == '\n')
            return true;
    return false;
}

/* What an OBJ model lacks of its materials is grey. Where the scene file defines materials, a name of its own is
 * misspelt. */
static enum err check_grey(const struct import *in, const struct assimp_files *files)
{
    const struct model_desc *d = in->desc;
    struct aiString name = { 0 };
    bool told = false;

    if (!in->materials || !path_ends_in(d->path, ".obj"))
        return ERR_OK;
    for (unsigned i = 0; i < in->ai->mNumMaterials; i++) {
        if (in->materials[i] == MATERIAL_NONE || in->materials[i] < d->named)
            continue;
        (void)aiGetMaterialString(in->ai->mMaterials[i], AI_MATKEY_NAME, &name);
        const bool unnamed = strcmp(name.data, ASSIMPS_OWN) == 0;
        if (files->others && (unnamed || mtl_defines(files->defined, name.data)))
            continue;
        const char *cause = files->others            ? "no .mtl file of the model defines it"
                            : files->refused.text[0] ? files->refused.text
                                                     : "the model names no .mtl file";
        if (d->named > 0 && !unnamed && !files->others)
            return fault(d, in->why, ERR_FORMAT, "unknown material '%s' (%s)", name.data, cause);
        if (!in->coloured && (files->others || !told))
            log_warning("%s: material '%s' is grey: %s", d->path, name.data, cause);
        told = true;
    }
    return ERR_OK;
}

/* Reads the file and brings what Assimp would misread into another form. */
static enum err read_text(const struct model_desc *d, struct bytes *out, double start[16], struct reason *why)
{
    double origin[3] = { 0.0 }, shift[16] = { [0] = 1.0, [5] = 1.0, [10] = 1.0, [15] = 1.0 };

    enum err e = read_checked(d, out, why);
    if (!e && path_ends_in(d->path, ".obj"))
        e = obj_text(out, d->path, d->normals != NORMALS_FLAT, origin, why);
    memcpy(shift + 12, origin, sizeof(origin));
    matrix_multiply(d->transform, shift, start);
    return e;
}

enum err model_load(struct scene *s, const struct model_desc *d, struct reason *why)
{
    /* Not JoinIdenticalVertices, which also joins vertices that are merely close, and NaN with anything. */
    const unsigned steps = aiProcess_Triangulate | aiProcess_SortByPType | aiProcess_RemoveComponent;
    struct bytes model;

    if (path_is_gltf(d->path))
        return gltf_load(s, d, why);
    struct import in = { .scene = s, .desc = d, .why = why };
    enum err e = read_text(d, &model, in.start, why);
    struct assimp_files files = { .host = d->host, .path = d->path, .model = &model };
    const struct aiScene *ai = e ? NULL : import_file(d, &files);
    bytes_finish(&model);
    if (!e)
        e = ai ? check_scene(ai, d, why) : import_fault(d, why);
    if (!e && !aiApplyPostProcessing(ai, steps)) { /* which frees the scene on failure */
        ai = NULL;
        e = import_fault(d, why);
    }
    if (!e) {
        in.ai = ai;
        in.plain = path_ends_in(d->path, ".ply") || (path_ends_in(d->path, ".obj") && !files.others);
        e = take(&in);
        if (!e)
            e = check_grey(&in, &files);
        mem_free(in.materials);
        mem_free(in.standing);
    }
    mem_free(files.defined);
    aiReleaseImport(ai); /* NULL is allowed */
    return e;
}
