#include "scene/geometry/coverage.h"

#include "base/rng.h"
#include "scene/geometry/mesh_read.h"

#include <math.h>
#include <string.h>

/* The number decides nothing but which random numbers are drawn. */
#define HASH_SEED UINT64_C(0x616c706861)

/* The texture whose alpha the material uses, or NULL. */
static const struct texture *alpha_texture(const struct scene *s, const struct material *m)
{
    return m->alpha_texture == MATERIAL_NO_TEXTURE ? NULL : &s->textures[m->alpha_texture];
}

/* Whether an alpha means surface everywhere, or (`none`) nowhere. */
static bool is_full(const struct material *m, float alpha)
{
    return m->alpha_mode == ALPHA_MASK ? alpha >= m->alpha_cutoff : alpha >= 1.0f;
}

static bool is_none(const struct material *m, float alpha)
{
    return m->alpha_mode == ALPHA_MASK ? alpha < m->alpha_cutoff : alpha <= 0.0f;
}

enum coverage material_coverage(const struct scene *s, const struct material *m)
{
    float low = 1.0f, high = 1.0f;

    if (m->alpha_mode == ALPHA_OPAQUE)
        return m->thin ? COVERAGE_PARTIAL : COVERAGE_FULL;
    const struct texture *t = alpha_texture(s, m);
    if (t)
        texture_alpha_limits(t, &low, &high);
    if (is_full(m, m->alpha * low))
        return m->thin ? COVERAGE_PARTIAL : COVERAGE_FULL;
    return is_none(m, m->alpha * high) ? COVERAGE_NONE : COVERAGE_PARTIAL;
}

enum coverage mesh_coverage(const struct scene *s, const struct mesh *m, enum coverage of_material)
{
    if (of_material != COVERAGE_FULL || !m->colours || s->materials[m->material].alpha_mode == ALPHA_OPAQUE)
        return of_material;
    for (size_t i = 0; i < m->vertex_count; i++) {
        if (m->colours[4 * i + 3] < 1.0f)
            return COVERAGE_PARTIAL;
    }
    return COVERAGE_FULL;
}

void mask_init(struct mask *m, const struct scene *s, uint32_t mesh)
{
    m->mesh = &s->meshes[mesh];
    m->material = &s->materials[m->mesh->material];
    m->texture = m->material->alpha_mode == ALPHA_OPAQUE ? NULL : alpha_texture(s, m->material);
    m->tint =
        m->material->thin && m->material->texture != MATERIAL_NO_TEXTURE ? &s->textures[m->material->texture] : NULL;
    m->index = mesh;
}

/* Texture coordinates at a hit; a mesh without them has (0, 0) everywhere. */
static void uv_at(const struct mesh *m, uint32_t triangle, float u, float v, float uv[2])
{
    const uint32_t *t = m->indices + 3 * (size_t)triangle;
    const float weight[3] = { 1.0f - u - v, u, v };

    uv[0] = uv[1] = 0.0f;
    for (int k = 0; m->uvs && k < 3; k++) {
        uv[0] += weight[k] * m->uvs[2 * (size_t)t[k]];
        uv[1] += weight[k] * m->uvs[2 * (size_t)t[k] + 1];
    }
}

static uint64_t bits(float high, float low)
{
    uint32_t b[2];

    memcpy(&b[0], &low, sizeof(low));
    memcpy(&b[1], &high, sizeof(high));
    return (uint64_t)b[1] << 32 | b[0];
}

/* In [0, 1). u and v are not hashed because their last bit differs between packets of different widths. */
static float hash_ray(const struct mask *m, uint32_t triangle, const float origin[3], const float dir[3])
{
    const uint64_t from = rng_mix(bits(origin[0], origin[1]), bits(origin[2], dir[0]));
    const uint64_t ray = rng_mix(from, bits(dir[1], dir[2]));

    return (float)(rng_mix(ray ^ HASH_SEED, (uint64_t)m->index << 32 | triangle) >> 40) * 0x1p-24f;
}

/* The alpha of the mesh's colours at a hit. */
static float vertex_alpha(const struct mesh *m, uint32_t triangle, float u, float v)
{
    const uint32_t *t = m->indices + 3 * (size_t)triangle;
    const float weight[3] = { 1.0f - u - v, u, v };
    float alpha = 0.0f;

    if (!m->colours)
        return 1.0f;
    for (int k = 0; k < 3; k++)
        alpha += weight[k] * m->colours[4 * (size_t)t[k] + 3];
    return alpha;
}

static float alpha_at(const struct mask *m, uint32_t triangle, float u, float v)
{
    const float alpha = m->material->alpha * vertex_alpha(m->mesh, triangle, u, v);
    float uv[2];

    if (!m->texture)
        return alpha;
    uv_at(m->mesh, triangle, u, v, uv);
    return alpha * texture_alpha(m->texture, uv[0], uv[1]);
}

/* For thin glass: the share of rays in this direction, of any length, that hit it. */
static float share_of_thin_glass(const struct mask *m, uint32_t triangle, float u, float v, const float dir[3])
{
    const struct mesh *mesh = m->mesh;
    const uint32_t *t = mesh->indices + 3 * (size_t)triangle;
    const float weight[3] = { 1.0f - u - v, u, v };
    const struct vec3 d = vec3_make(dir[0], dir[1], dir[2]);
    struct vec3 p[3], tint = m->material->diffuse, colour = { 0.0f, 0.0f, 0.0f };
    float uv[2];

    for (int k = 0; k < 3 && mesh->colours; k++) {
        const float *own = mesh->colours + 4 * (size_t)t[k];
        colour = vec3_add(colour, vec3_scale(vec3_make(own[0], own[1], own[2]), weight[k]));
    }
    if (mesh->colours)
        tint = vec3_mul(tint, colour);
    if (m->tint) {
        uv_at(mesh, triangle, u, v, uv);
        tint = vec3_mul(tint, texture_read(m->tint, uv, NULL));
    }
    mesh_corners_rounded(mesh, triangle, p);
    const struct vec3 n = vec3_cross(vec3_sub(p[1], p[0]), vec3_sub(p[2], p[0]));
    return thin_glass_at(m->material->ior, tint, vec3_dot(n, d) / (vec3_length(n) * vec3_length(d))).covers;
}

bool mask_covers_seen(const struct mask *m, uint32_t triangle, float u, float v)
{
    return m->material->alpha_mode != ALPHA_MASK || alpha_at(m, triangle, u, v) >= m->material->alpha_cutoff;
}

bool mask_covers(const struct mask *m, uint32_t triangle, float u, float v, const float origin[3], const float dir[3])
{
    float share = m->material->alpha_mode == ALPHA_BLEND ? alpha_at(m, triangle, u, v) : 1.0f;

    if (!mask_covers_seen(m, triangle, u, v))
        return false;
    if (m->material->thin)
        share *= share_of_thin_glass(m, triangle, u, v, dir);
    return m->material->alpha_mode == ALPHA_MASK && !m->material->thin ? true
                                                                       : hash_ray(m, triangle, origin, dir) < share;
}

/* Bounds how many texels of the finest level a metre on the triangle covers, in any direction: the length of the
 * gradients of both texture coordinates together. */
static float texels_per_metre(const struct mask *m, uint32_t triangle)
{
    const struct mesh *mesh = m->mesh;
    const uint32_t *t = mesh->indices + 3 * (size_t)triangle;
    const float size[2] = { (float)m->texture->width, (float)m->texture->height };
    struct vec3 p[3];
    float sum = 0.0f;

    if (!mesh->uvs)
        return 0.0f;
    mesh_corners_rounded(mesh, triangle, p);
    const struct vec3 e1 = vec3_sub(p[1], p[0]), e2 = vec3_sub(p[2], p[0]), n = vec3_cross(e1, e2);
    const struct vec3 across1 = vec3_cross(e2, n), across2 = vec3_cross(n, e1); /* over |n|^2: gradients of u and v */
    for (size_t i = 0; i < 2; i++) {
        const float first = mesh->uvs[2 * (size_t)t[0] + i];
        const struct vec3 gradient = vec3_add(vec3_scale(across1, mesh->uvs[2 * (size_t)t[1] + i] - first),
                                              vec3_scale(across2, mesh->uvs[2 * (size_t)t[2] + i] - first));
        sum += size[i] * size[i] * vec3_dot(gradient, gradient);
    }
    return sqrtf(sum) / vec3_dot(n, n);
}

static bool vertices_vary(const struct mesh *m, uint32_t triangle)
{
    const uint32_t *t = m->indices + 3 * (size_t)triangle;
    bool vary = false;

    for (int k = 1; k < 3 && m->colours; k++)
        vary |= m->colours[4 * (size_t)t[k] + 3] != m->colours[4 * (size_t)t[0] + 3];
    return vary;
}

bool mask_varies(const struct mask *m, uint32_t triangle, float u, float v, float width)
{
    float uv[2], low = 1.0f, high = 1.0f;

    if (vertices_vary(m->mesh, triangle))
        return true;
    if (!m->texture)
        return false;
    const float texels = width * texels_per_metre(m, triangle);
    if (!isfinite(texels))
        return true;
    uv_at(m->mesh, triangle, u, v, uv);
    texture_alpha_around(m->texture, uv[0], uv[1], texels, &low, &high);
    return low < 1.0f && high > 0.0f;
}

float coverage_seen(const struct scene *s, const struct hit *h, const struct scatter *at, struct vec3 dir,
                    const float uv_step[2][2], float passed[3])
{
    const struct material *m = &s->materials[s->meshes[h->mesh].material];
    float alpha = 1.0f;

    if (m->alpha_mode == ALPHA_BLEND) {
        const struct texture *t = alpha_texture(s, m);
        const float *uv = at->surface.uv;
        alpha = m->alpha * vertex_alpha(&s->meshes[h->mesh], h->triangle, h->u, h->v) *
                (t ? texture_filter_alpha(t, uv[0], uv[1], uv_step) : 1.0f);
    }
    passed[0] = passed[1] = passed[2] = 1.0f - alpha;
    if (at->delta != DELTA_THIN_GLASS)
        return alpha;
    const struct thin_glass glass = thin_glass_at(at->ior, at->reflectance, vec3_dot(dir, at->surface.geometric));
    passed[0] += alpha * glass.passed.x;
    passed[1] += alpha * glass.passed.y;
    passed[2] += alpha * glass.passed.z;
    return alpha * glass.covers;
}
