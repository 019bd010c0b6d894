#include "light/estimators/eye_paths.h"

#include "base/cancel.h"
#include "base/denormals.h"
#include "base/half.h"
#include "base/mem.h"
#include "light/cache/cache_file.h"
#include "light/estimators/packed.h"
#include "sky/tables/sky_split.h"

#include <assert.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#define MAX_BYTES (UINT64_C(256) << 20)
#define TRIED 16 /* one packet in so many is traced first, for an estimate of the memory */
#define AHEAD 16 /* ends whose texels are prefetched */

struct end {
    uint32_t from;   /* packed direction w */
    uint16_t rgb[3]; /* T, half floats */
    uint16_t lane;
};

struct list { /* of a packet with ends */
    uint32_t packet, count;
    struct end *ends;
};
#define LIST_STORED offsetof(struct list, ends) /* bytes of it in a file */

struct eye_store {
    struct list *lists; /* ascending packets */
    uint32_t list_count;
    struct end *ends; /* of all lists, once there are all */
    struct eye_store_stats stats;
};

struct gathering {
    struct list *of; /* [packet_count] */
};

static enum err take(void *context, uint32_t packet, const struct eye_path_end *ends, uint32_t count)
{
    struct list *to = &((struct gathering *)context)->of[packet];

    to->ends = mem_alloc_raw(count, sizeof(*to->ends));
    if (!to->ends)
        return ERR_NOMEM;
    to->packet = packet;
    to->count = count;
    for (uint32_t k = 0; k < count; k++) {
        struct end *one = &to->ends[k];
        one->from = direction_pack(ends[k].dir);
        one->lane = (uint16_t)ends[k].lane;
        for (int c = 0; c < 3; c++)
            one->rgb[c] = half_round(fminf(ends[k].weight[c], 65504.0f));
    }
    return ERR_OK;
}

static enum err count_only(void *context, uint32_t packet, const struct eye_path_end *ends, uint32_t count)
{
    (void)packet;
    (void)ends;
    atomic_fetch_add((atomic_uint_fast64_t *)context, count);
    return ERR_OK;
}

/* N that the memory allows, by the ends of one path at some of the points. */
static enum err limit_paths(const struct scene *scene, const struct rays *rays, const struct gbuffer *g,
                            const struct eye_store_desc *desc, struct eye_paths_desc *eye)
{
    const uint64_t room = (desc->max_bytes ? desc->max_bytes : MAX_BYTES) / sizeof(struct end);
    struct eye_paths_desc few = *eye;
    struct eye_paths_stats stats;
    uint32_t *index = mem_alloc_raw(g->packet_count / TRIED + 1, sizeof(*index));
    struct packet_list some = { index, 0 };
    atomic_uint_fast64_t ends = 0;

    if (!index)
        return ERR_NOMEM;
    for (uint32_t i = 0; i < g->packet_count; i += TRIED)
        index[some.count++] = i;
    few.only = &some;
    few.paths = 1;
    const enum err e = eye_paths_record(scene, rays, g, &few, count_only, &ends, &stats);
    const double per_path = TRIED * (double)ends;
    if (per_path * eye->paths > (double)room)
        eye->paths = (uint32_t)fmax(1.0, floor((double)room / per_path));
    mem_free(index);
    return e;
}

/* All lists side by side, in the order of the packets. */
static enum err join(struct eye_store *s, struct list *of, uint32_t packets)
{
    uint64_t ends = 0;
    uint32_t lists = 0;

    for (uint32_t i = 0; i < packets; i++) {
        ends += of[i].count;
        lists += of[i].count > 0;
    }
    s->ends = mem_alloc_raw(ends + 1, sizeof(*s->ends));
    s->lists = mem_alloc_raw(lists + 1, sizeof(*s->lists));
    if (!s->ends || !s->lists)
        return ERR_NOMEM;
    struct end *to = s->ends;
    for (uint32_t i = 0; i < packets; i++) {
        if (of[i].count == 0)
            continue;
        memcpy(to, of[i].ends, of[i].count * sizeof(*to));
        s->lists[s->list_count++] = (struct list){ i, of[i].count, to };
        to += of[i].count;
    }
    s->stats.ends = ends;
    s->stats.bytes = ends * sizeof(*s->ends) + lists * sizeof(*s->lists);
    return ERR_OK;
}

static uint64_t points_behind(const struct gbuffer *g)
{
    uint64_t count = 0;

    for (uint32_t i = 0; i < g->packet_count; i++)
        for (uint32_t l = 0; l < g->packets[i].count; l++)
            count += g->packets[i].behind[l] != 0;
    return count;
}

enum err eye_store_create(const struct scene *scene, const struct rays *rays, const struct gbuffer *g,
                          const struct eye_store_desc *desc, struct eye_store **out)
{
    struct eye_paths_desc eye = {
        .behind_classes = desc->classes,
        .paths = desc->paths,
        .seed = desc->seed,
        .cancel = desc->cancel,
        .urgent = desc->urgent,
    };
    struct gathering all = { mem_alloc(g->packet_count + 1, sizeof(*all.of)) };
    struct eye_store *s = mem_alloc(1, sizeof(*s));
    struct eye_paths_stats traced = { 0 };

    *out = NULL;
    enum err e = all.of && s ? limit_paths(scene, rays, g, desc, &eye) : ERR_NOMEM;
    if (!e)
        e = eye_paths_record(scene, rays, g, &eye, take, &all, &traced);
    if (!e)
        e = join(s, all.of, g->packet_count);
    for (uint32_t i = 0; all.of && i < g->packet_count; i++)
        mem_free(all.of[i].ends);
    mem_free(all.of);
    if (e || is_cancelled(desc->cancel)) {
        eye_store_destroy(s);
        return e;
    }
    s->stats.per_point = eye.paths;
    s->stats.paths = eye.paths * points_behind(g);
    s->stats.rays = traced.rays;
    *out = s;
    return ERR_OK;
}

void eye_store_destroy(struct eye_store *s)
{
    if (!s)
        return;
    mem_free(s->lists);
    mem_free(s->ends);
    mem_free(s);
}

static void light_packet(const struct list *list, const struct environment *e, float level, float share, float *lo)
{
    float sum[3][PACKET] = { { 0.0f } };

    for (uint32_t k = 0; k < list->count; k++) {
        const struct end *end = &list->ends[k];
        const struct texel *t = &e->texels[direction_texel(end->from, e->n)];
        if (k + AHEAD < list->count)
            __builtin_prefetch(&e->texels[direction_texel(end[AHEAD].from, e->n)]);
        const float below = sky_lower(level, rgb_luminance(t->r, t->g, t->b));
        sum[0][end->lane] += below * t->r * half_widen(end->rgb[0]);
        sum[1][end->lane] += below * t->g * half_widen(end->rgb[1]);
        sum[2][end->lane] += below * t->b * half_widen(end->rgb[2]);
    }
    for (int c = 0; c < 3; c++)
        for (int l = 0; l < PACKET; l++)
            lo[c * PACKET + l] += share * sum[c][l];
}

void eye_store_light(const struct eye_store *s, const struct environment *e, float level, float *lo)
{
    const float share = 1.0f / (float)s->stats.per_point;

    assert(e->ready);
#pragma omp parallel
    {
        const unsigned before = denormals_flush();
#pragma omp for schedule(dynamic, 16)
        for (uint32_t k = 0; k < s->list_count; k++)
            light_packet(&s->lists[k], e, level, share, lo + (size_t)s->lists[k].packet * 3 * PACKET);
        denormals_restore(before);
    }
}

const struct eye_store_stats *eye_store_stats(const struct eye_store *s)
{
    return &s->stats;
}

/* ---- Files ---- */

void eye_store_save(const struct eye_store *s, struct cache_writer *w)
{
    cache_writer_put(w, &s->stats, sizeof(s->stats));
    cache_writer_put(w, &s->list_count, sizeof(s->list_count));
    for (uint32_t k = 0; k < s->list_count; k++)
        cache_writer_put(w, &s->lists[k], LIST_STORED);
    cache_writer_put(w, s->ends, s->stats.ends * sizeof(*s->ends));
}

/* Reads the lists, whose packets ascend and whose ends are as many as there are. */
static enum err load_lists(struct eye_store *s, struct cache_reader *r, uint32_t packets, struct reason *why)
{
    struct end *at = s->ends;
    uint64_t left = s->stats.ends;
    enum err e = ERR_OK;

    for (uint32_t k = 0; k < s->list_count && !e; k++) {
        struct list *to = &s->lists[k];
        e = cache_reader_get(r, to, LIST_STORED, why);
        if (!e && (to->packet >= packets || (k > 0 && to->packet <= to[-1].packet) || to->count > left))
            e = cache_reader_refuse(r, why);
        to->ends = at;
        at += e ? 0 : to->count;
        left -= e ? 0 : to->count;
    }
    return e || left == 0 ? e : cache_reader_refuse(r, why);
}

static enum err load_ends(struct eye_store *s, struct cache_reader *r, struct reason *why)
{
    enum err e = cache_reader_get(r, s->ends, s->stats.ends * sizeof(*s->ends), why);

    for (uint64_t k = 0; k < s->stats.ends && !e; k++) {
        const struct end *end = &s->ends[k];
        bool sound = direction_is_packed(end->from) && end->lane < PACKET;
        for (int c = 0; c < 3; c++)
            sound = sound && isfinite(half_widen(end->rgb[c]));
        e = sound ? ERR_OK : cache_reader_refuse(r, why);
    }
    return e;
}

enum err eye_store_load(struct cache_reader *r, uint32_t packets, struct eye_store **out, struct reason *why)
{
    struct eye_store *s = mem_alloc(1, sizeof(*s));
    enum err e = s ? cache_reader_get(r, &s->stats, sizeof(s->stats), why) : err_say(why, ERR_NOMEM, "out of memory");

    *out = NULL;
    if (!e)
        e = cache_reader_get(r, &s->list_count, sizeof(s->list_count), why);
    if (!e && (s->list_count > packets || s->stats.ends > UINT32_MAX || s->stats.per_point == 0))
        e = cache_reader_refuse(r, why);
    if (!e) {
        s->lists = mem_alloc(s->list_count + 1, sizeof(*s->lists));
        s->ends = mem_alloc_raw(s->stats.ends + 1, sizeof(*s->ends));
        e = s->lists && s->ends ? load_lists(s, r, packets, why) : err_say(why, ERR_NOMEM, "out of memory");
    }
    if (!e)
        e = load_ends(s, r, why);
    if (e) {
        eye_store_destroy(s);
        return e;
    }
    *out = s;
    return ERR_OK;
}
