/* Where a surface is and where it has holes: alpha masks and fractional coverage (material.h). A ray that meets a hole
 * continues unchanged; rays.h tests every hit. Thin glass counts as having holes, too: its mean transmittance is the
 * share of rays that pass straight through. Thread: any. */
#pragma once

#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"
#include "scene/surface/scatter.h"

enum coverage {
    COVERAGE_FULL, /* no hole anywhere */
    COVERAGE_NONE, /* nothing but holes */
    COVERAGE_PARTIAL,
};

/* From the smallest and largest alpha of the material's texture. */
enum coverage material_coverage(const struct scene *s, const struct material *m);

/* The coverage of a mesh, given that of its material: vertices may have an alpha, too. */
enum coverage mesh_coverage(const struct scene *s, const struct mesh *m, enum coverage of_material);

/* The data that a hit's coverage depends on. Borrows from the scene. */
struct mask {
    const struct mesh *mesh;
    const struct material *material;
    const struct texture *texture; /* with its alpha; NULL: none */
    const struct texture *tint;    /* of thin glass; NULL: none */
    uint32_t index;                /* of the mesh */
};

void mask_init(struct mask *m, const struct scene *s, uint32_t mesh); /* mesh: an index */

/* Whether a ray hits surface, not a hole, at a point of a triangle; u and v are as in struct hit. With ALPHA_BLEND the
 * answer is true with probability alpha; with thin glass the probability follows from its transmittance. The random
 * number is a hash of the ray and the triangle, so that a repeated ray gets the same answer and different rays get
 * independent ones [Enderton et al. 2010]. origin and dir: the ray, as it was queried. */
bool mask_covers(const struct mask *m, uint32_t triangle, float u, float v, const float origin[3], const float dir[3]);

/* As mask_covers, for a ray of rays_see, for which only masks have holes. */
bool mask_covers_seen(const struct mask *m, uint32_t triangle, float u, float v);

/* Whether both surface and holes may lie within `width` metres of a hit, measured on the surface. */
bool mask_varies(const struct mask *m, uint32_t triangle, float u, float v, float width);

/* The fraction of surface that a ray from the camera sees at a hit of rays_see: 1, except with ALPHA_BLEND and on thin
 * glass; passed: the share of light from behind that gets through, per channel. at: the hit's; dir: the ray's; uv_step:
 * as in scatter_on. */
float coverage_seen(const struct scene *s, const struct hit *h, const struct scatter *at, struct vec3 dir,
                    const float uv_step[2][2], float passed[3]);
