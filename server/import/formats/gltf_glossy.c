/* Specular-glossiness materials of glTF [KHR_materials_pbrSpecularGlossiness]. */
#include "import/formats/gltf.h"

#include "base/luminance.h"
#include "base/mem.h"
#include "base/vec.h"
#include "import/formats/import.h"

#include <math.h>
#include <string.h>

#define BLACK 1e-3f /* a colour below is none */
#define F0 0.04f    /* of a dielectric, as in material.c */

/* The textures that a pair of textures and factors has become. */
struct glossy_known {
    size_t diffuse, glossy; /* the file's textures; GLTF_NONE: no diffuse texture */
    enum texture_values values;
    float factors[7];
    uint32_t base, roughness; /* the scene's */
};

/* A material as the file has it. */
struct glossy {
    struct vec3 diffuse, specular;
    float glossiness;
    struct gltf_image diffuse_image, image; /* decoded for the conversion */
};

static float share_of(float v)
{
    return fminf(fmaxf(v, 0.0f), 1.0f);
}

/* The root from 0 to 1 of F0 m^2 + (s + q - 2 F0) m + F0 - s, in which q is the base colour of a dielectric. */
static float solve_metallic(float matte, float specular)
{
    const float b = specular + matte / (1.0f - F0) - 2.0f * F0, c = F0 - specular;

    if (c >= 0.0f)
        return 0.0f;
    const float root = sqrtf(b * b - 4.0f * F0 * c);
    return share_of(b > 0.0f ? -2.0f * c / (b + root) : (root - b) / (2.0f * F0));
}

void glossy_convert(const float diffuse[3], const float specular[3], float glossiness, struct glossy_texel *out)
{
    const float below = 1.0f - fmaxf(specular[0], fmaxf(specular[1], specular[2]));
    float matte[3];

    for (int k = 0; k < 3; k++)
        matte[k] = diffuse[k] * below;
    const float metallic = solve_metallic(rgb_luminance(matte[0], matte[1], matte[2]),
                                          rgb_luminance(specular[0], specular[1], specular[2]));
    const float scatters = (1.0f - F0) * (1.0f - metallic);
    for (int k = 0; k < 3; k++) {
        const float reflected = specular[k] - F0 * (1.0f - metallic);
        out->base[k] =
            share_of((scatters * matte[k] + metallic * reflected) / (scatters * scatters + metallic * metallic));
    }
    out->metallic = metallic;
    out->roughness = 1.0f - glossiness;
}

/* ---- Textures ---- */

static uint8_t to_byte(float v)
{
    return (uint8_t)(share_of(v) * 255.0f + 0.5f);
}

/* The texel of an image at a place of a larger one; white without an image. */
static const uint8_t *texel_at(const struct texture *t, uint32_t x, uint32_t y, uint32_t width, uint32_t height)
{
    static const uint8_t white[4] = { 255, 255, 255, 255 };

    if (!t->texels)
        return white;
    const size_t column = (size_t)x * t->width / width, row = (size_t)y * t->height / height;
    return t->texels + 4 * (row * t->width + column);
}

static void convert_texels(const struct glossy *g, struct texture *base, struct texture *roughness)
{
    const float of_diffuse[3] = { g->diffuse.x, g->diffuse.y, g->diffuse.z };
    const float of_specular[3] = { g->specular.x, g->specular.y, g->specular.z };
    float linear[256], diffuse[3], specular[3];
    struct glossy_texel t;

    for (int i = 0; i < 256; i++)
        linear[i] = (float)srgb_decode(i / 255.0);
    for (uint32_t y = 0; y < base->height; y++) {
        for (uint32_t x = 0; x < base->width; x++) {
            const uint8_t *d = texel_at(&g->diffuse_image.texture, x, y, base->width, base->height);
            const uint8_t *s = texel_at(&g->image.texture, x, y, base->width, base->height);
            const size_t at = 4 * ((size_t)y * base->width + x);
            for (int k = 0; k < 3; k++) {
                diffuse[k] = of_diffuse[k] * linear[d[k]];
                specular[k] = of_specular[k] * linear[s[k]];
            }
            glossy_convert(diffuse, specular, g->glossiness * (float)s[3] / 255.0f, &t);
            for (int k = 0; k < 3; k++)
                base->texels[at + (size_t)k] = to_byte((float)srgb_encode(t.base[k]));
            base->texels[at + 3] = base->values == TEXTURE_CUTOUT ? d[3] : UINT8_MAX;
            const uint8_t numbers[4] = { 0, to_byte(t.roughness), to_byte(t.metallic), 255 };
            memcpy(roughness->texels + at, numbers, sizeof(numbers));
        }
    }
}

static enum err add_texture(struct gltf_source *s, struct texture *t, const struct gltf_image *like, uint32_t *index)
{
    t->wrap_u = like->wrap_u;
    t->wrap_v = like->wrap_v;
    texture_build_levels(t);
    const enum err e = scene_add_texture(s->g->scene, t, index);
    if (!e)
        *t = (struct texture){ 0 }; /* the scene owns it */
    return e;
}

/* Adds both textures to the scene. */
static enum err convert_images(struct gltf_source *s, const struct glossy *g, struct glossy_known *k)
{
    const struct gltf_image *diffuse = g->diffuse_image.texture.texels ? &g->diffuse_image : &g->image;
    const uint32_t width = (uint32_t)fmax(diffuse->texture.width, g->image.texture.width);
    const uint32_t height = (uint32_t)fmax(diffuse->texture.height, g->image.texture.height);
    struct texture base = { 0 }, roughness = { 0 };

    enum err e = texture_init(&base, width, height, k->values);
    if (!e)
        e = texture_init(&roughness, width, height, TEXTURE_LINEAR);
    if (!e) {
        convert_texels(g, &base, &roughness);
        e = add_texture(s, &base, diffuse, &k->base);
    }
    if (!e)
        e = add_texture(s, &roughness, &g->image, &k->roughness);
    texture_finish(&base);
    texture_finish(&roughness);
    return e;
}

static const struct glossy_known *find_known(const struct gltf_source *s, const struct glossy_known *like)
{
    for (size_t i = 0; i < s->glossy_count; i++) {
        const struct glossy_known *k = &s->glossy[i];
        if (k->diffuse == like->diffuse && k->glossy == like->glossy && k->values == like->values &&
            memcmp(k->factors, like->factors, sizeof(k->factors)) == 0)
            return k;
    }
    return NULL;
}

/* *out stays valid until the next call. */
static enum err know_pair(struct gltf_source *s, const struct glossy *g, enum texture_values values,
                          const struct glossy_known **out)
{
    struct glossy_known k = { .diffuse = g->diffuse_image.index,
                              .glossy = g->image.index,
                              .values = values,
                              .factors = { g->diffuse.x, g->diffuse.y, g->diffuse.z, g->specular.x, g->specular.y,
                                           g->specular.z, g->glossiness } };

    *out = find_known(s, &k);
    if (*out)
        return ERR_OK;
    if (!mem_reserve(&s->glossy, s->glossy_count, &s->glossy_room, sizeof(*s->glossy)))
        return ERR_NOMEM;
    const enum err e = convert_images(s, g, &k);
    if (e)
        return e;
    s->glossy[s->glossy_count] = k;
    *out = &s->glossy[s->glossy_count++];
    return ERR_OK;
}

/* ---- Materials ---- */

/* Factors without a texture that varies them. */
static void set_factors(const struct glossy *g, struct material *m)
{
    m->diffuse = g->diffuse;
    m->roughness = 1.0f - g->glossiness;
    m->metallic = largest(g->diffuse) < BLACK ? 1.0f : 0.0f;
    if (m->metallic > 0.0f)
        m->diffuse = g->specular;
    else
        m->specular = vec3_sub(g->specular, vec3_make(F0, F0, F0));
}

/* Multiplies the factors by the means of the texture. */
static void take_means(struct glossy *g)
{
    const struct texture *t = &g->image.texture;
    const size_t count = (size_t)t->width * t->height;
    double sum[4] = { 0.0 };

    for (size_t i = 0; i < count; i++) {
        for (size_t k = 0; k < 3; k++)
            sum[k] += srgb_decode(t->texels[4 * i + k] / 255.0);
        sum[3] += t->texels[4 * i + 3] / 255.0;
    }
    const double n = (double)count;
    g->specular = vec3_mul(g->specular, vec3_make((float)(sum[0] / n), (float)(sum[1] / n), (float)(sum[2] / n)));
    g->glossiness *= (float)(sum[3] / n);
}

static bool same_place(const struct gltf_surface *a, const struct gltf_surface *b)
{
    return a->uv_set == b->uv_set && memcmp(a->transform, b->transform, sizeof(a->transform)) == 0;
}

/* Whether both images together make two of a size that textures may have. */
static bool can_convert(const struct glossy *g)
{
    const struct texture *d = &g->diffuse_image.texture, *t = &g->image.texture;

    return (!d->texels || same_place(&g->diffuse_image.surface, &g->image.surface)) &&
           fmax(d->width, t->width) * fmax(d->height, t->height) <= (double)TEXTURE_TEXELS_MAX;
}

static enum err use_images(struct gltf_source *s, struct glossy *g, struct material *m, struct gltf_surface *surface)
{
    const struct glossy_known *k;

    const enum err e = know_pair(s, g, m->alpha_mode == ALPHA_OPAQUE ? TEXTURE_SRGB : TEXTURE_CUTOUT, &k);
    if (e)
        return e;
    m->diffuse = vec3_make(1.0f, 1.0f, 1.0f);
    m->metallic = m->roughness = 1.0f;
    m->texture = m->alpha_texture = k->base;
    m->maps |= MAP_ROUGHNESS;
    m->roughness_texture = k->roughness;
    surface[0] = g->image.surface;
    return ERR_OK;
}

static enum err read_textures(struct gltf_source *s, const struct gltf_at *at, struct glossy *g, struct material *m,
                              struct gltf_surface *surface)
{
    const struct gltf_at texture = gltf_key(at, "specularGlossinessTexture"), diffuse = gltf_key(at, "diffuseTexture");
    enum err e = ERR_OK;

    g->diffuse_image.index = GLTF_NONE;
    if (texture.value)
        e = gltf_texture_image(&s->images, &texture, "the specular and glossiness factors alone count", &g->image);
    if (!e && g->image.texture.texels && diffuse.value)
        e = gltf_texture_image(&s->images, &diffuse, "the surfaces are grey", &g->diffuse_image);
    if (e || !g->image.texture.texels) {
        set_factors(g, m);
        return e ? e : gltf_read_base_texture(s, at, "diffuseTexture", m, surface);
    }
    if (diffuse.value && !g->diffuse_image.texture.texels)
        g->diffuse = vec3_scale(g->diffuse, GREY);
    if (can_convert(g))
        return use_images(s, g, m, surface);
    gltf_note(&s->notes[FEATURE_SPECULAR_GLOSSINESS], s->material);
    take_means(g);
    set_factors(g, m);
    return gltf_read_base_texture(s, at, "diffuseTexture", m, surface);
}

enum err gltf_read_glossy(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                          struct gltf_surface *surface)
{
    struct glossy g = { .glossiness = 1.0f };

    enum err e = gltf_colour(s, at, "diffuseFactor", 4, 1.0, &g.diffuse);
    if (!e)
        e = gltf_colour(s, at, "specularFactor", 3, 1.0, &g.specular);
    if (!e)
        e = gltf_share(s, at, "glossinessFactor", 1.0, &g.glossiness);
    if (!e)
        e = read_textures(s, at, &g, m, surface);
    texture_finish(&g.diffuse_image.texture);
    texture_finish(&g.image.texture);
    return e;
}
