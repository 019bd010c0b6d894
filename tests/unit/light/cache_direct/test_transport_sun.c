/* The sun of a sky: its light where nothing hides it, the parts that points see, and what is kept of them. */
#include "light/cache_direct/internal.h"
#include "light/cache_direct/sealed.h"
#include "light/cache_direct/sun_index.h"
#include "light/cache_direct/transports.h"
#include "light/estimators/worlds.h"
#include "light/estimators/levels.h"
#include "scene/geometry/files.h"

#include <pthread.h>

#define TOLERANCE 1e-4 /* of the light of a surface that faces the sun */
#define CUT_TOLERANCE 1e-3

enum { SAMPLES = 1 << 14 };

struct sampled {
    float w[SAMPLES][3], rgb[SAMPLES][3];
};

static struct sampled *sample_sky(const struct sky_split *sky, const struct environment *e)
{
    struct sampled *s = mem_alloc(1, sizeof(*s));

    for (uint32_t i = 0; i < SAMPLES; i++) {
        double x[2];
        rng_sobol2(3, i, x);
        sky_split_sample(sky, e, x, s->w[i], s->rgb[i]);
    }
    return s;
}

/* What a matte point sees of the sun: the mean over its samples. False if its horizon cuts it. */
static bool sum_samples(const struct sampled *s, const struct shade_packet *p, uint32_t l, double out[3])
{
    uint32_t above = 0;

    memset(out, 0, 3 * sizeof(*out));
    for (uint32_t i = 0; i < SAMPLES; i++) {
        const float *w = s->w[i];
        const double cosine = (double)(p->ns_x[l] * w[0] + p->ns_y[l] * w[1] + p->ns_z[l] * w[2]);
        above += cosine > 0.0;
        for (int c = 0; c < 3 && cosine > 0.0; c++)
            out[c] += (double)(p->diffuse[c][l] * s->rgb[i][c]) * cosine / PI / SAMPLES;
    }
    return above == 0 || above == SAMPLES;
}

/* The block of packet k alone. */
static void compare_packet(struct transport *t, const struct sampled *s, uint32_t k, uint32_t counts[2])
{
    const struct shade_packet *p = &t->gbuffer->packets[k];
    float lo[TRANSPORT_PACKETS * 3 * PACKET] = { 0.0f };
    const struct transport_block *b = transport_block_of(t, k);
    uint64_t rays = 0;
    double most[3] = { 0.0 };

    assert_int_equal(transport_sun_add(t, (uint32_t)(b - t->blocks), lo, &rays), 0);
    assert_true(rays == 0);
    for (uint32_t i = 0; i < SAMPLES; i++)
        for (int c = 0; c < 3; c++) /* for a surface that faces it */
            most[c] += 0.6 / PI * (double)s->rgb[i][c] / SAMPLES;
    for (uint32_t l = 0; l < PACKET; l++) {
        double want[3];
        const bool whole = sum_samples(s, p, l, want);
        for (int c = 0; c < 3; c++)
            assert_true(fabs((double)lo[((k - b->first) * 3 + (uint32_t)c) * PACKET + l] - want[c]) <=
                        (whole ? TOLERANCE : CUT_TOLERANCE) * most[c]);
        counts[whole]++;
    }
}

/* Normals all over the sphere, under two suns. The mean of 2^14 stratified samples errs by less than 2e-5; a factor
 * left out or a texel lost is 10 % and more. Where a horizon cuts the sun, which is 0.7 degrees wide, all is faint. */
static void an_open_sun_has_the_light_of_its_samples(void **state)
{
    struct gbuffer g = points_make(40, LOBE_LAMBERT, 0.6f, 0.0f, 0.0f);
    uint32_t counts[2] = { 0, 0 };
    (void)state;

    points_scatter(&g, 9);
    for (int sun = 0; sun < 2; sun++) {
        struct environment *e = sky_environment(sky_with_sun(256, 128, sun ? 2e5f : 4e3f), 128, 0.0);
        struct transport *t = transport_begin(&g, NULL, best_kernels(), &(struct transport_desc){ .per_cell = 1 });
        assert_non_null(t);
        assert_int_equal(sky_split_take(&t->sky, e), ERR_OK);
        assert_int_equal(transport_sun_take(t, e), ERR_OK);
        assert_true(t->sky.sun_count > 0 && t->sun.parts.count > 0);
        struct sampled *s = sample_sky(&t->sky, e);
        for (uint32_t k = 0; k < g.packet_count; k++)
            compare_packet(t, s, k, counts);
        mem_free(s);
        transport_destroy(t);
        environment_destroy(e);
    }
    printf("%u points whose horizon cuts the sun, %u others\n", counts[0], counts[1]);
    assert_true(counts[0] >= 5);
    points_free(&g);
}

/* ---- A shadow with a penumbra ---- */

enum { WIDTH = 48, HEIGHT = 32 };

enum { SLATS = 60 };

static const struct camera above = { "above", { 0, 1.4f, 0.01f }, { 0, 0, 0 }, { 0, 0, -1 }, 0.9f };

/* A floor under slanting slats, 15 cm wide and as far apart, whose penumbrae are 2 to 3 cm wide. */
static struct scene *slatted_floor(void)
{
    static const float floor[4][3] = { { -9, 0, -9 }, { -9, 0, 9 }, { 9, 0, 9 }, { 9, 0, -9 } };
    float slats[SLATS][4][3];
    struct scene *s = scene_create();

    for (int k = 0; k < SLATS; k++) {
        const float x = 0.3f * (float)(k - SLATS / 2);
        const float slat[4][3] = {
            { x - 3, 1.5f, -9 }, { x - 2.85f, 1.5f, -9 }, { x + 3.15f, 1.5f, 9 }, { x + 3, 1.5f, 9 }
        };
        memcpy(slats[k], slat, sizeof(slat));
    }
    add_quads(s, add_lambert(s, 0.5f), floor, 1);
    add_quads(s, add_lambert(s, 0.2f), (const float(*)[3])slats, SLATS);
    return s;
}

struct shadow {
    struct world world;
    struct gbuffer *gbuffer;
    struct transport *transport;
    float *lo, *want;
};

static struct environment *turned_sky(double degrees)
{
    return sky_environment(sky_with_sun(512, 256, 2e5f), 256, degrees);
}

static struct shadow shadow_of_size(uint32_t width, uint32_t height)
{
    const struct gbuffer_desc desc = { .camera = &above, .width = width, .height = height };
    struct reason why = { "" };
    struct shadow s;

    world_make(&s.world, slatted_floor(), &above, width, height, turned_sky(0.0));
    assert_int_equal(gbuffer_create(s.world.scene, s.world.rays, &desc, &s.gbuffer, &why), ERR_OK);
    s.transport = transport_of(s.gbuffer, s.world.rays, &(struct transport_desc){ .per_cell = 1 });
    s.lo = mem_alloc(s.gbuffer->packet_count, 3 * PACKET * sizeof(float));
    s.want = mem_alloc(s.gbuffer->packet_count, 3 * PACKET * sizeof(float));
    return s;
}

static struct shadow shadow_make(void)
{
    return shadow_of_size(WIDTH, HEIGHT);
}

static void shadow_finish(struct shadow *s)
{
    transport_destroy(s->transport);
    gbuffer_destroy(s->gbuffer);
    world_finish(&s->world);
    mem_free(s->lo);
    mem_free(s->want);
}

static struct transport_frame_stats shadow_shade(const struct shadow *s, struct transport *t, double degrees, float *lo)
{
    const struct transport_frame frame = { .end = 0 };
    struct transport_frame_stats stats;
    struct environment *e = turned_sky(degrees);

    assert_int_equal(transport_shade(t, e, &frame, lo, &stats), ERR_OK);
    assert_true(stats.sun > 0 && s->gbuffer->packet_count > 0);
    environment_destroy(e);
    return stats;
}

/* Eight suns, a fifth of a degree apart, against 1024 samples of each. Over points in penumbrae, which are as wide as
 * a pixel, the error is 0.050 of the full sun, and 0.0001 in the mean. Bits of the direction before make it 0.072, and
 * 0.025 in the mean; rays that go to the next square 0.109; packets judged by two corners only 0.069; all from the same
 * cell of their pixel 0.059. */
static void penumbrae_are_where_they_belong(void **state)
{
    const struct direct_desc all = { .method = METHOD_MIS, .sun = true, .samples = 1024, .seed = 4 };
    struct shadow s = shadow_make();
    struct direct *d = direct_create(best_kernels());
    double square = 0.0, sum = 0.0, full = 0.0;
    uint32_t count = 0;
    (void)state;

    for (int turn = 0; turn < 8; turn++) {
        struct direct_stats direct_stats;
        struct environment *e = turned_sky(0.2 * turn);
        shadow_shade(&s, s.transport, 0.2 * turn, s.lo);
        assert_int_equal(direct_shade(d, s.gbuffer, s.world.rays, e, &all, s.want, &direct_stats), ERR_OK);
        environment_destroy(e);
        double most = 0.0, least = INFINITY;
        for (uint32_t k = 0; k < s.gbuffer->packet_count; k++)
            for (uint32_t l = 0; l < s.gbuffer->packets[k].count; l++) {
                most = fmax(most, (double)s.want[k * 3 * PACKET + l]);
                least = fmin(least, (double)s.want[k * 3 * PACKET + l]);
            }
        full = most - least;
        for (uint32_t k = 0; k < s.gbuffer->packet_count; k++)
            for (uint32_t l = 0; l < s.gbuffer->packets[k].count; l++) {
                const double want = s.want[k * 3 * PACKET + l], error = (s.lo[k * 3 * PACKET + l] - want) / full;
                if (want > least + 0.1 * full && want < most - 0.1 * full) {
                    square += error * error;
                    sum += error;
                    count++;
                }
            }
    }
    printf("%u points in penumbrae: error %.4f, mean %.4f\n", count, sqrt(square / count), sum / count);
    assert_true(count > 300);
    assert_true(sqrt(square / count) < 0.055 && fabs(sum / count) < 0.003);
    direct_destroy(d);
    shadow_finish(&s);
}

static float pixel_light(const struct shadow *s, const float *lo, uint32_t x, uint32_t y)
{
    const uint32_t point = s->gbuffer->entries[s->gbuffer->entry_first[y * s->gbuffer->width + x]].point;

    return lo[(size_t)(point / PACKET) * 3 * PACKET + point % PACKET];
}

/* The error of an image's pixels in which a shadow ends, in parts of the full sun: an image of eight times as many
 * pixels along each side says how much of it reaches them. */
static double edge_error(const struct shadow *coarse, const float *lo, const struct shadow *fine)
{
    const uint32_t width = coarse->gbuffer->width, height = coarse->gbuffer->height;
    double square = 0.0, most = 0.0, least = INFINITY;
    uint32_t count = 0;

    for (uint32_t i = 0; i < 64 * width * height; i++) {
        const double light = (double)pixel_light(fine, fine->lo, i % (8 * width), i / (8 * width));
        most = fmax(most, light);
        least = fmin(least, light);
    }
    for (uint32_t i = 0; i < width * height; i++) {
        double sum = 0.0;
        for (uint32_t k = 0; k < 64; k++)
            sum += (double)pixel_light(fine, fine->lo, i % width * 8 + k % 8, i / width * 8 + k / 8) / 64.0;
        const double part = (sum - least) / (most - least);
        if (part > 0.1 && part < 0.9) {
            const double error = ((double)pixel_light(coarse, lo, i % width, i / width) - sum) / (most - least);
            square += error * error;
            count++;
        }
    }
    assert_true(count > 50);
    return sqrt(square / count);
}

/* Pixels of 8 cm, and penumbrae of 2 to 3: errors are 0.04 and 0.02. They are 0.29 where a pixel's rays start at its
 * point alone, 0.21 where half of the cells get no ray, and 0.09 and 0.05 with bits of the direction before. */
static void edges_of_shadows_are_antialiased(void **state)
{
    const struct direct_desc all = { .method = METHOD_MIS, .sun = true, .samples = 256, .seed = 4 };
    struct shadow coarse = shadow_of_size(16, 12), fine = shadow_of_size(128, 96);
    struct direct *d = direct_create(best_kernels());
    struct environment *e = turned_sky(0.0);
    struct direct_stats stats;
    (void)state;

    shadow_shade(&fine, fine.transport, 0.0, fine.lo);
    shadow_shade(&coarse, coarse.transport, 0.0, coarse.lo);
    assert_int_equal(direct_shade(d, coarse.gbuffer, coarse.world.rays, e, &all, coarse.want, &stats), ERR_OK);
    const double cached = edge_error(&coarse, coarse.lo, &fine), mis = edge_error(&coarse, coarse.want, &fine);
    printf("errors of pixels where shadows end: cached %.3f, mis %.3f\n", cached, mis);
    assert_true(cached < 0.06 && mis < 0.04);
    environment_destroy(e);
    direct_destroy(d);
    shadow_finish(&coarse);
    shadow_finish(&fine);
}

/* A plane, level or steep, near the origin or far away, under a sky: no ray that starts on it meets it. Where
 * rounding errors of the steps along it are left in, half of the light is lost. */
static void planes_do_not_shade_themselves(void **state)
{
    static const float normals[4][3] = { { 0, 1, 0 }, { 0.3f, 1, 0.2f }, { 0.8f, 0.5f, 0.3f }, { -0.2f, 1, 0.9f } };
    const struct direct_desc all = { .method = METHOD_LIGHT, .samples = 64, .seed = 4 };
    struct direct *d = direct_create(best_kernels());
    (void)state;

    for (int k = 0; k < 8; k++) {
        const float *n = normals[k / 2], far = k % 2 ? 3000.0f : 1.0f;
        const struct vec3 middle = vec3_make(2.0f * far, 0, far);
        float corners[4][3];
        for (int c = 0; c < 4; c++) {
            const float x = c == 1 || c == 2 ? 4.0f : -4.0f, z = c < 2 ? 4.0f : -4.0f;
            corners[c][0] = middle.x + x;
            corners[c][1] = -(n[0] * x + n[2] * z) / n[1];
            corners[c][2] = middle.z + z;
        }
        const struct camera camera = {
            "near", vec3_make(middle.x + 3 * n[0] + 2, 3 * n[1], middle.z + 3 * n[2]), middle, { 0, 1, 0 }, 0.9f
        };
        const struct gbuffer_desc desc = { .camera = &camera, .width = 64, .height = 48 };
        struct scene *scene = scene_create();
        struct reason why = { "" };
        struct direct_stats stats;
        struct world w;
        struct gbuffer *g;
        add_quads(scene, add_lambert(scene, 0.5f), (const float(*)[3])corners, 1);
        world_make(&w, scene, &camera, 64, 48, sky_environment(sky_constant(64, 32, 1.0f), 64, 0.0));
        assert_int_equal(gbuffer_create(w.scene, w.rays, &desc, &g, &why), ERR_OK);
        const size_t count = (size_t)g->packet_count * 3 * PACKET;
        float *lit = mem_alloc(count, sizeof(*lit)), *open = mem_alloc(count, sizeof(*open));
        struct direct_desc blind = all;
        blind.no_visibility = true;
        assert_int_equal(direct_shade(d, g, w.rays, w.environment, &all, lit, &stats), ERR_OK);
        assert_true(g->point_count > 1000 && stats.rays > 10 * g->point_count);
        assert_int_equal(direct_shade(d, g, w.rays, w.environment, &blind, open, &stats), ERR_OK);
        uint32_t dark = 0;
        for (size_t i = 0; i < count; i++)
            dark += lit[i] < open[i];
        if (dark)
            fail_msg("plane %d: %u of %zu values are darker", k, dark, count);
        mem_free(lit);
        mem_free(open);
        gbuffer_destroy(g);
        world_finish(&w);
    }
    direct_destroy(d);
}

/* The same sun again costs few rays, for what it may meet next, and has the same bits, whichever suns came before, in
 * any order, and after so many that the first ones have been forgotten. */
static void what_is_seen_of_a_sun_does_not_depend_on_the_suns_before(void **state)
{
    struct shadow s = shadow_make();
    const size_t bytes = (size_t)s.gbuffer->packet_count * 3 * PACKET * sizeof(float);
    (void)state;

    const uint64_t first = shadow_shade(&s, s.transport, 0.0, s.want).rays;
    assert_true(first > 0);
    assert_true(shadow_shade(&s, s.transport, 0.8, s.lo).rays > 0);
    assert_true(shadow_shade(&s, s.transport, -0.8, s.lo).rays > 0);
    assert_true(shadow_shade(&s, s.transport, 0.0, s.lo).rays < first / 4);
    assert_memory_equal(s.lo, s.want, bytes);
    s.transport->index_bytes = 60000; /* of some ten suns */
    for (int turn = 0; turn < 16; turn++)
        shadow_shade(&s, s.transport, 20.0 * turn, s.lo);
    assert_true(shadow_shade(&s, s.transport, 0.0, s.lo).rays > 0);
    assert_memory_equal(s.lo, s.want, bytes);
    transport_sun_forget(s.transport, 0);
    shadow_shade(&s, s.transport, 0.0, s.lo);
    assert_memory_equal(s.lo, s.want, bytes);
    shadow_finish(&s);
}

/* The sun moves by a tenth of a texel per frame. Once it has done so for as many frames as it looks ahead, no frame
 * asks for much more than the others: 1.5 times the mean; 4.5 times without looking ahead. */
static void a_moving_sun_asks_for_a_little_in_each_frame(void **state)
{
    struct shadow s = shadow_make();
    uint64_t most = 0, sum = 0;
    (void)state;

    for (int k = 0; k < 40; k++) {
        const uint64_t rays = shadow_shade(&s, s.transport, 0.07 * k, s.lo).rays;
        most = k >= 10 && rays > most ? rays : most;
        sum += k >= 10 ? rays : 0;
    }
    printf("%.0f rays per frame, at most %.0f\n", (double)sum / 30.0, (double)most);
    assert_true((double)most < 3.0 * (double)sum / 30.0);
    shadow_finish(&s);
}

/* ---- Asked ahead, and kept ---- */

enum { PLACES = 9 };

/* Where the sun is between `degrees` - 0.4 and + 0.4, by frames of a cache of their own; the light of `degrees` in
 * s->want. Returns that frame's rays. */
static uint64_t places_at(const struct shadow *s, double degrees, double w[PLACES][3])
{
    struct transport *t = transport_of(s->gbuffer, s->world.rays, &(struct transport_desc){ .per_cell = 1 });
    const uint64_t rays = shadow_shade(s, t, degrees, s->want).rays;

    for (int k = 0; k < PLACES; k++) {
        shadow_shade(s, t, degrees + 0.1 * (k - PLACES / 2), s->lo);
        for (int i = 0; i < 3; i++)
            w[k][i] = transport_sun_axis(t)[i];
    }
    transport_destroy(t);
    return rays;
}

static bool look_ahead(struct transport *t, const double w[PLACES][3])
{
    enum err e = ERR_OK;

    for (uint32_t turn = 0; turn < 3 && !e; turn++)
        e = transport_look_at(t, w, PLACES, turn, 3, transport_frames(t));
    assert_true(!e || e == ERR_RANGE || e == ERR_UNSUPPORTED);
    return !e;
}

static void assert_costs_no_rays(const struct shadow *s, struct transport *t, double degrees, uint64_t alone)
{
    const uint64_t rays = shadow_shade(s, t, degrees, s->lo).rays;

    printf("%.0f rays, %.0f without\n", (double)rays, (double)alone);
    assert_true(alone > 10000 && rays * 100 <= alone);
    assert_memory_equal(s->lo, s->want, (size_t)s->gbuffer->packet_count * 3 * PACKET * sizeof(float));
}

/* A frame whose sun has been asked for ahead traces none of its rays, and has the bits of one that traces all, in three
 * directions of the sky, on two of its faces or more; a sun twelve degrees further is still to be traced. */
static void what_is_asked_ahead_costs_frames_no_rays(void **state)
{
    struct shadow s = shadow_make();
    double w[PLACES][3];
    (void)state;

    for (int k = 0; k < 3; k++) {
        const double degrees = 25.0 * (k + 1);
        shadow_shade(&s, s.transport, 0.0, s.lo);
        const uint64_t alone = places_at(&s, degrees, w);
        assert_true(look_ahead(s.transport, w));
        assert_costs_no_rays(&s, s.transport, degrees, alone);
        assert_true(shadow_shade(&s, s.transport, degrees + 12.0, s.lo).rays > alone / 2);
    }
    shadow_finish(&s);
}

/* Nothing is asked before a frame has shown how large the sun is; and what is full takes no more
 * than it may, but what earlier days asked for gives way. */
static void asking_ahead_keeps_to_its_memory(void **state)
{
    struct shadow s = shadow_make();
    double w[PLACES][3];
    (void)state;

    places_at(&s, 25.0, w);
    assert_false(look_ahead(s.transport, w));
    shadow_shade(&s, s.transport, 0.0, s.lo);
    s.transport->index_bytes = 400000; /* of some thirty tiles */
    int asked = 0;
    while (asked < 40 && look_ahead(s.transport, w))
        places_at(&s, 25.0 + 2.0 * ++asked, w);
    const uint32_t full = transport_sun_tiles(s.transport);
    printf("%d places of %u tiles\n", asked, full);
    assert_true(asked >= 2 && asked < 40);
    assert_true(s.transport->index->bytes <= 400000);
    shadow_shade(&s, s.transport, 0.0, s.lo); /* another day begins, and the last one's tiles may go */
    assert_true(look_ahead(s.transport, w));
    assert_true(transport_sun_tiles(s.transport) <= full);
    shadow_finish(&s);
}

/* What `from` knows of suns, as the file's bytes. */
static void store_sun(struct transport *from, const char *path, const struct digest *key)
{
    struct transport_sun_copy copy;
    struct cache_writer *w = cache_writer_create();
    struct reason why = { "" };

    assert_int_equal(transport_copy_sun(from, &copy), ERR_OK);
    transport_save_sun(&copy, key, w);
    assert_int_equal(cache_writer_store(w, path, &why), ERR_OK);
    cache_writer_destroy(w);
    mem_free(copy.bytes);
}

static enum err load_sun(struct transport *t, const char *path, const struct digest *key)
{
    struct cache_reader *r = NULL;
    struct reason why = { "" };
    enum err e = cache_reader_open(path, &r, &why);

    e = e ? e : transport_load_sun(t, r, key, &why);
    cache_reader_close(r);
    assert_true(!e || strstr(why.text, path));
    return e;
}

/* Another run has what is kept without a ray. A file cut or with a flipped bit, of another scene, or with impossible
 * places under a right checksum is refused, and leaves the light as it is. */
static void what_points_see_of_the_sun_is_kept_in_a_file(void **state)
{
    const struct digest key = { { 1 } }, other = { { 2 } };
    struct shadow s = shadow_make();
    struct folder folder;
    double w[PLACES][3];
    char path[256];
    size_t size;
    (void)state;

    folder_make(&folder);
    snprintf(path, sizeof(path), "%s", folder_write(&folder, "sun", "", 0));
    shadow_shade(&s, s.transport, 0.0, s.lo);
    const uint64_t alone = places_at(&s, 25.0, w);
    assert_true(look_ahead(s.transport, w));
    store_sun(s.transport, path, &key);
    uint8_t *bytes = sealed_read(path, &size);
    struct transport *t = transport_of(s.gbuffer, s.world.rays, &(struct transport_desc){ .per_cell = 1 });
    shadow_shade(&s, t, 50.0, s.lo);
    assert_int_equal(load_sun(t, path, &other), ERR_UNSUPPORTED);
    for (size_t at = 0; at < size; at += 1 + size / 97) {
        folder_write(&folder, "sun", bytes, at);
        assert_int_equal(load_sun(t, path, &key), ERR_FORMAT);
        bytes[at] ^= (uint8_t)(1u << at % 8);
        folder_write(&folder, "sun", bytes, size);
        assert_int_equal(load_sun(t, path, &key), ERR_FORMAT);
        bytes[at] ^= (uint8_t)(1u << at % 8);
    }
    const size_t first = SEALED_HEADER + SEALED_ENTRY + 4; /* a key, the units used, places */
    for (int k = 0; k < 3; k++) {
        uint8_t before[4];
        memcpy(before, bytes + first + 4 * k, sizeof(before));
        set_number(bytes + first + 4 * k, UINT32_MAX - 8);
        seal(bytes, size);
        folder_write(&folder, "sun", bytes, size);
        assert_int_equal(load_sun(t, path, &key), ERR_FORMAT);
        memcpy(bytes + first + 4 * k, before, sizeof(before));
    }
    assert_true(shadow_shade(&s, t, 25.0, s.lo).rays > alone / 2);
    transport_destroy(t);
    t = transport_of(s.gbuffer, s.world.rays, &(struct transport_desc){ .per_cell = 1 });
    shadow_shade(&s, t, 50.0, s.lo);
    seal(bytes, size);
    folder_write(&folder, "sun", bytes, size);
    assert_int_equal(load_sun(t, path, &key), ERR_OK);
    assert_costs_no_rays(&s, t, 25.0, alone);
    transport_destroy(t);
    mem_free(bytes);
    folder_remove(&folder);
    shadow_finish(&s);
}

static atomic_bool over;
static _Atomic uint32_t asked;

static void *ask_all_the_time(void *stage)
{
    const struct shadow *s = stage;
    double w[1][3];

    for (uint32_t k = 0; !atomic_load(&over); k++) {
        const double a = 0.01 * k;
        w[0][0] = cos(a);
        w[0][1] = 0.6;
        w[0][2] = sin(a);
        for (int i = 0; i < 3; i++)
            w[0][i] /= sqrt(1.36);
        asked += !transport_look_at(s->transport, (const double(*)[3])w, 1, k % 4, 4, UINT64_MAX);
    }
    return NULL;
}

/* Frames and the asking ahead on two threads, in so little memory that tiles come and go all the time: the frames have
 * the bits that they have alone. */
static void frames_and_asking_ahead_do_not_disturb_each_other(void **state)
{
    struct shadow s = shadow_make();
    const size_t bytes = (size_t)s.gbuffer->packet_count * 3 * PACKET * sizeof(float);
    struct transport *alone = transport_of(s.gbuffer, s.world.rays, &(struct transport_desc){ .per_cell = 1 });
    pthread_t thread;
    (void)state;

    atomic_store(&over, false);
    atomic_store(&asked, 0);
    s.transport->index_bytes = 400000;
    shadow_shade(&s, s.transport, 0.0, s.lo);
    assert_int_equal(pthread_create(&thread, NULL, ask_all_the_time, &s), 0);
    for (int k = 0; k < 16; k++) {
        shadow_shade(&s, s.transport, 3.0 * k, s.lo);
        shadow_shade(&s, alone, 3.0 * k, s.want);
        assert_memory_equal(s.lo, s.want, bytes);
    }
    atomic_store(&over, true);
    pthread_join(thread, NULL);
    printf("asked ahead %u times\n", atomic_load(&asked));
    assert_true(atomic_load(&asked) > 0);
    transport_destroy(alone);
    shadow_finish(&s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(what_is_asked_ahead_costs_frames_no_rays),
    cmocka_unit_test(asking_ahead_keeps_to_its_memory),
    cmocka_unit_test(what_points_see_of_the_sun_is_kept_in_a_file),
    cmocka_unit_test(frames_and_asking_ahead_do_not_disturb_each_other),
    cmocka_unit_test(an_open_sun_has_the_light_of_its_samples),
    cmocka_unit_test(penumbrae_are_where_they_belong),
    cmocka_unit_test(edges_of_shadows_are_antialiased),
    cmocka_unit_test(planes_do_not_shade_themselves),
    cmocka_unit_test(a_moving_sun_asks_for_a_little_in_each_frame),
    cmocka_unit_test(what_is_seen_of_a_sun_does_not_depend_on_the_suns_before),
};
UNIT_MAIN(tests)
