/* Materials of glTF as Assimp provides them: metallic-roughness becomes `ggx`, transmission becomes `glass`. */
#include "import/parts.h"

#include "base/mem.h"

#include <assimp/GltfMaterial.h>
#include <assimp/material.h>
#include <assimp/scene.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct source {
    struct scene *scene;
    const struct aiScene *ai;
    const struct host *host;
    const char *path;
    struct reason *why;
    /* The textures named so far, so that each image is read once. */
    struct {
        char name[256];
        uint32_t texture;
    } known[64];
    size_t known_count;
};

static float get_float(const struct aiMaterial *m, const char *key, float fallback)
{
    ai_real value = fallback;
    unsigned max = 1;

    if (aiGetMaterialFloatArray(m, key, 0, 0, &value, &max) != aiReturn_SUCCESS || !isfinite(value))
        return fallback;
    return value;
}

static float get_share(const struct aiMaterial *m, const char *key, float fallback)
{
    return fminf(fmaxf(get_float(m, key, fallback), 0.0f), 1.0f);
}

static struct vec3 get_colour(const struct aiMaterial *m, const char *key, struct vec3 fallback)
{
    struct aiColor4D c;

    if (aiGetMaterialColor(m, key, 0, 0, &c) != aiReturn_SUCCESS || !isfinite(c.r) || !isfinite(c.g) || !isfinite(c.b))
        return fallback;
    return vec3_make(fminf(fmaxf(c.r, 0.0f), 1.0f), fminf(fmaxf(c.g, 0.0f), 1.0f), fminf(fmaxf(c.b, 0.0f), 1.0f));
}

static bool has_texture(const struct aiMaterial *m, enum aiTextureType type)
{
    return aiGetMaterialTextureCount(m, type) > 0;
}

static int hex_digit(char c)
{
    if (c >= '0' && c <= '9')
        return c - '0';
    if (c >= 'a' && c <= 'f')
        return c - 'a' + 10;
    return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

/* The path of a URI, relative to the model; decodes %20 and the like. False: too long. */
static bool file_beside(const char *model, const char *uri, char *out, size_t size)
{
    const char *slash = strrchr(model, '/');
    size_t n = slash && uri[0] != '/' ? (size_t)(slash - model) + 1 : 0;

    if (n >= size)
        return false;
    memcpy(out, model, n);
    for (; *uri; uri++) {
        if (n + 1 >= size)
            return false;
        const int high = uri[0] == '%' ? hex_digit(uri[1]) : -1;
        const int low = high >= 0 ? hex_digit(uri[2]) : -1;
        out[n++] = low >= 0 ? (char)(16 * high + low) : *uri;
        uri += low >= 0 ? 2 : 0;
    }
    out[n] = '\0';
    return true;
}

/* Reads image `name`: "*3" is the third embedded one, anything else a file beside the model. */
static enum err read_picture(struct source *s, const char *name, enum texture_values values, struct texture *out)
{
    char label[4096];

    if (name[0] != '*') {
        if (!file_beside(s->path, name, label, sizeof(label)))
            return err_say(s->why, ERR_RANGE, "%s: the path of a texture is too long", s->path);
        return texture_load(s->host, label, values, out, s->why);
    }
    const unsigned long index = strtoul(name + 1, NULL, 10);
    snprintf(label, sizeof(label), "%.4000s: embedded texture %lu", s->path, index);
    if (index >= s->ai->mNumTextures)
        return err_say(s->why, ERR_FORMAT, "%s: does not exist", label);
    const struct aiTexture *t = s->ai->mTextures[index];
    if (t->mHeight != 0)
        return err_say(s->why, ERR_UNSUPPORTED, "%s: texture is neither PNG nor JPEG", label);
    return texture_decode(t->pcData, t->mWidth, values, label, out, s->why);
}

static enum err base_texture(struct source *s, const char *name, uint32_t *index)
{
    struct texture t;

    for (size_t i = 0; i < s->known_count; i++) {
        if (strcmp(s->known[i].name, name) == 0) {
            *index = s->known[i].texture;
            return ERR_OK;
        }
    }
    enum err e = read_picture(s, name, TEXTURE_SRGB, &t);
    if (e)
        return e;
    e = scene_add_texture(s->scene, &t, index);
    if (e) {
        mem_free(t.rgb);
        return e;
    }
    if (s->known_count < sizeof(s->known) / sizeof(s->known[0]) && strlen(name) < sizeof(s->known[0].name)) {
        snprintf(s->known[s->known_count].name, sizeof(s->known[0].name), "%s", name);
        s->known[s->known_count++].texture = *index;
    }
    return ERR_OK;
}

static bool is_identity(const struct aiUVTransform *t)
{
    return t->mTranslation.x == 0.0f && t->mTranslation.y == 0.0f && t->mScaling.x == 1.0f && t->mScaling.y == 1.0f &&
           t->mRotation == 0.0f;
}

static enum err read_base_texture(struct source *s, const struct aiMaterial *ai, struct material *m)
{
    enum aiTextureMapMode mode[2] = { aiTextureMapMode_Wrap, aiTextureMapMode_Wrap };
    struct aiUVTransform transform;
    struct aiString name;
    unsigned uv = 0, max = sizeof(transform) / sizeof(ai_real);

    if (aiGetMaterialTexture(ai, aiTextureType_BASE_COLOR, 0, &name, NULL, &uv, NULL, NULL, mode, NULL) !=
        aiReturn_SUCCESS)
        return ERR_OK;
    if (aiGetMaterialFloatArray(ai, AI_MATKEY_UVTRANSFORM(aiTextureType_BASE_COLOR, 0), (ai_real *)&transform, &max) !=
        aiReturn_SUCCESS)
        transform = (struct aiUVTransform){ .mScaling = { 1.0f, 1.0f } };
    if (uv != 0 || !is_identity(&transform))
        scene_note_unmodelled(s->scene, FEATURE_TEXTURE_TRANSFORM, s->path);
    if (mode[0] != aiTextureMapMode_Wrap || mode[1] != aiTextureMapMode_Wrap)
        scene_note_unmodelled(s->scene, FEATURE_TEXTURE_CLAMP, s->path);
    return base_texture(s, name.data, &m->texture);
}

/* Metallic and roughness vary over the surface if they have a texture (blue and green channels); their means are used.
 */
static enum err read_metallic_roughness(struct source *s, const struct aiMaterial *ai, struct material *m)
{
    double green = 0.0, blue = 0.0;
    struct aiString name;
    struct texture t;

    m->metallic = get_share(ai, "$mat.metallicFactor", 1.0f);
    m->roughness = get_share(ai, "$mat.roughnessFactor", 1.0f);
    if (aiGetMaterialTexture(ai, AI_MATKEY_GLTF_PBRMETALLICROUGHNESS_METALLICROUGHNESS_TEXTURE, &name, NULL, NULL, NULL,
                             NULL, NULL, NULL) != aiReturn_SUCCESS)
        return ERR_OK;
    scene_note_unmodelled(s->scene, FEATURE_ROUGHNESS_MAP, s->path);
    const enum err e = read_picture(s, name.data, TEXTURE_LINEAR, &t);
    if (e)
        return e;
    const size_t count = (size_t)t.width * t.height;
    for (size_t i = 0; i < count; i++) {
        green += t.rgb[3 * i + 1];
        blue += t.rgb[3 * i + 2];
    }
    m->roughness *= (float)(green / (double)count);
    m->metallic *= (float)(blue / (double)count);
    mem_free(t.rgb);
    return ERR_OK;
}

static void read_glass(struct source *s, const struct aiMaterial *ai, struct material *m)
{
    const struct vec3 c = m->diffuse;

    m->kind = MATERIAL_GLASS;
    m->ior = fminf(fmaxf(get_float(ai, "$mat.refracti", 1.5f), 1.0f), 4.0f);
    if (m->roughness > 0.03f)
        scene_note_unmodelled(s->scene, FEATURE_ROUGH_GLASS, s->path);
    if (c.x < 1.0f || c.y < 1.0f || c.z < 1.0f || m->texture != MATERIAL_NO_TEXTURE)
        scene_note_unmodelled(s->scene, FEATURE_TINTED_GLASS, s->path);
    m->diffuse = vec3_make(1.0f, 1.0f, 1.0f);
    m->texture = MATERIAL_NO_TEXTURE;
}

static float largest(struct vec3 v)
{
    return fmaxf(v.x, fmaxf(v.y, v.z));
}

static void note_extras(struct source *s, const struct aiMaterial *ai, bool glass)
{
    const struct vec3 black = { 0 };
    struct aiString alpha;

    if (has_texture(ai, aiTextureType_NORMALS))
        scene_note_unmodelled(s->scene, FEATURE_NORMAL_MAP, s->path);
    if (!glass && aiGetMaterialString(ai, AI_MATKEY_GLTF_ALPHAMODE, &alpha) == aiReturn_SUCCESS &&
        strcmp(alpha.data, "OPAQUE") != 0)
        scene_note_unmodelled(s->scene, FEATURE_ALPHA, s->path);
    if (get_float(ai, "$mat.volume.thicknessFactor", 0.0f) > 0.0f)
        scene_note_unmodelled(s->scene, FEATURE_VOLUME, s->path);
    if (largest(get_colour(ai, "$clr.emissive", black)) > 0.0f)
        scene_note_unmodelled(s->scene, FEATURE_EMISSION, s->path);
    if (get_float(ai, "$mat.clearcoat.factor", 0.0f) > 0.0f ||
        largest(get_colour(ai, "$clr.sheen.factor", black)) > 0.0f)
        scene_note_unmodelled(s->scene, FEATURE_CLEARCOAT, s->path);
    if (get_float(ai, "$mat.glossinessFactor", -1.0f) >= 0.0f)
        scene_note_unmodelled(s->scene, FEATURE_SPECULAR_GLOSSINESS, s->path);
}

static enum err add_material(struct source *s, const struct aiMaterial *ai)
{
    struct material m = { .kind = MATERIAL_GGX, .texture = MATERIAL_NO_TEXTURE };
    struct aiString name;

    if (aiGetMaterialString(ai, AI_MATKEY_NAME, &name) == aiReturn_SUCCESS)
        snprintf(m.name, sizeof(m.name), "%.63s", name.data);
    m.diffuse = get_colour(ai, "$clr.base", vec3_make(1.0f, 1.0f, 1.0f));
    enum err e = read_metallic_roughness(s, ai, &m);
    if (!e)
        e = read_base_texture(s, ai, &m);
    if (e)
        return e;
    const float transmission = get_share(ai, "$mat.transmission.factor", 0.0f);
    if (transmission > 0.0f && transmission < 1.0f)
        scene_note_unmodelled(s->scene, FEATURE_PARTIAL_GLASS, s->path);
    if (transmission >= 0.5f)
        read_glass(s, ai, &m);
    note_extras(s, ai, m.kind == MATERIAL_GLASS);
    return scene_add_material(s->scene, &m, NULL);
}

enum err gltf_add_materials(struct scene *scene, const struct aiScene *ai, const struct model_desc *d, uint32_t *first,
                            struct reason *why)
{
    struct source *s = mem_alloc(1, sizeof(*s));
    enum err e = s ? ERR_OK : ERR_NOMEM;

    *first = (uint32_t)scene->material_count;
    if (s)
        *s = (struct source){ .scene = scene, .ai = ai, .host = d->host, .path = d->path, .why = why };
    for (unsigned i = 0; i < ai->mNumMaterials && !e; i++)
        e = add_material(s, ai->mMaterials[i]);
    mem_free(s);
    return e;
}
