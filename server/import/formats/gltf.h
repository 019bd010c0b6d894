/* The parts of our reader of glTF 2.0 [glTF 2.0]. Private to this room. Thread: one at a time. */
#pragma once

#include "import/formats/import.h"

#include <jansson.h>
#include <math.h>

#define GLTF_NONE SIZE_MAX /* in place of an index: the file has none */

enum gltf_list { /* the arrays at the root of the JSON text */
                 GLTF_ACCESSORS,
                 GLTF_ANIMATIONS,
                 GLTF_BUFFERS,
                 GLTF_BUFFER_VIEWS,
                 GLTF_CAMERAS,
                 GLTF_IMAGES,
                 GLTF_MATERIALS,
                 GLTF_MESHES,
                 GLTF_NODES,
                 GLTF_SAMPLERS,
                 GLTF_SCENES,
                 GLTF_SKINS,
                 GLTF_TEXTURES,
                 GLTF_LISTS
};

struct gltf_at {                 /* a value of the JSON text, and its path for messages */
    const json_t *value;         /* NULL: missing */
    const struct gltf_at *above; /* NULL: the root */
    const char *key;             /* in `above`; NULL: `index` counts */
    size_t index;
};

struct gltf_buffer { /* read when it is first used */
    const uint8_t *at;
    size_t size;
    struct bytes owned; /* what to free */
    bool ready;
};

struct gltf_view {       /* a buffer view */
    const uint8_t *at;   /* NULL: not needed yet */
    size_t size, stride; /* stride 0: elements are adjacent */
    uint8_t *owned;
};

struct gltf_surface {    /* how the meshes of a material get texture coordinates */
    size_t uv_set;       /* GLTF_NONE: they need none */
    double transform[6]; /* KHR_texture_transform: u' = t0 u + t1 v + t2, v' = t3 u + t4 v + t5 */
};

struct gltf_note { /* elements of one list that a warning is about */
    size_t first, last, count;
};

struct gltf_use {     /* how a mesh is used */
    double count;     /* its places, where they are those of nodes without a skin or weights of their own */
    uint32_t *shared; /* the scene's mesh of each primitive, plus 1, to be shared; 0: none */
    bool skipped;     /* has been noted to have points or lines */
};

struct gltf { /* a file being read */
    struct scene *scene;
    const struct model_desc *desc;
    struct reason *why;
    struct bytes file;
    struct bytes chunk; /* binary data of a .glb; within file */
    json_t *json;
    struct gltf_at root, lists[GLTF_LISTS];
    size_t counts[GLTF_LISTS];
    struct gltf_buffer *buffers;
    struct gltf_view *views;
    struct gltf_surface (*surfaces)[2]; /* of each material: uvs and more_uvs of its meshes */
    uint32_t first_material;            /* in the scene */
    struct gltf_note skipped;           /* meshes with points or lines */
    uint32_t plain;        /* the scene's material for primitives without one; MATERIAL_NONE: not needed yet */
    double start[16];      /* matrix of the roots */
    double (*worlds)[16];  /* of each node, if the file has skins */
    struct gltf_use *uses; /* of each mesh */
    uint64_t dropped;      /* degenerate triangles */
};

/* ---- gltf_json.c: values, and where they are ---- */

/* Writes "FILE: meshes[3].name: TEXT" into g->why and returns e. */
enum err gltf_fault(const struct gltf *g, const struct gltf_at *at, enum err e, const char *format, ...)
    PRINTF_LIKE(4, 5);
/* The same as a warning in the log. */
void gltf_warn(const struct gltf *g, const struct gltf_at *at, const char *format, ...) PRINTF_LIKE(3, 4);

/* A member, which may be missing. `above` must outlive the result. */
struct gltf_at gltf_key(const struct gltf_at *above, const char *key);
struct gltf_at gltf_item(const struct gltf_at *above, size_t index);
struct gltf_at gltf_element(const struct gltf *g, enum gltf_list list, size_t index);
/* at.extensions[name]; missing if there are no extensions. For values only: its path lacks "extensions". */
struct gltf_at gltf_extension(const struct gltf_at *at, const char *name);

/* Read a member; what is missing leaves *out, or becomes `fallback`. ERR_FORMAT: of another type. */
MUST_CHECK enum err gltf_number(const struct gltf *g, const struct gltf_at *at, const char *key, double *out);
MUST_CHECK enum err gltf_numbers(const struct gltf *g, const struct gltf_at *at, const char *key, size_t count,
                                 double *out);
MUST_CHECK enum err gltf_size(const struct gltf *g, const struct gltf_at *at, const char *key, size_t fallback,
                              size_t *out);
/* An index into a list; GLTF_NONE if missing. ERR_FORMAT: beyond its end. */
MUST_CHECK enum err gltf_index(const struct gltf *g, const struct gltf_at *at, const char *key, enum gltf_list list,
                               size_t *out);
/* As gltf_index, of a value itself; ERR_FORMAT also if it is missing. */
MUST_CHECK enum err gltf_index_of(const struct gltf *g, const struct gltf_at *at, enum gltf_list list, size_t *out);
/* NULL if missing or no string. */
const char *gltf_string(const struct gltf_at *at, const char *key);

/* ---- gltf_notes.c: what a warning is about ---- */

/* Notes an element; one that is noted several times in a row counts once. */
void gltf_note(struct gltf_note *n, size_t index);
/* Warns if anything was noted: `FILE: material "Glass" and 3 more: TEXT`; nameless ones are `materials[2]`. */
void gltf_warn_of(const struct gltf *g, enum gltf_list list, const struct gltf_note *n, const char *format, ...)
    PRINTF_LIKE(4, 5);

/* ---- gltf_container.c: the file, its buffers ---- */

/* Finds the JSON text and the binary chunk in g->file, and parses. ERR_FORMAT, ERR_RANGE, ERR_UNSUPPORTED (glTF 1.0),
 * ERR_NOMEM. */
MUST_CHECK enum err gltf_parse(struct gltf *g);
/* The bytes of a buffer or of a buffer view, valid until the end. ERR_FORMAT, ERR_RANGE, errors of host_read. */
MUST_CHECK enum err gltf_buffer_bytes(struct gltf *g, size_t index, const uint8_t **at, size_t *size);
MUST_CHECK enum err gltf_view_bytes(struct gltf *g, size_t index, struct gltf_view *out);
/* The path of the file that a URI names, relative to the model; decodes %20 and the like. */
MUST_CHECK enum err gltf_uri_path(const struct gltf *g, const struct gltf_at *at, const char *uri,
                                  char out[HOST_PATH_MAX]);
bool gltf_uri_is_data(const char *uri);
/* The bytes in a data URI, for the caller to free. ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err gltf_uri_decode(const struct gltf *g, const struct gltf_at *at, const char *uri, struct bytes *out);

/* ---- gltf_meshopt.c: EXT_meshopt_compression ---- */

/* The view's extension; missing: it is not compressed. */
struct gltf_at gltf_meshopt(const struct gltf_at *view);
/* Decompresses; sets out->owned, at and size. ERR_FORMAT, ERR_RANGE, ERR_UNSUPPORTED, ERR_NOMEM. */
MUST_CHECK enum err gltf_meshopt_decode(struct gltf *g, const struct gltf_at *at, struct gltf_view *out);

/* ---- gltf_accessor.c: typed arrays ---- */

enum gltf_type { /* of components; the values of the file */
                 GLTF_BYTE = 5120,
                 GLTF_UNSIGNED_BYTE,
                 GLTF_SHORT,
                 GLTF_UNSIGNED_SHORT,
                 GLTF_UNSIGNED_INT = 5125,
                 GLTF_FLOAT,
};

struct gltf_run {      /* elements in memory, checked to be there */
    const uint8_t *at; /* NULL: all zero */
    size_t stride;
    enum gltf_type type;
};

struct gltf_accessor {
    size_t index, count, components;
    bool normalized;
    struct gltf_run elements;
    size_t sparse_count; /* elements that replace others */
    struct gltf_run sparse_indices, sparse_values;
};

/* Bytes of a component; 0 if there is no such type. */
size_t gltf_type_size(enum gltf_type type);

/* The accessor that the value at `at` names, checked against the bytes of its views. ERR_FORMAT, ERR_RANGE, ERR_NOMEM,
 * errors of gltf_view_bytes. */
MUST_CHECK enum err gltf_accessor_open(struct gltf *g, const struct gltf_at *at, struct gltf_accessor *out);
/* The same without its data, which come from elsewhere. */
MUST_CHECK enum err gltf_accessor_head(struct gltf *g, const struct gltf_at *at, struct gltf_accessor *out);
/* ERR_FORMAT: it has not `least` to `most` components. */
MUST_CHECK enum err gltf_accessor_width(const struct gltf *g, const struct gltf_at *at, size_t least, size_t most,
                                        const struct gltf_accessor *a);
/* As gltf_accessor_open; it must have `least` to `most` components. */
MUST_CHECK enum err gltf_accessor_vector(struct gltf *g, const struct gltf_at *at, size_t least, size_t most,
                                         struct gltf_accessor *out);
/* Elements first .. first + count - 1 as numbers, normalized where the file says so: out[count][width]. Missing
 * components keep what is in `out`. */
void gltf_accessor_floats(const struct gltf_accessor *a, size_t first, size_t count, size_t width, float *out);
/* All elements of a scalar accessor of integers. ERR_FORMAT: others. */
MUST_CHECK enum err gltf_accessor_indices(const struct gltf *g, const struct gltf_at *at, const struct gltf_accessor *a,
                                          uint32_t *out);

/* ---- gltf_nodes.c: nodes, cameras ---- */

/* Passes all nodes of the scene and adds their meshes, then their cameras if wanted. Errors of the parts. */
MUST_CHECK enum err gltf_add_nodes(struct gltf *g);

/* ---- gltf_matrix.c ---- */

/* Translation, rotation (a quaternion, w last; need not be unit) and scale. */
void gltf_compose(const double t[3], const double r[4], const double s[3], double out[16]);
/* The matrix of a node. */
MUST_CHECK enum err gltf_node_matrix(const struct gltf *g, const struct gltf_at *node, double out[16]);

/* ---- gltf_animation.c ---- */

/* Poses the nodes as the first animation has them at desc->time; without a time, warns that they stay at rest. Before
 * anything reads nodes. ERR_FORMAT, ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err gltf_animate(struct gltf *g);

/* ---- gltf_mesh.c ---- */

/* Adds a mesh as `node` carries it: with its weights, its skin, and once per instance. */
MUST_CHECK enum err gltf_add_mesh(struct gltf *g, size_t mesh, const struct gltf_at *node, const double world[16]);

/* ---- gltf_instances.c ---- */

/* Counts the places of a node that occurs `copies` times, each with its instances, as uses of its mesh. */
void gltf_count_uses(struct gltf *g, size_t node, double copies);

/* ---- gltf_materials.c ---- */

/* Adds every material in order: material i of the file becomes g->first_material + i in the scene. ERR_FORMAT,
 * ERR_NOMEM. */
MUST_CHECK enum err gltf_add_materials(struct gltf *g);
/* The material of primitives without one, added when first used. ERR_NOMEM. */
MUST_CHECK enum err gltf_plain_material(struct gltf *g, uint32_t *out);

/* ---- gltf_lamps.c ---- */

/* Adds the light of KHR_lights_punctual that a node holds, if any. What is no light costs a warning. ERR_FORMAT,
 * ERR_NOMEM. */
MUST_CHECK enum err gltf_add_node_light(struct gltf *g, const struct gltf_at *node, const double world[16]);

/* ---- gltf_extensions.c ---- */

/* Refuses required extensions that are not supported, and names those that are ignored. ERR_UNSUPPORTED. */
MUST_CHECK enum err gltf_check_extensions(const struct gltf *g);

/* ---- Meshes ---- */

/* Parts of a mesh of glTF. Private to this room. Thread: one at a time. */

struct skin {
    size_t count;           /* joints; 0: no skin */
    double (*matrices)[16]; /* from the mesh to the world, for each joint */
};

struct gltf_draco;

#define GLTF_DRACO_ARRAYS 16 /* arrays of a primitive that can be compressed: more than are read of one */

struct primitive {
    const struct gltf_at *at, *mesh, *node;
    const struct skin *skin;
    struct gltf_at attributes, indices;
    struct gltf_accessor positions;
    size_t first, count;      /* the vertices that are used */
    struct gltf_draco *draco; /* NULL: not compressed */
};

struct places { /* where copies of a mesh stand */
    double (*matrices)[16];
    size_t count;
};

/* The slot for the scene's mesh that others share, see struct gltf_use; uses below 2: none do. */
struct sharing {
    double uses;
    uint32_t *slot;
};

/* As gltf_accessor_vector, where the primitive's data may be compressed. */
MUST_CHECK enum err primitive_accessor(struct gltf *g, const struct primitive *p, const struct gltf_at *at,
                                       size_t least, size_t most, struct gltf_accessor *out);
/* The same; it must have an element for each vertex. */
MUST_CHECK enum err primitive_attribute(struct gltf *g, const struct primitive *p, const struct gltf_at *at,
                                        size_t least, size_t most, struct gltf_accessor *out);

/* ---- gltf_draco.c: KHR_draco_mesh_compression ---- */

/* Decompresses the primitive's data if they are compressed. ERR_FORMAT, ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err primitive_draco_begin(struct gltf *g, struct primitive *p);
void primitive_draco_end(struct primitive *p);
/* The accessor of an attribute, or of the indices, if it is compressed; else *found is false. Valid until the end. */
MUST_CHECK enum err primitive_draco_accessor(struct gltf *g, const struct primitive *p, const struct gltf_at *at,
                                             struct gltf_accessor *out, bool *found);

/* ---- gltf_instances.c: EXT_mesh_gpu_instancing ---- */

/* The world matrices of the copies; `out` has one, the node's own, without instances. Free with places_finish.
 * ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err places_load(struct gltf *g, const struct gltf_at *node, const double world[16], struct places *out);
void places_finish(struct places *p); /* zeroed memory is allowed */

/* What a node's mesh shares with other nodes. ERR_NOMEM. */
MUST_CHECK enum err sharing_find(struct gltf *g, size_t mesh, const struct gltf_at *node, size_t primitive,
                                 struct sharing *out);

/* ---- gltf_place.c ---- */

/* Adds a mesh, in its own space, at each place: as instances where it has many triangles and uses, else as copies.
 * Takes over the arrays of *m, also on error. ERR_NOMEM. */
MUST_CHECK enum err place_all(struct gltf *g, struct mesh *m, const struct places *places, const struct sharing *with);
/* The same for a mesh that the scene has. */
MUST_CHECK enum err place_again(struct gltf *g, uint32_t mesh, const char *name, const struct places *places);

/* ---- gltf_deform.c: morph targets and skins, as the nodes stand ---- */

/* The node's skin, whose matrices the caller frees; none: count 0. Needs g->worlds. ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err skin_load(struct gltf *g, const struct gltf_at *node, struct skin *out);
/* Moves the vertices. ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err primitive_deform(struct gltf *g, const struct primitive *p, struct mesh *m);

/* Transform a point by a matrix, a normal by its cofactors; side: the determinant's sign. A normal becomes unit, or
 * (0, 0, 0). */
void gltf_transform_point(const double m[16], float p[3]);
void gltf_transform_normal(const double c[9], double side, float n[3]);
/* Reverses the winding. */
void mesh_turn_over(struct mesh *m);

/* ---- Materials ---- */

/* What readers of a glTF file's materials share. Private to this room. Thread: one at a time. */

/* ---- Textures ---- */

/* Textures of glTF: each image is read once per use. Private to this room. Thread: one at a time. */

struct gltf_known_image;

struct gltf_images { /* zeroed but for g at first */
    struct gltf *g;
    struct gltf_known_image *known; /* the caller frees the list, not the scene's textures */
    size_t count, room;
};

struct gltf_numbers { /* a texture of numbers: TEXTURE_LINEAR */
    bool found;       /* false: it cannot be read; the rest is zero, and a warning was logged */
    uint32_t texture; /* of the scene; MATERIAL_NO_TEXTURE: uniform, the means say it all */
    float mean[4];    /* of the channels, 0..1 */
    struct gltf_surface surface;
};

/* Reads the texture of colours that `at` names; *index is MATERIAL_NO_TEXTURE if it cannot be read, which costs a
 * warning. Else sets *surface. ERR_FORMAT, ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err gltf_texture_colours(struct gltf_images *s, const struct gltf_at *at, enum texture_values values,
                                         uint32_t *index, struct gltf_surface *surface);

/* The same for numbers. channels: those that count, bit 0 for red, where a uniform texture is as good as its means; 0:
 * it never is. If only alpha counts, the scene's texture has it in each channel. instead: what happens without the
 * image, for the warning; static text. */
MUST_CHECK enum err gltf_texture_numbers(struct gltf_images *s, const struct gltf_at *at, unsigned channels,
                                         const char *instead, struct gltf_numbers *out);

struct gltf_image {         /* an image by itself, sRGB with alpha */
    size_t index;           /* of the texture in the file */
    struct texture texture; /* without texels: it cannot be read, and a warning was logged */
    enum texture_wrap wrap_u, wrap_v;
    struct gltf_surface surface;
};

/* Decodes the texture that `at` names without adding it to the scene; free out->texture with texture_finish. instead:
 * as above. ERR_FORMAT, ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err gltf_texture_image(struct gltf_images *s, const struct gltf_at *at, const char *instead,
                                       struct gltf_image *out);

/* ---- The source ---- */

struct glossy_known;

#define GREY 0.5f /* in place of a texture that cannot be opened */

struct gltf_source {
    struct gltf *g;
    struct gltf_images images;
    struct gltf_note unlit, notes[FEATURE_COUNT];
    size_t material;             /* being read */
    struct glossy_known *glossy; /* what specular-glossiness textures have become */
    size_t glossy_count, glossy_room;
};

static inline float largest(struct vec3 v)
{
    return fmaxf(v.x, fmaxf(v.y, v.z));
}

/* A number from 0 to 1; others become the nearest. ERR_FORMAT: not a number. */
MUST_CHECK enum err gltf_share(struct gltf_source *s, const struct gltf_at *at, const char *key, double fallback,
                               float *out);

/* A colour whose first three of `count` numbers matter, likewise. */
MUST_CHECK enum err gltf_colour(struct gltf_source *s, const struct gltf_at *at, const char *key, size_t count,
                                double fallback, struct vec3 *out);

/* The texture of the base colour and of alpha, at the key of an object; the surfaces are grey, with a warning, if it
 * cannot be read. m has its alpha_mode. ERR_FORMAT, ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err gltf_read_base_texture(struct gltf_source *s, const struct gltf_at *above, const char *key,
                                           struct material *m, struct gltf_surface *surface);

/* Whether a texture can have one of the two sets of texture coordinates of the material's meshes, which the first
 * textures choose, or if it is one of `maps`, some that are affine in one: then m->moved_by says so. surface[2]. */
bool gltf_place_texture(struct gltf_source *s, struct material *m, enum material_map map, struct gltf_surface *surface,
                        const struct gltf_surface *own);

/* KHR_materials_clearcoat. Its normal is that of the mesh, or of the surface's normal map if it names the same.
 * ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err gltf_read_coat(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                                   struct gltf_surface *surface);

/* KHR_materials_sheen, of the material `at`. ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err gltf_read_sheen(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                                    struct gltf_surface *surface);

/* ---- Glossiness ---- */

/* KHR_materials_pbrSpecularGlossiness as metallic-roughness. Private to this room. Thread: one at a time. */

/* Reads the material whose extension `at` is; m has its alpha_mode. Factors alone become a metal where the diffuse
 * colour is black, else a dielectric with this F0. A specular-glossiness texture makes two textures of the scene, once
 * for all materials with the same textures and factors: base colour and metallic-roughness, texel by texel, as large
 * as the larger of the two. With other coordinates than the diffuse texture it counts by its means, with a warning.
 * ERR_FORMAT, ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err gltf_read_glossy(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                                     struct gltf_surface *surface);

struct glossy_texel { /* of the conversion, all 0..1 and linear */
    float base[3], metallic, roughness;
};

/* The metallic-roughness values that reflect the same: base and metallic solve
 *     0.96 (1 - metallic) base = diffuse (1 - max specular),    0.04 (1 - metallic) + metallic base = specular
 * for the luminance, where specular is at least 0.04; then base is the least-squares solution per channel. */
void glossy_convert(const float diffuse[3], const float specular[3], float glossiness, struct glossy_texel *out);
