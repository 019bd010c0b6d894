#include "import/formats/gltf.h"

#include "base/mem.h"

#include <inttypes.h>

static enum err read_file(struct gltf *g)
{
    struct reason cause = { "" };
    const enum err e = host_read(g->desc->host, g->desc->path, &g->file, &cause);
    const char *place = g->desc->place;

    if (e) /* the reason begins with the path */
        return err_say(g->why, e, "%s%s%s", place ? place : "", place ? ": " : "", cause.text);
    return ERR_OK;
}

/* Viewers cull the near side of an outline, so that a dark rim remains; with two sides it would hide the model. */
static enum err leave_out_outlines(struct gltf *g, size_t meshes_before)
{
    bool *single_sided = mem_alloc(g->scene->material_count, sizeof(*single_sided));
    uint64_t *dropped = mem_alloc(g->scene->material_count, sizeof(*dropped)), triangles = 0;
    struct gltf_note note = { 0 };

    enum err e = single_sided && dropped ? ERR_OK : ERR_NOMEM;
    for (size_t i = 0; i < g->counts[GLTF_MATERIALS] && !e; i++) {
        const struct gltf_at at = gltf_element(g, GLTF_MATERIALS, i);
        single_sided[g->first_material + i] = !json_is_true(json_object_get(at.value, "doubleSided"));
    }
    if (!e)
        e = scene_drop_outlines(g->scene, meshes_before, single_sided, dropped);
    for (size_t i = 0; i < g->counts[GLTF_MATERIALS] && !e; i++) {
        const uint64_t own = dropped[g->first_material + i];
        triangles += own;
        if (own > 0)
            gltf_note(&note, i);
    }
    gltf_warn_of(g, GLTF_MATERIALS, &note,
                 "left out %" PRIu64 " triangles of an outline, a shell that is turned inside out around other meshes; "
                 "\"doubleSided\": true keeps it",
                 triangles);
    mem_free(single_sided);
    mem_free(dropped);
    return e;
}

static enum err take(struct gltf *g)
{
    const size_t meshes_before = g->scene->mesh_count;

    enum err e = gltf_check_extensions(g);
    if (!e && g->desc->material == MATERIAL_NONE)
        e = gltf_add_materials(g);
    if (!e)
        e = gltf_animate(g);
    if (!e)
        e = gltf_add_nodes(g);
    if (!e && g->desc->material == MATERIAL_NONE)
        e = leave_out_outlines(g, meshes_before);
    if (e)
        return e;
    gltf_warn_of(g, GLTF_MESHES, &g->skipped, "left out points and lines");
    if (g->dropped > 0)
        gltf_warn(g, NULL, "dropped %" PRIu64 " degenerate or non-finite triangles", g->dropped);
    if (g->scene->mesh_count == meshes_before)
        return gltf_fault(g, NULL, ERR_FORMAT, "the model contains no triangles; points and lines are not rendered");
    return ERR_OK;
}

static void finish(struct gltf *g)
{
    for (size_t i = 0; g->buffers && i < g->counts[GLTF_BUFFERS]; i++)
        bytes_finish(&g->buffers[i].owned);
    for (size_t i = 0; g->views && i < g->counts[GLTF_BUFFER_VIEWS]; i++)
        mem_free(g->views[i].owned);
    mem_free(g->buffers);
    mem_free(g->views);
    mem_free(g->surfaces);
    for (size_t i = 0; g->uses && i < g->counts[GLTF_MESHES]; i++)
        mem_free(g->uses[i].shared);
    mem_free(g->uses);
    mem_free(g->worlds);
    json_decref(g->json);
    bytes_finish(&g->file);
}

enum err gltf_load(struct scene *s, const struct model_desc *d, struct reason *why)
{
    struct gltf g = { .scene = s, .desc = d, .why = why, .plain = MATERIAL_NONE };

    enum err e = read_file(&g);
    if (!e)
        e = gltf_parse(&g);
    if (!e)
        e = take(&g);
    finish(&g);
    return e;
}
