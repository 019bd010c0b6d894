#include "import/gltf.h"

#include <stdio.h>
#include <string.h>

#define NAMES_TEXT 200 /* bytes for the names in one warning */

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

static void name_ignored(const struct gltf *g)
{
    const json_t *used = json_object_get(g->json, "extensionsUsed");
    char names[NAMES_TEXT] = "";

    for (size_t i = 0; i < json_array_size(used); i++) {
        const char *name = json_string_value(json_array_get(used, i));
        const size_t n = strlen(names);
        if (name && support_of(name) == UNKNOWN)
            snprintf(names + n, sizeof(names) - n, "%s%.80s", n ? ", " : "", name);
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
