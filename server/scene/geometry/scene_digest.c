#include "scene/geometry/scene_digest.h"

#include <stdbool.h>
#include <stddef.h>

/* Nothing for meshes in world space. True: the arrays are those of an earlier mesh. */
static bool digest_place(struct digest *d, const struct mesh *m)
{
    if (m->placed) {
        digest_u64(d, m->source);
        digest_bytes(d, m->place.matrix, sizeof(m->place.matrix));
    }
    return m->source != 0;
}

static void digest_mesh(struct digest *d, const struct mesh *m)
{
    if (digest_place(d, m))
        return;
    digest_u64(d, (uint64_t)m->vertex_count << 32 | m->triangle_count);
    digest_u64(d, m->material);
    digest_bytes(d, m->positions, 3 * sizeof(float) * m->vertex_count);
    digest_bytes(d, m->normals, m->normals ? 3 * sizeof(float) * m->vertex_count : 0);
    digest_bytes(d, m->uvs, m->uvs ? 2 * sizeof(float) * m->vertex_count : 0);
    digest_bytes(d, m->colours, m->colours ? 4 * sizeof(float) * m->vertex_count : 0);
    digest_bytes(d, m->indices, 3 * sizeof(uint32_t) * m->triangle_count);
    if (m->more_uvs)
        digest_bytes(d, m->more_uvs, 2 * sizeof(float) * m->vertex_count);
    if (m->tangents)
        digest_bytes(d, m->tangents, 4 * sizeof(float) * m->vertex_count);
}

/* What decides where a material has holes, without its texture; nothing if it has none. */
static void digest_alpha(struct digest *d, const struct material *m)
{
    const float values[] = { m->alpha, m->alpha_cutoff },
                glass[] = { m->ior, m->diffuse.x, m->diffuse.y, m->diffuse.z };

    if (m->thin) {
        digest_u64(d, (uint64_t)m->thin << 32 | m->texture);
        digest_bytes(d, glass, sizeof(glass));
    }
    if (m->alpha_mode == ALPHA_OPAQUE)
        return;
    digest_u64(d, (uint64_t)m->alpha_mode << 32 | m->alpha_texture);
    digest_bytes(d, values, sizeof(values));
}

/* Nothing without maps. */
static void digest_maps(struct digest *d, const struct material *m)
{
    if (m->maps & MAP_ROUGHNESS)
        digest_u64(d, (uint64_t)MAP_ROUGHNESS << 32 | m->roughness_texture);
    if (m->maps & MAP_NORMAL) {
        digest_u64(d, (uint64_t)MAP_NORMAL << 32 | m->normal_texture);
        digest_bytes(d, &m->normal_scale, sizeof(m->normal_scale));
    }
    if (m->maps & MAP_COAT)
        digest_u64(d, (uint64_t)MAP_COAT << 32 | m->coat_texture);
    if (m->maps & MAP_COAT_ROUGHNESS)
        digest_u64(d, (uint64_t)MAP_COAT_ROUGHNESS << 32 | m->coat_roughness_texture);
    if (m->maps & MAP_SHEEN_ROUGHNESS)
        digest_u64(d, (uint64_t)MAP_SHEEN_ROUGHNESS << 32 | m->sheen_roughness_texture);
    if (m->second)
        digest_u64(d, (uint64_t)m->second << 32);
    if (m->moved) {
        digest_u64(d, m->moved);
        digest_bytes(d, m->moved_by, sizeof(m->moved_by));
    }
}

/* Field by field, since padding is undefined. */
static void digest_material(struct digest *d, const struct material *m)
{
    const float values[] = { m->diffuse.x,  m->diffuse.y, m->diffuse.z, m->specular.x, m->specular.y,
                             m->specular.z, m->exponent,  m->metallic,  m->roughness,  m->ior };

    digest_u64(d, (uint64_t)m->kind << 32 | m->texture);
    digest_bytes(d, values, sizeof(values));
    if (m->attenuation.x + m->attenuation.y + m->attenuation.z > 0.0f)
        digest_bytes(d, &m->attenuation, sizeof(m->attenuation));
    if (m->transmits > 0.0f) {
        const float beyond[] = { m->transmits, m->through.x, m->through.y, m->through.z };
        digest_u64(d, m->through_texture);
        digest_bytes(d, beyond, sizeof(beyond));
    }
    if (m->coat > 0.0f) {
        const float coat[] = { m->coat, m->coat_roughness };
        digest_u64(d, (uint64_t)LAYER_COAT << 32 | m->coat_bent);
        digest_bytes(d, coat, sizeof(coat));
    }
    if (m->sheen.x + m->sheen.y + m->sheen.z > 0.0f) {
        const float sheen[] = { m->sheen.x, m->sheen.y, m->sheen.z, m->sheen_roughness };
        digest_u64(d, (uint64_t)LAYER_SHEEN << 32 | m->sheen_texture);
        digest_bytes(d, sheen, sizeof(sheen));
    }
    digest_alpha(d, m);
    digest_maps(d, m);
}

static void digest_texture(struct digest *d, const struct texture *t)
{
    digest_u64(d, (uint64_t)t->width << 32 | t->height);
    digest_u64(d, (uint64_t)t->values << 32 | (uint64_t)t->wrap_u << 16 | (uint64_t)t->wrap_v);
    digest_bytes(d, t->texels, 4 * (size_t)t->width * t->height);
}

void digest_scene(struct digest *d, const struct scene *scene)
{
    for (size_t i = 0; i < scene->mesh_count; i++)
        digest_mesh(d, &scene->meshes[i]);
    for (size_t i = 0; i < scene->material_count; i++)
        digest_material(d, &scene->materials[i]);
    for (size_t i = 0; i < scene->texture_count; i++)
        digest_texture(d, &scene->textures[i]);
}

void digest_view(struct digest *d, const struct view *view)
{
    digest_bytes(d, view->origin, sizeof(view->origin));
    digest_bytes(d, view->corner, sizeof(view->corner));
    digest_bytes(d, view->step_x, sizeof(view->step_x));
    digest_bytes(d, view->step_y, sizeof(view->step_y));
    digest_u64(d, (uint64_t)view->width << 32 | view->height);
    if (view->projection != PROJECTION_PERSPECTIVE)
        digest_u64(d, view->projection);
}

/* What decides where a mesh has holes. */
static void digest_holes(struct digest *d, const struct scene *scene, const struct mesh *m)
{
    const struct material *material = &scene->materials[m->material];

    const bool masked = material->alpha_mode != ALPHA_OPAQUE && material->alpha_texture != MATERIAL_NO_TEXTURE;
    const bool tinted = material->thin && material->texture != MATERIAL_NO_TEXTURE;

    digest_alpha(d, material);
    if (masked || tinted)
        digest_bytes(d, m->uvs, m->uvs ? 2 * sizeof(float) * m->vertex_count : 0);
    if (masked)
        digest_texture(d, &scene->textures[material->alpha_texture]);
    if (tinted)
        digest_texture(d, &scene->textures[material->texture]);
    if ((material->thin || material->alpha_mode != ALPHA_OPAQUE) && m->colours)
        digest_bytes(d, m->colours, 4 * sizeof(float) * m->vertex_count);
}

void digest_geometry(struct digest *d, const struct scene *scene)
{
    for (size_t i = 0; i < scene->mesh_count; i++) {
        const struct mesh *m = &scene->meshes[i];
        if (digest_place(d, m))
            continue;
        digest_bytes(d, m->positions, 3 * sizeof(float) * m->vertex_count);
        digest_bytes(d, m->indices, 3 * sizeof(uint32_t) * m->triangle_count);
        digest_holes(d, scene, m);
    }
}

void digest_points(struct digest *d, const struct gbuffer *g)
{
    digest_u64(d, (uint64_t)g->width << 32 | g->height);
    for (uint32_t i = 0; i < g->packet_count; i++) /* excludes the padding at the end of a packet */
        digest_bytes(d, &g->packets[i], offsetof(struct shade_packet, count) + sizeof(g->packets[i].count));
}
