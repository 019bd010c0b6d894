#include "year/annual.h"

#include "base/mem.h"
#include "base/vec.h"

struct glare_view {
    uint32_t width, height;
    float *solid_angle;    /* [height][width] */
    float (*direction)[3]; /* likewise */
    double ahead[3], up[3];
};

static void fill(const struct view *v, struct glare_view *g)
{
    for (uint32_t y = 0; y < v->height; y++)
        for (uint32_t x = 0; x < v->width; x++) {
            const size_t i = (size_t)y * v->width + x;
            const struct vec3 w = view_direction(v, x + 0.5, y + 0.5);
            g->solid_angle[i] = view_sees(v, x + 0.5, y + 0.5) ? (float)view_solid_angle(v, w) : 0.0f;
            g->direction[i][0] = w.x;
            g->direction[i][1] = w.y;
            g->direction[i][2] = w.z;
        }
    for (int k = 0; k < 3; k++) {
        g->ahead[k] = v->ahead[k];
        g->up[k] = -v->step_y[k] / v->step;
    }
}

enum err glare_view_create(const struct view *v, struct glare_view **out)
{
    const size_t pixels = (size_t)v->width * v->height;

    *out = NULL;
    if (v->projection == PROJECTION_PERSPECTIVE)
        return ERR_OK;
    struct glare_view *g = mem_alloc(1, sizeof(*g));
    if (!g)
        return ERR_NOMEM;
    g->width = v->width;
    g->height = v->height;
    g->solid_angle = mem_alloc(pixels, sizeof(*g->solid_angle));
    g->direction = mem_alloc(pixels, sizeof(*g->direction));
    if (!g->solid_angle || !g->direction) {
        glare_view_destroy(g);
        return ERR_NOMEM;
    }
    fill(v, g);
    *out = g;
    return ERR_OK;
}

void glare_view_destroy(struct glare_view *g)
{
    if (!g)
        return;
    mem_free(g->solid_angle);
    mem_free(g->direction);
    mem_free(g);
}

enum err glare_view_measure(const struct glare_view *g, const float *cdm2, struct glare *out)
{
    const struct glare_desc d = {
        .width = g->width,
        .height = g->height,
        .luminance = cdm2,
        .solid_angle = g->solid_angle,
        .direction = (const float(*)[3])g->direction,
        .ahead = { g->ahead[0], g->ahead[1], g->ahead[2] },
        .up = { g->up[0], g->up[1], g->up[2] },
    };

    return glare_measure(&d, out);
}
