#include "digest.h"

#include "rng.h"

#include <string.h>

void digest_begin(struct digest *d)
{
    *d = (struct digest){ { 0x6368617274u, 0x7472757468u } };
}

void digest_u64(struct digest *d, uint64_t value)
{
    d->half[0] = rng_mix(d->half[0], value);
    d->half[1] = rng_mix(value, d->half[1]);
}

void digest_bytes(struct digest *d, const void *bytes, size_t size)
{
    const unsigned char *p = bytes;

    digest_u64(d, size);
    for (size_t i = 0; i < size; i += 8) {
        uint64_t word = 0;
        memcpy(&word, p + i, size - i < 8 ? size - i : 8);
        digest_u64(d, word);
    }
}

static void digest_mesh(struct digest *d, const struct mesh *m)
{
    digest_u64(d, (uint64_t)m->vertex_count << 32 | m->triangle_count);
    digest_u64(d, m->material);
    digest_bytes(d, m->positions, 3 * sizeof(float) * m->vertex_count);
    digest_bytes(d, m->normals, m->normals ? 3 * sizeof(float) * m->vertex_count : 0);
    digest_bytes(d, m->uvs, m->uvs ? 2 * sizeof(float) * m->vertex_count : 0);
    digest_bytes(d, m->indices, 3 * sizeof(uint32_t) * m->triangle_count);
}

/* Field by field: what stands between them is nobody's. */
static void digest_material(struct digest *d, const struct material *m)
{
    const float values[] = { m->diffuse.x,  m->diffuse.y, m->diffuse.z, m->specular.x, m->specular.y,
                             m->specular.z, m->exponent,  m->metallic,  m->roughness,  m->ior };

    digest_u64(d, (uint64_t)m->kind << 32 | m->texture);
    digest_bytes(d, values, sizeof(values));
}

void digest_scene(struct digest *d, const struct scene *scene)
{
    for (size_t i = 0; i < scene->mesh_count; i++)
        digest_mesh(d, &scene->meshes[i]);
    for (size_t i = 0; i < scene->material_count; i++)
        digest_material(d, &scene->materials[i]);
    for (size_t i = 0; i < scene->texture_count; i++) {
        const struct texture *t = &scene->textures[i];
        digest_u64(d, (uint64_t)t->width << 32 | t->height);
        digest_bytes(d, t->rgb, 3 * sizeof(float) * t->width * t->height);
    }
}

void digest_view(struct digest *d, const struct view *view)
{
    digest_bytes(d, view->origin, sizeof(view->origin));
    digest_bytes(d, view->corner, sizeof(view->corner));
    digest_bytes(d, view->step_x, sizeof(view->step_x));
    digest_bytes(d, view->step_y, sizeof(view->step_y));
    digest_u64(d, (uint64_t)view->width << 32 | view->height);
}

void digest_frame(struct digest *d, const struct frame *frame)
{
    digest_u64(d, (uint64_t)frame->kind);
    digest_bytes(d, frame->layout, strlen(frame->layout));
    if (frame->kind == FRAME_FILE) {
        digest_bytes(d, frame->faces, sizeof(frame->faces));
        digest_bytes(d, frame->bytes, frame->size);
    } else if (frame->kind == FRAME_TEXELS) {
        digest_u64(d, (uint64_t)frame->width << 32 | frame->height);
        digest_bytes(d, frame->rgb, 3 * sizeof(float) * frame->width * frame->height);
    }
}
