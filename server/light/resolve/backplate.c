#include "light/resolve/resolve.h"

#include "base/mem.h"
#include "scene/geometry/ground.h"
#include "sky/tables/irradiance.h"
#include "sky/tables/lookup_place.h"

#include <math.h>
#include <string.h>

struct catch
{ /* a shade point on the ground */
    uint32_t point;
    float open; /* v */
    struct vec3 away;
    struct lookup_place place;
};

struct backplate {
    const struct scene *scene;
    const struct gbuffer *gbuffer;
    const struct view *view;
    struct catch *catches;
    uint32_t count;
    float (*lit)[3]; /* [count]: the radiances that backplate_show replaced */
    uint32_t *index;
    struct packet_list packets;
    struct lookup_key key; /* of the places */
    bool placed, sky, held;
    double *weights; /* of irradiance_upward */
    uint32_t n;      /* theirs */
    double bare[3];
    float *unshadowed, *splats; /* NULL until they are needed */
    float *through, *behind;    /* [height][width][3]: T, and what the image shows of the background; NULL: not kept */
};

static size_t values_of(const struct backplate *b)
{
    return 3 * (size_t)b->gbuffer->width * b->gbuffer->height;
}

static bool is_ground(const struct backplate *b, uint32_t point)
{
    const uint32_t material = b->gbuffer->packets[point / PACKET].material[point % PACKET];

    return b->scene->materials[material].ground;
}

static struct catch catch_of(const struct backplate *b, uint32_t point)
{
    const struct shade_packet *p = &b->gbuffer->packets[point / PACKET];
    const struct ground *ground = &b->scene->ground;
    const uint32_t lane = point % PACKET;
    const struct vec3 off = vec3_sub(vec3_make(p->x[lane], p->y[lane], p->z[lane]), ground->centre);
    const float near = ground->radius / vec3_length(off);

    return (struct catch){
        .point = point,
        .open = 1.0f - fminf(1.0f, 2.0f * near * near * near),
        .away = vec3_make(-p->wo_x[lane], -p->wo_y[lane], -p->wo_z[lane]),
    };
}

/* Lists points and packets; only counts them where there are no arrays. */
static void find_points(struct backplate *b)
{
    const struct gbuffer *g = b->gbuffer;

    b->count = b->packets.count = 0;
    for (uint32_t i = 0; i < g->packet_count; i++) {
        const uint32_t before = b->count;
        for (uint32_t lane = 0; lane < g->packets[i].count; lane++) {
            if (!is_ground(b, i * PACKET + lane))
                continue;
            if (b->catches)
                b->catches[b->count] = catch_of(b, i * PACKET + lane);
            b->count++;
        }
        if (b->count == before)
            continue;
        if (b->index)
            b->index[b->packets.count] = i;
        b->packets.count++;
    }
}

struct backplate *backplate_create(const struct scene *scene, const struct gbuffer *g, const struct view *view)
{
    struct backplate *b = mem_alloc(1, sizeof(*b));

    if (!b)
        return NULL;
    b->scene = scene;
    b->gbuffer = g;
    b->view = view;
    find_points(b);
    b->index = mem_alloc(b->packets.count + 1, sizeof(*b->index));
    b->lit = mem_alloc(b->count + 1, sizeof(*b->lit));
    struct catch *catches = mem_alloc(b->count + 1, sizeof(*catches));
    b->catches = catches;
    if (!b->index || !b->lit || !catches) {
        backplate_destroy(b);
        return NULL;
    }
    find_points(b);
    b->packets.index = b->index;
    return b;
}

void backplate_destroy(struct backplate *b)
{
    if (!b)
        return;
    mem_free(b->catches);
    mem_free(b->lit);
    mem_free(b->index);
    mem_free(b->weights);
    mem_free(b->unshadowed);
    mem_free(b->splats);
    mem_free(b->through);
    mem_free(b->behind);
    mem_free(b);
}

static void bare_by(const struct environment *e, const double *weights, double rgb[3])
{
    irradiance_upward(e, weights, rgb);
    for (int c = 0; c < 3; c++)
        rgb[c] *= (double)GROUND_ALBEDO / PI;
}

enum err backplate_bare(const struct environment *e, double rgb[3])
{
    double *weights = mem_alloc(2 * (size_t)e->n * e->n, sizeof(*weights));

    if (!weights)
        return ERR_NOMEM;
    irradiance_weights(e->n, weights);
    bare_by(e, weights, rgb);
    mem_free(weights);
    return ERR_OK;
}

enum err backplate_begin(struct backplate *b, const struct environment *e, bool sky)
{
    const struct lookup_key key = lookup_key_of(e);

    if (b->n != e->n) {
        mem_free(b->weights);
        b->n = 0;
        b->weights = mem_alloc(2 * (size_t)e->n * e->n, sizeof(*b->weights));
        if (!b->weights)
            return ERR_NOMEM;
        b->n = e->n;
        irradiance_weights(e->n, b->weights);
    }
    if (!b->held)
        bare_by(e, b->weights, b->bare);
    b->sky = sky;
    if (b->placed && lookup_key_equal(&key, &b->key))
        return ERR_OK;
#pragma omp parallel for schedule(dynamic, 256)
    for (uint32_t i = 0; i < b->count; i++)
        b->catches[i].place = lookup_place_find(e, b->catches[i].away, b->gbuffer->pixel_angle);
    b->key = key;
    b->placed = true;
    return ERR_OK;
}

void backplate_hold(struct backplate *b, bool hold)
{
    b->held = hold;
}

bool backplate_is_held(const struct backplate *b)
{
    return b->held;
}

const struct packet_list *backplate_packets(const struct backplate *b)
{
    return &b->packets;
}

float *backplate_unshadowed(struct backplate *b)
{
    if (!b->unshadowed)
        b->unshadowed = mem_alloc(b->gbuffer->packet_count, 3 * PACKET * sizeof(float));
    return b->unshadowed;
}

static inline float *radiance_at(float *lo, uint32_t point)
{
    return lo + (size_t)(point / PACKET) * 3 * PACKET + point % PACKET;
}

void backplate_steady(const struct backplate *b, float *lo)
{
#pragma omp parallel for schedule(static)
    for (uint32_t i = 0; i < b->count; i++) {
        const struct catch *at = &b->catches[i];
        const float *free = radiance_at(b->unshadowed, at->point);
        float *x = radiance_at(lo, at->point);
        for (int c = 0; c < 3; c++)
            x[c * PACKET] += at->open * ((float)b->bare[c] - free[c * PACKET]);
    }
}

/* T and the visible background, from the radiances before and after their replacement. */
static void keep_pixel(const struct backplate *b, const struct environment *e, const float *lo, uint32_t x, uint32_t y)
{
    const struct gbuffer *g = b->gbuffer;
    const size_t pixel = (size_t)y * g->width + x;
    const struct vec3 ahead = view_direction(b->view, x + 0.5, y + 0.5);
    float *through = b->through + 3 * pixel, *behind = b->behind + 3 * pixel, seen[3];

    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *entry = &g->entries[k];
        const uint32_t packet = entry->point / PACKET, lane = entry->point % PACKET;
        const float *shown = lo + (size_t)packet * 3 * PACKET + lane;
        if (!is_ground(b, entry->point) || g->packets[packet].behind[lane])
            continue;
        for (int c = 0; c < 3; c++)
            behind[c] += entry->weight[c] * shown[c * PACKET];
    }
    for (uint32_t k = g->miss_first[pixel]; k < g->miss_first[pixel + 1]; k++) {
        const struct gbuffer_miss *miss = &g->misses[k];
        if (vec3_length(vec3_sub(miss->direction, ahead)) > g->pixel_angle)
            continue; /* in a mirror, or bent by glass: the model's own */
        environment_lookup_wide(e, miss->direction, miss->width, seen);
        for (int c = 0; c < 3; c++) {
            through[c] += miss->weight[c];
            behind[c] += b->sky ? miss->weight[c] * seen[c] : 0.0f;
        }
    }
}

/* The part of T that the ground has, before its radiances are replaced. */
static void keep_ratios(const struct backplate *b, const float *lo)
{
    const struct gbuffer *g = b->gbuffer;

#pragma omp parallel for schedule(dynamic, 4096)
    for (size_t pixel = 0; pixel < (size_t)g->width * g->height; pixel++) {
        for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
            const struct gbuffer_entry *entry = &g->entries[k];
            const uint32_t packet = entry->point / PACKET, lane = entry->point % PACKET;
            const float *lit = lo + (size_t)packet * 3 * PACKET + lane;
            if (!is_ground(b, entry->point) || g->packets[packet].behind[lane])
                continue;
            for (int c = 0; c < 3; c++)
                b->through[3 * pixel + (size_t)c] +=
                    entry->weight[c] * (b->bare[c] > 0.0 ? (float)((double)lit[c * PACKET] / b->bare[c]) : 1.0f);
        }
    }
}

static void keep_pixels(const struct backplate *b, const struct environment *e, const float *lo)
{
    const struct gbuffer *g = b->gbuffer;

#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t y = 0; y < g->height; y++)
        for (uint32_t x = 0; x < g->width; x++)
            keep_pixel(b, e, lo, x, y);
}

void backplate_show(struct backplate *b, const struct environment *e, float *lo)
{
    const struct lookup_image image = lookup_image_of(e);

    environment_complete_pyramid(e);
    if (b->through) {
        memset(b->through, 0, values_of(b) * sizeof(float));
        memset(b->behind, 0, values_of(b) * sizeof(float));
        keep_ratios(b, lo);
    }
#pragma omp parallel for schedule(static)
    for (uint32_t i = 0; i < b->count; i++) {
        const struct catch *at = &b->catches[i];
        float *x = radiance_at(lo, at->point), seen[3];
        if (at->place.texel == LOOKUP_NONE)
            environment_lookup_wide(e, at->away, b->gbuffer->pixel_angle, seen);
        else
            lookup_at(&image, &at->place, seen);
        for (int c = 0; c < 3; c++) {
            const float still = b->sky ? seen[c] : 0.0f;
            b->lit[i][c] = x[c * PACKET];
            x[c * PACKET] = b->bare[c] > 0.0 ? seen[c] * (float)((double)x[c * PACKET] / b->bare[c]) : still;
        }
    }
    if (b->through)
        keep_pixels(b, e, lo);
}

void backplate_restore(const struct backplate *b, float *lo)
{
#pragma omp parallel for schedule(static)
    for (uint32_t i = 0; i < b->count; i++) {
        float *x = radiance_at(lo, b->catches[i].point);
        for (int c = 0; c < 3; c++)
            x[c * PACKET] = b->lit[i][c];
    }
}

float *backplate_splats(struct backplate *b)
{
    if (!b->splats)
        b->splats = mem_alloc_raw(2 * values_of(b), sizeof(float));
    if (b->splats)
        memset(b->splats, 0, 2 * values_of(b) * sizeof(float));
    return b->splats;
}

/* The background at the middle of a pixel. */
static void background_at(const struct backplate *b, const struct environment *e, size_t pixel, float rgb[3])
{
    const uint32_t width = b->gbuffer->width;
    const struct vec3 ahead = view_direction(b->view, (double)(pixel % width) + 0.5, (double)(pixel / width) + 0.5);

    environment_lookup_wide(e, ahead, b->gbuffer->pixel_angle, rgb);
}

void backplate_add_splats(struct backplate *b, const struct environment *e, float *rgb)
{
    const size_t values = values_of(b);
    const float *model = b->splats, *ground = b->splats + values;

    environment_complete_pyramid(e);
#pragma omp parallel for schedule(dynamic, 4096)
    for (size_t i = 0; i < values; i += 3) {
        float seen[3] = { 0.0f, 0.0f, 0.0f };
        if (ground[i] + ground[i + 1] + ground[i + 2] > 0.0f)
            background_at(b, e, i / 3, seen);
        for (size_t c = 0; c < 3; c++) {
            const float ratio = b->bare[c] > 0.0 ? (float)((double)ground[i + c] / b->bare[c]) : 0.0f;
            rgb[i + c] += model[i + c] + ratio * seen[c];
            if (b->through) {
                b->through[i + c] += ratio;
                b->behind[i + c] += ratio * seen[c];
            }
        }
    }
}

enum err backplate_keep(struct backplate *b)
{
    if (!b->through)
        b->through = mem_alloc(values_of(b), sizeof(float));
    if (!b->behind)
        b->behind = mem_alloc(values_of(b), sizeof(float));
    return b->through && b->behind ? ERR_OK : ERR_NOMEM;
}

void backplate_split(const struct backplate *b, const struct environment *e, const float *rgb, float *rgba)
{
    environment_complete_pyramid(e);
#pragma omp parallel for schedule(dynamic, 4096)
    for (size_t i = 0; i < values_of(b); i += 3) {
        const float *t = b->through + i;
        const float left = fmaxf(0.0f, fminf(1.0f, fminf(t[0], fminf(t[1], t[2]))));
        float *out = rgba + i / 3 * 4, seen[3];
        background_at(b, e, i / 3, seen);
        for (size_t c = 0; c < 3; c++) {
            const float model = fmaxf(0.0f, rgb[i + c] - b->behind[i + c]);
            out[c] = model + fmaxf(0.0f, t[c] - left) * seen[c];
        }
        out[3] = 1.0f - left;
    }
}
