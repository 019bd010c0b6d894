/* Materials of OBJ (MTL), FBX, COLLADA, 3DS, PLY and STL files as Assimp provides them. Their Blinn-Phong model does
 * not conserve energy, so it is replaced by our closest type: a GGX lobe as wide as the highlight, a mirror or glass.
 * */
#include "import/formats/import.h"

#include "base/log.h"
#include "base/mem.h"

#include <assimp/ObjMaterial.h>
#include <assimp/material.h>
#include <assimp/scene.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define GREY 0.5f          /* where a texture or the whole .mtl file is missing */
#define BLACK 1e-3f        /* a colour below is none */
#define COLOURED 0.05f     /* difference of channels from which glass is tinted */
#define GLASS_OPACITY 0.5f /* at most this much, for glass */
#define GLASS_IOR 1.5f     /* where the file has none */

/* Values of `illum` in MTL files. */
enum illumination {
    ILLUM_PLAIN = 1, /* also Assimp's value where the file has none: Ks alone decides whether there is a highlight */
    ILLUM_GLASS = 4,
    ILLUM_MIRROR = 5,
    ILLUM_REFRACTION = 6,
    ILLUM_FRESNEL_REFRACTION = 7,
    ILLUM_GLASS_WITHOUT_RAYS = 9,
};

struct reading {
    struct scene *scene;
    const struct aiScene *ai;
    const struct model_desc *desc;
    uint32_t *known; /* the scene's texture for the base colour of each material so far; MATERIAL_NO_TEXTURE: none */
    struct reason *why;
};

static bool has(const struct aiMaterial *m, const char *key)
{
    const struct aiMaterialProperty *p;
    return aiGetMaterialProperty(m, key, 0, 0, &p) == aiReturn_SUCCESS;
}

static float get_number(const struct aiMaterial *m, const char *key, float fallback)
{
    ai_real value = fallback;
    unsigned max = 1;

    if (aiGetMaterialFloatArray(m, key, 0, 0, &value, &max) != aiReturn_SUCCESS || !isfinite(value))
        return fallback;
    return value;
}

static float get_share(const struct aiMaterial *m, const char *key, float fallback)
{
    return fminf(fmaxf(get_number(m, key, fallback), 0.0f), 1.0f);
}

static struct vec3 get_colour(const struct aiMaterial *m, const char *key, float fallback)
{
    struct aiColor4D c;

    if (aiGetMaterialColor(m, key, 0, 0, &c) != aiReturn_SUCCESS || !isfinite(c.r) || !isfinite(c.g) || !isfinite(c.b))
        return vec3_make(fallback, fallback, fallback);
    return vec3_make(fminf(fmaxf(c.r, 0.0f), 1.0f), fminf(fmaxf(c.g, 0.0f), 1.0f), fminf(fmaxf(c.b, 0.0f), 1.0f));
}

static bool is_black(struct vec3 c)
{
    return fmaxf(c.x, fmaxf(c.y, c.z)) < BLACK;
}

static bool is_coloured(struct vec3 c)
{
    return fmaxf(c.x, fmaxf(c.y, c.z)) - fminf(c.x, fminf(c.y, c.z)) > COLOURED;
}

/* The width of a GGX lobe with the curvature of a Blinn-Phong highlight at its peak: alpha^2 = 2 / (n + 2) [Walter et
 * al. 2007], and alpha = roughness^2. */
static float roughness_of(float exponent)
{
    return powf(2.0f / (fmaxf(exponent, 0.0f) + 2.0f), 0.25f);
}

static bool is_glass(int illum, float opacity, float ior)
{
    const bool refracts = illum == ILLUM_GLASS || illum == ILLUM_REFRACTION || illum == ILLUM_FRESNEL_REFRACTION ||
                          illum == ILLUM_GLASS_WITHOUT_RAYS || ior > 1.0f;
    return refracts && opacity <= GLASS_OPACITY;
}

static void choose_kind(const struct aiMaterial *ai, struct material *m)
{
    const struct vec3 specular = get_colour(ai, "$clr.specular", 0.0f);
    const float ior = get_number(ai, "$mat.refracti", 1.0f);
    int illum = ILLUM_PLAIN;

    (void)aiGetMaterialIntegerArray(ai, AI_MATKEY_OBJ_ILLUM, &illum, NULL);
    m->diffuse = get_colour(ai, "$clr.diffuse", GREY);
    if (is_glass(illum, get_share(ai, "$mat.opacity", 1.0f), ior)) {
        m->kind = MATERIAL_GLASS;
        m->ior = ior > 1.0f ? fminf(ior, 4.0f) : GLASS_IOR;
        m->diffuse = vec3_make(1.0f, 1.0f, 1.0f);
    } else if (has(ai, "$mat.roughnessFactor") || has(ai, "$mat.metallicFactor")) {
        m->kind = MATERIAL_GGX;
        m->roughness = get_share(ai, "$mat.roughnessFactor", 1.0f);
        m->metallic = get_share(ai, "$mat.metallicFactor", 0.0f);
    } else if (is_black(specular)) {
        m->kind = MATERIAL_LAMBERT;
    } else {
        const bool metal = is_black(m->diffuse);
        m->kind = metal && illum == ILLUM_MIRROR ? MATERIAL_MIRROR : MATERIAL_GGX;
        m->roughness = roughness_of(get_number(ai, "$mat.shininess", 0.0f));
        m->metallic = metal ? 1.0f : 0.0f;
        if (metal)
            m->diffuse = specular;
    }
}

static void note_extras(const struct reading *r, const struct aiMaterial *ai, const struct material *m)
{
    const bool glass = m->kind == MATERIAL_GLASS;

    if (aiGetMaterialTextureCount(ai, aiTextureType_HEIGHT))
        scene_note_unmodelled(r->scene, FEATURE_BUMP_MAP, r->desc->path);
    if (glass && is_coloured(get_colour(ai, "$clr.diffuse", 0.0f)))
        scene_note_unmodelled(r->scene, FEATURE_TINTED_GLASS, r->desc->path);
}

/* An emissive colour of 1 is a radiance of 1; formats that multiply a strength into it exceed 1. */
static void read_emission(const struct reading *r, const struct aiMaterial *ai, struct material *m)
{
    struct aiColor4D c;

    if (aiGetMaterialColor(ai, "$clr.emissive", 0, 0, &c) == aiReturn_SUCCESS)
        gltf_set_emission(m, vec3_make(c.r, c.g, c.b), 1.0);
    if (aiGetMaterialTextureCount(ai, aiTextureType_EMISSIVE))
        log_warning("%s: material '%s': its emissive texture is ignored", r->desc->path, m->name);
}

/* The file that `name` means: MTL files often hold paths of the machine that wrote them, so a path from a root ("C:\",
 * "/") means a file of that name beside the model. False: too long. */
static bool texture_path(const char *model, const char *name, char out[HOST_PATH_MAX])
{
    const char *slash = strrchr(model, '/');
    const int folder = slash ? (int)(slash - model) + 1 : 0;
    char unix_name[1024];
    size_t n = 0;

    for (; name[n] && n < sizeof(unix_name) - 1; n++)
        unix_name[n] = name[n] == '\\' ? '/' : name[n];
    unix_name[n] = '\0';
    const bool rooted = unix_name[0] == '/' || (unix_name[0] && unix_name[1] == ':');
    const char *last = strrchr(unix_name, '/');
    const char *file = rooted && last ? last + 1 : unix_name;
    return !name[n] && snprintf(out, HOST_PATH_MAX, "%.*s%s", folder, model, file) < HOST_PATH_MAX;
}

/* The compressed image inside the model: "*3" is the third, FBX refers to them by file name. */
static const struct aiTexture *embedded_image(const struct aiScene *ai, const char *name)
{
    const unsigned long number = name[0] == '*' ? strtoul(name + 1, NULL, 10) : ai->mNumTextures;

    for (unsigned i = 0; i < ai->mNumTextures; i++) {
        const struct aiTexture *t = ai->mTextures[i];
        if (t->mHeight == 0 && (i == number || strcmp(t->mFilename.data, name) == 0))
            return t;
    }
    return NULL;
}

static enum err load_image(const struct reading *r, const char *name, enum texture_values values, struct texture *out,
                             struct reason *why)
{
    const struct aiTexture *embedded = embedded_image(r->ai, name);
    char path[HOST_PATH_MAX];

    if (embedded)
        return texture_decode(embedded->pcData, embedded->mWidth, values, name, out, why);
    if (!texture_path(r->desc->path, name, path))
        return err_say(why, ERR_RANGE, "%s: the path of a texture is too long", r->desc->path);
    return texture_load(r->desc->host, path, values, out, why);
}

/* The texture of an earlier material that names the same file. */
static uint32_t known_texture(const struct reading *r, unsigned index, const char *name)
{
    struct aiString other;

    for (unsigned i = 0; i < index; i++) {
        if (r->known[i] != MATERIAL_NO_TEXTURE &&
            aiGetMaterialString(r->ai->mMaterials[i], AI_MATKEY_TEXTURE_DIFFUSE(0), &other) == aiReturn_SUCCESS &&
            strcmp(other.data, name) == 0)
            return r->known[i];
    }
    return MATERIAL_NO_TEXTURE;
}

/* A texture that is missing or broken costs a warning: the surface renders grey. */
static enum err read_texture(const struct reading *r, unsigned index, struct material *m)
{
    struct reason why = { "" };
    struct aiString name;
    struct texture t;

    if (aiGetMaterialString(r->ai->mMaterials[index], AI_MATKEY_TEXTURE_DIFFUSE(0), &name) != aiReturn_SUCCESS)
        return ERR_OK;
    m->texture = known_texture(r, index, name.data);
    if (m->texture == MATERIAL_NO_TEXTURE) {
        enum err e = load_image(r, name.data, TEXTURE_SRGB, &t, &why);
        if (e == ERR_NOMEM)
            return e;
        if (e) {
            log_warning("%s; '%s' is grey instead", why.text, m->name);
            m->diffuse = vec3_make(GREY, GREY, GREY);
            return ERR_OK;
        }
        e = scene_add_texture(r->scene, &t, &m->texture);
        if (e) {
            texture_finish(&t);
            return e;
        }
        r->known[index] = m->texture;
    }
    if (is_black(m->diffuse)) /* many exporters write a black Kd beside map_Kd */
        m->diffuse = vec3_make(1.0f, 1.0f, 1.0f);
    return ERR_OK;
}

/* A mask without an alpha channel is a grey image: its red is the alpha. */
static void grey_to_alpha(struct texture *t)
{
    const size_t count = (size_t)t->width * t->height;
    size_t opaque = 0;

    while (opaque < count && t->texels[4 * opaque + 3] == UINT8_MAX)
        opaque++;
    if (opaque < count)
        return;
    for (size_t i = 0; i < count; i++)
        t->texels[4 * i + 3] = t->texels[4 * i];
    texture_build_levels(t);
}

/* An image that is not a colour; *index stays MATERIAL_NO_TEXTURE, with a warning, if it cannot be read. */
static enum err read_map(const struct reading *r, const struct aiMaterial *ai, enum aiTextureType type,
                         enum texture_values values, const char *instead, uint32_t *index)
{
    struct reason why = { "" };
    struct aiString name;
    struct texture t;

    *index = MATERIAL_NO_TEXTURE;
    if (aiGetMaterialString(ai, AI_MATKEY_TEXTURE(type, 0), &name) != aiReturn_SUCCESS)
        return ERR_OK;
    enum err e = load_image(r, name.data, values, &t, &why);
    if (e == ERR_NOMEM)
        return e;
    if (e) {
        log_warning("%s; %s", why.text, instead);
        return ERR_OK;
    }
    if (values == TEXTURE_CUTOUT)
        grey_to_alpha(&t);
    e = scene_add_texture(r->scene, &t, index);
    if (e)
        texture_finish(&t);
    return e;
}

/* d, Tr and map_d: how much of the surface is there. Not of glass. */
static enum err read_alpha(const struct reading *r, const struct aiMaterial *ai, struct material *m)
{
    const bool mapped = aiGetMaterialTextureCount(ai, aiTextureType_OPACITY) > 0;

    m->alpha = get_share(ai, "$mat.opacity", 1.0f);
    m->alpha_texture = MATERIAL_NO_TEXTURE;
    const enum err e =
        read_map(r, ai, aiTextureType_OPACITY, TEXTURE_CUTOUT, "the surface has no holes", &m->alpha_texture);
    if (m->alpha <= 0.0f) {
        if (!mapped)
            log_warning("%s: material '%s' has d 0 (Tr 1): it is shown opaque", r->desc->path, m->name);
        m->alpha = 1.0f; /* exporters that take d and Tr for each other, and those that leave it to map_d */
    }
    if (m->alpha < 1.0f || m->alpha_texture != MATERIAL_NO_TEXTURE)
        m->alpha_mode = ALPHA_BLEND;
    return e;
}

/* `norm`; a height in place of a normal (map_Bump) is not supported. */
static enum err read_normal_map(const struct reading *r, const struct aiMaterial *ai, struct material *m)
{
    const enum err e =
        read_map(r, ai, aiTextureType_NORMALS, TEXTURE_LINEAR, "the surface is smooth", &m->normal_texture);

    if (!e && m->normal_texture != MATERIAL_NO_TEXTURE) {
        m->maps |= MAP_NORMAL;
        m->normal_scale = 1.0f;
    }
    return e;
}

static enum err add_material(const struct reading *r, unsigned index, const char *name, uint32_t *out)
{
    const struct aiMaterial *ai = r->ai->mMaterials[index];
    struct material m = { .texture = MATERIAL_NO_TEXTURE, .emission_texture = MATERIAL_NO_TEXTURE };
    enum err e = ERR_OK;

    snprintf(m.name, sizeof(m.name), "%.63s", name);
    choose_kind(ai, &m);
    if (m.kind != MATERIAL_GLASS)
        e = read_texture(r, index, &m);
    if (!e && m.kind != MATERIAL_GLASS)
        e = read_alpha(r, ai, &m);
    if (!e)
        e = read_normal_map(r, ai, &m);
    read_emission(r, ai, &m);
    note_extras(r, ai, &m);
    return e ? e : scene_add_material(r->scene, &m, out);
}

static bool is_used(const struct aiScene *ai, unsigned material)
{
    for (unsigned i = 0; i < ai->mNumMeshes; i++) {
        if (ai->mMeshes[i]->mMaterialIndex == material)
            return true;
    }
    return false;
}

/* A name of the scene file comes first, then the model's own material. */
static enum err find_material(const struct reading *r, unsigned index, uint32_t *out)
{
    struct aiString name = { 0 };

    *out = MATERIAL_NONE;
    if (!is_used(r->ai, index))
        return ERR_OK;
    (void)aiGetMaterialString(r->ai->mMaterials[index], AI_MATKEY_NAME, &name);
    *out = scene_find_material(r->scene, name.data, 0);
    if (*out != MATERIAL_NONE && *out < r->desc->named)
        return ERR_OK;
    return add_material(r, index, name.data, out);
}

enum err model_add_materials(struct scene *s, const struct aiScene *ai, const struct model_desc *d, uint32_t *map,
                             struct reason *why)
{
    struct reading r = { .scene = s, .ai = ai, .desc = d, .why = why };
    enum err e = ERR_OK;

    r.known = mem_alloc((size_t)ai->mNumMaterials + 1, sizeof(*r.known));
    if (!r.known)
        return ERR_NOMEM;
    for (unsigned i = 0; i < ai->mNumMaterials; i++)
        r.known[i] = MATERIAL_NO_TEXTURE;
    for (unsigned i = 0; i < ai->mNumMaterials && !e; i++)
        e = find_material(&r, i, &map[i]);
    mem_free(r.known);
    return e;
}
