#include "import/gltf.h"

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
