#include "light/frame/frame_plan.h"

/* The reflectance of a point under a white sky: its diffuse part, plus its lobe at normal incidence. */
static double albedo_of(const struct shade_packet *p, uint32_t lane)
{
    const double d = rgb_luminance(p->diffuse[0][lane], p->diffuse[1][lane], p->diffuse[2][lane]);
    return d + rgb_luminance(p->specular[0][lane], p->specular[1][lane], p->specular[2][lane]);
}

void facts_of_set(const struct scene *scene, const struct gbuffer *g, struct plan_facts *out)
{
    double sum = 0.0;

    *out = (struct plan_facts){
        .casters = scene_casters(scene, NULL, 0),
        .points = g->point_count,
        .pixels = (uint64_t)g->width * g->height,
    };
    for (uint32_t i = 0; i < g->packet_count; i++)
        for (uint32_t l = 0; l < g->packets[i].count; l++) {
            sum += albedo_of(&g->packets[i], l);
            out->behind += g->packets[i].behind[l];
        }
    out->albedo = g->point_count ? sum / (double)g->point_count : 0.0;
}

double facts_peakedness(const struct environment *e)
{
    const uint32_t texels = e->n * e->n;
    double mean = 0.0, square = 0.0;

    for (uint32_t t = 0; t < CUBE_FACES * texels; t++) {
        const struct texel *x = &e->texels[t];
        const double l = rgb_luminance(x->r, x->g, x->b), angle = e->solid_angle[t % texels];
        mean += l * angle;
        square += l * l * angle;
    }
    return mean > 0.0 ? 4.0 * PI * square / (mean * mean) : 0.0;
}
