#include "light/inspector/inspector.h"

#include "base/mem.h"
#include "base/rng.h"
#include "scene/geometry/scatter_hit.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#define ESTIMATES 16                 /* maximum number of reference estimates */
#define ESTIMATES_MIN 6              /* minimum, if a pixel has many packets */
#define WORK 48                      /* packets to shade for the reference, approximately */
#define REFERENCE_SEED 0x70726f6265u /* independent of the frame's own random numbers */
#define FIGURE_DIFFUSE 0.3f          /* albedos; chosen, not measured */
#define FIGURE_SPECULAR 0.5f

struct inspection {
    struct direct *direct;
    float *lo; /* as large as the G-buffer's; only the pixel's packets are written */
    uint32_t lo_packets;
    uint32_t *packets; /* [packet_room] */
    uint32_t packet_room;
    struct direct_log log;
    struct shade_packet figure; /* the shading point with the preset's material */
};

struct inspection *inspect_create(const struct kernels *kernels)
{
    struct inspection *p = mem_alloc(1, sizeof(*p));

    if (!p)
        return NULL;
    p->direct = direct_create(kernels);
    if (!p->direct) {
        inspect_destroy(p);
        return NULL;
    }
    return p;
}

void inspect_destroy(struct inspection *p)
{
    if (!p)
        return;
    direct_destroy(p->direct);
    direct_log_finish(&p->log);
    mem_free(p->lo);
    mem_free(p->packets);
    mem_free(p);
}

/* ---- The pixel ---- */

static size_t pixel_of(const struct inspect_desc *desc)
{
    return (size_t)desc->y * desc->gbuffer->width + desc->x;
}

static float weight_of(const float weight[3])
{
    return weight[0] + weight[1] + weight[2];
}

static void find_parts(const struct inspect_desc *desc, struct inspect_result *out)
{
    const struct gbuffer *g = desc->gbuffer;
    const size_t pixel = pixel_of(desc);
    float best = 0.0f, best_miss = 0.0f;

    out->points = g->entry_first[pixel + 1] - g->entry_first[pixel];
    out->misses = g->miss_first[pixel + 1] - g->miss_first[pixel];
    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *entry = &g->entries[k];
        const float weight = weight_of(entry->weight);
        if (weight > best || k == g->entry_first[pixel]) {
            best = weight;
            out->point = entry->point;
            memcpy(out->weight, entry->weight, sizeof(out->weight));
        }
    }
    for (uint32_t k = g->miss_first[pixel]; k < g->miss_first[pixel + 1]; k++) {
        const float weight = weight_of(g->misses[k].weight);
        if (weight > best_miss || k == g->miss_first[pixel]) {
            best_miss = weight;
            out->miss = g->misses[k].direction;
        }
    }
}

static void find_first(const struct inspect_desc *desc, struct inspect_result *out)
{
    const struct view *v = desc->view;
    const struct vec3 origin = vec3_make((float)v->origin[0], (float)v->origin[1], (float)v->origin[2]);
    const struct vec3 dir = view_direction(v, desc->x + 0.5, desc->y + 0.5);
    struct hit hit;

    out->hit = view_sees(v, desc->x + 0.5, desc->y + 0.5) && rays_intersect(desc->rays, origin, dir, 0.0f, &hit);
    if (!out->hit)
        return;
    rays_surface(desc->rays, &hit, vec3_scale(dir, -1.0f), &out->first.surface);
    scatter_on(desc->scene, &hit, NULL, &out->first);
}

/* Lists the pixel's packets without duplicates. */
static enum err list_packets(struct inspection *p, const struct inspect_desc *desc, struct packet_list *list)
{
    const struct gbuffer *g = desc->gbuffer;
    const uint32_t first = g->entry_first[pixel_of(desc)], last = g->entry_first[pixel_of(desc) + 1];
    uint32_t count = 0;

    if (last - first > p->packet_room) {
        mem_free(p->packets);
        p->packet_room = 0;
        p->packets = mem_alloc(last - first, sizeof(*p->packets));
        if (!p->packets)
            return ERR_NOMEM;
        p->packet_room = last - first;
    }
    for (uint32_t k = first; k < last; k++) {
        const uint32_t packet = g->entries[k].point / PACKET;
        uint32_t i = 0;
        while (i < count && p->packets[i] != packet)
            i++;
        p->packets[i] = packet;
        count += i == count;
    }
    *list = (struct packet_list){ p->packets, count };
    return ERR_OK;
}

/* Reserves room for all packets, since direct_shade writes each to its own place; untouched pages take no memory. */
static enum err reserve_lo(struct inspection *p, const struct gbuffer *g)
{
    if (g->packet_count <= p->lo_packets)
        return ERR_OK;
    mem_free(p->lo);
    p->lo_packets = 0;
    p->lo = mem_alloc_raw(g->packet_count, 3 * PACKET * sizeof(float));
    if (!p->lo)
        return ERR_NOMEM;
    p->lo_packets = g->packet_count;
    return ERR_OK;
}

static void read_point(const float *lo, uint32_t point, float rgb[3])
{
    for (int c = 0; c < 3; c++)
        rgb[c] = lo[((size_t)(point / PACKET) * 3 + (size_t)c) * PACKET + point % PACKET];
}

/* In the order of resolve_pixels. */
static void sum_entries(const struct inspection *p, const struct inspect_desc *desc, float sum[3])
{
    const struct gbuffer *g = desc->gbuffer;
    const size_t pixel = pixel_of(desc);

    sum[0] = sum[1] = sum[2] = 0.0f;
    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        float rgb[3];
        read_point(p->lo, g->entries[k].point, rgb);
        for (int c = 0; c < 3; c++)
            sum[c] += g->entries[k].weight[c] * rgb[c];
    }
}

static void add_misses(const struct inspect_desc *desc, float sum[3], float background[3])
{
    const struct gbuffer *g = desc->gbuffer;
    const size_t pixel = pixel_of(desc);

    if (g->miss_first[pixel + 1] > g->miss_first[pixel])
        environment_complete_pyramid(desc->environment);
    for (uint32_t k = g->miss_first[pixel]; k < g->miss_first[pixel + 1]; k++) {
        const struct gbuffer_miss *miss = &g->misses[k];
        float rgb[3];
        environment_lookup_wide(desc->environment, miss->direction, miss->width, rgb);
        for (int c = 0; c < 3; c++) {
            sum[c] += miss->weight[c] * rgb[c];
            background[c] += miss->weight[c] * rgb[c];
        }
    }
}

/* ---- Visibility ---- */

void inspect_map_direction(uint32_t column, uint32_t row, float w[3])
{
    const double phi = PI - 2.0 * PI * (column + 0.5) / INSPECT_MAP_WIDTH,
                 theta = PI * (row + 0.5) / INSPECT_MAP_HEIGHT;

    w[0] = (float)(sin(theta) * sin(phi));
    w[1] = (float)cos(theta);
    w[2] = (float)(sin(theta) * cos(phi));
}

static double cosine_with(const float x, const float y, const float z, const float w[3])
{
    return (double)x * w[0] + (double)y * w[1] + (double)z * w[2];
}

/* Whether the direction is above the surface. *cosine: with the shading normal. */
static bool is_above(const struct shade_packet *at, const float w[3], double *cosine)
{
    *cosine = cosine_with(at->ns_x[0], at->ns_y[0], at->ns_z[0], w);
    return *cosine > 0.0 && cosine_with(at->ng_x[0], at->ng_y[0], at->ng_z[0], w) > 0.0;
}

/* Traces sixteen cells of a row at a time. */
static void look_at_cells(const struct inspect_desc *desc, const struct shade_packet *at, uint32_t row, uint32_t first,
                          uint8_t *out, double cosine[PACKET])
{
    struct ray16 rays;
    _Alignas(64) int32_t valid[PACKET];

    memset(&rays, 0, sizeof(rays));
    for (uint32_t l = 0; l < PACKET; l++) {
        float w[3];
        inspect_map_direction(first + l, row, w);
        valid[l] = is_above(at, w, &cosine[l]) ? -1 : 0;
        rays.org_x[l] = at->x[0];
        rays.org_y[l] = at->y[0];
        rays.org_z[l] = at->z[0];
        rays.dir_x[l] = w[0];
        rays.dir_y[l] = w[1];
        rays.dir_z[l] = w[2];
        rays.tfar[l] = INFINITY;
        rays.mask[l] = UINT32_MAX;
    }
    if (!desc->direct.no_visibility)
        rays_occluded16(desc->rays, RAYS_APART, valid, &rays);
    for (uint32_t l = 0; l < PACKET; l++)
        out[l] = valid[l] == 0 ? INSPECT_BEHIND : rays.tfar[l] > 0.0f ? INSPECT_OPEN : INSPECT_BLOCKED;
}

static void look_around(const struct inspect_desc *desc, struct inspect_result *out)
{
    double above = 0.0, open = 0.0, cosines = 0.0, open_cosines = 0.0, cosine[PACKET];

    for (uint32_t row = 0; row < INSPECT_MAP_HEIGHT; row++) {
        const double area = sin(PI * (row + 0.5) / INSPECT_MAP_HEIGHT);
        for (uint32_t first = 0; first < INSPECT_MAP_WIDTH; first += PACKET) {
            look_at_cells(desc, &out->lane0, row, first, &out->map[row][first], cosine);
            for (uint32_t l = 0; l < PACKET; l++) {
                const uint8_t sight = out->map[row][first + l];
                above += sight != INSPECT_BEHIND ? area : 0.0;
                open += sight == INSPECT_OPEN ? area : 0.0;
                cosines += sight != INSPECT_BEHIND ? area * cosine[l] : 0.0;
                open_cosines += sight == INSPECT_OPEN ? area * cosine[l] : 0.0;
            }
        }
    }
    out->open = above > 0.0 ? open / above : 0.0;
    out->open_cosine = cosines > 0.0 ? open_cosines / cosines : 0.0;
}

/* ---- Estimates ---- */

static struct direct_desc choose_method(const struct inspect_desc *desc)
{
    const enum method asked = desc->direct.method;
    struct direct_desc d = desc->direct;

    if (desc->figure ||
        !(asked == METHOD_MIS || asked == METHOD_AUTO || asked == METHOD_FACES || asked == METHOD_FACES_UNIFORM))
        d.method = METHOD_MIS;
    d.samples = desc->figure ? PROBE_FIGURE_SAMPLES : d.samples;
    d.samples = d.samples < INSPECT_SAMPLES_MAX ? d.samples : INSPECT_SAMPLES_MAX;
    if (desc->figure) /* the paper's method and samples */
        d = (struct direct_desc){ .method = d.method,
                                  .samples = d.samples,
                                  .seed = d.seed,
                                  .pass = d.pass,
                                  .no_visibility = d.no_visibility,
                                  .cancel = d.cancel,
                                  .why = d.why };
    d.only = NULL;
    d.keep = false;
    d.counts = NULL;
    d.log = NULL;
    return d;
}

/* Mean and standard error of independent estimates, of the pixel and of the shading point at once. */
static enum err estimate(struct inspection *p, const struct inspect_desc *desc, const struct packet_list *list,
                         uint32_t point, struct inspect_result *out)
{
    uint32_t n = WORK / list->count;
    double sum[2][3] = { { 0 } }, squares[2][3] = { { 0 } };
    struct direct_desc d = choose_method(desc);
    struct direct_stats stats;

    n = n < ESTIMATES_MIN ? ESTIMATES_MIN : n > ESTIMATES ? ESTIMATES : n;
    d.method = METHOD_AUTO;
    d.samples = INSPECT_SAMPLES_MAX;
    d.seed = rng_mix(d.seed, REFERENCE_SEED);
    d.cells = 0;
    d.only = list;
    for (uint32_t k = 0; k < n; k++) {
        float rgb[2][3];
        d.pass = k;
        d.keep = k > 0;
        const enum err e = direct_shade(p->direct, desc->gbuffer, desc->rays, desc->environment, &d, p->lo, &stats);
        if (e)
            return e;
        sum_entries(p, desc, rgb[0]);
        read_point(p->lo, point, rgb[1]);
        for (int i = 0; i < 6; i++) {
            sum[i / 3][i % 3] += rgb[i / 3][i % 3];
            squares[i / 3][i % 3] += (double)rgb[i / 3][i % 3] * rgb[i / 3][i % 3];
        }
    }
    for (int i = 0; i < 6; i++) {
        struct inspect_mean *m = i < 3 ? &out->reference : &out->lo_reference;
        const double mean = sum[i / 3][i % 3] / n, spread = squares[i / 3][i % 3] / n - mean * mean;
        m->mean[i % 3] = mean;
        m->error[i % 3] = sqrt((spread > 0.0 ? spread : 0.0) / (n - 1));
        m->estimates = n;
    }
    return ERR_OK;
}

/* A G-buffer with only this point, with the preset's material. */
static void make_figure(struct inspection *p, const struct inspect_desc *desc, const struct inspect_result *out,
                        struct gbuffer *g)
{
    const struct shade_packet *from = &desc->gbuffer->packets[out->point / PACKET];

    p->figure = *from;
    p->figure.kind = LOBE_PHONG;
    p->figure.count = 1;
    for (uint32_t l = 0; l < PACKET; l++) {
        shade_packet_put(&p->figure, l, from, out->point % PACKET, l == 0 ? -1 : 0);
        p->figure.gloss[l] = PROBE_FIGURE_EXPONENT;
        for (int c = 0; c < 3; c++) {
            p->figure.diffuse[c][l] = FIGURE_DIFFUSE;
            p->figure.specular[c][l] = FIGURE_SPECULAR;
        }
    }
    *g = *desc->gbuffer;
    g->packets = &p->figure;
    g->packet_count = 1;
    g->point_count = 1;
}

static enum err run_point(struct inspection *p, const struct inspect_desc *desc, const struct packet_list *list,
                          uint32_t point, struct inspect_result *out)
{
    struct direct_desc d = choose_method(desc);
    struct direct_stats stats;

    out->lane0 = desc->gbuffer->packets[point / PACKET];
    shade_packet_put(&out->lane0, 0, &desc->gbuffer->packets[point / PACKET], point % PACKET, -1);
    d.only = list;
    d.log = &p->log;
    p->log.packet = point / PACKET;
    p->log.lane = point % PACKET;
    const enum err e = direct_shade(p->direct, desc->gbuffer, desc->rays, desc->environment, &d, p->lo, &stats);
    if (e)
        return e;
    out->log = p->log;
    read_point(p->lo, point, out->lo);
    sum_entries(p, desc, out->radiance);
    look_around(desc, out);
    return estimate(p, desc, list, point, out);
}

static enum err run_figure(struct inspection *p, const struct inspect_desc *desc, struct inspect_result *out)
{
    static const uint32_t zero = 0, entry_first[] = { 0, 0 };
    struct gbuffer g;
    struct inspect_desc d = *desc;

    make_figure(p, desc, out, &g);
    g.entry_first = (uint32_t *)entry_first; /* a pixel without shading points: only the point is requested */
    g.width = g.height = 1;
    d.gbuffer = &g;
    d.x = d.y = 0;
    return run_point(p, &d, &(struct packet_list){ &zero, 1 }, 0, out);
}

enum err inspect_run(struct inspection *p, const struct inspect_desc *desc, struct inspect_result *out)
{
    const struct direct_desc d = choose_method(desc);
    struct packet_list list;

    assert(desc->x < desc->gbuffer->width && desc->y < desc->gbuffer->height && desc->environment->ready);
    *out = (struct inspect_result){ .method = d.method, .samples = d.samples };
    find_parts(desc, out);
    find_first(desc, out);
    enum err e = reserve_lo(p, desc->gbuffer);
    if (!e)
        e = list_packets(p, desc, &list);
    if (!e && out->points > 0)
        e = desc->figure ? run_figure(p, desc, out) : run_point(p, desc, &list, out->point, out);
    if (e)
        return e;
    add_misses(desc, out->radiance, out->background);
    for (int c = 0; c < 3; c++)
        out->reference.mean[c] += out->background[c];
    return desc->figure ? ERR_OK : inspect_divide(desc, out);
}
