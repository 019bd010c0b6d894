/* Layers on top of a glTF material: clear coat and sheen. */
#include "import/formats/gltf.h"

/* A map of numbers that multiplies a factor by one of its channels, or by that one's mean where it is the same
 * everywhere or has no coordinates. */
static enum err read_factor_map(struct gltf_source *s, const struct gltf_at *above, const char *key,
                                enum material_map map, int channel, struct material *m, struct gltf_surface *surface,
                                float *factor, uint32_t *texture)
{
    const struct gltf_at at = gltf_key(above, key);
    struct gltf_numbers t;

    if (!at.value)
        return ERR_OK;
    const enum err e = gltf_texture_numbers(&s->images, &at, 1u << channel, "the factor alone counts", &t);
    if (e || !t.found)
        return e;
    if (t.texture != MATERIAL_NO_TEXTURE && gltf_place_texture(s, m, map, surface, &t.surface)) {
        m->maps |= (uint32_t)map;
        *texture = t.texture;
    } else {
        *factor *= t.mean[channel];
    }
    return ERR_OK;
}

/* The index that a texture has in the file; GLTF_NONE: there is no texture. */
static enum err texture_index(struct gltf_source *s, const struct gltf_at *at, size_t *out)
{
    *out = GLTF_NONE;
    return at->value ? gltf_index(s->g, at, "index", GLTF_TEXTURES, out) : ERR_OK;
}

enum err gltf_read_coat(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                        struct gltf_surface *surface)
{
    const struct gltf_at own = gltf_extension(at, "KHR_materials_clearcoat");
    const struct gltf_at normal = gltf_key(&own, "clearcoatNormalTexture"), base = gltf_key(at, "normalTexture");
    size_t bent, of_base;

    enum err e = gltf_share(s, &own, "clearcoatFactor", 0.0, &m->coat);
    if (!e)
        e = gltf_share(s, &own, "clearcoatRoughnessFactor", 0.0, &m->coat_roughness);
    if (e || !(m->coat > 0.0f))
        return e;
    if (m->kind == MATERIAL_GLASS) {
        m->coat = 0.0f;
        gltf_note(&s->notes[FEATURE_COATED_GLASS], s->material);
        return ERR_OK;
    }
    e = read_factor_map(s, &own, "clearcoatTexture", MAP_COAT, 0, m, surface, &m->coat, &m->coat_texture);
    if (!e)
        e = read_factor_map(s, &own, "clearcoatRoughnessTexture", MAP_COAT_ROUGHNESS, 1, m, surface, &m->coat_roughness,
                            &m->coat_roughness_texture);
    if (!e)
        e = texture_index(s, &normal, &bent);
    if (!e)
        e = texture_index(s, &base, &of_base);
    if (e || bent == GLTF_NONE)
        return e;
    m->coat_bent = bent == of_base && (m->maps & MAP_NORMAL);
    if (bent != of_base)
        gltf_note(&s->notes[FEATURE_COAT_NORMAL], s->material);
    return ERR_OK;
}

enum err gltf_read_sheen(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                         struct gltf_surface *surface)
{
    const struct gltf_at own = gltf_extension(at, "KHR_materials_sheen");
    const struct gltf_at texture = gltf_key(&own, "sheenColorTexture");
    struct gltf_surface place;

    m->sheen_texture = MATERIAL_NO_TEXTURE;
    enum err e = gltf_colour(s, &own, "sheenColorFactor", 3, 0.0, &m->sheen);
    if (!e)
        e = gltf_share(s, &own, "sheenRoughnessFactor", 0.0, &m->sheen_roughness);
    if (e || !(largest(m->sheen) > 0.0f))
        return e;
    if (m->kind == MATERIAL_GLASS) {
        m->sheen = vec3_make(0.0f, 0.0f, 0.0f);
        gltf_note(&s->notes[FEATURE_SHEEN], s->material);
        return ERR_OK;
    }
    e = read_factor_map(s, &own, "sheenRoughnessTexture", MAP_SHEEN_ROUGHNESS, 3, m, surface, &m->sheen_roughness,
                        &m->sheen_roughness_texture);
    if (e || !texture.value)
        return e;
    e = gltf_texture_colours(&s->images, &texture, TEXTURE_SRGB, &m->sheen_texture, &place);
    if (!e && m->sheen_texture != MATERIAL_NO_TEXTURE)
        (void)gltf_place_texture(s, m, MAP_SHEEN, surface, &place);
    else
        m->sheen = vec3_scale(m->sheen, GREY);
    return e;
}
