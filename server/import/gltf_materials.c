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

/* How a material uses an image. */
struct use {
    const char *name; /* "*3" is the third embedded image, anything else a file beside the model */
    enum texture_values values;
    enum texture_wrap wrap_u, wrap_v;
};

/* An image that has been read. */
struct known {
    struct use use;    /* owns its name */
    uint32_t texture;  /* of the scene; MATERIAL_NO_TEXTURE: only the means were needed */
    float green, blue; /* means of TEXTURE_LINEAR */
};

struct source {
    struct scene *scene;
    const struct aiScene *ai;
    const struct host *host;
    const char *path;
    struct reason *why;
    struct known *known; /* each image is read once per use */
    size_t known_count, known_room;
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

static bool same_use(const struct use *a, const struct use *b)
{
    return strcmp(a->name, b->name) == 0 && a->values == b->values && a->wrap_u == b->wrap_u && a->wrap_v == b->wrap_v;
}

/* The mean of a channel, 0..1. */
static float channel_mean(const struct texture *t, size_t channel)
{
    const size_t count = (size_t)t->width * t->height;
    uint64_t sum = 0;

    for (size_t i = 0; i < count; i++)
        sum += t->texels[4 * i + channel];
    return (float)((double)sum / (255.0 * (double)count));
}

/* Remembers an image for its use; colours go to the scene, of numbers only the means are kept. */
static enum err remember(struct source *s, const struct use *use, struct texture *t)
{
    if (!mem_reserve(&s->known, s->known_count, &s->known_room, sizeof(*s->known)))
        return ERR_NOMEM;
    struct known *k = &s->known[s->known_count];
    char *name = mem_alloc(strlen(use->name) + 1, 1);
    if (!name)
        return ERR_NOMEM;
    strcpy(name, use->name);
    *k = (struct known){ .use = *use, .texture = MATERIAL_NO_TEXTURE };
    k->use.name = name;
    s->known_count++;
    if (use->values == TEXTURE_LINEAR) {
        k->green = channel_mean(t, 1);
        k->blue = channel_mean(t, 2);
        texture_finish(t);
        return ERR_OK;
    }
    return scene_add_texture(s->scene, t, &k->texture);
}

/* *out stays valid until the next call. */
static enum err know_picture(struct source *s, const struct use *use, const struct known **out)
{
    struct texture t;

    for (size_t i = 0; i < s->known_count; i++) {
        *out = &s->known[i];
        if (same_use(&s->known[i].use, use))
            return ERR_OK;
    }
    enum err e = read_picture(s, use->name, use->values, &t);
    if (e)
        return e;
    t.wrap_u = use->wrap_u;
    t.wrap_v = use->wrap_v;
    e = remember(s, use, &t);
    if (e)
        texture_finish(&t);
    else
        *out = &s->known[s->known_count - 1];
    return e;
}

static enum texture_wrap wrap_of(enum aiTextureMapMode mode)
{
    if (mode == aiTextureMapMode_Mirror)
        return TEXTURE_MIRROR;
    return mode == aiTextureMapMode_Wrap ? TEXTURE_REPEAT : TEXTURE_CLAMP;
}

static bool is_identity(const struct aiUVTransform *t)
{
    return t->mTranslation.x == 0.0f && t->mTranslation.y == 0.0f && t->mScaling.x == 1.0f && t->mScaling.y == 1.0f &&
           t->mRotation == 0.0f;
}

static enum err read_base_texture(struct source *s, const struct aiMaterial *ai, struct material *m)
{
    enum aiTextureMapMode mode[2] = { aiTextureMapMode_Wrap, aiTextureMapMode_Wrap };
    const struct known *known;
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
    const struct use use = { name.data, TEXTURE_SRGB, wrap_of(mode[0]), wrap_of(mode[1]) };
    const enum err e = know_picture(s, &use, &known);
    if (!e)
        m->texture = known->texture;
    return e;
}

/* Metallic and roughness vary over the surface if they have a texture (blue and green channels); their means are used.
 */
static enum err read_metallic_roughness(struct source *s, const struct aiMaterial *ai, struct material *m)
{
    const struct known *known;
    struct aiString name;

    m->metallic = get_share(ai, "$mat.metallicFactor", 1.0f);
    m->roughness = get_share(ai, "$mat.roughnessFactor", 1.0f);
    if (aiGetMaterialTexture(ai, AI_MATKEY_GLTF_PBRMETALLICROUGHNESS_METALLICROUGHNESS_TEXTURE, &name, NULL, NULL, NULL,
                             NULL, NULL, NULL) != aiReturn_SUCCESS)
        return ERR_OK;
    scene_note_unmodelled(s->scene, FEATURE_ROUGHNESS_MAP, s->path);
    const struct use use = { .name = name.data, .values = TEXTURE_LINEAR };
    const enum err e = know_picture(s, &use, &known);
    if (e)
        return e;
    m->roughness *= known->green;
    m->metallic *= known->blue;
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
    struct source s = { .scene = scene, .ai = ai, .host = d->host, .path = d->path, .why = why };
    enum err e = ERR_OK;

    *first = (uint32_t)scene->material_count;
    for (unsigned i = 0; i < ai->mNumMaterials && !e; i++)
        e = add_material(&s, ai->mMaterials[i]);
    for (size_t i = 0; i < s.known_count; i++)
        mem_free((char *)s.known[i].use.name);
    mem_free(s.known);
    return e;
}
