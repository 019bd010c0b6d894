/* Images of glTF as textures of the scene. */
#include "import/formats/gltf.h"

#include "base/mem.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define KTX_ADVICE                                                                                                     \
    "is KTX2 (KHR_texture_basisu), which is not supported; convert it to PNG, for instance with "                      \
    "'gltf-transform ktxdecompress IN OUT'"

enum { ALPHA = 8 }; /* alone, of `channels` */

/* How a material uses an image. */
struct use {
    size_t image;
    enum texture_values values;
    unsigned channels; /* of TEXTURE_LINEAR: those that count, bit 0 for red */
    enum texture_wrap wrap_u, wrap_v;
    const char *instead; /* what happens without it, for the warning */
};

/* An image that has been read for a use. */
struct gltf_known_image {
    struct use use;
    bool missing;
    uint32_t texture; /* of the scene; MATERIAL_NO_TEXTURE: missing, or uniform */
    bool uniform;     /* of TEXTURE_LINEAR: the channels that count are the same everywhere */
    float mean[4];    /* of TEXTURE_LINEAR, 0..1 */
};

static bool is_known_missing(const struct gltf_images *s, size_t image)
{
    for (size_t i = 0; i < s->count; i++) {
        if (s->known[i].use.image == image && s->known[i].missing)
            return true;
    }
    return false;
}

/* An image that cannot be read costs a warning, as in all formats, and *out stays empty. */
static enum err excuse(struct gltf_images *s, const struct gltf_at *at, size_t image, enum err e,
                       const struct reason *cause, const char *instead)
{
    if (e == ERR_NOMEM)
        return e;
    if (e && !is_known_missing(s, image))
        gltf_warn(s->g, at, "%s; %s instead", cause->text, instead);
    return ERR_OK;
}

static enum err decode_view(struct gltf_images *s, const struct gltf_at *at, size_t view, const struct use *use,
                            struct texture *out)
{
    struct gltf_view bytes = { 0 };
    struct reason cause = { "" };

    enum err e = gltf_view_bytes(s->g, view, &bytes);
    if (e)
        return e;
    e = texture_decode(bytes.at, bytes.size, use->values, "its image", out, &cause);
    return excuse(s, at, at->index, e, &cause, use->instead);
}

static enum err decode_data(struct gltf_images *s, const struct gltf_at *at, const char *uri, const struct use *use,
                            struct texture *out)
{
    struct reason cause = { "" };
    struct bytes bytes;

    enum err e = gltf_uri_decode(s->g, at, uri, &bytes);
    if (e)
        return e;
    e = texture_decode(bytes.at, bytes.size, use->values, "its image", out, &cause);
    bytes_finish(&bytes);
    return excuse(s, at, at->above->index, e, &cause, use->instead);
}

static enum err load_file(struct gltf_images *s, const struct gltf_at *at, const char *uri, const struct use *use,
                          struct texture *out)
{
    struct reason cause = { "" };
    char path[HOST_PATH_MAX];
    enum err e;

    if (strstr(uri, "://"))
        e = err_say(&cause, ERR_UNSUPPORTED, "'%.100s' is on a server; only files are read", uri);
    else
        e = gltf_uri_path(s->g, at, uri, path);
    if (e && !cause.text[0])
        return e;
    if (!e)
        e = texture_load(s->g->desc->host, path, use->values, out, &cause);
    return excuse(s, at, at->above->index, e, &cause, use->instead);
}

static enum err read_image(struct gltf_images *s, const struct use *use, struct texture *out)
{
    const struct gltf_at at = gltf_element(s->g, GLTF_IMAGES, use->image), uri = gltf_key(&at, "uri");
    const char *text = json_string_value(uri.value);
    size_t view;

    *out = (struct texture){ 0 };
    enum err e = gltf_index(s->g, &at, "bufferView", GLTF_BUFFER_VIEWS, &view);
    if (e)
        return e;
    if (view != GLTF_NONE)
        return decode_view(s, &at, view, use, out);
    if (!text)
        return gltf_fault(s->g, &at, ERR_FORMAT, "has neither a uri nor a bufferView");
    return gltf_uri_is_data(text) ? decode_data(s, &uri, text, use, out) : load_file(s, &uri, text, use, out);
}

enum { WRAP_CLAMP = 33071, WRAP_MIRROR = 33648, WRAP_REPEAT = 10497 }; /* the values of the file */

static enum err read_wrap(struct gltf_images *s, const struct gltf_at *sampler, const char *key, enum texture_wrap *out)
{
    size_t wrap;
    const enum err e = gltf_size(s->g, sampler, key, WRAP_REPEAT, &wrap);

    *out = wrap == WRAP_CLAMP ? TEXTURE_CLAMP : wrap == WRAP_MIRROR ? TEXTURE_MIRROR : TEXTURE_REPEAT;
    return e;
}

/* The texture that `at`.index names; use->image is GLTF_NONE if it has no image that can be read. */
static enum err find_image(struct gltf_images *s, const struct gltf_at *at, struct use *use)
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
        gltf_warn(s->g, &t, "%s; %s instead",
                  gltf_extension(&t, "KHR_texture_basisu").value ? KTX_ADVICE : "has no source", use->instead);
    return e;
}

/* The means of the channels, and whether those that count are the same everywhere. */
static void measure(const struct texture *t, unsigned channels, struct gltf_known_image *out)
{
    const size_t count = (size_t)t->width * t->height;
    uint64_t sum[4] = { 0 };

    out->uniform = channels != 0;
    for (size_t i = 0; i < count; i++) {
        for (unsigned k = 0; k < 4; k++) {
            sum[k] += t->texels[4 * i + k];
            out->uniform &= !(channels >> k & 1u) || t->texels[4 * i + k] == t->texels[k];
        }
    }
    for (int k = 0; k < 4; k++)
        out->mean[k] = (float)((double)sum[k] / (255.0 * (double)count));
}

/* Alpha instead of the colours, which lookups do not return it with. */
static void spread_alpha(struct texture *t)
{
    const uint64_t count = texture_texel_count(t->width, t->height);

    for (uint64_t i = 0; i < count; i++)
        memset(t->texels + 4 * i, t->texels[4 * i + 3], 3);
}

/* Takes over *t unless it fails. */
static enum err remember(struct gltf_images *s, const struct use *use, struct texture *t)
{
    enum err e = ERR_OK;

    if (!mem_reserve(&s->known, s->count, &s->room, sizeof(*s->known)))
        return ERR_NOMEM;
    struct gltf_known_image *k = &s->known[s->count];
    *k = (struct gltf_known_image){ .use = *use, .missing = !t->texels, .texture = MATERIAL_NO_TEXTURE };
    t->wrap_u = use->wrap_u;
    t->wrap_v = use->wrap_v;
    if (t->texels && use->channels == ALPHA)
        spread_alpha(t);
    if (t->texels && use->values == TEXTURE_LINEAR)
        measure(t, use->channels, k);
    if (k->uniform)
        texture_finish(t);
    else if (t->texels)
        e = scene_add_texture(s->g->scene, t, &k->texture);
    s->count += !e;
    return e;
}

static bool same_use(const struct use *a, const struct use *b)
{
    return a->image == b->image && a->values == b->values && a->channels == b->channels && a->wrap_u == b->wrap_u &&
           a->wrap_v == b->wrap_v;
}

/* *out stays valid until the next call. */
static enum err know_image(struct gltf_images *s, const struct use *use, const struct gltf_known_image **out)
{
    struct texture t;

    for (size_t i = 0; i < s->count; i++) {
        *out = &s->known[i];
        if (same_use(&s->known[i].use, use))
            return ERR_OK;
    }
    enum err e = read_image(s, use, &t);
    if (!e)
        e = remember(s, use, &t);
    if (e)
        texture_finish(&t);
    else
        *out = &s->known[s->count - 1];
    return e;
}

/* KHR_texture_transform: scale, then rotation, then offset; all in coordinates whose v points down. */
static enum err read_transform(struct gltf_images *s, const struct gltf_at *at, struct gltf_surface *surface)
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

enum err gltf_texture_colours(struct gltf_images *s, const struct gltf_at *at, enum texture_values values,
                              uint32_t *index, struct gltf_surface *surface)
{
    const struct gltf_known_image *known = NULL;
    struct use use = { .values = values, .instead = "the surfaces are grey" };

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

enum err gltf_texture_numbers(struct gltf_images *s, const struct gltf_at *at, unsigned channels, const char *instead,
                              struct gltf_numbers *out)
{
    const struct gltf_known_image *known = NULL;
    struct use use = { .values = TEXTURE_LINEAR, .channels = channels, .instead = instead };

    *out = (struct gltf_numbers){ .texture = MATERIAL_NO_TEXTURE };
    enum err e = find_image(s, at, &use);
    if (!e && use.image != GLTF_NONE)
        e = know_image(s, &use, &known);
    if (e || !known || known->missing)
        return e;
    out->found = true;
    out->texture = known->texture;
    memcpy(out->mean, known->mean, sizeof(out->mean));
    return read_transform(s, at, &out->surface);
}

enum err gltf_texture_image(struct gltf_images *s, const struct gltf_at *at, const char *instead,
                            struct gltf_image *out)
{
    struct use use = { .values = TEXTURE_CUTOUT, .instead = instead }; /* which keeps alpha */

    *out = (struct gltf_image){ .index = GLTF_NONE };
    enum err e = find_image(s, at, &use);
    if (!e)
        e = gltf_index(s->g, at, "index", GLTF_TEXTURES, &out->index);
    if (!e && use.image != GLTF_NONE)
        e = read_image(s, &use, &out->texture);
    out->wrap_u = use.wrap_u;
    out->wrap_v = use.wrap_v;
    return e || !out->texture.texels ? e : read_transform(s, at, &out->surface);
}
