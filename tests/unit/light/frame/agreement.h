/* What the tests that hold estimators to each other share: a scene before a camera under a sky, an estimator run by
 * many seeds, and the comparison of two.
 *
 * Points of an image share light samples, so that its pixels are correlated: the replicates are seeds. What is
 * compared is the mean luminance over the pixels that count, and over those in each ninth of the image. Two
 * estimators differ where their means over the seeds do by more than limit() joint standard errors, or in a ninth by
 * more than limit_ninth(). By chance that happens to the whole image once in 20 000 comparisons of SEEDS_ALL seeds
 * where both errors are equal and once in 6000 where one is nothing (Student's t of 46 and of 23 degrees of freedom),
 * of SEEDS_FEW once in 5100 and in 640. A ninth holds few points, so that its sums are further from normal: among
 * 5000 of them 4.5 errors have been seen once. There are some 180 comparisons, and the seeds are fixed: what passes
 * once will pass again. AGREEMENT_SEED draws others.
 *
 * Power: of each comparison the joint error over the whole image of SEEDS_ALL seeds is asserted, as a share of it:
 * WORST_ERROR, or what the comparison says. A bias of five times that is caught in 7 of 10 if the error is as large as
 * is allowed, and where it is two thirds of it, as the counts were chosen, in 998 of 1000. So WORST_ERROR is a bias of
 * 1 %. Each commit draws SEEDS_FEW with a quarter of the samples each, whose errors are 3.46 times as large: it catches
 * a bias of 3.85 % as often, at two thirds of the error one of 2.8 % in 8 of 10 and one of 2 % in 3 of 10. What the
 * tests say of a bias that is caught holds for all seeds. */
#pragma once

#include "light/estimators/points.h"

#include "import/reader/reader.h"
#include "light/estimators/baselines/path.h"
#include "light/estimators/caustic_store.h"
#include "light/estimators/eye_paths.h"
#include "light/estimators/light_tracer.h"
#include "light/resolve/resolve.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/scene_build.h"
#include "sky/source/source.h"
#include "sky/tables/sky_split.h"

#include <omp.h>

#ifndef AGREEMENT_SEED
#define AGREEMENT_SEED 1
#endif

#define WORST_ERROR 2e-3
#define REGIONS 10 /* the whole image, then its ninths */

enum { SEEDS_FEW = 8, SEEDS_ALL = 24, PIXELS_MAX = 64 * 36, SEQUENCED = 2 + 2 * PATH_PLACES_EVENT };

struct world {
    struct scene *scene;
    struct environment *environment;
    struct rays *rays;
    struct direct *direct;
    struct gbuffer *gbuffer; /* one camera ray a pixel, two by two sets of light samples */
    struct view view;
    struct light_tracer *light;
    float *lo;
    uint32_t width, height, pixels;
    uint64_t stream;          /* of the sky and all that was before it: each world draws its own numbers */
    uint8_t mask[PIXELS_MAX]; /* 1: the pixel counts */
};

enum who {
    BY_DIRECT, /* direct.h, at the G-buffer's points */
    BY_EYE,    /* eye_paths.h, at the same */
    BY_CENTRE, /* path.h through the pixels' centres, which is where those points are */
    BY_PATH,   /* path.h, all over the pixels */
    BY_LIGHT,  /* light_tracer.h, likewise */
    BY_MLT,    /* mlt.c, likewise */
    BY_STORED, /* caustic_store.h, and light_tracer.h for the sky's sun, likewise */
};

struct technique {
    const char *name;
    enum who who;
    uint32_t classes;          /* of all but BY_DIRECT */
    uint32_t count;            /* samples a pixel or point; BY_LIGHT: particles, BY_STORED: paths and particles */
    struct direct_desc direct; /* method and options */
    enum start_kind start;
    double worst;   /* joint error that is allowed to the comparison with it, of the whole image; 0: WORST_ERROR */
    double allowed; /* of its mean, to each ninth, beyond chance; a tenth of that to the whole image */
};

struct estimate {
    double mean[REGIONS], error[REGIONS]; /* luminance; the whole image's is the sum of its ninths */
};

static inline uint64_t stream_of(uint64_t stream, const char *name)
{
    for (; *name; name++)
        stream = rng_mix(stream, (uint64_t)*name);
    return stream;
}

/* scene: beside the test data, in the folder of scenes; NULL: the built-in one. Then world_sky and world_look. */
static inline struct world world_open(const char *scene)
{
    struct world w = { .stream = stream_of(AGREEMENT_SEED, scene ? scene : "") };
    struct reason why = { "" };

    omp_set_num_threads(1); /* claims run beside each other */
    if (scene && scene_load(unit_data(scene), NULL, &w.scene, NULL, &why))
        fail_msg("%s", why.text);
    if (!scene)
        w.scene = scene_create_builtin();
    w.environment = environment_create(&(struct environment_desc){ .n = 0 });
    w.direct = direct_create(best_kernels());
    assert_true(w.scene && w.environment && w.direct);
    return w;
}

/* spec: a file below the test data, or of the built-in sky. */
static inline void world_sky(struct world *w, const char *spec)
{
    const struct source_desc desc = { .spec = strncmp(spec, "sky:", 4) == 0 ? spec : unit_data(spec) };
    struct source *source = NULL;
    struct frame f = { 0 };
    struct reason why = { "" };

    if (source_open(&desc, &source, &why) || source_next(source, &f, &why) ||
        environment_update(w->environment, &f, &why))
        fail_msg("%s", why.text);
    source_close(source);
    frame_finish(&f);
    w->stream = stream_of(w->stream, spec);
}

static inline void world_close_look(struct world *w)
{
    mem_free(w->lo);
    light_tracer_destroy(w->light);
    gbuffer_destroy(w->gbuffer);
}

/* An image of that size, of which every pixel counts. */
static inline void world_look(struct world *w, uint32_t width, uint32_t height)
{
    const struct camera *camera = scene_camera(w->scene, NULL);
    const struct gbuffer_desc desc = { .camera = camera, .width = width, .height = height, .edge_rays = 1 };
    struct reason why = { "" };

    if (!w->rays)
        w->rays = rays_create_for(w->scene, cpu_best());
    assert_non_null(w->rays);
    world_close_look(w);
    if (gbuffer_create(w->scene, w->rays, &desc, &w->gbuffer, &why))
        fail_msg("%s", why.text);
    view_init(&w->view, camera, width, height);
    w->light = light_tracer_create(w->scene, w->rays, &w->view);
    w->lo = mem_alloc(w->gbuffer->packet_count, 3 * PACKET * sizeof(float));
    w->width = width;
    w->height = height;
    w->pixels = width * height;
    assert_true(w->light && w->lo && w->pixels <= PIXELS_MAX);
    memset(w->mask, 1, sizeof(w->mask));
}

/* Before world_look: draws all vertices that are further than `reach` metres from the y axis, along x or z, in to
 * there. So the wide ground is cut, on which else nearly all particles would end that nobody sees. */
static inline void world_trim(struct world *w, float reach)
{
    struct scene *s = w->scene;

    for (size_t m = 0; m < s->mesh_count; m++)
        for (size_t v = 0; v < s->meshes[m].vertex_count; v++) {
            float *p = s->meshes[m].positions + 3 * v;
            p[0] = fminf(reach, fmaxf(-reach, p[0]));
            p[2] = fminf(reach, fmaxf(-reach, p[2]));
        }
    s->low.x = fmaxf(s->low.x, -reach);
    s->low.z = fmaxf(s->low.z, -reach);
    s->high.x = fminf(s->high.x, reach);
    s->high.z = fminf(s->high.z, reach);
}

/* Before world_look: all meshes but the first, the ground, get a mask of round holes at 10 cm from each other, which
 * let through about a half. */
static inline void world_perforate(struct world *w)
{
    enum { SIDE = 32 };
    struct texture t;
    uint32_t index;

    assert_int_equal(texture_init(&t, SIDE, SIDE, TEXTURE_CUTOUT), ERR_OK);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        const double x = (i % SIDE + 0.5) / SIDE - 0.5, y = (i / SIDE + 0.5) / SIDE - 0.5;
        const double alpha = 0.5 + 4.0 * (hypot(x, y) - 0.4); /* a soft edge at a radius of 0.4: half of the square */
        memset(t.texels + 4 * (size_t)i, (int)lround(255.0 * fmin(fmax(alpha, 0.0), 1.0)), 4);
    }
    texture_build_levels(&t);
    assert_int_equal(scene_add_texture(w->scene, &t, &index), ERR_OK);
    for (size_t i = 1; i < w->scene->mesh_count; i++) {
        struct mesh *m = &w->scene->meshes[i];
        struct material holed = w->scene->materials[m->material];
        holed.alpha_mode = ALPHA_MASK;
        holed.alpha = 1.0f;
        holed.alpha_cutoff = 0.5f;
        holed.alpha_texture = index;
        assert_int_equal(scene_add_material(w->scene, &holed, &m->material), ERR_OK);
        m->uvs = mem_alloc(m->vertex_count, 2 * sizeof(float));
        assert_non_null(m->uvs);
        for (size_t v = 0; v < m->vertex_count; v++) {
            const float *p = m->positions + 3 * v; /* no axis is without a change of both */
            m->uvs[2 * v] = 10.0f * (p[0] + 0.4f * p[2]);
            m->uvs[2 * v + 1] = 10.0f * (p[1] - 0.7f * p[2] + 0.3f * p[0]);
        }
    }
    w->stream = stream_of(w->stream, "holes");
}

/* After world_trim: every surface becomes ggx whose roughness rises along x, from 0.2 to 1, and which becomes metal
 * along z. The ramps are the same however they are filtered. */
static inline void world_polish(struct world *w)
{
    enum { SIDE = 256 };
    const float reach = 10.0f; /* further than any vertex */
    struct texture t;
    uint32_t index;

    assert_int_equal(texture_init(&t, SIDE, SIDE, TEXTURE_LINEAR), ERR_OK);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        const uint8_t rough = (uint8_t)(51 + i % SIDE * 204 / 255), texel[4] = { 0, rough, (uint8_t)(i / SIDE), 255 };
        memcpy(t.texels + 4 * (size_t)i, texel, 4);
    }
    t.wrap_u = t.wrap_v = TEXTURE_CLAMP;
    texture_build_levels(&t);
    assert_int_equal(scene_add_texture(w->scene, &t, &index), ERR_OK);
    for (size_t i = 0; i < w->scene->material_count; i++) {
        struct material *m = &w->scene->materials[i];
        m->kind = MATERIAL_GGX;
        m->metallic = m->roughness = 1.0f;
        m->maps = MAP_ROUGHNESS;
        m->roughness_texture = index;
    }
    for (size_t i = 0; i < w->scene->mesh_count; i++) {
        struct mesh *m = &w->scene->meshes[i];
        mem_free(m->uvs);
        m->uvs = mem_alloc(m->vertex_count, 2 * sizeof(float));
        assert_non_null(m->uvs);
        for (size_t v = 0; v < 2 * (size_t)m->vertex_count; v++)
            m->uvs[v] = 0.5f + 0.5f * m->positions[3 * (v / 2) + 2 * (v % 2)] / reach;
    }
    w->stream = stream_of(w->stream, "maps");
}

/* The same, and normals that turn by up to 35 degrees along x and z, likewise. */
static inline void world_bend(struct world *w)
{
    enum { SIDE = 256 };
    const float reach = 14.0f; /* further than any vertex, by the skewed coordinates below */
    struct texture t;
    uint32_t index;

    world_polish(w);
    assert_int_equal(texture_init(&t, SIDE, SIDE, TEXTURE_LINEAR), ERR_OK);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        const uint8_t texel[4] = { i % SIDE & ~1u, i / SIDE & ~1u, 255, 255 }; /* all means are whole numbers */
        memcpy(t.texels + 4 * (size_t)i, texel, 4);
    }
    t.wrap_u = t.wrap_v = TEXTURE_CLAMP;
    texture_build_levels(&t);
    assert_int_equal(scene_add_texture(w->scene, &t, &index), ERR_OK);
    for (size_t i = 0; i < w->scene->material_count; i++) {
        w->scene->materials[i].maps |= MAP_NORMAL;
        w->scene->materials[i].normal_texture = index;
        w->scene->materials[i].normal_scale = 0.5f;
    }
    for (size_t i = 0; i < w->scene->mesh_count; i++) {
        struct mesh *m = &w->scene->meshes[i];
        for (size_t v = 0; v < m->vertex_count; v++) {
            const float *p = m->positions + 3 * v;
            m->uvs[2 * v] = 0.5f + 0.5f * (p[0] + 0.4f * p[1]) / reach;
            m->uvs[2 * v + 1] = 0.5f - 0.5f * (p[2] - 0.3f * p[1]) / reach;
        }
        assert_int_equal(mesh_make_tangents(m, false), ERR_OK);
    }
    w->stream = stream_of(w->stream, "bent");
}

/* Whether any of 16 rays through the pixel meets a mirror or glass. */
static inline bool sees_delta(const struct world *w, uint32_t x, uint32_t y)
{
    const struct vec3 eye = vec3_make((float)w->view.origin[0], (float)w->view.origin[1], (float)w->view.origin[2]);

    for (uint32_t k = 0; k < 16; k++) {
        const struct vec3 dir = view_direction(&w->view, x + (k % 4 + 0.5) / 4.0, y + (k / 4 + 0.5) / 4.0);
        struct hit h;
        if (rays_intersect(w->rays, eye, dir, 0.0f, &h) &&
            material_is_delta(&w->scene->materials[w->scene->meshes[h.mesh].material]))
            return true;
    }
    return false;
}

/* What stands behind mirrors and glass is out of the light tracer's reach: pixels that see them do not count, nor do
 * their neighbours. All other edges of geometry do. */
static inline void world_leave_out_deltas(struct world *w)
{
    uint32_t left = 0;

    for (uint32_t y = 0; y < w->height; y++)
        for (uint32_t x = 0; x < w->width; x++)
            if (sees_delta(w, x, y))
                for (uint32_t j = y - (y > 0); j <= y + 1 && j < w->height; j++)
                    for (uint32_t i = x - (x > 0); i <= x + 1 && i < w->width; i++)
                        w->mask[j * w->width + i] = 0;
    for (uint32_t i = 0; i < w->pixels; i++)
        left += w->mask[i];
    assert_true(2 * left >= w->pixels);
}

static inline void world_finish(struct world *w)
{
    world_close_look(w);
    direct_destroy(w->direct);
    rays_destroy(w->rays);
    environment_destroy(w->environment);
    scene_destroy(w->scene);
}

/* What a sample of path.h is made of: at its first events a low-discrepancy sequence, the same for all pixels but for a
 * digital shift of each place of each pixel, which leaves every number uniform; then random numbers. */
struct placed {
    struct numbers numbers; /* the first member */
    const uint64_t *row;    /* [SEQUENCED]: of this sample */
    const uint64_t *turn;   /* [SEQUENCED]: of this pixel */
    uint64_t stream;
};

static inline double placed_at(struct numbers *n, uint32_t place)
{
    const struct placed *p = (const struct placed *)n;
    return rng_unit(place < SEQUENCED ? p->row[place] ^ p->turn[place] : rng_mix(p->stream, place));
}

static inline uint32_t shuffled(uint64_t seed, uint32_t index)
{
    double x[2];
    uint32_t r = 0;
    for (int bit = 0; bit < 32; bit++)
        r |= (index >> bit & 1) << (31 - bit);
    rng_sobol2(seed, r, x);
    return (uint32_t)(x[0] * 0x1p32);
}

/* rows[count][SEQUENCED]: each pair of places by the Sobol sequence, in an order of its own. */
static inline void fill_rows(uint64_t seed, uint32_t count, uint64_t *rows)
{
    for (uint32_t k = 0; k < count; k++)
        for (uint32_t p = 0; p < SEQUENCED; p += 2) {
            double x[2];
            rng_sobol2(rng_mix(seed, p), shuffled(rng_mix(seed, p + 1), k), x);
            rows[k * SEQUENCED + p] = (uint64_t)(x[0] * 0x1p53) << 11;
            rows[k * SEQUENCED + p + 1] = (uint64_t)(x[1] * 0x1p53) << 11;
        }
}

static inline void take_paths(const struct world *w, const struct technique *t, uint64_t seed, float *rgb)
{
    const struct path_world world = { w->scene, w->rays, &w->view, w->environment, NULL };
    uint64_t *rows = mem_alloc(t->count, SEQUENCED * sizeof(*rows)), rays = 0;

    fill_rows(seed, t->count, rows);
    for (uint32_t i = 0; i < w->pixels; i++) {
        uint64_t turn[SEQUENCED];
        double sum[3] = { 0.0, 0.0, 0.0 };
        for (uint32_t p = 0; p < SEQUENCED; p++)
            turn[p] = rng_mix(rng_mix(seed, i), p);
        for (uint32_t k = 0; k < t->count && w->mask[i]; k++) {
            struct placed c = { { placed_at }, rows + k * SEQUENCED, turn, rng_mix(rng_mix(~seed, i), k) };
            const bool centre = t->who == BY_CENTRE;
            const double xy[2] = { i % w->width + (centre ? 0.5 : placed_at(&c.numbers, 0)),
                                   i / w->width + (centre ? 0.5 : placed_at(&c.numbers, 1)) };
            double one[3];
            path_sample(&world, t->classes, xy, &c.numbers, one, &rays);
            for (int a = 0; a < 3; a++)
                sum[a] += one[a];
        }
        for (int a = 0; a < 3; a++)
            rgb[3 * i + (uint32_t)a] = (float)(sum[a] / (double)t->count);
    }
    mem_free(rows);
}

static inline void take_points(struct world *w, const struct technique *t, uint64_t seed, float *rgb)
{
    struct direct_desc direct = t->direct;
    struct direct_stats direct_stats;
    struct eye_paths_stats eye_stats;
    const struct eye_paths_desc eye = {
        .classes = t->classes, .behind_classes = t->classes, .paths = t->count, .seed = seed
    };

    direct.samples = t->count;
    direct.seed = seed;
    memset(w->lo, 0, (size_t)w->gbuffer->packet_count * 3 * PACKET * sizeof(float));
    if (t->who == BY_DIRECT)
        assert_int_equal(direct_shade(w->direct, w->gbuffer, w->rays, w->environment, &direct, w->lo, &direct_stats),
                         ERR_OK);
    else
        assert_int_equal(eye_paths_shade(w->scene, w->rays, w->gbuffer, w->environment, &eye, w->lo, &eye_stats),
                         ERR_OK);
    resolve_pixels(w->gbuffer, w->lo, NULL, rgb);
}

static inline void take_stored(const struct world *w, const struct technique *t, uint64_t seed, float *rgb)
{
    const struct caustic_store_desc desc = { t->classes, t->count, .parts = 3, .start = t->start, .seed = seed };
    struct sky_split sky = { .level = 0.0f };
    struct light_tracer_stats stats;
    struct caustic_store *store;
    struct reason why;

    assert_int_equal(sky_split_take(&sky, w->environment), ERR_OK);
    assert_int_equal(caustic_store_create(w->scene, w->rays, &w->view, &desc, &store, &why), ERR_OK);
    assert_int_equal(caustic_store_turn(store, 0, NULL, NULL), ERR_OK);
    assert_int_equal(caustic_store_light(store, w->environment, sky.level, rgb), ERR_OK);
    const struct light_tracer_desc light = {
        .classes = t->classes, .particles = t->count, .seed = seed, .start = t->start, .sun = &sky
    };
    assert_int_equal(light_tracer_run(w->light, w->environment, &light, rgb, &stats), ERR_OK);
    caustic_store_destroy(store);
    sky_split_finish(&sky);
}

static inline void take(struct world *w, const struct technique *t, uint64_t seed, float *rgb)
{
    const struct path_world world = { w->scene, w->rays, &w->view, w->environment, NULL };
    const struct path_desc path = { .classes = t->classes, .samples = t->count, .seed = seed };
    const struct light_tracer_desc light = {
        .classes = t->classes, .particles = t->count, .seed = seed, .start = t->start
    };
    struct light_tracer_stats light_stats;
    struct path_stats path_stats;

    memset(rgb, 0, 3 * PIXELS_MAX * sizeof(*rgb));
    if (t->who == BY_CENTRE || t->who == BY_PATH)
        take_paths(w, t, seed, rgb);
    else if (t->who == BY_MLT)
        assert_int_equal(mlt_render(&world, &path, rgb, &path_stats), ERR_OK);
    else if (t->who == BY_STORED)
        take_stored(w, t, seed, rgb);
    else if (t->who == BY_LIGHT)
        assert_int_equal(light_tracer_run(w->light, w->environment, &light, rgb, &light_stats), ERR_OK);
    else
        take_points(w, t, seed, rgb);
}

/* Each region's mean over those of its pixels that count, as a share of all that count: the ninths add up to the whole.
 */
static inline void sum_regions(const struct world *w, const float *rgb, double out[REGIONS])
{
    double count = 0.0;

    for (uint32_t r = 0; r < REGIONS; r++)
        out[r] = 0.0;
    for (uint32_t i = 0; i < w->pixels; i++) {
        const uint32_t ninth = 1 + i / w->width * 3 / w->height * 3 + i % w->width * 3 / w->width;
        if (!w->mask[i])
            continue;
        out[ninth] += rgb_luminance(rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]);
        count++;
    }
    for (uint32_t r = 1; r < REGIONS; r++) {
        out[r] /= count;
        out[0] += out[r];
    }
}

/* Each commit draws a quarter of the samples. */
static inline uint32_t samples_part(void)
{
    return seeds_count(4, 1);
}

static inline struct estimate measure(struct world *w, const struct technique *t)
{
    static float rgb[3 * PIXELS_MAX];
    double sum[REGIONS] = { 0.0 }, squares[REGIONS] = { 0.0 };
    const uint64_t stream = rng_mix(stream_of(w->stream, t->name), t->classes);
    const uint32_t seeds = seeds_count(SEEDS_FEW, SEEDS_ALL);
    struct technique drawn = *t;
    struct estimate out;

    drawn.count /= samples_part();
    for (uint64_t seed = 0; seed < seeds; seed++) {
        double value[REGIONS];
        take(w, &drawn, rng_mix(stream, seed), rgb);
        sum_regions(w, rgb, value);
        for (uint32_t r = 0; r < REGIONS; r++) {
            sum[r] += value[r];
            squares[r] += value[r] * value[r];
        }
    }
    for (uint32_t r = 0; r < REGIONS; r++) {
        out.mean[r] = sum[r] / seeds;
        out.error[r] = sqrt(fmax(0.0, squares[r] / seeds - out.mean[r] * out.mean[r]) / (seeds - 1));
    }
    return out;
}

/* The estimate of a sum of independent estimates. */
static inline void add_estimate(struct estimate *sum, const struct estimate *e, double factor)
{
    for (uint32_t r = 0; r < REGIONS; r++) {
        sum->mean[r] += factor * e->mean[r];
        sum->error[r] = hypot(sum->error[r], factor * e->error[r]);
    }
}

/* How many joint errors the two are apart in a region, beyond `allowed` of the latter's mean there. */
static inline double apart(const struct estimate *a, const struct estimate *b, uint32_t region, double allowed)
{
    const double error = hypot(a->error[region], b->error[region]) + 1e-7 * fabs(b->mean[0]);
    return fmax(0.0, fabs(a->mean[region] - b->mean[region]) - allowed * fabs(b->mean[region])) / error;
}

static inline double worst_ninth(const struct estimate *a, const struct estimate *b, double allowed)
{
    double worst = 0.0;

    for (uint32_t r = 1; r < REGIONS; r++)
        worst = fmax(worst, apart(a, b, r, allowed));
    return worst;
}

/* Joint errors, by all seeds 4.5 and 6.5. */
static inline double limit(void)
{
    return seeds_count(50, 45) / 10.0;
}

static inline double limit_ninth(void)
{
    return limit() + 2.0;
}

static inline bool agree(const struct estimate *a, const struct estimate *b, double allowed)
{
    return apart(a, b, 0, 0.1 * allowed) < limit() && worst_ninth(a, b, allowed) < limit_ninth();
}

static inline double blur(void)
{
    return seeds_blur(SEEDS_FEW, SEEDS_ALL) * sqrt(samples_part());
}

static inline bool sharp(const struct estimate *a, const struct estimate *b, double worst)
{
    return b->mean[0] > 0.0 && hypot(a->error[0], b->error[0]) <= blur() * worst * b->mean[0];
}

/* Prints the comparison, whatever comes of it. */
static inline void assert_agree(const char *name, const struct estimate *a, const struct estimate *b, double worst,
                                double allowed)
{
    const double joint = hypot(a->error[0], b->error[0]), bound = worst > 0.0 ? worst : WORST_ERROR;

    printf("%-28s %+.3f %%, joint error %.3f %% of %.3f, z %+.2f, ninths up to %.2f, %.2f\n", name,
           100.0 * (a->mean[0] / b->mean[0] - 1.0), 100.0 * joint / b->mean[0], 100.0 * blur() * bound,
           (a->mean[0] - b->mean[0]) / joint, worst_ninth(a, b, 0.0), worst_ninth(a, b, allowed));
    fflush(stdout);
    assert_true(sharp(a, b, bound));
    assert_true(agree(a, b, allowed));
}

static inline void assert_technique_agrees(struct world *w, const struct technique *t, const struct estimate *want)
{
    const struct estimate got = measure(w, t);
    assert_agree(t->name, &got, want, t->worst, t->allowed);
}
