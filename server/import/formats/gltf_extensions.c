#include "import/formats/gltf.h"

#include <stdio.h>
#include <string.h>

#define NAMES_TEXT 200 /* bytes for the names in one warning */
#define IGNORED_MAX 16 /* extensions that are named */

enum support {
    UNKNOWN,  /* ignored, and named */
    MODELLED, /* also approximations */
};

static const struct {
    const char *name;
    enum support support;
    const char *advice; /* what to do if it is required but not supported */
} known[] = {
    { "KHR_mesh_quantization", MODELLED, NULL },
    { "KHR_materials_ior", MODELLED, NULL },
    { "KHR_materials_specular", MODELLED, NULL },
    { "KHR_materials_transmission", MODELLED, NULL },
    { "KHR_materials_volume", MODELLED, NULL },
    { "KHR_materials_clearcoat", MODELLED, NULL },
    { "KHR_materials_sheen", MODELLED, NULL },
    { "KHR_materials_diffuse_transmission", MODELLED, NULL },
    { "KHR_materials_emissive_strength", MODELLED, NULL },
    { "KHR_materials_pbrSpecularGlossiness", MODELLED, NULL }, /* with a warning */
    { "KHR_materials_unlit", MODELLED, NULL },                 /* with a warning */
    { "KHR_materials_variants", MODELLED, NULL },              /* the default one */
    { "KHR_lights_punctual", MODELLED, NULL },
    { "KHR_texture_transform", MODELLED, NULL },
    { "KHR_texture_basisu", UNKNOWN, "convert its textures with 'gltf-transform ktxdecompress IN OUT'" },
    { "KHR_draco_mesh_compression", MODELLED, NULL },
    { "EXT_meshopt_compression", MODELLED, NULL },
    { "KHR_meshopt_compression", MODELLED, NULL },
    { "EXT_mesh_gpu_instancing", MODELLED, NULL },
    { "EXT_texture_webp", MODELLED, NULL },
};

static size_t find(const char *name)
{
    size_t i = 0;

    while (i < sizeof(known) / sizeof(known[0]) && strcmp(known[i].name, name) != 0)
        i++;
    return i;
}

static enum support support_of(const char *name)
{
    const size_t i = find(name);
    return i < sizeof(known) / sizeof(known[0]) ? known[i].support : UNKNOWN;
}

static enum err check_required(const struct gltf *g)
{
    const json_t *required = json_object_get(g->json, "extensionsRequired");

    for (size_t i = 0; i < json_array_size(required); i++) {
        const char *name = json_string_value(json_array_get(required, i));
        if (!name || support_of(name) == MODELLED)
            continue;
        const size_t k = find(name);
        const char *advice = k < sizeof(known) / sizeof(known[0]) ? known[k].advice : NULL;
        return gltf_fault(g, NULL, ERR_UNSUPPORTED, "requires the extension %.80s, which is not supported%s%s", name,
                          advice ? "; " : "", advice ? advice : "");
    }
    return ERR_OK;
}

struct ignored { /* an extension */
    const char *name;
    enum gltf_list list; /* the first that uses it */
    struct gltf_note note;
};

struct search { /* for places of ignored extensions */
    struct ignored ignored[IGNORED_MAX];
    size_t count;
    enum gltf_list list;
    size_t element;
};

static void note_uses(struct search *s, const json_t *extensions)
{
    for (size_t i = 0; i < s->count; i++) {
        struct ignored *k = &s->ignored[i];
        if (!json_object_get(extensions, k->name))
            continue;
        if (k->note.count == 0)
            k->list = s->list;
        if (k->list == s->list)
            gltf_note(&k->note, s->element);
    }
}

/* As deep as the parser allows. */
static void search_value(struct search *s, json_t *v)
{
    const char *key;
    json_t *member;

    for (size_t i = 0; i < json_array_size(v); i++)
        search_value(s, json_array_get(v, i));
    json_object_foreach(v, key, member)
    {
        if (strcmp(key, "extensions") == 0)
            note_uses(s, member);
        search_value(s, member);
    }
}

static void search_lists(const struct gltf *g, struct search *s)
{
    for (int list = 0; list < GLTF_LISTS; list++) {
        json_t *elements = json_object_get(g->json, g->lists[list].key);
        s->list = (enum gltf_list)list;
        for (s->element = 0; s->element < json_array_size(elements); s->element++)
            search_value(s, json_array_get(elements, s->element));
    }
}

/* Each with its first place; those without a place share a warning. */
static void name_ignored(const struct gltf *g)
{
    const json_t *used = json_object_get(g->json, "extensionsUsed");
    struct search s = { .count = 0 };
    char names[NAMES_TEXT] = "";

    for (size_t i = 0; i < json_array_size(used) && s.count < IGNORED_MAX; i++) {
        const char *name = json_string_value(json_array_get(used, i));
        if (name && support_of(name) == UNKNOWN)
            s.ignored[s.count++].name = name;
    }
    if (s.count > 0)
        search_lists(g, &s);
    for (size_t i = 0; i < s.count; i++) {
        const struct ignored *k = &s.ignored[i];
        const size_t n = strlen(names);
        if (k->note.count > 0)
            gltf_warn_of(g, k->list, &k->note, "%.80s is ignored", k->name);
        else
            snprintf(names + n, sizeof(names) - n, "%s%.80s", n ? ", " : "", k->name);
    }
    if (names[0])
        gltf_warn(g, NULL, "ignored extensions: %s", names);
}

enum err gltf_check_extensions(const struct gltf *g)
{
    const enum err e = check_required(g);

    if (!e)
        name_ignored(g);
    return e;
}
