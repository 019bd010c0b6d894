/* Reads scene files and all that they name, in this process: call it in one that is confined (import/reader/reader.h),
 * since the libraries behind it are not made for hostile files. Thread: one at a time. */
#pragma once

#include "import/parts/texture_decode.h"
#include "import/reader/host.h"
#include "scene/geometry/scene.h"
#include "scene/geometry/scene_build.h"

#include <jansson.h>
#include <math.h>

/* Reads a .json scene or a model (docs/scenes.md lists the formats) through `host`; frames it if it has no camera. On
 * ERR_OK the caller owns *out; on error *out is NULL and *why names file, place and fault. ERR_IO: a missing file.
 * ERR_FORMAT: malformed JSON or model, an unknown material. ERR_RANGE: a value outside its limits. ERR_UNSUPPORTED: an
 * unknown file format. ERR_NOMEM. Unsupported features are named once each in a warning. */
MUST_CHECK enum err import_scene(const char *path, const struct host *host, struct scene **out, struct reason *why);

/* ---- Parts ---- */

/* Shared by the files of this room. Thread: one at a time. */

enum model_normals {
    NORMALS_FLAT,   /* geometric normals */
    NORMALS_FILE,   /* the file's, else flat */
    NORMALS_SMOOTH, /* the file's, else computed */
};

struct model_desc {
    const struct host *host;
    const char *path;
    const char *place;    /* beginning of messages, such as "plaza.json: models[0]"; NULL: they begin with the path */
    uint32_t material;    /* for the whole model; MATERIAL_NONE: the file's */
    uint32_t named;       /* number of materials of the scene that replace the model's of the same name; not glTF's */
    bool camera;          /* import the file's cameras; glTF only */
    double time;          /* s, at which its animation stands; NAN: at rest. glTF only */
    double transform[16]; /* column-major, affine */
    enum model_normals normals;
};

/* Reads a model, all formats but glTF through Assimp, and adds its meshes, one per node. ERR_IO,
 * ERR_FORMAT, ERR_RANGE, ERR_UNSUPPORTED, ERR_NOMEM. */
MUST_CHECK enum err model_load(struct scene *s, const struct model_desc *d, struct reason *why);

/* Checks the header of a .ply file, on which Assimp 5.2 can loop forever. *why has no path. ERR_FORMAT. */
MUST_CHECK enum err ply_check(const struct bytes *file, struct reason *why);

struct aiFileIO;
struct aiScene;

/* Files as Assimp asks for them: the model itself, which has been read, and others through the host. */
struct assimp_files {
    const struct host *host;
    const char *path;          /* of the model */
    const struct bytes *model; /* its contents */
    struct reason refused;     /* why the first other file could not be opened; empty: none was refused */
    char *defined; /* names of the materials of .mtl files (obj_text.h); the caller of assimp_files_init frees it */
    bool others;   /* a file besides the model was read */
};

/* Fills the functions; `files` must outlive their use. */
void assimp_files_init(struct assimp_files *files, struct aiFileIO *out);

/* Reads a glTF 2.0 file (gltf.h), by itself; otherwise as model_load. */
MUST_CHECK enum err gltf_load(struct scene *s, const struct model_desc *d, struct reason *why);

/* Finds a material for every one that the meshes of a file other than glTF use: map[i] is the scene's for the file's
 * i-th, MATERIAL_NONE if no mesh uses it. A texture that cannot be read costs a warning. ERR_NOMEM. */
MUST_CHECK enum err model_add_materials(struct scene *s, const struct aiScene *ai, const struct model_desc *d,
                                        uint32_t *map, struct reason *why);

/* Whether a model of this file name can be read; if not, *why lists the supported formats. ERR_UNSUPPORTED. */
MUST_CHECK enum err model_check_format(const char *path, struct reason *why);

/* Sets what a glTF material emits: emissiveFactor times KHR_materials_emissive_strength. The texture is set apart. */
void gltf_set_emission(struct material *m, struct vec3 factor, double strength);

/* A light of KHR_lights_punctual as the file has it. */
struct gltf_light {
    enum light_kind kind;
    struct vec3 colour;  /* linear Rec.709 */
    double intensity;    /* candela; directional: lux */
    double inner, outer; /* radians: a spot's half angles */
};

/* Adds the light of a node with this matrix (column-major), along whose -Z axis it shines; a scale does not matter.
 * `place` begins messages. ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err gltf_add_light(struct scene *s, const struct gltf_light *l, const double world[16],
                                   const char *place, struct reason *why);

/* Whether the extension is .gltf or .glb. */
bool path_is_gltf(const char *path);

/* Whether the path ends in this extension (".ply"), in either case. */
bool path_ends_in(const char *path, const char *ending);

/* a * b, both column-major; `out` is neither. */
void matrix_multiply(const double a[16], const double b[16], double out[16]);
/* Cofactors of the upper 3x3, which transform normals up to a factor. Returns the determinant. */
double matrix_cofactors(const double m[16], double c[9]);

/* ---- Scenes far from the origin of their coordinates ---- */

/* A model's box in world space, before anything is a float. Empty: high below low. */
struct wide_box {
    double low[3], high[3];
};
#define WIDE_BOX_EMPTY                                                                                                 \
    {                                                                                                                  \
        { INFINITY, INFINITY, INFINITY },                                                                              \
        {                                                                                                              \
            -INFINITY, -INFINITY, -INFINITY                                                                            \
        }                                                                                                              \
    }

/* Adds a box that stands by a matrix. Coordinates that are not finite are left out. */
void wide_box_grow(struct wide_box *b, const double matrix[16], const double low[3], const double high[3]);
/* If the scene has no mesh yet and its first model lies so far away that floats would lose it, moves the scene's
 * origin there and says so. */
void origin_choose(struct scene *s, const struct wide_box *model, const char *path);
/* The matrix of a model's root in the scene, whose origin has been chosen. */
void origin_start(const struct scene *s, const double transform[16], double out[16]);

/* The rows of a column-major matrix, as mesh_place wants them. */
void matrix_rows(const double m[16], float rows[3][4]);

/* Whether a mesh that stands at `uses` places is better shared than copied. */
bool instances_pay(double uses, size_t triangles);

/* The inverse of an affine matrix, column-major. False: it is singular. */
bool matrix_inverse(const double m[16], double out[16]);

/* Adds meshes first..end - 1, which belong to a model that stands by the matrix `from`, once more where it stands by
 * `to`: as instances, which share their arrays. ERR_RANGE, and nothing has changed: one does not suit (mesh_place).
 * ERR_NOMEM. */
MUST_CHECK enum err meshes_repeat(struct scene *s, size_t first, size_t end, const double from[16],
                                  const double to[16]);

/* Reads a JSON scene into an empty scene. Errors of import_scene. */
MUST_CHECK enum err json_load_scene(struct scene *s, const char *path, const struct host *host, struct reason *why);

/* ---- JSON scenes ---- */

/* The parts of JSON scenes: json.c reads materials, cameras and lights, json_models.c places models. Private to this
 * room. Thread: one at a time. */

/* A JSON object being read. */
struct spot {
    const json_t *object;
    char place[320]; /* beginning of messages: "plaza.json: materials 'wall'" */
    struct scene *scene;
    uint32_t named; /* materials of the scene file, which come before those of models */
    const char *path;
    const struct host *host;
    struct reason *why;
};

/* Enters the object `value` of s, called `name` in messages. ERR_FORMAT: not an object. */
MUST_CHECK enum err spot_enter(const struct spot *s, const json_t *value, const char *name, struct spot *out);

/* Warns of keys that are not in `known`, which ends with NULL. */
void spot_warn_unknown(const struct spot *s, const char *const *known);

/* Reads a number within [least, most]; the key may be missing if fallback is not NULL. ERR_FORMAT, ERR_RANGE. */
MUST_CHECK enum err spot_number(const struct spot *s, const char *key, const double *fallback, double least,
                                double most, float *out);

/* Reads a string, which the JSON value owns. ERR_FORMAT: missing, empty, or none. */
MUST_CHECK enum err spot_string(const struct spot *s, const char *key, const char **out);

/* Adds the models of the scene file. Errors of model_load. */
MUST_CHECK enum err json_add_models(const struct spot *root);
