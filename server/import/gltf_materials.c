/* Materials of glTF: metallic-roughness becomes `ggx`, transmission becomes `glass`. */
#include "import/gltf.h"

#include "base/mem.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define GREY 0.5f   /* in place of a texture that cannot be opened */
#define BLACK 1e-3f /* a colour below is none */

#define KTX_ADVICE                                                                                                     \
    "is KTX2 (KHR_texture_basisu), which is not supported; convert it to PNG, for instance with "                      \
    "'gltf-transform ktxdecompress IN OUT'"

/* How a material uses an image. */
struct use {
    size_t image;
    enum texture_values values;
    enum texture_wrap wrap_u, wrap_v;
};

/* An image that has been read for a use. */
struct known {
    struct use use;
    bool missing;
    uint32_t texture;  /* of the scene; MATERIAL_NO_TEXTURE: missing, or only the means were needed */
    float green, blue; /* means of TEXTURE_LINEAR */
};

struct source {
    struct gltf *g;
    struct known *known; /* each image is read once per use */
    size_t count, room;
    bool unlit; /* has been named */
};

static float share(double v)
{
    return (float)fmin(fmax(v, 0.0), 1.0);
}

static enum err get_share(struct source *s, const struct gltf_at *at, const char *key, double fallback, float *out)
{
    double v = fallback;
    const enum err e = gltf_number(s->g, at, key, &v);

    *out = share(v);
    return e;
}

/* A colour whose first three of `count` numbers matter. */
static enum err get_colour(struct source *s, const struct gltf_at *at, const char *key, size_t count, double fallback,
                           struct vec3 *out)
{
    double c[4] = { fallback, fallback, fallback };
    const enum err e = gltf_numbers(s->g, at, key, count, c);

    *out = vec3_make(share(c[0]), share(c[1]), share(c[2]));
    return e;
}

static float largest(struct vec3 v)
{
    return fmaxf(v.x, fmaxf(v.y, v.z));
}

/* ---- Images ---- */

static enum err decode_view(struct source *s, const struct gltf_at *at, size_t view, enum texture_values values,
                            struct texture *out)
{
    struct gltf_view bytes = { 0 };
    char label[HOST_PATH_MAX];

    const enum err e = gltf_view_bytes(s->g, view, &bytes);
    if (e)
        return e;
    snprintf(label, sizeof(label), "%.4000s: images[%zu]", s->g->desc->path, at->index);
    return texture_decode(bytes.at, bytes.size, values, label, out, s->g->why);
}

static enum err decode_data(struct source *s, const struct gltf_at *at, const char *uri, enum texture_values values,
                            struct texture *out)
{
    struct bytes bytes;
    char label[HOST_PATH_MAX];

    enum err e = gltf_uri_decode(s->g, at, uri, &bytes);
    if (e)
        return e;
    snprintf(label, sizeof(label), "%.4000s: images[%zu]", s->g->desc->path, at->above->index);
    e = texture_decode(bytes.at, bytes.size, values, label, out, s->g->why);
    bytes_finish(&bytes);
    return e;
}

static bool is_known_missing(const struct source *s, size_t image)
{
    for (size_t i = 0; i < s->count; i++) {
        if (s->known[i].use.image == image && s->known[i].missing)
            return true;
    }
    return false;
}

/* An image that cannot be opened costs a warning, and *out stays empty. */
static enum err load_file(struct source *s, const struct gltf_at *at, const char *uri, enum texture_values values,
                          struct texture *out)
{
    struct reason cause = { "" };
    char path[HOST_PATH_MAX];

    enum err e = gltf_uri_path(s->g, at, uri, path);
    if (e)
        return e;
    e = texture_load(s->g->desc->host, path, values, out, &cause);
    if (e && e != ERR_IO)
        return err_say(s->g->why, e, "%s", cause.text);
    if (e && !is_known_missing(s, at->above->index))
        gltf_warn(s->g, at, "%s; the surfaces are grey instead", cause.text);
    return ERR_OK;
}

static enum err read_image(struct source *s, size_t index, enum texture_values values, struct texture *out)
{
    const struct gltf_at at = gltf_element(s->g, GLTF_IMAGES, index), uri = gltf_key(&at, "uri");
    const char *text = json_string_value(uri.value);
    size_t view;

    *out = (struct texture){ 0 };
    enum err e = gltf_index(s->g, &at, "bufferView", GLTF_BUFFER_VIEWS, &view);
    if (e)
        return e;
    if (view != GLTF_NONE)
        return decode_view(s, &at, view, values, out);
    if (!text)
        return gltf_fault(s->g, &at, ERR_FORMAT, "has neither a uri nor a bufferView");
    return gltf_uri_is_data(text) ? decode_data(s, &uri, text, values, out) : load_file(s, &uri, text, values, out);
}

enum { WRAP_CLAMP = 33071, WRAP_MIRROR = 33648, WRAP_REPEAT = 10497 }; /* the values of the file */

static enum err read_wrap(struct source *s, const struct gltf_at *sampler, const char *key, enum texture_wrap *out)
{
    size_t wrap;
    const enum err e = gltf_size(s->g, sampler, key, WRAP_REPEAT, &wrap);

    *out = wrap == WRAP_CLAMP ? TEXTURE_CLAMP : wrap == WRAP_MIRROR ? TEXTURE_MIRROR : TEXTURE_REPEAT;
    return e;
}

/* The texture that `at`.index names; use->image is GLTF_NONE if it has no image that can be read. */
static enum err find_image(struct source *s, const struct gltf_at *at, struct use *use)
{
    size_t texture, sampler = GLTF_NONE;

    use->image = GLTF_NONE;
    enum err e = gltf_index(s->g, at, "index", GLTF_TEXTURES, &texture);
    if (!e && texture == GLTF_NONE)
        return gltf_fault(s->g, at, ERR_FORMAT, "has no index");
    if (e)
        return e;
    const struct gltf_at t = gltf_element(s->g, GLTF_TEXTURES, texture);
    e = gltf_index(s->g, &t, "sampler", GLTF_SAMPLERS, &sampler);
    if (!e && sampler != GLTF_NONE) {
        const struct gltf_at how = gltf_element(s->g, GLTF_SAMPLERS, sampler);
        e = read_wrap(s, &how, "wrapS", &use->wrap_u);
        if (!e)
            e = read_wrap(s, &how, "wrapT", &use->wrap_v);
    }
    const struct gltf_at webp = gltf_extension(&t, "EXT_texture_webp");
    if (!e)
        e = gltf_index(s->g, &webp, "source", GLTF_IMAGES, &use->image);
    if (!e && use->image == GLTF_NONE)
        e = gltf_index(s->g, &t, "source", GLTF_IMAGES, &use->image);
    if (!e && use->image == GLTF_NONE)
        gltf_warn(s->g, &t, "%s; the surfaces are grey instead",
                  gltf_extension(&t, "KHR_texture_basisu").value ? KTX_ADVICE : "has no source");
    return e;
}

/* ---- Textures of a material ---- */

/* The mean of a channel, 0..1. */
static float channel_mean(const struct texture *t, size_t channel)
{
    const size_t count = (size_t)t->width * t->height;
    uint64_t sum = 0;

    for (size_t i = 0; i < count; i++)
        sum += t->texels[4 * i + channel];
    return (float)((double)sum / (255.0 * (double)count));
}

/* Colours go to the scene, of numbers only the means are kept. Takes over *t unless it fails. */
static enum err remember(struct source *s, const struct use *use, struct texture *t)
{
    if (!mem_reserve(&s->known, s->count, &s->room, sizeof(*s->known)))
        return ERR_NOMEM;
    struct known *k = &s->known[s->count];
    *k = (struct known){ .use = *use, .missing = !t->texels, .texture = MATERIAL_NO_TEXTURE, .green = 1, .blue = 1 };
    t->wrap_u = use->wrap_u;
    t->wrap_v = use->wrap_v;
    if (t->texels && use->values == TEXTURE_LINEAR) {
        k->green = channel_mean(t, 1);
        k->blue = channel_mean(t, 2);
        texture_finish(t);
    } else if (t->texels) {
        const enum err e = scene_add_texture(s->g->scene, t, &k->texture);
        if (e)
            return e;
    }
    s->count++;
    return ERR_OK;
}

static bool same_use(const struct use *a, const struct use *b)
{
    return a->image == b->image && a->values == b->values && a->wrap_u == b->wrap_u && a->wrap_v == b->wrap_v;
}

/* *out stays valid until the next call. */
static enum err know_image(struct source *s, const struct use *use, const struct known **out)
{
    struct texture t;

    for (size_t i = 0; i < s->count; i++) {
        *out = &s->known[i];
        if (same_use(&s->known[i].use, use))
            return ERR_OK;
    }
    enum err e = read_image(s, use->image, use->values, &t);
    if (!e)
        e = remember(s, use, &t);
    if (e)
        texture_finish(&t);
    else
        *out = &s->known[s->count - 1];
    return e;
}

/* KHR_texture_transform: scale, then rotation, then offset; all in coordinates whose v points down. */
static enum err read_transform(struct source *s, const struct gltf_at *at, struct gltf_surface *surface)
{
    const struct gltf_at t = gltf_extension(at, "KHR_texture_transform");
    double offset[2] = { 0.0 }, scale[2] = { 1.0, 1.0 }, angle = 0.0;

    enum err e = gltf_size(s->g, at, "texCoord", 0, &surface->uv_set);
    if (!e)
        e = gltf_numbers(s->g, &t, "offset", 2, offset);
    if (!e)
        e = gltf_numbers(s->g, &t, "scale", 2, scale);
    if (!e)
        e = gltf_number(s->g, &t, "rotation", &angle);
    if (!e)
        e = gltf_size(s->g, &t, "texCoord", surface->uv_set, &surface->uv_set);
    const double c = cos(angle), r = sin(angle);
    const double transform[6] = { c * scale[0], r * scale[1], offset[0], -r * scale[0], c * scale[1], offset[1] };
    memcpy(surface->transform, transform, sizeof(transform));
    return e;
}

/* A texture of colours; *index is MATERIAL_NO_TEXTURE if it cannot be read. */
static enum err read_colours(struct source *s, const struct gltf_at *at, enum texture_values values, uint32_t *index,
                             struct gltf_surface *surface)
{
    const struct known *known = NULL;
    struct use use = { .values = values };

    *index = MATERIAL_NO_TEXTURE;
    enum err e = find_image(s, at, &use);
    if (!e && use.image != GLTF_NONE)
        e = know_image(s, &use, &known);
    if (e)
        return e;
    if (known)
        *index = known->texture;
    return *index != MATERIAL_NO_TEXTURE ? read_transform(s, at, surface) : ERR_OK;
}

static enum err read_base_texture(struct source *s, const struct gltf_at *above, const char *key, struct material *m,
                                  struct gltf_surface *surface)
{
    const struct gltf_at at = gltf_key(above, key);

    if (!at.value)
        return ERR_OK;
    const enum err e =
        read_colours(s, &at, m->alpha_mode == ALPHA_OPAQUE ? TEXTURE_SRGB : TEXTURE_CUTOUT, &m->texture, surface);
    m->alpha_texture = m->texture;
    if (!e && m->texture == MATERIAL_NO_TEXTURE)
        m->diffuse = vec3_scale(m->diffuse, GREY);
    return e;
}

/* An emissive texture has the coordinates of the base colour's; one that cannot be read emits nothing. */
static enum err read_emissive_texture(struct source *s, const struct gltf_at *at, struct material *m,
                                      struct gltf_surface *surface)
{
    struct gltf_surface own = *surface;

    const enum err e = read_colours(s, at, TEXTURE_SRGB, &m->emission_texture, &own);
    if (e)
        return e;
    if (m->emission_texture == MATERIAL_NO_TEXTURE)
        m->emission = vec3_make(0.0f, 0.0f, 0.0f);
    else if (surface->uv_set == GLTF_NONE)
        *surface = own;
    else if (surface->uv_set != own.uv_set || memcmp(surface->transform, own.transform, sizeof(own.transform)) != 0)
        scene_note_unmodelled(s->g->scene, FEATURE_TEXTURE_TRANSFORM, s->g->desc->path);
    return ERR_OK;
}

static enum err read_emission(struct source *s, const struct gltf_at *at, struct material *m,
                              struct gltf_surface *surface)
{
    const struct gltf_at extension = gltf_extension(at, "KHR_materials_emissive_strength");
    const struct gltf_at texture = gltf_key(at, "emissiveTexture");
    struct vec3 factor;
    double strength = 1.0;

    enum err e = get_colour(s, at, "emissiveFactor", 3, 0.0, &factor);
    if (!e)
        e = gltf_number(s->g, &extension, "emissiveStrength", &strength);
    gltf_set_emission(m, factor, strength);
    if (e || !texture.value || !(largest(m->emission) > 0.0f))
        return e;
    return read_emissive_texture(s, &texture, m, surface);
}

/* Metallic and roughness vary over the surface if they have a texture (blue and green channels); their means are used.
 */
static enum err read_metallic_roughness(struct source *s, const struct gltf_at *pbr, struct material *m)
{
    const struct gltf_at at = gltf_key(pbr, "metallicRoughnessTexture");
    const struct known *known = NULL;
    struct use use = { .values = TEXTURE_LINEAR };

    enum err e = get_share(s, pbr, "metallicFactor", 1.0, &m->metallic);
    if (!e)
        e = get_share(s, pbr, "roughnessFactor", 1.0, &m->roughness);
    if (e || !at.value)
        return e;
    scene_note_unmodelled(s->g->scene, FEATURE_ROUGHNESS_MAP, s->g->desc->path);
    e = find_image(s, &at, &use);
    use.wrap_u = use.wrap_v = TEXTURE_REPEAT; /* a mean does not depend on them */
    if (e || use.image == GLTF_NONE)
        return e;
    e = know_image(s, &use, &known);
    if (e)
        return e;
    m->roughness *= known->green;
    m->metallic *= known->blue;
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
static enum err read_alpha(struct source *s, const struct gltf_at *at, const struct gltf_at *colour, const char *key,
                           struct material *m)
{
    double factor[4] = { 1.0, 1.0, 1.0, 1.0 }, cutoff = 0.5;

    enum err e = gltf_numbers(s->g, colour, key, 4, factor);
    if (!e)
        e = gltf_number(s->g, at, "alphaCutoff", &cutoff);
    m->alpha = share(factor[3]);
    m->alpha_cutoff = (float)fmin(fmax(cutoff, 0.0), 2.0); /* above 1 nothing is left */
    return e;
}

static enum err read_glass(struct source *s, const struct gltf_at *at, struct material *m)
{
    const struct gltf_at extension = gltf_extension(at, "KHR_materials_ior");
    const struct vec3 c = m->diffuse;
    double ior = 1.5;

    const enum err e = gltf_number(s->g, &extension, "ior", &ior);
    m->kind = MATERIAL_GLASS;
    m->ior = (float)fmin(fmax(ior, 1.0), 4.0);
    if (m->roughness > 0.03f)
        scene_note_unmodelled(s->g->scene, FEATURE_ROUGH_GLASS, s->g->desc->path);
    if (c.x < 1.0f || c.y < 1.0f || c.z < 1.0f || m->texture != MATERIAL_NO_TEXTURE)
        scene_note_unmodelled(s->g->scene, FEATURE_TINTED_GLASS, s->g->desc->path);
    m->diffuse = vec3_make(1.0f, 1.0f, 1.0f);
    m->texture = MATERIAL_NO_TEXTURE;
    if (m->alpha_mode == ALPHA_BLEND) /* many exporters blend glass for viewers that cannot refract */
        m->alpha_mode = ALPHA_OPAQUE;
    return e;
}

/* The features of extensions. */
static enum err note_extensions(struct source *s, const struct gltf_at *at)
{
    const struct gltf_at volume = gltf_extension(at, "KHR_materials_volume");
    const struct gltf_at coat = gltf_extension(at, "KHR_materials_clearcoat");
    const struct gltf_at sheen = gltf_extension(at, "KHR_materials_sheen");
    struct vec3 sheen_colour;
    double thickness = 0.0;
    float coat_share = 0.0f;

    enum err e = gltf_number(s->g, &volume, "thicknessFactor", &thickness);
    if (!e)
        e = get_share(s, &coat, "clearcoatFactor", 0.0, &coat_share);
    if (!e)
        e = get_colour(s, &sheen, "sheenColorFactor", 3, 0.0, &sheen_colour);
    if (e)
        return e;
    if (thickness > 0.0)
        scene_note_unmodelled(s->g->scene, FEATURE_VOLUME, s->g->desc->path);
    if (coat_share > 0.0f || largest(sheen_colour) > 0.0f)
        scene_note_unmodelled(s->g->scene, FEATURE_CLEARCOAT, s->g->desc->path);
    return ERR_OK;
}

static enum err note_extras(struct source *s, const struct gltf_at *at)
{
    if (gltf_key(at, "normalTexture").value)
        scene_note_unmodelled(s->g->scene, FEATURE_NORMAL_MAP, s->g->desc->path);
    return note_extensions(s, at);
}

static enum err read_surface(struct source *s, const struct gltf_at *at, struct material *m,
                             struct gltf_surface *surface)
{
    const struct gltf_at pbr = gltf_key(at, "pbrMetallicRoughness");

    enum err e = get_colour(s, &pbr, "baseColorFactor", 4, 1.0, &m->diffuse);
    if (!e)
        e = read_metallic_roughness(s, &pbr, m);
    if (!e)
        e = read_base_texture(s, &pbr, "baseColorTexture", m, surface);
    if (gltf_extension(at, "KHR_materials_unlit").value) {
        m->kind = MATERIAL_LAMBERT;
        if (!s->unlit)
            gltf_warn(s->g, at, "is unlit: approximated by a matte surface");
        s->unlit = true;
    }
    return e;
}

/* A material of KHR_materials_pbrSpecularGlossiness: a metal where the diffuse colour is black, else a dielectric. */
static enum err read_specular_glossiness(struct source *s, const struct gltf_at *at, struct material *m,
                                         struct gltf_surface *surface)
{
    struct vec3 specular;
    float glossiness;

    scene_note_unmodelled(s->g->scene, FEATURE_SPECULAR_GLOSSINESS, s->g->desc->path);
    enum err e = get_colour(s, at, "diffuseFactor", 4, 1.0, &m->diffuse);
    if (!e)
        e = get_colour(s, at, "specularFactor", 3, 1.0, &specular);
    if (!e)
        e = get_share(s, at, "glossinessFactor", 1.0, &glossiness);
    if (e)
        return e;
    m->metallic = largest(m->diffuse) < BLACK ? 1.0f : 0.0f;
    m->roughness = 1.0f - glossiness;
    if (m->metallic > 0.0f)
        m->diffuse = specular;
    return read_base_texture(s, at, "diffuseTexture", m, surface);
}

static enum err add_material(struct source *s, const struct gltf_at *at, struct gltf_surface *surface)
{
    struct material m = { .kind = MATERIAL_GGX,
                          .texture = MATERIAL_NO_TEXTURE,
                          .emission_texture = MATERIAL_NO_TEXTURE,
                          .alpha_mode = alpha_mode(at),
                          .alpha_texture = MATERIAL_NO_TEXTURE };
    const struct gltf_at pbr = gltf_key(at, "pbrMetallicRoughness");
    const struct gltf_at glossy = gltf_extension(at, "KHR_materials_pbrSpecularGlossiness");
    const struct gltf_at glass = gltf_extension(at, "KHR_materials_transmission");
    const char *name = gltf_string(at, "name");
    float transmission = 0.0f;

    *surface = (struct gltf_surface){ .uv_set = GLTF_NONE };
    snprintf(m.name, sizeof(m.name), "%.63s", name ? name : "");
    enum err e = glossy.value ? read_specular_glossiness(s, &glossy, &m, surface) : read_surface(s, at, &m, surface);
    if (!e)
        e = glossy.value ? read_alpha(s, at, &glossy, "diffuseFactor", &m)
                         : read_alpha(s, at, &pbr, "baseColorFactor", &m);
    if (!e)
        e = get_share(s, &glass, "transmissionFactor", 0.0, &transmission);
    if (e)
        return e;
    if (transmission > 0.0f && transmission < 1.0f)
        scene_note_unmodelled(s->g->scene, FEATURE_PARTIAL_GLASS, s->g->desc->path);
    if (transmission >= 0.5f)
        e = read_glass(s, at, &m);
    if (m.texture == MATERIAL_NO_TEXTURE && (m.alpha_mode == ALPHA_OPAQUE || m.alpha_texture == MATERIAL_NO_TEXTURE))
        surface->uv_set = GLTF_NONE;
    if (!e)
        e = read_emission(s, at, &m, surface);
    if (!e)
        e = note_extras(s, at);
    return e ? e : scene_add_material(s->g->scene, &m, NULL);
}

enum err gltf_add_materials(struct gltf *g)
{
    struct source s = { .g = g };

    g->first_material = (uint32_t)g->scene->material_count;
    g->surfaces = mem_alloc(g->counts[GLTF_MATERIALS], sizeof(*g->surfaces));
    enum err e = g->surfaces ? ERR_OK : ERR_NOMEM;
    for (size_t i = 0; i < g->counts[GLTF_MATERIALS] && !e; i++) {
        const struct gltf_at at = gltf_element(g, GLTF_MATERIALS, i);
        e = add_material(&s, &at, &g->surfaces[i]);
    }
    mem_free(s.known);
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
