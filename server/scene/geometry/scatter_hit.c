#include "scene/geometry/scatter_hit.h"

void scatter_on(const struct scene *scene, const struct hit *h, const float (*uv_step)[2], struct scatter *out)
{
    const uint32_t material = scene->meshes[h->mesh].material;
    const struct material *m = &scene->materials[material];
    const struct vec3 smooth = out->surface.shading;

    if (m->maps & MAP_NORMAL)
        normal_map_turn(scene, h, uv_step, &out->surface);
    out->mesh = h->mesh;
    out->material = material;
    scatter_of(m, scene->textures, smooth, h->t, uv_step, out);
}

void scatter_at(const struct scene *scene, const struct rays *rays, const struct hit *h, struct vec3 dir,
                struct scatter *out)
{
    rays_surface(rays, h, vec3_scale(dir, -1.0f), &out->surface);
    scatter_on(scene, h, NULL, out);
    scatter_choose(out, h, dir);
}

void scatter_light_at(const struct scene *scene, const struct rays *rays, const struct hit *h, struct vec3 dir,
                      struct scatter *out)
{
    scatter_at(scene, rays, h, dir, out);
    if (out->through)
        scatter_turn_over(out);
}
