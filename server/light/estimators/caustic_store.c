#include "light/estimators/caustic_store.h"

#include "base/cancel.h"
#include "base/denormals.h"
#include "base/mem.h"
#include "base/precedence.h"
#include "base/progress.h"
#include "base/rng.h"
#include "light/cache/cache_file.h"
#include "light/estimators/light_tracer.h"
#include "light/estimators/packed.h"
#include "sky/tables/sky_split.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#define MAX_BYTES ((uint64_t)1 << 28) /* default: 256 MiB */
#define TILE 32                       /* pixels per edge: the sums of a tile, 16 KB, stay in the first-level cache */
#define TRIAL (1u << 16)              /* paths traced to estimate the number of splats */
#define SPARE 16                      /* a part's buffers get 1/16 extra, so that its replacement fits as well */
#define BYTES_PER_SPLAT 10            /* from, power, place */
#define AHEAD 64                      /* number of splats whose radiance is prefetched */

struct part {        /* splats sorted by tile, and by particle within a tile */
    uint64_t number; /* in the sequence, from 1; 0: empty */
    uint32_t *first; /* [tiles + 1] */
    uint32_t *from;  /* [capacity]: packed direction, as in light_tracer.h */
    uint32_t *power; /* T: as packed.h packs it */
    uint16_t *place; /* pixel within the tile, row by row */
    uint32_t count, capacity;
};

struct caustic_store {
    struct particles particles;
    struct caustic_store_desc desc;
    struct caustic_store_stats stats;
    uint64_t per_part; /* paths */
    uint32_t tiles, tiles_x;
    uint32_t rows;      /* of the image, or of both */
    struct part *parts; /* [desc.parts]: part k is stored at index k modulo desc.parts */
    bool whole;
    struct particle_splat *found; /* of the part being computed */
    size_t found_count, found_capacity;
    uint32_t *cursor; /* [tiles] */
    float (*sky)[4];  /* [6][n][n]: the sky's lower part in this frame; the fourth number is 0 */
    uint32_t n;
};

/* ---- Tracing ---- */

static enum err keep(void *user, const struct particle_splat *splats, size_t count)
{
    struct caustic_store *s = user;

    if (s->found_count + count > s->found_capacity) {
        const size_t capacity = 2 * s->found_capacity + count + 1024;
        struct particle_splat *grown = mem_grow(s->found, s->found_count, capacity, sizeof(*grown));
        if (!grown)
            return ERR_NOMEM;
        s->found = grown;
        s->found_capacity = capacity;
    }
    if (count > 0)
        memcpy(s->found + s->found_count, splats, count * sizeof(*splats));
    s->found_count += count;
    return ERR_OK;
}

static struct particle_run run_of(const struct caustic_store *s, uint64_t paths, const atomic_bool *cancel)
{
    struct particle_run run = {
        .start = s->desc.start,
        .classes = s->desc.classes,
        .shown = s->desc.classes,
        .particles = paths,
        .seed = rng_mix(s->desc.seed, s->desc.classes),
        .per_particle = 1.0,
        .ground_apart = s->desc.ground_apart,
        .cancel = cancel,
    };

    particles_aim(&s->particles, true, &run);
    return run;
}

static MUST_CHECK enum err part_reserve(struct part *p, uint32_t count)
{
    if (count <= p->capacity)
        return ERR_OK;
    const uint32_t capacity = count + count / SPARE;
    mem_free(p->from);
    mem_free(p->power);
    mem_free(p->place);
    p->from = mem_alloc_raw(capacity, sizeof(*p->from));
    p->power = mem_alloc_raw(capacity, sizeof(*p->power));
    p->place = mem_alloc_raw(capacity, sizeof(*p->place));
    p->capacity = p->from && p->power && p->place ? capacity : 0;
    return p->capacity ? ERR_OK : ERR_NOMEM;
}

/* Sorts the collected splats by tile, keeping their order within each. */
static void sort_into(const struct caustic_store *s, struct part *p)
{
    const uint32_t width = s->particles.view.width;
    const uint64_t stream = rng_mix(s->desc.seed ^ 0x726f756e64, p->number);
    uint32_t sum = 0;

    memset(s->cursor, 0, s->tiles * sizeof(*s->cursor));
    for (size_t k = 0; k < s->found_count; k++)
        s->cursor[s->found[k].pixel / width / TILE * s->tiles_x + s->found[k].pixel % width / TILE]++;
    for (uint32_t t = 0; t < s->tiles; t++) {
        p->first[t] = sum;
        sum += s->cursor[t];
        s->cursor[t] = p->first[t];
    }
    p->first[s->tiles] = p->count = sum;
    for (size_t k = 0; k < s->found_count; k++) {
        const struct particle_splat *f = &s->found[k];
        const uint32_t x = f->pixel % width, y = f->pixel / width;
        const uint32_t at = s->cursor[y / TILE * s->tiles_x + x / TILE]++;
        p->from[at] = f->from;
        p->power[at] = power_pack(f->rgb, rng_unit(rng_mix(stream, k)));
        p->place[at] = (uint16_t)(y % TILE * TILE + x % TILE);
    }
}

/* Computes part `number` of the sequence, replacing another. If cancelled, the part stays empty. */
static enum err draw_part(struct caustic_store *s, uint64_t number, const atomic_bool *cancel)
{
    struct part *p = &s->parts[number % s->desc.parts];
    struct particle_run run = run_of(s, s->per_part, cancel);
    struct light_tracer_stats stats = { 0 };

    p->number = 0;
    s->found_count = 0;
    run.first_direction = number * (s->per_part / STARTS_PER_DIRECTION);
    enum err e = particles_trace(&s->particles, &run, keep, s, &stats);
    s->stats.rays += stats.rays;
    if (e || is_cancelled(cancel))
        return e;
    e = s->found_count > UINT32_MAX / 2 ? ERR_NOMEM : part_reserve(p, (uint32_t)s->found_count);
    if (e)
        return e;
    p->number = number + 1;
    sort_into(s, p);
    s->stats.renewed++;
    return ERR_OK;
}

static void count_all(struct caustic_store *s)
{
    const uint64_t tables = sizeof(*s->parts) + (s->tiles + 1) * sizeof(*s->parts->first);

    s->stats.splats = s->stats.filled = 0;
    s->stats.bytes = s->desc.parts * tables;
    for (uint32_t k = 0; k < s->desc.parts; k++) {
        s->stats.filled += s->parts[k].number > 0;
        s->stats.splats += s->parts[k].count;
        s->stats.bytes += (uint64_t)s->parts[k].capacity * BYTES_PER_SPLAT;
    }
}

static bool has_part(const struct caustic_store *s, uint64_t number)
{
    return s->parts[number % s->desc.parts].number == number + 1;
}

enum err caustic_store_turn(struct caustic_store *s, uint64_t turn, struct progress *progress,
                            const atomic_bool *cancel)
{
    enum err e = ERR_OK;
    bool whole = true;

    s->stats.rays = 0;
    s->stats.renewed = 0;
    for (uint32_t k = 0; k < s->desc.parts && s->stats.paths > 0 && !e; k++) {
        const uint64_t number = turn + k;
        if (!has_part(s, number)) {
            precedence_give_way(s->desc.urgent);
            e = draw_part(s, number, cancel);
        }
        whole = whole && has_part(s, number);
        progress_step(progress, 1);
    }
    s->whole = whole && !e;
    count_all(s);
    return e;
}

enum err caustic_store_grow(struct caustic_store *s, uint64_t turn, uint32_t most, const atomic_bool *cancel)
{
    enum err e = ERR_OK;

    s->stats.rays = 0;
    s->stats.renewed = 0;
    for (int round = 0; round < 2; round++)
        for (uint32_t k = 0; k < s->desc.parts && s->stats.paths > 0 && !e && s->stats.renewed < most; k++) {
            const uint64_t number = turn + k;
            if (!has_part(s, number) && (round || s->parts[number % s->desc.parts].number == 0) &&
                !is_cancelled(cancel))
                e = draw_part(s, number, cancel);
        }
    s->whole = !e;
    for (uint32_t k = 0; k < s->desc.parts && s->stats.paths > 0; k++)
        s->whole = s->whole && has_part(s, turn + k);
    count_all(s);
    return e;
}

/* ---- Lighting ---- */

static MUST_CHECK enum err take_sky(struct caustic_store *s, const struct environment *e, float level)
{
    const size_t texels = (size_t)CUBE_FACES * e->n * e->n;

    if (e->n != s->n) {
        mem_free(s->sky);
        s->n = 0;
        s->sky = mem_alloc_raw(texels, sizeof(*s->sky));
        if (!s->sky)
            return ERR_NOMEM;
        s->n = e->n;
    }
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < texels; i++) {
        const struct texel *t = &e->texels[i];
        const float g = rgb_luminance(t->r, t->g, t->b), part = sky_lower(level, g);
        s->sky[i][0] = part * t->r;
        s->sky[i][1] = part * t->g;
        s->sky[i][2] = part * t->b;
        s->sky[i][3] = 0.0f;
    }
    return ERR_OK;
}

/* A batch of a tile's splats. Their directions are scattered over the sky table, which exceeds the second-level cache,
 * so all are prefetched before the first is used. */
struct ahead {
    uint32_t count;
    uint32_t power[AHEAD];
    uint16_t place[AHEAD];
    const float *light[AHEAD];
};

/* sum[place] += L(w) T. */
static void add_all(struct ahead *a, float sum[][4])
{
    for (uint32_t k = 0; k < a->count; k++) {
        const uint32_t power = a->power[k];
        const float *light = a->light[k], scale = power_unit(power);
        float *to = sum[a->place[k]];

        for (int c = 0; c < 4; c++)
            to[c] += (float)(power >> 8 * c & 255u) * scale * light[c];
    }
    a->count = 0;
}

static void add_part(const struct part *p, uint32_t tile, const float (*sky)[4], uint32_t n, struct ahead *a,
                     float sum[][4])
{
    for (uint32_t k = p->first[tile]; k < p->first[tile + 1]; k++) {
        const float *light = sky[direction_texel(p->from[k], n)];
        __builtin_prefetch(light);
        a->light[a->count] = light;
        a->power[a->count] = p->power[k];
        a->place[a->count++] = p->place[k];
        if (a->count == AHEAD)
            add_all(a, sum);
    }
}

/* The parts that light an image: every `step`-th from `first` on. */
struct chosen {
    uint32_t first, step;
    float share; /* 1 / their paths */
};

static struct chosen choose(const struct caustic_store *s, uint32_t first, uint32_t step)
{
    uint64_t filled = 0;

    for (uint32_t k = first; k < s->desc.parts; k += step)
        filled += s->parts[k].number > 0;
    return (struct chosen){ first, step, filled ? (float)(1.0 / (double)(filled * s->per_part)) : 0.0f };
}

static void light_tile(const struct caustic_store *s, const struct chosen *c, uint32_t tile, float *rgb)
{
    const uint32_t width = s->particles.view.width, height = s->rows;
    const uint32_t x0 = tile % s->tiles_x * TILE, y0 = tile / s->tiles_x * TILE;
    _Alignas(64) float sum[TILE * TILE][4] = { 0 };
    struct ahead ahead = { .count = 0 };

    for (uint32_t k = c->first; k < s->desc.parts; k += c->step)
        if (s->parts[k].number > 0)
            add_part(&s->parts[k], tile, (const float(*)[4])s->sky, s->n, &ahead, sum);
    add_all(&ahead, sum);
    for (uint32_t y = y0; y < y0 + TILE && y < height; y++)
        for (uint32_t x = x0; x < x0 + TILE && x < width; x++)
            for (uint32_t k = 0; k < 3; k++)
                rgb[3 * ((size_t)y * width + x) + k] += c->share * sum[(y - y0) * TILE + (x - x0)][k];
}

static enum err light_by(struct caustic_store *s, const struct environment *e, float level, const struct chosen *c,
                         float *rgb)
{
    if (s->stats.splats == 0 || !(level > 0.0f))
        return ERR_OK;
    const enum err failed = take_sky(s, e, level);
    if (failed)
        return failed;
#pragma omp parallel
    {
        const unsigned before = denormals_flush();
#pragma omp for schedule(dynamic, 1)
        for (uint32_t tile = 0; tile < s->tiles; tile++)
            light_tile(s, c, tile, rgb);
        denormals_restore(before);
    }
    return ERR_OK;
}

enum err caustic_store_light(struct caustic_store *s, const struct environment *e, float level, float *rgb)
{
    const struct chosen all = choose(s, 0, 1);

    assert(e->ready && s->whole);
    return light_by(s, e, level, &all, rgb);
}

enum err caustic_store_light_half(struct caustic_store *s, const struct environment *e, float level, uint32_t half,
                                  float *rgb)
{
    const struct chosen every_second = choose(s, half, 2);

    assert(e->ready);
    return light_by(s, e, level, &every_second, rgb);
}

/* ---- Creation ---- */

bool caustic_store_is_complete(const struct caustic_store *s)
{
    return s->whole;
}

const struct caustic_store_stats *caustic_store_stats(const struct caustic_store *s)
{
    return &s->stats;
}

static enum err drop(void *user, const struct particle_splat *splats, size_t count)
{
    (void)user;
    (void)splats;
    (void)count;
    return ERR_OK;
}

/* Determines how many paths fit, from a few with separate random numbers, so that the number of paths does not depend
 * on their own splats. */
static enum err lay_out(struct caustic_store *s, struct reason *why)
{
    const uint64_t tables = sizeof(*s->parts) + (s->tiles + 1) * sizeof(*s->parts->first);
    const uint64_t fixed = s->desc.parts * tables, each = (uint64_t)s->desc.parts * STARTS_PER_DIRECTION;
    struct particle_run run = run_of(s, TRIAL, NULL);
    struct light_tracer_stats stats = { 0 };

    run.seed = rng_mix(run.seed, 0x747269616c);
    const enum err e = particles_trace(&s->particles, &run, drop, NULL, &stats);
    if (e)
        return err_say(why, e, "out of memory");
    const double splats = (double)(stats.splats + 1) / (double)stats.particles; /* splats per path */
    const double bytes = splats * BYTES_PER_SPLAT * (1.0 + 2.0 / SPARE);
    const double most = ((double)s->desc.max_bytes - (double)fixed) / bytes / (double)each;
    const uint64_t requested = (s->desc.paths + each - 1) / each;
    if (most < 1.0)
        return err_say(why, ERR_RANGE, "a caustic store of %u parts needs at least %.0f MB", s->desc.parts,
                       ceil(1e-6 * ((double)fixed + bytes * (double)each)));
    s->stats.requested = requested * each;
    s->per_part = (most < (double)requested ? (uint64_t)most : requested) * STARTS_PER_DIRECTION;
    s->stats.paths = s->per_part * s->desc.parts;
    return ERR_OK;
}

static enum err reserve_parts(struct caustic_store *s)
{
    s->parts = mem_alloc(s->desc.parts, sizeof(*s->parts));
    s->cursor = mem_alloc(s->tiles, sizeof(*s->cursor));
    bool all = s->parts && s->cursor;
    for (uint32_t k = 0; all && k < s->desc.parts; k++)
        all = (s->parts[k].first = mem_alloc(s->tiles + 1, sizeof(*s->parts->first)));
    return all ? ERR_OK : ERR_NOMEM;
}

enum err caustic_store_create(const struct scene *scene, const struct rays *rays, const struct view *view,
                              const struct caustic_store_desc *desc, struct caustic_store **out, struct reason *why)
{
    struct caustic_store *s = *out = NULL;

    assert(desc->classes && !(desc->classes & ~(uint32_t)(PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC)));
    assert(desc->paths > 0 && desc->parts <= CAUSTIC_PARTS_MAX);
    s = mem_alloc(1, sizeof(*s));
    if (!s)
        return err_say(why, ERR_NOMEM, "out of memory");
    s->desc = *desc;
    s->desc.parts = desc->parts ? desc->parts : CAUSTIC_PARTS;
    s->desc.max_bytes = desc->max_bytes ? desc->max_bytes : MAX_BYTES;
    s->stats.parts = s->desc.parts;
    s->tiles_x = (view->width + TILE - 1) / TILE;
    s->rows = desc->ground_apart ? 2 * view->height : view->height;
    s->tiles = s->tiles_x * ((s->rows + TILE - 1) / TILE);
    enum err e = particles_init(&s->particles, scene, rays, view) ? ERR_OK : ERR_NOMEM;
    if (!e)
        e = reserve_parts(s);
    if (e)
        err_say(why, e, "out of memory");
    else if (s->particles.caster_count > 0)
        e = lay_out(s, why);
    if (e) {
        caustic_store_destroy(s);
        return e;
    }
    *out = s;
    return ERR_OK;
}

/* ---- Files ---- */

void caustic_store_save(const struct caustic_store *s, struct cache_writer *w)
{
    cache_writer_put(w, &s->per_part, sizeof(s->per_part));
    for (uint32_t k = 0; k < s->desc.parts && s->stats.paths > 0; k++) {
        const struct part *p = &s->parts[k];
        cache_writer_put(w, p->first, (s->tiles + 1) * sizeof(*p->first));
        cache_writer_put(w, p->from, p->count * sizeof(*p->from));
        cache_writer_put(w, p->power, p->count * sizeof(*p->power));
        cache_writer_put(w, p->place, p->count * sizeof(*p->place));
    }
}

static bool is_sound(const struct caustic_store *s, const struct part *p)
{
    bool sound = p->first[0] == 0;

    for (uint32_t t = 0; t < s->tiles; t++)
        sound = sound && p->first[t] <= p->first[t + 1];
    for (uint32_t k = 0; k < p->count && sound; k++)
        sound = direction_is_packed(p->from[k]) && p->power[k] >> 24 <= POWER_MAX && p->place[k] < TILE * TILE;
    return sound;
}

static enum err load_part(struct caustic_store *s, struct cache_reader *r, uint32_t k, struct reason *why)
{
    struct part *p = &s->parts[k];
    enum err e = cache_reader_get(r, p->first, (s->tiles + 1) * sizeof(*p->first), why);

    p->count = e ? 0 : p->first[s->tiles];
    if (!e && p->count > UINT32_MAX / 2)
        e = cache_reader_refuse(r, why);
    if (!e && part_reserve(p, p->count))
        e = err_say(why, ERR_NOMEM, "out of memory");
    if (!e)
        e = cache_reader_get(r, p->from, p->count * sizeof(*p->from), why);
    if (!e)
        e = cache_reader_get(r, p->power, p->count * sizeof(*p->power), why);
    if (!e)
        e = cache_reader_get(r, p->place, p->count * sizeof(*p->place), why);
    p->number = (uint64_t)k + 1;
    return e || is_sound(s, p) ? e : cache_reader_refuse(r, why);
}

enum err caustic_store_load(struct caustic_store *s, struct cache_reader *r, struct reason *why)
{
    uint64_t per_part;
    enum err e = cache_reader_get(r, &per_part, sizeof(per_part), why);

    if (!e && per_part != s->per_part)
        e = cache_reader_refuse(r, why);
    for (uint32_t k = 0; k < s->desc.parts && s->stats.paths > 0 && !e; k++)
        e = load_part(s, r, k, why);
    if (!e)
        e = cache_reader_end(r, why); /* before that, numbers may be damaged */
    s->whole = !e;
    for (uint32_t k = 0; k < s->desc.parts && e; k++)
        s->parts[k].number = s->parts[k].count = 0;
    count_all(s);
    return e;
}

void caustic_store_destroy(struct caustic_store *s)
{
    if (!s)
        return;
    for (uint32_t k = 0; s->parts && k < s->desc.parts; k++) {
        mem_free(s->parts[k].first);
        mem_free(s->parts[k].from);
        mem_free(s->parts[k].power);
        mem_free(s->parts[k].place);
    }
    particles_finish(&s->particles);
    mem_free(s->parts);
    mem_free(s->found);
    mem_free(s->cursor);
    mem_free(s->sky);
    mem_free(s);
}
