/* Shade points made without a scene: for what can be said about an estimator in closed form. */
#pragma once

#include "light/estimators/direct.h"
#include "light/estimators/kernels.h"
#include "support/skies.h"

/* A G-buffer of `packets` full packets, all of one lobe kind; normals and viewers to be set. Free with points_free. */
static inline struct gbuffer points_make(uint32_t packets, enum lobe_kind kind, float diffuse, float specular,
                                         float gloss)
{
    struct gbuffer g = { .packet_count = packets, .point_count = (uint64_t)packets * PACKET };
    g.packets = mem_alloc(packets, sizeof(*g.packets));
    for (uint32_t i = 0; i < packets; i++) {
        struct shade_packet *p = &g.packets[i];
        p->kind = kind;
        p->count = PACKET;
        for (int l = 0; l < PACKET; l++) {
            p->ns_y[l] = p->ng_y[l] = p->wo_y[l] = 1.0f;
            p->gloss[l] = gloss;
            p->valid[l] = -1;
            for (int c = 0; c < 3; c++) {
                p->diffuse[c][l] = diffuse;
                p->specular[c][l] = specular;
            }
        }
    }
    return g;
}

/* Rays start at the points alone, not all over their pixels. */
static inline void points_alone(struct gbuffer *g)
{
    for (uint32_t i = 0; i < g->packet_count; i++)
        memset(g->packets[i].pixel, 0, sizeof(g->packets[i].pixel));
}

static inline void points_free(struct gbuffer *g)
{
    mem_free(g->packets);
    g->packets = NULL;
}

static inline struct vec3 random_direction(struct rng *r)
{
    const double y = 2.0 * rng_next(r) - 1.0, phi = 2.0 * PI * rng_next(r), s = sqrt(1.0 - y * y);
    return vec3_make((float)(s * sin(phi)), (float)y, (float)(s * cos(phi)));
}

/* Normals all over the sphere, viewers above them. */
static inline void points_scatter(struct gbuffer *g, uint64_t seed)
{
    struct rng r = { seed };
    for (uint32_t i = 0; i < g->packet_count; i++)
        for (int l = 0; l < PACKET; l++) {
            struct shade_packet *p = &g->packets[i];
            const struct vec3 n = random_direction(&r);
            struct vec3 o = random_direction(&r);
            if (vec3_dot(n, o) < 0.0f)
                o = vec3_scale(o, -1.0f);
            p->ns_x[l] = p->ng_x[l] = n.x;
            p->ns_y[l] = p->ng_y[l] = n.y;
            p->ns_z[l] = p->ng_z[l] = n.z;
            p->wo_x[l] = o.x;
            p->wo_y[l] = o.y;
            p->wo_z[l] = o.z;
        }
}

static inline const struct kernels *best_kernels(void)
{
    const struct kernels *k;
    struct reason why;
    assert_int_equal(kernels_select(NULL, &k, &why), ERR_OK);
    return k;
}

/* Shades without visibility into lo[packet_count][3][16]. */
static inline struct direct_stats shade(struct direct *d, const struct gbuffer *g, const struct environment *e,
                                        enum method m, uint32_t samples, uint64_t seed, float *lo)
{
    struct direct_stats stats;
    const struct direct_desc desc = { .method = m, .samples = samples, .seed = seed, .no_visibility = true };
    assert_int_equal(direct_shade(d, g, NULL, e, &desc, lo, &stats), ERR_OK);
    return stats;
}
