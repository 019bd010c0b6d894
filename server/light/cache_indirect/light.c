/* The records: their positions, their direct light from the sky, and the light exchanged between them. */
#include "light/cache_indirect/internal.h"

#include "base/cancel.h"
#include "base/denormals.h"
#include "base/half.h"
#include "base/mem.h"
#include "base/precedence.h"

#include <cblas.h>

#include <math.h>
#include <string.h>

#define ANGLE 0.015f        /* initial size of a voxel / distance */
#define RECORDS_LEAST 4000u /* bound the time of a start; in between, half the points */
#define RECORDS_MOST 24000u
#define PROBES 16u /* rays that search for surfaces, per record */
#define BOUNCES_MOST 64u
#define REST 1e-3 /* share of the energy that further bounces may have: most of it is outdoors, rooms have more */

/* ---- Places ---- */

static void move_spots(struct indirect_spots *to, struct indirect_spots *from)
{
    if (to->failed || from->failed || from->count == 0) {
        to->failed |= from->failed;
        return;
    }
    struct indirect_spot *at = mem_grow(to->at, to->count, to->count + from->count, sizeof(*at));
    if (!at) {
        to->failed = true;
        return;
    }
    memcpy(at + to->count, from->at, from->count * sizeof(*at));
    to->at = at;
    to->count = to->capacity = to->count + from->count;
    from->count = 0;
}

static void probe(const struct indirect_world *w, const struct indirect_spot *from, uint64_t seed,
                  struct indirect_ends *ends)
{
    struct rng rng = { seed };
    const double x[2] = { rng_next(&rng), rng_next(&rng) };
    const uint32_t before = w->found->count;
    struct vec3 dir;
    float weight;

    if (!indirect_leave(from, x, &dir, &weight))
        return;
    indirect_walk(w, from->at, dir, &rng, ends);
    for (uint32_t k = before; k < w->found->count; k++)
        w->found->at[k].order = rng_next(&rng) * 0x1p63;
}

static struct indirect_spot spot_of_lane(const struct shade_packet *p, uint32_t l)
{
    return (struct indirect_spot){ .at = { p->x[l], p->y[l], p->z[l] },
                                   .geometric = { p->ng_x[l], p->ng_y[l], p->ng_z[l] },
                                   .shading = { p->ns_x[l], p->ns_y[l], p->ns_z[l] },
                                   .kind = LOBE_LAMBERT };
}

/* Traces rays from the shade points, evenly over all of them, and then from the hits of the first rays. */
static void probe_all(struct indirect_build *b, struct indirect_spots *all, bool second)
{
    const uint32_t probes = PROBES * b->most;
    const struct gbuffer *g = b->desc->gbuffer;
    const uint32_t from = second ? all->count : g->packet_count * PACKET;
    const uint32_t each = second ? 1 : probes / (from ? from : 1) + 1;
    const uint32_t step = second ? 1 : from / probes + 1;
    struct indirect_spots found_by_all = { .at = NULL };
    uint64_t rays = 0;

#pragma omp parallel reduction(+ : rays)
    {
        const unsigned before = denormals_flush();
        struct indirect_spots found = { .at = NULL };
        struct indirect_ends ends = { .at = NULL };
        const struct indirect_world w = { b->desc->scene, b->desc->rays, &b->records, &found };
#pragma omp for schedule(dynamic, 256)
        for (uint32_t i = 0; i < from; i += step) {
            const struct shade_packet *p = second ? NULL : &g->packets[i / PACKET];
            if (is_cancelled(b->desc->cancel) || (p && i % PACKET >= p->count))
                continue;
            const struct indirect_spot spot = second ? all->at[i] : spot_of_lane(p, i % PACKET);
            for (uint32_t k = 0; k < each; k++)
                probe(&w, &spot,
                      rng_mix(rng_mix(b->desc->seed, second ? 1 : 2), second ? spot.order : (uint64_t)i * each + k),
                      &ends);
        }
        rays += ends.rays;
#pragma omp critical
        move_spots(&found_by_all, &found);
        mem_free(found.at);
        denormals_restore(before);
    }
    move_spots(all, &found_by_all);
    mem_free(found_by_all.at);
    b->rays += rays;
}

enum err indirect_find_records(struct indirect_build *b)
{
    const struct indirect_desc *d = b->desc;
    struct indirect_spots all = { .at = NULL };
    enum err e = ERR_NOMEM;

    /* half the number of points: each record is then hit by a hundred rays or more */
    const uint64_t fair = d->gbuffer->point_count / 2;
    b->most = d->records             ? d->records
              : b->effort->records   ? b->effort->records
              : fair < RECORDS_LEAST ? RECORDS_LEAST
              : fair > RECORDS_MOST  ? RECORDS_MOST
                                     : (uint32_t)fair;
    b->records.eye = d->eye;
    b->records.angle = ANGLE;
    probe_all(b, &all, false);
    if (!all.failed)
        probe_all(b, &all, true);
    if (!all.failed)
        e = indirect_records_init(&b->records, &all, b->most);
    b->b->stats.records = b->records.count;
    mem_free(all.at);
    return e;
}

/* ---- Direct light ---- */

/* Both halves of the packet are the record's spots. */
static void set_origins(const struct indirect_spot *spots, struct ray16 *ray)
{
    memset(ray, 0, sizeof(*ray));
    for (uint32_t l = 0; l < PACKET; l++) {
        ray->org_x[l] = spots[l % INDIRECT_SPOTS].at.x;
        ray->org_y[l] = spots[l % INDIRECT_SPOTS].at.y;
        ray->org_z[l] = spots[l % INDIRECT_SPOTS].at.z;
        ray->mask[l] = UINT32_MAX;
    }
}

uint32_t indirect_direction(uint32_t cell, uint64_t turn, uint32_t l, uint32_t *which)
{
    const uint32_t spot = (l ^ (uint32_t)turn) % INDIRECT_SPOTS, random = (uint32_t)(turn >> (8 + 2 * l)) % 4;

    *which = 2 * (l / INDIRECT_SPOTS) + spot % 2;
    const uint32_t quarter = ((uint32_t)(turn >> (40 + 2 * *which)) ^ spot / 2) % 4;
    return (cell + *which) * PACKET + (2 * (quarter / 2) + random / 2) * INDIRECT_SIDE + 2 * (quarter % 2) + random % 2;
}

/* As indirect_direction, or each lane looks through a cell of its own. */
static uint32_t direction(const struct indirect_build *b, uint32_t cell, uint64_t turn, uint32_t l, uint32_t *which)
{
    if (b->effort->cells < PACKET)
        return indirect_direction(cell, turn, l, which);
    *which = l;
    return (cell + l) * PACKET + (uint32_t)(turn >> 4 * l) % PACKET;
}

/* Traces four directions from each spot of a record, through effort.cells neighbouring cells, in the order of sky_cell:
 * out[cell] is the mean of cos / pi (of the share that enters the matte part) times the solid angle. */
static void light_by(const struct indirect_build *b, const struct indirect_spot *spots, struct ray16 *ray,
                     uint32_t cell, float out[PACKET], uint64_t *rays)
{
    const uint64_t turn = rng_mix(spots->key, cell);
    _Alignas(64) int32_t valid[PACKET];
    float value[PACKET];
    uint32_t which[PACKET], count = 0;

    for (uint32_t l = 0; l < PACKET; l++) {
        const uint32_t at = direction(b, cell, turn, l, &which[l]);
        const float x = b->directions.x[at], y = b->directions.y[at], z = b->directions.z[at];
        const struct indirect_spot *s = &spots[l % INDIRECT_SPOTS];
        const float above = s->geometric.x * x + s->geometric.y * y + s->geometric.z * z;
        const float cosine = s->shading.x * x + s->shading.y * y + s->shading.z * z;
        valid[l] = above > 0.0f && cosine > 0.0f ? -1 : 0;
        value[l] = cosine * lobe_enters_single(s->kind, cosine) * b->directions.weight[at];
        count += valid[l] != 0;
        ray->dir_x[l] = x;
        ray->dir_y[l] = y;
        ray->dir_z[l] = z;
        ray->tfar[l] = INFINITY;
    }
    memset(out, 0, PACKET * sizeof(*out));
    if (count == 0)
        return;
    rays_occluded16(b->desc->rays, RAYS_TOGETHER, valid, ray);
    *rays += count;
    for (uint32_t l = 0; l < PACKET; l++) /* weights are for all of a cell's directions; 16 / cells are traced */
        out[which[l]] += valid[l] && ray->tfar[l] > 0.0f ? value[l] * (float)(b->effort->cells / PI) : 0.0f;
}

static uint64_t light_record(const struct indirect_build *b, uint32_t r)
{
    const struct indirect_spot *spots = b->records.spots + (size_t)r * INDIRECT_SPOTS;
    uint16_t *light = b->light + (size_t)r * SKY_CELLS;
    struct ray16 ray;
    uint64_t rays = 0;

    precedence_give_way(b->desc->urgent);
    set_origins(spots, &ray);
    for (uint32_t c = 0; c < SKY_CELLS; c += b->effort->cells) {
        float out[PACKET];
        light_by(b, spots, &ray, c, out, &rays);
        for (uint32_t k = 0; k < b->effort->cells; k++)
            light[c + k] = half_round(out[k]);
    }
    return rays;
}

enum err indirect_light_records(struct indirect_build *b)
{
    const uint32_t records = b->records.count;
    uint64_t rays = 0;

    b->light = mem_alloc(((size_t)records + 1) * SKY_CELLS, sizeof(*b->light));
    if (!b->light)
        return ERR_NOMEM;
#pragma omp parallel for schedule(dynamic, 32) reduction(+ : rays)
    for (uint32_t r = 0; r < records; r++) {
        if (is_cancelled(b->desc->cancel) || !cache_share_computes(b->desc->share, r / 2)) /* processes share pairs */
            continue;
        rays += light_record(b, r);
    }
    b->own_rays += rays;
    return ERR_OK;
}

/* ---- Light between records ---- */

static void trace_record(const struct indirect_build *b, const struct indirect_world *w, uint32_t r,
                         struct indirect_ends *ends)
{
    const uint32_t rays = INDIRECT_SPOTS * b->effort->exchange;

    precedence_give_way(b->desc->urgent);
    for (uint32_t k = 0; k < rays; k++) {
        const struct indirect_spot *s = &b->records.spots[(size_t)r * INDIRECT_SPOTS + k % INDIRECT_SPOTS];
        const uint64_t seed = rng_mix(b->desc->seed, s->key);
        struct rng rng = { rng_mix(seed, k) };
        const uint32_t before = ends->count;
        struct vec3 dir;
        double x[2];
        float weight;
        rng_sobol2(seed, k, x);
        if (!indirect_leave(s, x, &dir, &weight))
            continue;
        indirect_walk(w, s->at, dir, &rng, ends);
        for (uint32_t i = before; i < ends->count; i++)
            for (int c = 0; c < 3; c++)
                ends->at[i].weight[c] *= weight / (float)rays;
    }
}

static bool trace_exchange(struct indirect_build *b, struct indirect_ends *all)
{
    const struct indirect_world w = { b->desc->scene, b->desc->rays, &b->records, NULL };
    uint64_t rays = 0;
    int failed = 0;

#pragma omp parallel for schedule(dynamic, 16) reduction(+ : rays, failed)
    for (uint32_t r = 0; r < b->records.count; r++) {
        if (is_cancelled(b->desc->cancel))
            continue;
        trace_record(b, &w, r, &all[r]);
        rays += all[r].rays;
        failed += all[r].failed;
    }
    b->rays += rays;
    return failed == 0;
}

/* Direct light in the basis, the same for each colour, followed by the cells' own rows. */
static void project_light(const struct indirect_build *b, float *out)
{
    const uint32_t k = b->b->basis.count, records = b->records.count;
    const float *rows = b->b->basis.rows;

#pragma omp parallel for schedule(static)
    for (uint32_t first = 0; first < records; first += 16) {
        const uint32_t n = first + 16 < records ? 16 : records - first;
        float *to = out + (size_t)first * 3 * k, light[16 * SKY_CELLS];
        for (size_t i = 0; i < (size_t)n * SKY_CELLS; i++)
            light[i] = half_widen(b->light[(size_t)first * SKY_CELLS + i]);
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, (int)n, (int)k, SKY_CELLS, 1.0f, light, SKY_CELLS, rows,
                    SKY_CELLS, 0.0f, to, 3 * (int)k);
        for (uint32_t r = 0; r < n; r++)
            for (int c = 1; c < 3; c++)
                memcpy(to + ((size_t)r * 3 + (size_t)c) * k, to + (size_t)r * 3 * k, k * sizeof(float));
    }
    for (uint32_t cell = 0; cell < SKY_CELLS; cell++)
        for (uint32_t c = 0; c < 3; c++)
            for (uint32_t i = 0; i < k; i++)
                out[((size_t)(records + cell) * 3 + c) * k + i] = rows[(size_t)i * SKY_CELLS + cell];
}

/* next = light + one bounce of `now`. square: sums of squares of the change, and of the result. */
static void indirect_once(const struct indirect_build *b, const struct indirect_ends *all, const float *light,
                          const float *now, float *next, double square[2])
{
    const uint32_t records = b->records.count, k = b->b->basis.count;
    const size_t row = 3 * (size_t)k;
    double *part = mem_alloc(2 * (size_t)records, sizeof(*part)); /* summed in a fixed order */

#pragma omp parallel for schedule(dynamic, 64)
    for (uint32_t r = 0; r < records; r++) {
        float *to = next + r * row;
        memcpy(to, light + r * row, row * sizeof(float));
        for (uint32_t i = 0; i < all[r].count; i++)
            indirect_kernels_of(b->b->kernels)->add(to, now + all[r].at[i].source * row, all[r].at[i].weight, k);
        for (size_t i = 0; i < row && part; i++) {
            const double d = (double)to[i] - (double)now[r * row + i];
            part[2 * r] += d * d;
            part[2 * r + 1] += (double)to[i] * (double)to[i];
        }
    }
    square[0] = square[1] = 0.0;
    for (uint32_t r = 0; r < records && part; r++) {
        square[0] += part[2 * r];
        square[1] += part[2 * r + 1];
    }
    if (!part)
        square[1] = INFINITY; /* counts as not converged */
    mem_free(part);
}

/* Iterates until the rest, estimated as a geometric series from the last two changes, is below REST. */
static void iterate(struct indirect_build *b, const struct indirect_ends *all, const float *light, float *spare)
{
    const uint32_t records = b->records.count, k = b->b->basis.count;
    const size_t row = 3 * (size_t)k;
    double before = 0.0;

    memcpy(spare + records * row, light + records * row, SKY_CELLS * row * sizeof(float));
    for (uint32_t i = 0; i < BOUNCES_MOST && !is_cancelled(b->desc->cancel); i++) {
        double square[2];
        indirect_once(b, all, light, b->sources, spare, square);
        float *swap = b->sources;
        b->sources = spare;
        spare = swap;
        b->b->stats.bounces = i + 1;
        const double changed = sqrt(square[0]), whole = sqrt(square[1]), ratio = before > 0.0 ? changed / before : 1.0;
        if (ratio < 1.0 && changed * ratio / (1.0 - ratio) <= REST * whole)
            break;
        if (!(changed > 0.0))
            break;
        before = changed;
    }
}

enum err indirect_solve(struct indirect_build *b)
{
    const size_t row = 3 * (size_t)b->b->basis.count, count = (size_t)b->records.count + SKY_CELLS;
    struct indirect_ends *all = mem_alloc(b->records.count, sizeof(*all));
    float *light = mem_alloc(count, row * sizeof(float)), *spare = mem_alloc(count, row * sizeof(float));
    enum err e = ERR_NOMEM;

    b->sources = mem_alloc(count, row * sizeof(float));
    if (all && light && spare && b->sources && trace_exchange(b, all)) {
        float *const both[2] = { b->sources, spare };
        project_light(b, light);
        memcpy(b->sources, light, count * row * sizeof(float));
        iterate(b, all, light, spare);
        spare = b->sources == both[0] ? both[1] : both[0];
        e = ERR_OK;
    }
    for (uint32_t r = 0; all && r < b->records.count; r++)
        mem_free(all[r].at);
    mem_free(all);
    mem_free(spare);
    mem_free(light);
    return e;
}
