/* Materials of glTF: metallic-roughness becomes `ggx`, transmission becomes `glass`. */
#include "import/formats/gltf.h"

#include "base/mem.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define BLACK 1e-3f /* a colour below is none */

#define FROSTED 0.4f /* transmission of surfaces that are rougher is diffuse; of others it is that of smooth glass */

enum { GREEN = 2, BLUE = 4 }; /* channels */
#define ROUGHNESS_ALONE "the metallic and roughness factors alone count"

static float share(double v)
{
    return (float)fmin(fmax(v, 0.0), 1.0);
}

enum err gltf_share(struct gltf_source *s, const struct gltf_at *at, const char *key, double fallback, float *out)
{
    double v = fallback;
    const enum err e = gltf_number(s->g, at, key, &v);

    *out = share(v);
    return e;
}

enum err gltf_colour(struct gltf_source *s, const struct gltf_at *at, const char *key, size_t count, double fallback,
                     struct vec3 *out)
{
    double c[4] = { fallback, fallback, fallback };
    const enum err e = gltf_numbers(s->g, at, key, count, c);

    *out = vec3_make(share(c[0]), share(c[1]), share(c[2]));
    return e;
}

enum err gltf_read_base_texture(struct gltf_source *s, const struct gltf_at *above, const char *key, struct material *m,
                                struct gltf_surface *surface)
{
    const struct gltf_at at = gltf_key(above, key);

    if (!at.value)
        return ERR_OK;
    const enum err e = gltf_texture_colours(
        &s->images, &at, m->alpha_mode == ALPHA_OPAQUE ? TEXTURE_SRGB : TEXTURE_CUTOUT, &m->texture, surface);
    m->alpha_texture = m->texture;
    if (!e && m->texture == MATERIAL_NO_TEXTURE)
        m->diffuse = vec3_scale(m->diffuse, GREY);
    return e;
}

/* A transform of coordinates as a mesh keeps them, v upwards: glTF's are 1 - v. */
static void upright(const double t[6], double out[6])
{
    const double own[6] = { t[0], -t[1], t[1] + t[2], -t[3], t[4], 1.0 - t[4] - t[5] };
    memcpy(out, own, sizeof(own));
}

/* Whether the coordinates `own` are affine in those of a surface, other than by being the same: then `by` is the
 * transform. The frame of a normal map is the mesh's, so that it must not be turned. */
static bool is_affine(const struct gltf_surface *surface, const struct gltf_surface *own, bool normal, float out[6])
{
    double a[6], b[6], by[6];
    bool fits = true;

    upright(surface->transform, a);
    upright(own->transform, b);
    const double det = a[0] * a[4] - a[1] * a[3];
    if (surface->uv_set != own->uv_set || det == 0.0)
        return false;
    for (int k = 0; k < 6; k += 3) {
        by[k] = (b[k] * a[4] - b[k + 1] * a[3]) / det;
        by[k + 1] = (b[k + 1] * a[0] - b[k] * a[1]) / det;
        by[k + 2] = b[k + 2] - by[k] * a[2] - by[k + 1] * a[5];
    }
    for (int k = 0; k < 6; k++) {
        fits &= fabs(by[k]) <= (double)MOVED_MAX;
        out[k] = fits ? (float)by[k] : 0.0f;
    }
    return fits && (!normal || (by[0] > 0.0 && by[4] > 0.0 && fabs(by[1]) + fabs(by[3]) < 1e-6 * (by[0] + by[4])));
}

bool gltf_place_texture(struct gltf_source *s, struct material *m, enum material_map map, struct gltf_surface *surface,
                        const struct gltf_surface *own)
{
    const bool normal = map == MAP_NORMAL;

    for (int k = 0; k < 2; k++) {
        if (surface[k].uv_set == GLTF_NONE)
            surface[k] = *own;
        const bool same = surface[k].uv_set == own->uv_set &&
                          memcmp(surface[k].transform, own->transform, sizeof(own->transform)) == 0;
        const bool moved = !same && (map & MAPS_MOVED) && is_affine(&surface[k], own, normal, m->moved_by[normal]);
        if (!same && !moved)
            continue;
        m->second |= k ? (uint32_t)map : 0;
        m->moved |= moved ? (uint32_t)map : 0;
        return true;
    }
    gltf_note(&s->notes[FEATURE_TEXTURE_TRANSFORM], s->material);
    return false;
}

/* An emissive texture without a place has the base colour's; one that cannot be read emits nothing. */
static enum err read_emissive_texture(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                                      struct gltf_surface *surface)
{
    struct gltf_surface own;

    const enum err e = gltf_texture_colours(&s->images, at, TEXTURE_SRGB, &m->emission_texture, &own);
    if (e)
        return e;
    if (m->emission_texture == MATERIAL_NO_TEXTURE)
        m->emission = vec3_make(0.0f, 0.0f, 0.0f);
    else
        (void)gltf_place_texture(s, m, MAP_EMISSION, surface, &own);
    return ERR_OK;
}

static enum err read_emission(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                              struct gltf_surface *surface)
{
    const struct gltf_at extension = gltf_extension(at, "KHR_materials_emissive_strength");
    const struct gltf_at texture = gltf_key(at, "emissiveTexture");
    struct vec3 factor;
    double strength = 1.0;

    enum err e = gltf_colour(s, at, "emissiveFactor", 3, 0.0, &factor);
    if (!e)
        e = gltf_number(s->g, &extension, "emissiveStrength", &strength);
    gltf_set_emission(m, factor, strength);
    if (e || !texture.value || !(largest(m->emission) > 0.0f))
        return e;
    return read_emissive_texture(s, &texture, m, surface);
}

/* Metallic and roughness vary over the surface if they have a texture (blue and green channels). Its means are used
 * where it cannot share the coordinates, and of glass. */
static enum err read_roughness_texture(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                                       struct gltf_surface *surface)
{
    struct gltf_numbers t;

    if (!at->value || m->kind == MATERIAL_LAMBERT)
        return ERR_OK;
    const enum err e = gltf_texture_numbers(&s->images, at, GREEN | BLUE, ROUGHNESS_ALONE, &t);
    if (e || !t.found)
        return e;
    if (t.texture != MATERIAL_NO_TEXTURE && material_has_finish(m) &&
        gltf_place_texture(s, m, MAP_ROUGHNESS, surface, &t.surface)) {
        m->maps |= MAP_ROUGHNESS;
        m->roughness_texture = t.texture;
        return ERR_OK;
    }
    m->roughness *= t.mean[1];
    m->metallic *= t.mean[2];
    return ERR_OK;
}

/* A flat map, which many exporters write, is none. */
static bool is_flat(const struct gltf_numbers *t)
{
    const float half_step = 0.5f / 255.0f, step = 1.0f / 255.0f;
    return fabsf(t->mean[0] - 0.5f) < step && fabsf(t->mean[1] - 0.5f) < step && t->mean[2] > 1.0f - half_step;
}

/* A map that cannot share the coordinates is ignored. */
static enum err read_normal_texture(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                                    struct gltf_surface *surface)
{
    double scale = 1.0;
    struct gltf_numbers t;

    if (!at->value)
        return ERR_OK;
    enum err e = gltf_texture_numbers(&s->images, at, 0, "the surfaces are smooth", &t);
    if (!e)
        e = gltf_number(s->g, at, "scale", &scale);
    if (e || !t.found || scale == 0.0 || is_flat(&t) || !gltf_place_texture(s, m, MAP_NORMAL, surface, &t.surface))
        return e;
    m->maps |= MAP_NORMAL;
    m->normal_texture = t.texture;
    m->normal_scale = (float)fmin(fmax(scale, -(double)NORMAL_SCALE_MAX), (double)NORMAL_SCALE_MAX);
    return ERR_OK;
}

/* ---- Materials ---- */

static enum alpha_mode alpha_mode(const struct gltf_at *at)
{
    const char *mode = gltf_string(at, "alphaMode");

    if (mode && strcmp(mode, "MASK") == 0)
        return ALPHA_MASK;
    return mode && strcmp(mode, "BLEND") == 0 ? ALPHA_BLEND : ALPHA_OPAQUE;
}

/* colour: the object with the colour whose fourth number is alpha's factor. */
static enum err read_alpha(struct gltf_source *s, const struct gltf_at *at, const struct gltf_at *colour,
                           const char *key, struct material *m)
{
    double factor[4] = { 1.0, 1.0, 1.0, 1.0 }, cutoff = 0.5;

    enum err e = gltf_numbers(s->g, colour, key, 4, factor);
    if (!e)
        e = gltf_number(s->g, at, "alphaCutoff", &cutoff);
    m->alpha = share(factor[3]);
    m->alpha_cutoff = (float)fmin(fmax(cutoff, 0.0), 2.0); /* above 1 nothing is left */
    return e;
}

/* KHR_materials_volume; without it, or with a thickness of 0, the glass is a thin sheet. The real distance inside
 * counts, not the thickness, by which viewers without rays guess it. */
static enum err read_volume(struct gltf_source *s, const struct gltf_at *at, struct material *m)
{
    const struct gltf_at volume = gltf_extension(at, "KHR_materials_volume");
    double distance = INFINITY, thickness = 0.0;
    struct vec3 colour;

    enum err e = gltf_colour(s, &volume, "attenuationColor", 3, 1.0, &colour);
    if (!e)
        e = gltf_number(s->g, &volume, "attenuationDistance", &distance);
    if (!e)
        e = gltf_number(s->g, &volume, "thicknessFactor", &thickness);
    m->thin = !(thickness > 0.0);
    if (!e && !(distance > 0.0))
        return gltf_fault(s->g, &volume, ERR_FORMAT, "attenuationDistance is %g; expected more than 0", distance);
    m->attenuation = attenuation_from(colour, distance);
    return e;
}

static enum err read_glass(struct gltf_source *s, const struct gltf_at *at, struct material *m)
{
    const struct gltf_at extension = gltf_extension(at, "KHR_materials_ior");
    double ior = 1.5;

    enum err e = gltf_number(s->g, &extension, "ior", &ior);
    if (!e)
        e = read_volume(s, at, m);
    m->kind = MATERIAL_GLASS;
    m->ior = (float)fmin(fmax(ior, 1.0), 4.0);
    if (m->alpha_mode == ALPHA_BLEND) /* many exporters blend glass for viewers that cannot refract */
        m->alpha_mode = ALPHA_OPAQUE;
    return e;
}

/* KHR_materials_specular and KHR_materials_ior. Without its specular part a dielectric is matte; a share of it reflects
 * as much at grazing angles as the whole. */
static enum err read_specular(struct gltf_source *s, const struct gltf_at *at, struct material *m)
{
    const struct gltf_at own = gltf_extension(at, "KHR_materials_specular"),
                         index = gltf_extension(at, "KHR_materials_ior");
    double ior = 1.5, factor = 1.0, colour[3] = { 1.0, 1.0, 1.0 };
    float more[3];

    enum err e = gltf_number(s->g, &index, "ior", &ior);
    if (!e)
        e = gltf_number(s->g, &own, "specularFactor", &factor);
    if (!e)
        e = gltf_numbers(s->g, &own, "specularColorFactor", 3, colour);
    if (e)
        return e;
    const double root = ior == 0.0 ? 1.0 : (fmax(ior, 1.0) - 1.0) / (fmax(ior, 1.0) + 1.0); /* 0: all is reflected */
    for (int k = 0; k < 3; k++)
        more[k] = (float)((double)share(factor) * (double)share(root * root * fmax(colour[k], 0.0))) - 0.04f;
    m->specular = vec3_make(more[0], more[1], more[2]);
    if (gltf_key(&own, "specularTexture").value || gltf_key(&own, "specularColorTexture").value)
        gltf_note(&s->notes[FEATURE_SPECULAR_MAP], s->material);
    if (factor <= 0.0 && m->metallic <= 0.0f) {
        m->kind = MATERIAL_LAMBERT;
        m->specular = vec3_make(0.0f, 0.0f, 0.0f);
    }
    return ERR_OK;
}

/* KHR_materials_diffuse_transmission. */
static enum err read_diffuse_transmission(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                                          struct gltf_surface *surface)
{
    const struct gltf_at own = gltf_extension(at, "KHR_materials_diffuse_transmission");
    const struct gltf_at texture = gltf_key(&own, "diffuseTransmissionColorTexture");

    m->through_texture = MATERIAL_NO_TEXTURE;
    if (!own.value || !material_has_finish(m))
        return ERR_OK;
    enum err e = gltf_share(s, &own, "diffuseTransmissionFactor", 0.0, &m->transmits);
    if (!e)
        e = gltf_colour(s, &own, "diffuseTransmissionColorFactor", 3, 1.0, &m->through);
    if (gltf_key(&own, "diffuseTransmissionTexture").value)
        gltf_note(&s->notes[FEATURE_SPECULAR_MAP], s->material);
    if (e || !texture.value || !(m->transmits > 0.0f))
        return e;
    struct gltf_surface place;
    e = gltf_texture_colours(&s->images, &texture, TEXTURE_SRGB, &m->through_texture, &place);
    if (!e && m->through_texture != MATERIAL_NO_TEXTURE)
        (void)gltf_place_texture(s, m, MAP_THROUGH, surface, &place);
    else
        m->through = vec3_scale(m->through, GREY);
    return e;
}

/* Whether light that passes would be spread more than not: by the roughness, with the mean of its texture. */
static enum err is_frosted(struct gltf_source *s, const struct gltf_at *texture, const struct material *m, bool *out)
{
    struct gltf_numbers t = { .found = false };

    const enum err e =
        texture->value ? gltf_texture_numbers(&s->images, texture, GREEN | BLUE, ROUGHNESS_ALONE, &t) : ERR_OK;
    *out = m->roughness * (t.found ? t.mean[1] : 1.0f) > FROSTED;
    return e;
}

/* KHR_materials_transmission of what does not become glass. Frosted glass transmits diffusely, in the base colour.
 * Where less than half passes, as much of the surface becomes a hole. */
static void approximate_transmission(struct gltf_source *s, float transmission, bool frosted, struct material *m)
{
    if (frosted && !(m->transmits > 0.0f)) {
        gltf_note(&s->notes[FEATURE_ROUGH_GLASS], s->material);
        m->transmits = transmission;
        m->through = m->diffuse;
        m->through_texture = m->texture;
    } else if (!frosted && m->alpha_mode != ALPHA_MASK) {
        if (m->alpha_mode == ALPHA_OPAQUE)
            m->alpha_texture = MATERIAL_NO_TEXTURE;
        m->alpha = (m->alpha_mode == ALPHA_BLEND ? m->alpha : 1.0f) * (1.0f - transmission);
        m->alpha_mode = ALPHA_BLEND;
    }
}

static enum err read_surface(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                             struct gltf_surface *surface)
{
    const struct gltf_at pbr = gltf_key(at, "pbrMetallicRoughness");

    enum err e = gltf_colour(s, &pbr, "baseColorFactor", 4, 1.0, &m->diffuse);
    if (!e)
        e = gltf_share(s, &pbr, "metallicFactor", 1.0, &m->metallic);
    if (!e)
        e = gltf_share(s, &pbr, "roughnessFactor", 1.0, &m->roughness);
    if (!e)
        e = gltf_read_base_texture(s, &pbr, "baseColorTexture", m, surface);
    if (gltf_extension(at, "KHR_materials_unlit").value) {
        m->kind = MATERIAL_LAMBERT;
        gltf_note(&s->unlit, s->material);
    }
    return e;
}

/* surface[2]: for the material's meshes. */
static enum err add_material(struct gltf_source *s, const struct gltf_at *at, struct gltf_surface *surface)
{
    struct material m = { .kind = MATERIAL_GGX,
                          .texture = MATERIAL_NO_TEXTURE,
                          .emission_texture = MATERIAL_NO_TEXTURE,
                          .alpha_mode = alpha_mode(at),
                          .alpha_texture = MATERIAL_NO_TEXTURE };
    const struct gltf_at pbr = gltf_key(at, "pbrMetallicRoughness");
    const struct gltf_at roughness = gltf_key(&pbr, "metallicRoughnessTexture");
    const struct gltf_at normal = gltf_key(at, "normalTexture");
    const struct gltf_at glossy = gltf_extension(at, "KHR_materials_pbrSpecularGlossiness");
    const struct gltf_at glass = gltf_extension(at, "KHR_materials_transmission");
    const char *name = gltf_string(at, "name");
    float transmission = 0.0f;
    bool frosted = false;

    surface[0] = surface[1] = (struct gltf_surface){ .uv_set = GLTF_NONE };
    snprintf(m.name, sizeof(m.name), "%.63s", name ? name : "");
    enum err e = glossy.value ? gltf_read_glossy(s, &glossy, &m, surface) : read_surface(s, at, &m, surface);
    if (!e)
        e = glossy.value ? read_alpha(s, at, &glossy, "diffuseFactor", &m)
                         : read_alpha(s, at, &pbr, "baseColorFactor", &m);
    if (!e)
        e = gltf_share(s, &glass, "transmissionFactor", 0.0, &transmission);
    if (e)
        return e;
    /* Light that passes takes the base colour: where that is black, there is a black surface with reflections. */
    if (largest(m.diffuse) < BLACK)
        transmission = 0.0f;
    if (transmission > 0.0f && gltf_key(&glass, "transmissionTexture").value)
        gltf_note(&s->notes[FEATURE_SPECULAR_MAP], s->material);
    if (transmission > 0.0f && transmission < 1.0f)
        gltf_note(&s->notes[FEATURE_PARTIAL_GLASS], s->material);
    if (transmission > 0.0f)
        e = is_frosted(s, &roughness, &m, &frosted);
    if (!e && transmission >= 0.5f && !frosted)
        e = read_glass(s, at, &m);
    if (m.texture == MATERIAL_NO_TEXTURE && (m.alpha_mode == ALPHA_OPAQUE || m.alpha_texture == MATERIAL_NO_TEXTURE))
        surface->uv_set = GLTF_NONE;
    const bool unlit = m.kind == MATERIAL_LAMBERT;
    if (!e)
        e = read_diffuse_transmission(s, at, &m, surface);
    if (!e && transmission > 0.0f && material_has_finish(&m))
        approximate_transmission(s, transmission, frosted, &m);
    if (!e && !glossy.value && material_has_finish(&m))
        e = read_specular(s, at, &m);
    if (!e && !glossy.value)
        e = read_roughness_texture(s, &roughness, &m, surface);
    if (!e && !unlit)
        e = read_normal_texture(s, &normal, &m, surface);
    if (!e && !unlit)
        e = gltf_read_coat(s, at, &m, surface);
    if (m.kind == MATERIAL_GLASS && m.roughness > 0.03f)
        gltf_note(&s->notes[FEATURE_ROUGH_GLASS], s->material);
    if (!e &&
        !unlit) /* of unlit materials the base colour alone counts; emission is for viewers without the extension */
        e = read_emission(s, at, &m, surface);
    if (!e && !unlit)
        e = gltf_read_sheen(s, at, &m, surface);
    return e ? e : scene_add_material(s->g->scene, &m, NULL);
}

/* A feature is named once per scene, as the statistics count it. */
static void name_notes(const struct gltf_source *s)
{
    struct scene *scene = s->g->scene;

    gltf_warn_of(s->g, GLTF_MATERIALS, &s->unlit, "unlit: approximated by a matte surface");
    for (int i = 0; i < FEATURE_COUNT; i++) {
        const uint32_t bit = UINT32_C(1) << i;
        if (s->notes[i].count == 0)
            continue;
        if (!(scene->unmodelled & bit))
            gltf_warn_of(s->g, GLTF_MATERIALS, &s->notes[i], "not supported: %s",
                         scene_feature_name((enum scene_feature)i));
        scene->unmodelled |= bit;
    }
}

enum err gltf_add_materials(struct gltf *g)
{
    struct gltf_source s = { .g = g, .images.g = g };

    g->first_material = (uint32_t)g->scene->material_count;
    g->surfaces = mem_alloc(g->counts[GLTF_MATERIALS], sizeof(*g->surfaces));
    enum err e = g->surfaces ? ERR_OK : ERR_NOMEM;
    for (size_t i = 0; i < g->counts[GLTF_MATERIALS] && !e; i++) {
        const struct gltf_at at = gltf_element(g, GLTF_MATERIALS, i);
        s.material = i;
        e = add_material(&s, &at, g->surfaces[i]);
    }
    if (!e)
        name_notes(&s);
    mem_free(s.images.known);
    mem_free(s.glossy);
    return e;
}

/* glTF's default: a rough white metal. */
enum err gltf_plain_material(struct gltf *g, uint32_t *out)
{
    const struct material m = { .name = "default",
                                .kind = MATERIAL_GGX,
                                .diffuse = { 1.0f, 1.0f, 1.0f },
                                .metallic = 1.0f,
                                .roughness = 1.0f,
                                .texture = MATERIAL_NO_TEXTURE };

    const enum err e = g->plain != MATERIAL_NONE ? ERR_OK : scene_add_material(g->scene, &m, &g->plain);
    *out = g->plain;
    return e;
}
