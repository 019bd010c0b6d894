#include "light/frame/beside.h"

#include "base/cancel.h"
#include "base/mem.h"
#include "base/rng.h"
#include "light/resolve/resolve.h"

#include <math.h>
#include <string.h>

#define GROW_S 0.1 /* of an image, for paths to be stored; none in the first */
/* Relative to a white surface under the whole sky: the limit on a path that hits the sky behind mirrors and glass. Such
 * a path finds a sun once in 10^5 times and is then brighter by the same factor, which would leave a speck for
 * minutes. */
#define BRIGHTEST 4.0

#define MOST_PATHS 2 /* of a point, where eye paths find caustics or indirect light that the cache leaves to them */

/* What an image under a moving sky takes one of, and all others take together: half of the stored paths, the other
 * half, parts of one half of the samples, then of the other; the history takes them, and parts of the filter. */
enum { SLICE_STORED, SLICE_STORED_OTHER, SLICE_SAMPLES };

#define PART_PATHS 40000  /* eye paths of a part, about, */
#define PARTICLE_PATHS 2  /* each of whose rays a particle needs twice as many */
#define PARTS_MOST 8      /* of half of the samples */
#define PART_POINTS 40000 /* that the filter has for each of its slices, about */

/* A sky that has changed by more since the last image is not worth gliding to: of its energy, and radians of its sun, 3
 * degrees, for which a day's sun takes 12 minutes. */
#define OTHER_ENERGY 0.2
#define OTHER_SUN 0.052f
#define SUN_PARTS 8 /* of its energy, to find its middle: of a lamp of 5 degrees to half a degree */

struct beside {
    const struct prepared_scene *set;
    struct denoiser *denoiser;
    struct accumulation *accumulation;
    size_t points, values; /* floats of all shade points, of an image */
    size_t images;         /* 1; with a ground 2: the second is for splats on it */
    float *weight;         /* [packet_count][16]: sum of a point's weights, if it is seen directly; else 0 */
    float *stored[2];      /* [packet_count][3][16], as the next */
    float *half[2], *shown;
    float *image, *fresh, *rest; /* [images][height][width][3]; fresh: splats of this round without a shade point, */
    uint32_t rounds;             /* rest: the mean of so many rounds, since the sky or the estimator changed */
    uint64_t key;                /* of the last image */
    uint32_t parts;              /* of half of the samples, in this round */
    uint32_t slice;              /* the next */
    uint64_t uses;               /* of the denoiser, after the last one */
    bool shows;                  /* the accumulation has light of this key */
    double energy;               /* of the last image's sky */
    float sun[3];                /* and where its sun was */
    /* Of the image: */
    const struct relight_desc *request;
    const struct relight_desc *grows;      /* the same, if stored paths are to grow; else NULL */
    const struct relight_desc *stored_by;  /* the same, if it shows stored paths; else NULL */
    struct light_tracer_desc light[3];     /* particles 0: none; the last: of the sun, beside stored paths */
    struct eye_paths_desc unserved;        /* indirect light that the cache leaves to eye paths; paths 0: none */
    uint64_t wanted;                       /* its key */
    bool stored_behind;                    /* stored eye paths light points behind mirrors and glass: */
    const struct eye_store *const *behind; /* its two halves of them; NULL: none */
    bool glides;                           /* nothing is sampled */
    bool still, slow;                      /* its sky is the last one's; its light may glide under that */
    const atomic_bool *cancel;             /* may be NULL */
};

struct beside *beside_create(const struct prepared_scene *set, struct denoiser *denoiser)
{
    struct beside *b = mem_alloc(1, sizeof(*b));
    const struct gbuffer *g = set->gbuffer;

    if (!b)
        return NULL;
    b->set = set;
    b->denoiser = denoiser;
    b->points = (size_t)g->packet_count * 3 * PACKET;
    b->values = (size_t)g->width * g->height * 3;
    b->images = set->scene->ground.radius > 0.0f ? 2 : 1;
    b->accumulation = accumulation_create(g, denoiser);
    b->weight = mem_alloc((size_t)g->packet_count * PACKET, sizeof(float));
    for (int k = 0; k < 2; k++)
        b->stored[k] = mem_alloc(b->points, sizeof(float));
    for (int k = 0; k < 2; k++)
        b->half[k] = mem_alloc(b->points, sizeof(float));
    b->shown = mem_alloc(b->points, sizeof(float));
    b->image = mem_alloc(b->images * b->values, sizeof(float));
    b->fresh = mem_alloc(b->images * b->values, sizeof(float));
    b->rest = mem_alloc(b->images * b->values, sizeof(float));
    const void *const all[] = { b->accumulation, b->weight, b->stored[0], b->stored[1], b->half[0],
                                b->half[1],      b->shown,  b->image,     b->fresh,     b->rest };
    for (size_t k = 0; k < sizeof(all) / sizeof(all[0]); k++)
        if (!all[k]) {
            beside_destroy(b);
            return NULL;
        }
    for (uint32_t k = 0; k < g->entry_first[b->values / 3]; k++) {
        const uint32_t point = g->entries[k].point;
        if (!g->packets[point / PACKET].behind[point % PACKET])
            b->weight[point] += g->entries[k].weight[0];
    }
    return b;
}

void beside_destroy(struct beside *b)
{
    if (!b)
        return;
    accumulation_destroy(b->accumulation);
    mem_free(b->weight);
    for (int k = 0; k < 2; k++) {
        mem_free(b->stored[k]);
        mem_free(b->half[k]);
    }
    mem_free(b->shown);
    mem_free(b->image);
    mem_free(b->fresh);
    mem_free(b->rest);
    mem_free(b);
}

bool beside_wanted(const struct prepared_scene *set, const struct relight_desc *desc)
{
    return desc->remember && set->facts.casters > 0 && desc->classes & (PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC);
}

static uint32_t filter_steps(const struct beside *b)
{
    return 1 + denoiser_parts(b->denoiser);
}

static uint32_t filter_slices(const struct beside *b)
{
    const uint64_t slices = 1 + b->points / 3 / PART_POINTS;

    return slices < filter_steps(b) ? (uint32_t)slices : filter_steps(b);
}

static uint32_t slices(const struct beside *b)
{
    return SLICE_SAMPLES + 2 * b->parts + filter_slices(b);
}

/* The parts that half of an image's samples take. */
static uint32_t count_parts(const struct beside *b, const struct eye_paths_desc *eye)
{
    const struct eye_paths_desc *u = &b->unserved;
    const uint64_t found = (eye->paths + 1) / 2 * b->set->facts.behind,
                   left = u->paths ? (uint64_t)(u->paths + 1) / 2 * u->only->count * PACKET : 0;
    uint64_t particles = 0;

    for (int i = 0; i < 3; i++)
        particles += b->light[i].particles / 2;
    const uint64_t parts = 1 + (found + left + PARTICLE_PATHS * particles) / PART_PATHS;

    return parts < PARTS_MOST ? (uint32_t)parts : PARTS_MOST;
}

/* A round of slices; whole: all of them in this image. What is shown moves towards a round during the next one. */
static void begin(struct beside *b, bool whole)
{
    b->shows = b->shows && b->wanted == b->key;
    const bool still = b->still && b->shows;

    accumulation_begin(b->accumulation, b->wanted,
                       !whole    ? slices(b)
                       : !still  ? 0
                       : b->slow ? ACCUMULATION_GLIDE
                                 : ACCUMULATION_STEADY);
    accumulation_hold(b->accumulation, still);
    memset(b->fresh, 0, b->images * b->values * sizeof(float));
    if (!still)
        b->rounds = 0;
    b->key = b->wanted;
}

/* Caustics by eye paths leave the passes' eye paths. stored: there are others behind mirrors and glass. */
static struct eye_paths_desc take_eye_paths(const struct environment *e, bool stored, struct frame_plan *plan)
{
    struct pass *s = frame_plan_find(plan, PASS_EYE);

    if (!s)
        return (struct eye_paths_desc){ .paths = 0 };
    struct eye_paths_desc own = s->eye;
    own.classes &= PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC;
    own.behind_classes = stored ? 0 : own.behind_classes & ~(uint32_t)PATH_INDIRECT_LIT;
    own.most = 3.0 * BRIGHTEST * e->total_energy / PI;
    own.paths = own.classes || own.behind_classes ? MOST_PATHS : 0;
    s->eye.classes &= PATH_INDIRECT_LIT;
    s->eye.behind_classes &= PATH_INDIRECT_LIT;
    s->classes &= PATH_INDIRECT_LIT;
    if (!s->classes)
        frame_plan_remove(plan, s);
    return own;
}

/* A cached image would trace all of them, for points whose lobes are narrower than the cache's cells. */
static void take_left(struct beside *b, struct frame_plan *plan)
{
    b->unserved.paths = 0;
    for (uint32_t k = plan->count; k-- > 0;)
        if (plan->pass[k].kind == PASS_EYE && plan->pass[k].eye.only) {
            b->unserved = plan->pass[k].eye;
            b->unserved.paths = b->unserved.paths < MOST_PATHS ? b->unserved.paths : MOST_PATHS;
            frame_plan_remove(plan, &plan->pass[k]);
        }
}

static void take_particles(struct beside *b, struct frame_plan *plan)
{
    for (int k = 0; k < 3; k++)
        b->light[k] = (struct light_tracer_desc){ .particles = 0 };
    for (uint32_t k = 0, i = 0; k < plan->count; k++)
        if (plan->pass[k].kind == PASS_PARTICLES)
            b->light[i++] = plan->pass[k].light;
    frame_plan_drop(plan, PASS_PARTICLES);
}

void beside_describe(struct beside *b, const struct environment *e, const struct relight_desc *desc,
                     const struct relight_stats *stats, bool stored_behind, bool glides, struct frame_plan *plan)
{
    const struct plan *p = &stats->plan;

    b->glides = glides;
    b->cancel = desc->direct.cancel;
    b->wanted = (uint64_t)desc->classes << 8 | (uint64_t)p->caustics << 4 | p->indirect_caustics;
    b->still = stats->still;
    b->slow = desc->glide;
    b->request = desc;
    b->grows = relight_plan_later(desc, p) ? desc : NULL;
    b->stored_by = frame_plan_has(plan, PASS_STORED) ? desc : NULL;
    frame_plan_drop(plan, PASS_STORED);
    take_particles(b, plan);
    take_left(b, plan);
    b->stored_behind = p->caustics == PLAN_STORED && stored_behind;
    b->wanted |= (uint64_t)(b->unserved.paths > 0) << 63 | (uint64_t)b->stored_behind << 62;
    const struct eye_paths_desc eye = take_eye_paths(e, b->stored_behind, plan);
    frame_plan_add(plan, PASS_BESIDE, PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC)->eye = eye;
    frame_plan_add(plan, PASS_REST, 0);
}

/* Whether a point takes splats of image 0 or 1. */
static bool takes(const struct beside *b, uint32_t point, size_t image)
{
    const uint32_t material = b->set->gbuffer->packets[point / PACKET].material[point % PACKET];

    return b->weight[point] > 0.0f && (b->images == 1 || b->set->scene->materials[material].ground == (image == 1));
}

/* Moves this share of a pixel's splats of image 0 or 1 to its shade points in lo. */
static void move_pixel(struct beside *b, size_t pixel, size_t image, float share, float *lo)
{
    const struct gbuffer *g = b->set->gbuffer;
    float *splats = b->image + image * b->values + 3 * pixel, *rest = b->fresh + image * b->values + 3 * pixel;
    float sum = 0.0f;

    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++)
        if (takes(b, g->entries[k].point, image))
            sum += g->entries[k].weight[0];
    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1] && sum > 0.0f; k++) {
        const uint32_t point = g->entries[k].point;
        if (!takes(b, point, image))
            continue;
        float *to = lo + (size_t)(point / PACKET) * 3 * PACKET + point % PACKET;
        for (size_t c = 0; c < 3; c++)
            to[c * PACKET] += share * g->entries[k].weight[0] / b->weight[point] * splats[c] / sum;
    }
    for (int c = 0; c < 3 && !(sum > 0.0f); c++)
        rest[c] += share * 0.5f * splats[c];
    memset(splats, 0, 3 * sizeof(float));
}

static void move_splats(struct beside *b, float share, float *lo)
{
    for (size_t k = 0; k < b->images * b->values; k += 3)
        if (b->image[k] + b->image[k + 1] + b->image[k + 2] > 0.0f)
            move_pixel(b, k % b->values / 3, k / b->values, share, lo);
}

/* A half of the stored light. Until there is other light to show, the store grows only enough for this image; once it
 * is full only a still sky renews it, of which every image is a better one. */
static enum err run_stored(struct beside *b, struct relight_caustics *c, const struct environment *e, uint32_t k,
                           struct relight_stats *stats)
{
    const uint64_t turn = accumulation_turn(b->accumulation);
    enum err result = ERR_OK;

    memset(b->stored[k], 0, b->points * sizeof(float));
    if (k == 0 && b->grows && (turn > 0 || b->stored_by) && (b->still || !relight_caustics_is_full(c)))
        result = relight_caustics_grow(c, b->grows, turn > 0 ? GROW_S : 0.0, stats);
    if (b->stored_by && !result) {
        result = caustic_store_light_half(c->store, e, c->sky.level, k, b->image);
        move_splats(b, 1.0f, b->stored[k]);
    }
    if (b->behind && !result)
        eye_store_light(b->behind[k], e, c->sky.level, b->stored[k]);
    return result;
}

/* Of half k, as many of them as a part has. */
static enum err run_particles(struct beside *b, struct passes *s, const struct environment *e,
                              const struct light_tracer_desc *desc, uint64_t k, uint64_t part,
                              struct relight_stats *stats)
{
    struct light_tracer_desc own = *desc;
    struct light_tracer_stats one = { 0 };

    if (desc->particles == 0)
        return ERR_OK;
    own.ground = b->images > 1 ? b->image + b->values : NULL;
    own.particles = (desc->particles + 2 * b->parts - 1) / (2 * b->parts);
    own.pass = part;
    own.seed = rng_mix(desc->seed, 2 * accumulation_turn(b->accumulation) + k);
    const enum err result = light_tracer_run(s->light, e, &own, b->image, &one);
    light_tracer_stats_add(&stats->light, &one);
    return result;
}

/* Of half k, at the packets of one part. */
static enum err run_eye_paths(struct beside *b, const struct environment *e, const struct eye_paths_desc *desc,
                              uint64_t k, uint64_t part, struct relight_stats *stats)
{
    struct eye_paths_desc own = *desc;
    struct eye_paths_stats found = { 0 };

    if (desc->paths == 0)
        return ERR_OK;
    const uint64_t all = desc->only->count, first = all * part / b->parts, end = all * (part + 1) / b->parts;
    const struct packet_list some = { desc->only->index + first, (uint32_t)(end - first) };
    own.only = &some;
    own.paths = (desc->paths + 1) / 2;
    own.pass = 2 * accumulation_turn(b->accumulation) + k;
    own.seed = rng_mix(desc->seed, k);
    const enum err result = eye_paths_shade(b->set->scene, b->set->rays, b->set->gbuffer, e, &own, b->half[k], &found);
    stats->eye.paths += found.paths;
    stats->eye.rays += found.rays;
    return result;
}

/* A part of new samples, to half k. */
static enum err run_half(struct beside *b, struct passes *s, const struct environment *e,
                         const struct eye_paths_desc *eye, uint64_t k, uint64_t part, struct relight_stats *stats)
{
    if (part == 0)
        memset(b->half[k], 0, b->points * sizeof(float));
    enum err result = run_eye_paths(b, e, eye, k, part, stats);
    if (!result)
        result = run_eye_paths(b, e, &b->unserved, k, part, stats);
    for (int i = 0; i < 3 && !result; i++)
        result = run_particles(b, s, e, &b->light[i], k, part, stats);
    move_splats(b, 1.0f / (float)b->parts, b->half[k]);
    return result;
}

/* The samples of the round become part of the history. lo: what errors are relative to. */
static void take_samples(struct beside *b, const float *lo)
{
    const float *const samples[2] = { b->half[0], b->half[1] };

    accumulation_add(b->accumulation, samples, lo);
    const float share = 1.0f / (float)++b->rounds;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < b->images * b->values; i++)
        b->rest[i] = b->rounds > 1 ? b->rest[i] + share * (b->fresh[i] - b->rest[i]) : b->fresh[i];
}

/* Slice k of these: the history takes the samples, and parts of the filter. If others have used the denoiser since the
 * slice before, all that is left, from the filter's first part on. */
static void filter(struct beside *b, const float *lo, uint32_t k)
{
    const float *const stored[2] = { b->stored[0], b->stored[1] };
    const uint32_t steps = filter_steps(b), count = filter_slices(b);
    const bool lost = k > 0 && denoiser_uses(b->denoiser) != b->uses;
    const uint32_t first = lost ? 1 : k * steps / count, end = lost ? steps : (k + 1) * steps / count;

    for (uint32_t step = first; step < end; step++)
        if (step == 0)
            take_samples(b, lo);
        else
            accumulation_show_part(b->accumulation, step - 1, stored, b->shown);
    b->slice = lost ? slices(b) - 1 : b->slice;
    b->shows = b->shows || end == steps;
    b->uses = denoiser_uses(b->denoiser);
}

static enum err run_slice(struct beside *b, struct passes *s, struct relight_caustics *c, const struct environment *e,
                          const struct eye_paths_desc *eye, bool whole, struct relight_stats *stats)
{
    enum err result = ERR_OK;

    if (b->slice == SLICE_STORED) {
        b->parts = count_parts(b, eye);
        begin(b, whole);
    }
    const uint32_t sampled = SLICE_SAMPLES + 2 * b->parts;
    if (b->slice < SLICE_SAMPLES)
        result = run_stored(b, c, e, b->slice - SLICE_STORED, stats);
    else if (b->slice < sampled)
        result =
            run_half(b, s, e, eye, (b->slice - SLICE_SAMPLES) / b->parts, (b->slice - SLICE_SAMPLES) % b->parts, stats);
    else
        filter(b, s->lo, b->slice - sampled);
    b->slice = result || is_cancelled(b->cancel) ? SLICE_STORED : (b->slice + 1) % slices(b);
    return result;
}

/* The middle of the sun, by samples of equal energy; 0 if there is none. */
static void find_sun(const struct relight_caustics *c, const struct environment *e, float sun[3])
{
    memset(sun, 0, 3 * sizeof(*sun));
    for (int k = 0; k < SUN_PARTS && c->sky.sun_count > 0; k++) {
        const double x[2] = { (k + 0.5) / SUN_PARTS, 0.5 };
        float w[3], rgb[3];
        sky_split_sample(&c->sky, e, x, w, rgb);
        for (int i = 0; i < 3; i++)
            sun[i] += w[i] / SUN_PARTS;
    }
}

/* Whether the sky is too unlike the last image's to take one slice of it. */
static bool is_other_sky(struct beside *b, const struct relight_caustics *c, const struct environment *e)
{
    const double was = b->energy;
    float sun[3] = { 0.0f, 0.0f, 0.0f }, apart = 0.0f;

    find_sun(c, e, sun);
    for (int i = 0; i < 3; i++)
        apart += (sun[i] - b->sun[i]) * (sun[i] - b->sun[i]);
    b->energy = e->total_energy;
    memcpy(b->sun, sun, sizeof(sun));
    return fabs(b->energy - was) > OTHER_ENERGY * was || apart > OTHER_SUN * OTHER_SUN;
}

static void add_shown(const struct beside *b, float *lo)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < b->points; i++)
        lo[i] += b->shown[i];
}

enum err beside_run(struct beside *b, struct passes *s, struct relight_caustics *caustics, const struct environment *e,
                    const struct eye_paths_desc *eye, const struct eye_store *const *behind,
                    struct relight_stats *stats)
{
    b->behind = b->stored_behind ? behind : NULL;
    if (!stats->bias && b->behind)
        stats->bias = "caustics behind mirrors and glass: without those of the sun";
    else if (!stats->bias && eye->paths > 0)
        stats->bias = "caustics behind mirrors and glass: no path brings more than a limit";
    if (b->glides) {
        accumulation_glide(b->accumulation, b->shown);
        add_shown(b, s->lo);
        return ERR_OK;
    }
    enum err result = relight_caustics_take(caustics, e, b->request);
    if (b->stored_by)
        b->light[2] = relight_caustics_sun(caustics, e, b->stored_by, stats->plan.particles);
    const bool whole = is_other_sky(b, caustics, e) || b->still || !b->shows || b->wanted != b->key;

    if (whole)
        b->slice = SLICE_STORED;
    else if (b->slice + 1 < slices(b)) /* the filter does it itself */
        accumulation_glide(b->accumulation, b->shown);
    do
        result = run_slice(b, s, caustics, e, eye, whole, stats);
    while (whole && b->slice != SLICE_STORED && !result && !is_cancelled(b->cancel));
    if (!result && !is_cancelled(b->cancel))
        add_shown(b, s->lo);
    return result;
}

enum err beside_finish(const struct beside *b, struct backplate *ground, const struct environment *e, float *rgb)
{
    float *to = ground ? backplate_splats(ground) : rgb;

    if (!to)
        return ERR_NOMEM;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < b->images * b->values; i++)
        to[i] += b->rest[i];
    if (ground)
        backplate_add_splats(ground, e, rgb);
    return ERR_OK;
}
