/* --layers: the channels of a multi-layer EXR. What does not change from frame to frame is made once. */
#include "base/mem.h"
#include "image/codec/encode.h"
#include "light/frame/layers.h"
#include "programs/render/render.h"
#include "scene/geometry/view.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

#define MATTES 2 /* by object and by material */
#define RANKS 6  /* ids of a pixel, two to a layer of the file */
#define ATTRIBUTES (4 * MATTES)

static const char *const matte_names[MATTES] = { "CryptoObject", "CryptoMaterial" };

struct render_layers {
    struct layers light;
    struct first_hits *hits;
    float *albedo; /* [height][width][3] */
    float *lamps;  /* likewise; NULL: there are none */
    float *samples, *ones;
    float *matte[MATTES]; /* [height][width][2 * RANKS]: id and coverage in turn */
    float (*ids)[MATTES]; /* [mesh_count] */
    struct cryptomatte manifest[MATTES];

    struct exr_channel channels[EXR_CHANNELS_MAX];
    char names[EXR_CHANNELS_MAX][32];
    size_t count;
    struct exr_attribute attributes[ATTRIBUTES];
};

/* ---- Channels ---- */

/* Channels LAYER.x for each letter, or LAYER alone where there are none. */
static void add_channels(struct render_layers *l, const char *layer, const char *letters, const float *values,
                         uint32_t stride, bool full)
{
    const size_t count = letters[0] ? strlen(letters) : 1;

    for (size_t c = 0; c < count; c++, l->count++) {
        assert(l->count < EXR_CHANNELS_MAX);
        if (letters[0])
            snprintf(l->names[l->count], sizeof(l->names[0]), "%s.%c", layer, letters[c]);
        else
            snprintf(l->names[l->count], sizeof(l->names[0]), "%s", layer);
        l->channels[l->count] = (struct exr_channel){ l->names[l->count], values + c, stride, full };
    }
}

static void list_channels(struct render_layers *l, bool denoised)
{
    static const char *const lights[LAYER_ERROR] = { "direct", "indirect", "caustics", "background", "sun", "sky" };

    add_channels(l, "A", "", l->ones, 1, false);
    for (int k = 0; k < LAYER_ERROR; k++)
        add_channels(l, lights[k], "RGB", l->light.light[k], 3, false);
    if (l->lamps)
        add_channels(l, "lamps", "RGB", l->lamps, 3, false);
    if (denoised)
        add_channels(l, "unfiltered", "RGB", l->light.unfiltered, 3, false);
    add_channels(l, "albedo", "RGB", l->albedo, 3, false);
    add_channels(l, "N", "XYZ", l->hits->normal, 3, false);
    add_channels(l, "P", "XYZ", l->hits->position, 3, true);
    add_channels(l, "Z", "", l->hits->depth, 1, true);
    add_channels(l, "samples", "Y", l->samples, 1, false);
    add_channels(l, "error", "Y", l->light.light[LAYER_ERROR], 1, true);
    for (int m = 0; m < MATTES; m++)
        for (int pair = 0; pair < RANKS / 2; pair++) {
            char name[24];
            snprintf(name, sizeof(name), "%s%02d", matte_names[m], pair);
            add_channels(l, name, "RGBA", l->matte[m] + 4 * pair, 2 * RANKS, true);
        }
}

/* ---- What stays ---- */

/* Reflectance of what a pixel shows, also in mirrors and through glass. */
static void fill_albedo(struct render_layers *l, const struct gbuffer *g, uint32_t samples)
{
#pragma omp parallel for schedule(static)
    for (size_t pixel = 0; pixel < (size_t)g->width * g->height; pixel++) {
        l->ones[pixel] = 1.0f;
        l->samples[pixel] = (float)samples * (float)(g->entry_first[pixel + 1] - g->entry_first[pixel]);
        for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
            const struct shade_packet *p = &g->packets[g->entries[k].point / PACKET];
            const uint32_t lane = g->entries[k].point % PACKET;
            for (uint32_t c = 0; c < 3; c++) {
                const float albedo = p->diffuse[c][lane] + p->specular[c][lane];
                l->albedo[3 * pixel + c] += g->entries[k].weight[c] * (albedo < 1.0f ? albedo : 1.0f);
            }
        }
    }
}

/* Adds to a pixel's ids, which are in descending order of coverage at the end; what has no rank is left out. */
static void rank_pixel(const struct render_layers *l, const struct first_part *parts, uint32_t count, int m, float *out)
{
    struct {
        float id, share;
    } sum[64];
    uint32_t n = 0;

    for (uint32_t k = 0; k < count; k++) {
        const float id = l->ids[parts[k].mesh][m];
        uint32_t at = 0;
        while (at < n && sum[at].id != id)
            at++;
        if (at == n && n == sizeof(sum) / sizeof(sum[0]))
            continue;
        if (at == n) {
            sum[n].id = id;
            sum[n++].share = 0.0f;
        }
        sum[at].share += parts[k].share;
    }
    for (uint32_t rank = 0; rank < RANKS && rank < n; rank++) {
        uint32_t most = 0;
        for (uint32_t at = 1; at < n; at++)
            most = sum[at].share > sum[most].share ? at : most;
        out[2 * rank] = sum[most].id;
        out[2 * rank + 1] = sum[most].share;
        sum[most].share = -1.0f;
    }
}

/* The object's name; without one, the material's, else a number. */
static void name_mesh(const struct scene *s, size_t mesh, int m, char out[80])
{
    const struct mesh *at = &s->meshes[mesh];
    const char *material = s->materials[at->material].name;

    if (m == 0 && at->name[0])
        snprintf(out, 80, "%s", at->name);
    else if (material[0])
        snprintf(out, 80, "%s", material);
    else
        snprintf(out, 80, m == 0 ? "object %zu" : "material %zu", m == 0 ? mesh : (size_t)at->material);
}

static enum err make_matte(struct render_layers *l, const struct prepared_scene *set, int m)
{
    const struct gbuffer *g = set->gbuffer;
    const size_t meshes = set->scene->mesh_count;
    char(*text)[80] = mem_alloc(meshes + 1, sizeof(*text));
    const char **names = mem_alloc(meshes + 1, sizeof(*names));
    enum err e = text && names ? ERR_OK : ERR_NOMEM;

    for (size_t i = 0; !e && i < meshes; i++) {
        name_mesh(set->scene, i, m, text[i]);
        names[i] = text[i];
        l->ids[i][m] = cryptomatte_id(names[i]);
    }
    if (!e)
        e = cryptomatte_init(&l->manifest[m], matte_names[m], names, meshes);
    mem_free(names);
    mem_free(text);
    for (int k = 0; !e && k < 4; k++)
        l->attributes[4 * m + k] = (struct exr_attribute){ l->manifest[m].key[k], l->manifest[m].value[k] };
#pragma omp parallel for schedule(static)
    for (size_t pixel = 0; pixel < (e ? 0 : (size_t)g->width * g->height); pixel++)
        rank_pixel(l, l->hits->parts + l->hits->first[pixel], l->hits->first[pixel + 1] - l->hits->first[pixel], m,
                   l->matte[m] + 2 * RANKS * pixel);
    return e;
}

static enum err allocate(struct render_layers *l, const struct prepared_scene *set, bool lamps)
{
    const size_t pixels = (size_t)set->gbuffer->width * set->gbuffer->height;

    l->albedo = mem_alloc(pixels, 3 * sizeof(float));
    l->lamps = lamps ? mem_alloc(pixels, 3 * sizeof(float)) : NULL;
    l->samples = mem_alloc(pixels, sizeof(float));
    l->ones = mem_alloc(pixels, sizeof(float));
    l->ids = mem_alloc(set->scene->mesh_count + 1, sizeof(*l->ids));
    for (int m = 0; m < MATTES; m++)
        l->matte[m] = mem_alloc(pixels, 2 * RANKS * sizeof(float));
    return layers_init(&l->light, set) && l->albedo && (l->lamps || !lamps) && l->samples && l->ones && l->ids &&
                   l->matte[0] && l->matte[1]
               ? ERR_OK
               : ERR_NOMEM;
}

enum err render_layers_create(struct render *r, struct reason *why)
{
    const struct setup *s = &r->desc.setup;
    const struct prepared_scene *set = r->set;
    struct render_layers *l = r->layers = mem_alloc(1, sizeof(*l));
    enum err e = l ? allocate(l, set, r->lamps != NULL) : ERR_NOMEM;

    if (!e)
        e = first_hits_create(set->scene, set->rays, set->gbuffer, &set->view, s->set_desc.edge_rays, &l->hits);
    if (!e)
        fill_albedo(l, set->gbuffer, s->light.classes & PATH_DIRECT ? s->light.direct.samples : 0);
    for (int m = 0; m < MATTES && !e; m++)
        e = make_matte(l, set, m);
    if (e)
        return err_say(why, e, "no memory for layers of %ux%u", s->set_desc.width, s->set_desc.height);
    list_channels(l, s->light.denoise);
    output_set_layers(r->output, l->channels, l->count, l->attributes, ATTRIBUTES);
    return ERR_OK;
}

void render_layers_destroy(struct render_layers *l)
{
    if (!l)
        return;
    layers_finish(&l->light);
    first_hits_destroy(l->hits);
    mem_free(l->albedo);
    mem_free(l->lamps);
    mem_free(l->samples);
    mem_free(l->ones);
    mem_free(l->ids);
    for (int m = 0; m < MATTES; m++) {
        mem_free(l->matte[m]);
        cryptomatte_finish(&l->manifest[m]);
    }
    mem_free(l);
}

enum err render_layers_run(struct render *r, struct relight_stats *stats)
{
    struct render_layers *l = r->layers;
    const size_t values = 3 * (size_t)r->set->gbuffer->width * r->set->gbuffer->height;

    if (l->lamps) {
        memset(l->lamps, 0, values * sizeof(float));
        relight_lamps_add(r->lamps, r->desc.setup.initial.lamps, l->lamps);
    }
    return relighter_run_layers(r->relighter, r->environment, &r->request.light, &l->light, r->rgb, stats);
}
