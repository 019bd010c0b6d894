#include "light/inspector/inspector.h"

#include "base/mem.h"
#include "base/rng.h"
#include "light/estimators/eye_paths.h"

#include <math.h>
#include <string.h>

#define PATHS 2048 /* of each estimate and class, shared by the pixel's points */
#define PATHS_LEAST 16
#define PARTS_SEED 0x7061727473u /* independent of the frame's own random numbers */

static const uint32_t class_of[INSPECT_PARTS] = { PATH_DIRECT, PATH_INDIRECT, PATH_CAUSTICS, PATH_BACKGROUND };

/* The pixel's shading points. Each fills all lanes of a packet, which are thus PACKET independent estimates. */
struct points {
    struct gbuffer g;
    const struct gbuffer_entry *entries; /* [g.packet_count] */
    float *lo;                           /* [g.packet_count][3][PACKET] */
};

/* False when out of memory; call points_finish even then. */
static bool points_init(struct points *p, const struct inspect_desc *desc)
{
    const struct gbuffer *g = desc->gbuffer;
    const size_t pixel = (size_t)desc->y * g->width + desc->x;
    const uint32_t count = g->entry_first[pixel + 1] - g->entry_first[pixel];

    *p = (struct points){ .g = *g, .entries = g->entries + g->entry_first[pixel] };
    p->g.packet_count = count;
    p->g.packets = mem_alloc(count, sizeof(*p->g.packets));
    p->lo = mem_alloc(count, 3 * PACKET * sizeof(float));
    if (!p->g.packets || !p->lo)
        return false;
    for (uint32_t k = 0; k < count; k++) {
        const uint32_t point = p->entries[k].point;
        const struct shade_packet *from = &g->packets[point / PACKET];
        p->g.packets[k] = *from;
        p->g.packets[k].count = PACKET;
        for (uint32_t l = 0; l < PACKET; l++)
            shade_packet_put(&p->g.packets[k], l, from, point % PACKET, -1);
    }
    return true;
}

/* What the camera sees on the ground is not the ground's own light (light/resolve/resolve.h). */
static bool is_on_ground(const struct points *p, const struct scene *scene)
{
    bool any = false;

    for (uint32_t k = 0; k < p->g.packet_count; k++)
        any = any || scene->materials[p->g.packets[k].material[0]].ground;
    return any;
}

static void take_mean(const struct points *p, struct inspect_mean *out)
{
    for (uint32_t c = 0; c < 3; c++) {
        double sum = 0.0, squares = 0.0;
        for (uint32_t l = 0; l < PACKET; l++) {
            double one = 0.0;
            for (uint32_t k = 0; k < p->g.packet_count; k++)
                one += (double)p->entries[k].weight[c] * (double)p->lo[((size_t)k * 3 + c) * PACKET + l];
            sum += one;
            squares += one * one;
        }
        const double mean = sum / PACKET, spread = squares / PACKET - mean * mean;
        out->mean[c] = mean;
        out->error[c] = sqrt((spread > 0.0 ? spread : 0.0) / (PACKET - 1));
    }
    out->estimates = PACKET;
}

static enum err trace(struct points *p, const struct inspect_desc *desc, uint32_t classes, struct inspect_mean *out)
{
    const uint32_t each = PATHS / p->g.packet_count;
    const struct eye_paths_desc paths = {
        .classes = classes,
        .behind_classes = classes,
        .paths = each > PATHS_LEAST ? each : PATHS_LEAST,
        .seed = rng_mix(rng_mix(desc->direct.seed, PARTS_SEED), classes),
    };
    struct eye_paths_stats stats;

    memset(p->lo, 0, (size_t)p->g.packet_count * 3 * PACKET * sizeof(float));
    const enum err e = eye_paths_shade(desc->scene, desc->rays, &p->g, desc->environment, &paths, p->lo, &stats);
    if (!e)
        take_mean(p, out);
    return e;
}

/* Shares of the luminance. */
static void fill_shares(struct inspect_parts *parts)
{
    double all = 0.0;

    for (int k = 0; k < INSPECT_PARTS; k++) {
        const double *m = parts->of[k].mean;
        parts->share[k] = (double)rgb_luminance((float)m[0], (float)m[1], (float)m[2]);
        all += parts->share[k];
    }
    for (int k = 0; k < INSPECT_PARTS; k++)
        parts->share[k] = all > 0.0 ? parts->share[k] / all : 0.0;
}

static enum err divide(struct points *p, const struct inspect_desc *desc, struct inspect_result *a)
{
    struct inspect_parts *parts = &a->parts;
    struct inspect_mean *of = parts->of;
    enum err e = ERR_OK;

    for (int c = 0; c < 3; c++) {
        of[INSPECT_DIRECT].mean[c] = a->reference.mean[c] - (double)a->background[c];
        of[INSPECT_DIRECT].error[c] = a->reference.error[c];
        of[INSPECT_BACKGROUND].mean[c] = (double)a->background[c];
    }
    of[INSPECT_DIRECT].estimates = a->reference.estimates;
    for (int k = 0; k < INSPECT_PARTS; k++)
        if (!(parts->classes & class_of[k]))
            of[k] = (struct inspect_mean){ .estimates = 0 };
    for (int k = INSPECT_INDIRECT; k <= INSPECT_CAUSTICS && !e; k++)
        if (parts->classes & class_of[k] && p->g.packet_count > 0)
            e = trace(p, desc, parts->classes & class_of[k], &of[k]);
    fill_shares(parts);
    return e;
}

enum err inspect_divide(const struct inspect_desc *desc, struct inspect_result *a)
{
    struct points p;
    enum err e = points_init(&p, desc) ? ERR_OK : ERR_NOMEM;

    a->parts = (struct inspect_parts){ .classes = desc->classes ? desc->classes : PATH_BACKGROUND | PATH_DIRECT };
    a->parts.known = !e && !is_on_ground(&p, desc->scene);
    if (a->parts.known)
        e = divide(&p, desc, a);
    mem_free(p.g.packets);
    mem_free(p.lo);
    return e;
}

bool inspect_has_part(const struct inspect_parts *parts, enum inspect_part part)
{
    return parts->known && parts->classes & class_of[part];
}
