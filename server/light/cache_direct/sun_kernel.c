/* The loops that trace the sun of a frame's sky (light/cache_direct/internal.h): compiled once per CPU level, see
 * CMakeLists.txt. */
#include "light/cache_direct/internal.h"
#include "scene/geometry/lane_rays.h"
#include "scene/surface/lobes.h"

#include <math.h>
#include <string.h>

/* The lobes of a packet with gazes, without the matte part. */
struct glints {
    struct shade_packet points;
    struct lobes lobes;
};

static void set_up_glints(const struct shade_packet *p, struct glints *s)
{
    s->points = *p;
    memset(s->points.diffuse, 0, sizeof(s->points.diffuse));
    lobes_set_up(p, &s->lobes);
    LANES(l) s->lobes.diffuse_part.v[l] = 0.0f;
}

/* Reduces the lobes' light along d to the balance heuristic's share of samples, beside that of the gazes. */
static void balance_glints(const struct glints *s, const struct transport_sun *b, const int32_t at[PACKET],
                           const struct lanes d[3], const struct lanes *cosine, struct lanes brdf[3])
{
    struct lanes lobe[3], pdf;

    lobes_evaluate(&s->lobes, &s->points, d, cosine, lobe, &pdf);
    for (int c = 0; c < 3; c++)
        LANES(l)
        {
            const float own = b->density[at[l]], theirs = TRANSPORT_GAZES * pdf.v[l];
            brdf[c].v[l] -= lobe[c].v[l] * (theirs > 0.0f ? theirs / (own + theirs) : 0.0f);
        }
}

/* A packet while its rays are traced. */
struct shining {
    const struct rays *rays; /* NULL: everything is visible */
    const struct transport_sun *sun;
    const struct shade_packet *points;
    const struct glints *glints; /* NULL: no gazes */
    struct lobes lobes;
    struct ray16 ray;
    float (*sum)[PACKET];
    struct transport_view *view;
};

/* Traces one sample per lane. Returns the number of rays. */
static uint64_t shine(struct shining *s, const int32_t at[PACKET])
{
    _Alignas(64) int32_t valid[PACKET];
    const struct transport_sun *b = s->sun;
    const struct shade_packet *p = s->points;
    struct lanes d[3], cosine, brdf[3], pdf;
    int32_t count = 0;
    uint32_t lit = 0, dark = 0;

    LANES(l)
    {
        d[0].v[l] = b->x[at[l]];
        d[1].v[l] = b->y[at[l]];
        d[2].v[l] = b->z[at[l]];
    }
    if (!lobes_see(p, d, &cosine))
        return 0;
    LANES(l)
    {
        valid[l] = cosine.v[l] > 0.0f ? p->valid[l] : 0;
        count -= valid[l];
    }
    if (count == 0)
        return 0;
    lanes_aim(d, &s->ray);
    if (s->rays)
        rays_occluded16(s->rays, RAYS_TOGETHER, valid, &s->ray);
    LANES(l)
    {
        const int32_t sees = s->ray.tfar[l] > 0.0f ? valid[l] : 0;
        lit |= (uint32_t)(sees & 1) << l;
        dark |= (uint32_t)(valid[l] & ~sees & 1) << l;
        valid[l] = sees;
    }
    s->view->lit |= lit;
    s->view->dark |= dark;
    if (lit) {
        lobes_evaluate(&s->lobes, p, d, &cosine, brdf, &pdf);
        if (s->glints)
            balance_glints(s->glints, b, at, d, &cosine, brdf);
        LANES(l)
        {
            s->sum[0][l] += valid[l] ? brdf[0].v[l] * b->r[at[l]] : 0.0f;
            s->sum[1][l] += valid[l] ? brdf[1].v[l] * b->g[at[l]] : 0.0f;
            s->sum[2][l] += valid[l] ? brdf[2].v[l] * b->b[at[l]] : 0.0f;
        }
    }
    return s->rays ? (uint64_t)count : 0;
}

/* The order of the strata of a group: the second is opposite the first. */
static const uint32_t turns[TRANSPORT_MORE] = { 0, 2, 1, 3 };

static uint64_t light(const struct rays *rays, const struct transport_sun *b, const struct shade_packet *p,
                      bool narrow, const uint32_t variant[PACKET], const struct transport_round *round,
                      float sum[3][PACKET], struct transport_view *view)
{
    struct shining s = { .rays = rays, .sun = b, .points = p, .sum = sum, .view = view };
    struct glints glints;
    uint64_t traced = 0;

    lobes_set_up(p, &s.lobes);
    if (narrow) {
        set_up_glints(p, &glints);
        s.glints = &glints;
    }
    lobes_rays(p, &s.ray);
    for (uint32_t i = round->groups[0]; i < round->groups[1]; i++)
        for (uint32_t j = round->turns[0]; j < round->turns[1]; j++) {
            int32_t at[PACKET];
            LANES(l)
            {
                const uint32_t stratum = TRANSPORT_MORE * i + (variant[l] + i + turns[j]) % TRANSPORT_MORE;
                at[l] = (int32_t)(stratum * TRANSPORT_VARIANTS + variant[l]);
            }
            traced += shine(&s, at);
        }
    return traced;
}

/* Sixteen points represent a block: every fourth of each packet, or more of fewer packets. */
static uint64_t probe(const struct rays *rays, const struct transport_sun *b, const struct shade_packet *packets,
                      uint32_t count, const uint32_t variant[PACKET], struct transport_view *view)
{
    _Alignas(64) int32_t valid[PACKET];
    struct ray16 ray = { .org_x = { 0 } };
    int32_t faced = 0;

    for (uint32_t l = 0; l < PACKET; l++) {
        const struct shade_packet *p = &packets[l % count];
        const uint32_t k = (l / count * count + l % count * 5 + l % count) % PACKET; /* other lanes in each packet */
        const uint32_t at = (l * b->strata / PACKET) * TRANSPORT_VARIANTS + variant[l];
        const float x = b->x[at], y = b->y[at], z = b->z[at];
        const bool faces = p->ns_x[k] * x + p->ns_y[k] * y + p->ns_z[k] * z > 0.0f &&
                           p->ng_x[k] * x + p->ng_y[k] * y + p->ng_z[k] * z > 0.0f;
        valid[l] = faces ? p->valid[k] : 0;
        faced -= valid[l];
        ray.org_x[l] = p->x[k];
        ray.org_y[l] = p->y[k];
        ray.org_z[l] = p->z[k];
        ray.dir_x[l] = x;
        ray.dir_y[l] = y;
        ray.dir_z[l] = z;
        ray.tfar[l] = INFINITY;
        ray.mask[l] = UINT32_MAX;
    }
    if (faced == 0)
        return 0;
    rays_occluded16(rays, RAYS_TOGETHER, valid, &ray);
    for (uint32_t l = 0; l < PACKET; l++) {
        view->lit |= (uint32_t)(valid[l] && ray.tfar[l] > 0.0f) << l;
        view->dark |= (uint32_t)(valid[l] && !(ray.tfar[l] > 0.0f)) << l;
    }
    return (uint64_t)faced;
}

static bool open(const struct transport_sun *b, const struct shade_packet *p, float sum[3][PACKET])
{
    int32_t cut = 0;
    struct lanes whole;

    LANES(l)
    {
        const float shading = p->ns_x[l] * b->axis[0] + p->ns_y[l] * b->axis[1] + p->ns_z[l] * b->axis[2];
        const float geometric = p->ng_x[l] * b->axis[0] + p->ng_y[l] * b->axis[1] + p->ng_z[l] * b->axis[2];
        const float least = shading < geometric ? shading : geometric;
        whole.v[l] = least > b->sine ? (float)(1.0 / PI) : 0.0f;
        cut |= (least <= b->sine) & (least >= -b->sine);
    }
    if (cut)
        return false;
    for (int c = 0; c < 3; c++)
        LANES(l)
        {
            const float cosine = p->ns_x[l] * b->flux[c][0] + p->ns_y[l] * b->flux[c][1] + p->ns_z[l] * b->flux[c][2];
            sum[c][l] = p->diffuse[c][l] * cosine * whole.v[l];
        }
    return true;
}

#define NEAR_SQUARE 4.0f /* points within twice their spacing are neighbours */

/* The square of the distance up to which points of a block are neighbours. A square grid of n points with spacing s has
 * variances of n s^2 / 6 in all; where a block is stretched, or lies at two depths, the distance is larger. */
static float near_square(const struct shade_packet *packets, uint32_t count)
{
    struct lanes sum[3] = { { { 0.0f } } }, square = { { 0.0f } };
    const float x = packets->x[0], y = packets->y[0], z = packets->z[0];
    float mean[3] = { 0.0f }, squares = 0.0f;

    for (uint32_t k = 0; k < count; k++)
        LANES(l)
        {
            const float dx = packets[k].x[l] - x, dy = packets[k].y[l] - y, dz = packets[k].z[l] - z;
            sum[0].v[l] += dx;
            sum[1].v[l] += dy;
            sum[2].v[l] += dz;
            square.v[l] += dx * dx + dy * dy + dz * dz;
        }
    for (uint32_t l = 0; l < PACKET; l++) {
        for (int c = 0; c < 3; c++)
            mean[c] += sum[c].v[l];
        squares += square.v[l];
    }
    const float n = (float)(count * PACKET);
    const float variance = (squares - (mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]) / n) / n;
    return variance * (NEAR_SQUARE * 6.0f / n);
}

static void edges(const struct shade_packet *packets, uint32_t count, const struct transport_view *view,
                  uint32_t near[TRANSPORT_PACKETS])
{
    const float most = near_square(packets, count);
    uint32_t lit = 0, dark = 0;

    for (uint32_t k = 0; k < count; k++) {
        near[k] = view[k].lit & view[k].dark;
        lit += (uint32_t)__builtin_popcount(view[k].lit);
        dark += (uint32_t)__builtin_popcount(view[k].dark);
    }
    const bool few_lit = lit < dark;
    for (uint32_t k = 0; k < count; k++)
        for (uint32_t few = few_lit ? view[k].lit : view[k].dark; few; few &= few - 1) {
            const uint32_t at = (uint32_t)__builtin_ctz(few);
            const float x = packets[k].x[at], y = packets[k].y[at], z = packets[k].z[at];
            bool some = false;
            for (uint32_t q = 0; q < count; q++) {
                const struct shade_packet *p = &packets[q];
                _Alignas(64) int32_t is_near[PACKET];
                uint32_t bits = 0;
                LANES(l)
                {
                    const float dx = p->x[l] - x, dy = p->y[l] - y, dz = p->z[l] - z;
                    is_near[l] = dx * dx + dy * dy + dz * dz <= most ? 1 << l : 0;
                }
                for (uint32_t l = 0; l < PACKET; l++)
                    bits |= (uint32_t)is_near[l];
                bits &= few_lit ? view[q].dark : view[q].lit;
                near[q] |= bits;
                some |= bits != 0;
            }
            near[k] |= some ? 1u << at : 0u;
        }
}

extern const struct sun_kernels KERNEL(sun_kernels);
const struct sun_kernels KERNEL(sun_kernels) = { light, open, edges, probe };
