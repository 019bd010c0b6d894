/* Popping: one map, rotated by a hundredth of a texel per frame for 300 frames, while its sun crosses texels and an
 * edge of the cube; normals that turn across a face's border; and a sun whose shadows glide, by the cache. Random
 * numbers are the same in every frame: remaining changes are the estimators' own. The second difference of each point
 * from frame to frame is counted in samples: N_s times it, over the point's unoccluded value. One sample that comes or
 * goes is about 1.
 *
 * No statistics: seeds are fixed, and bounds are one and a half times the measured values. */
#include "light/cache_direct/transports.h"
#include "stability.h"

enum { FRAMES = 300, WIDTH = 16, HEIGHT = 12, SAMPLES = 32, LANES_MAX = 24 * PACKET };
#define TEXEL_DEGREES (360.0 / 96.0)

/* The sky of frame k: overcast or black, with a sun halfway over the edge between +X and +Z. */
static void turned_sky(struct environment *e, int k, bool black)
{
    struct frame f = black ? sky_constant(96, 48, 0.0f) : sky_overcast(96, 48);
    double w[3] = { 1.0, 1.1, 1.0 };
    struct reason why;

    unit3(w);
    sky_disc(&f, w, 2.2, 1000.0f, 900.0f, 700.0f);
    environment_configure(e,
                          &(struct environment_desc){ .layout = LAYOUT_LATLONG,
                                                      .rotation_degrees = TEXEL_DEGREES * (k - FRAMES / 2) / 100.0 });
    assert_int_equal(environment_update(e, &f, &why), ERR_OK);
    frame_finish(&f);
}

static struct environment *small_environment(void)
{
    struct environment *e = environment_create(&(struct environment_desc){ .n = 24 });

    assert_non_null(e);
    return e;
}

/* A floor, a wall, and a block that casts its shadow on both. */
static struct prepared_scene *yard(void)
{
    static const struct camera camera = { "yard", { 1.5f, 4.0f, 4.5f }, { 0, 0.4f, 0 }, { 0, 1, 0 }, 0.7f };
    struct scene *s = scene_create();
    const uint32_t matte = add_lambert(s, 0.6f);

    add_wall(s, matte, 1, 0.0f, (const float[2]){ -4, -4 }, (const float[2]){ 4, 4 });
    add_wall(s, matte, 2, -2.0f, (const float[2]){ -4, 0 }, (const float[2]){ 4, 2 });
    add_box(s, matte, (const float[3]){ -0.4f, 0, -0.4f }, (const float[3]){ 0.4f, 1.2f, 0.4f });
    return set_of(s, &camera, WIDTH, HEIGHT, 1);
}

/* The luminance of each lane in the last three frames of a method, and its reference. */
struct series {
    double lo[3][LANES_MAX], unit[LANES_MAX];
    double squares, count; /* of the second differences */
};

static void keep(const struct gbuffer *g, const float *lo, double *out)
{
    for (uint32_t i = 0; i < g->packet_count * PACKET; i++) {
        const float *p = lo + (size_t)(i / PACKET) * 3 * PACKET + i % PACKET;
        out[i] = g->packets[i / PACKET].valid[i % PACKET] ? rgb_luminance(p[0], p[PACKET], p[2 * PACKET]) : 0.0;
    }
}

/* The worst second difference at frame k. */
static void difference(struct series *m, uint32_t lanes, int k, const char *name, struct worst *worst)
{
    char where[32];

    snprintf(where, sizeof(where), "frame %d", k);
    for (uint32_t i = 0; k >= 2 && i < lanes; i++) {
        const double second = m->lo[(k - 2) % 3][i] - 2.0 * m->lo[(k - 1) % 3][i] + m->lo[k % 3][i];
        if (m->unit[i] > 0.0) {
            const double samples = SAMPLES * fabs(second) / m->unit[i];
            worst_of(worst, samples, name, where);
            m->squares += samples * samples;
            m->count += 1.0;
        }
    }
}

/* The estimator of Eq. 4 of [LPG13] again, for matte points that see the whole sky, from the method's own samples:
 * N_f with the last sample's beta of Eq. 5, or N_f rounded to an integer. */
static double again(const struct shade_packet *p, uint32_t l, const struct light_samples *s, bool rounded)
{
    double share[CUBE_FACES], total = 0.0, sum = 0.0;

    for (uint32_t f = 0; f < CUBE_FACES; f++) {
        share[f] = 0.0;
        for (int k = 0; k < 4; k++) {
            const float *c = s->corner[f][k];
            share[f] += fmax(0.0, (double)p->ns_x[l] * c[0] + (double)p->ns_y[l] * c[1] + (double)p->ns_z[l] * c[2]);
        }
        total += share[f] *= s->energy[f];
    }
    for (uint32_t f = 0; f < CUBE_FACES; f++) {
        const double real = share[f] / total * SAMPLES, count = rounded ? floor(real + 0.5) : real;
        for (uint32_t i = 0; (double)i < count && s->first[f] + i < s->first[f + 1]; i++) {
            const uint32_t k = s->first[f] + i;
            const double beta = fmin(1.0, count - i);
            const double cosine =
                (double)p->ns_x[l] * s->x[k] + (double)p->ns_y[l] * s->y[k] + (double)p->ns_z[l] * s->z[k];
            if (cosine > 0.0)
                sum += beta * cosine * rgb_luminance(s->r[k], s->g[k], s->b[k]) / (share[f] / total * s->pdf[k]);
        }
    }
    return sum * p->diffuse[0][l] / PI / SAMPLES;
}

/* Eq. 4 with and without beta beside the kernel's own. */
struct rewritten {
    struct series with, without;
    struct worst kept, rounded, unfaithful;
};

static void rewrite(struct rewritten *r, const struct gbuffer *g, const struct direct *d, const double *want, int k)
{
    const uint32_t lanes = g->packet_count * PACKET;

    for (uint32_t i = 0; i < lanes; i++) {
        const struct shade_packet *p = &g->packets[i / PACKET];
        r->with.unit[i] = r->without.unit[i] = want[i];
        r->with.lo[k % 3][i] = want[i] > 0.0 ? again(p, i % PACKET, direct_samples(d), false) : 0.0;
        r->without.lo[k % 3][i] = want[i] > 0.0 ? again(p, i % PACKET, direct_samples(d), true) : 0.0;
        worst_of(&r->unfaithful, want[i] > 0.0 ? fabs(r->with.lo[k % 3][i] / want[i] - 1.0) : 0.0, "", "");
    }
    difference(&r->with, lanes, k, "", &r->kept);
    difference(&r->without, lanes, k, "", &r->rounded);
}

static double deviation(const struct series *s)
{
    return sqrt(s->squares / s->count);
}

static void say_rewritten(const char *name, const struct rewritten *r, double kept, double rounded, double ratio)
{
    char text[96];

    snprintf(text, sizeof(text), "%s: Eq. 4 written again", name);
    holds_below(text, "faces", "relative difference from the kernel", r->unfaithful.value, 1e-4, "");
    snprintf(text, sizeof(text), "%s: that with beta of Eq. 5", name);
    holds_below(text, "faces", "second difference in samples", r->kept.value, kept, r->kept.where);
    snprintf(text, sizeof(text), "%s: that without, N_f rounded", name);
    fails_above(text, "not ours", "second difference in samples", r->rounded.value, rounded, r->rounded.where);
    fails_above(text, "not ours", "root mean square over that with beta", deviation(&r->without) / deviation(&r->with),
                ratio, "");
}

/* By light alone, with lobes too, and with cells, whose counts are integers, without beta. */
enum group { BY_LIGHT, BY_BOTH, BY_CELLS, GROUPS };
static const char *const group_names[GROUPS] = { "by light (6)", "mis, auto (4)", "with cells (3)" };

static enum group group_of(const struct variant *v)
{
    if (v->desc.cells > 1)
        return BY_CELLS;
    return method_recipe(v->desc.method)->brdf_part > 0.0f ? BY_BOTH : BY_LIGHT;
}

static bool is_plain_faces(const struct variant *v)
{
    return v->desc.method == METHOD_FACES && !v->desc.sun && !v->desc.cells;
}

/* One frame of a method without occlusion, and in the yard if `shadowed` is given. */
struct turning {
    struct prepared_scene *set;
    struct direct *d;
    float *lo;
    struct series open[VARIANTS], shadowed[VARIANTS];
    struct worst worst_open[GROUPS], worst_shadowed[GROUPS];
    struct rewritten again;
    double energy, first_energy;
};

static void turn(struct turning *t, const struct environment *e, int k, bool shadows)
{
    const struct gbuffer *g = t->set->gbuffer;
    const uint32_t lanes = g->packet_count * PACKET;

    t->first_energy = k ? t->first_energy : e->total_energy;
    t->energy = fmax(t->energy, fabs(e->total_energy / t->first_energy - 1.0));
    for (int v = 0; v < VARIANTS; v++) {
        const struct variant *by = &variants[v];
        if (!(by->claims & SMALL_SUN) || (!shadows && group_of(by) != BY_LIGHT))
            continue;
        shade_by(t->d, g, NULL, e, by, SAMPLES, 1, t->lo);
        keep(g, t->lo, t->open[v].lo[k % 3]);
        memcpy(t->open[v].unit, t->open[v].lo[k % 3], sizeof(t->open[v].unit));
        memcpy(t->shadowed[v].unit, t->open[v].unit, sizeof(t->open[v].unit));
        difference(&t->open[v], lanes, k, by->name, &t->worst_open[group_of(by)]);
        if (is_plain_faces(by))
            rewrite(&t->again, g, t->d, t->open[v].unit, k);
        if (!shadows)
            continue;
        shade_by(t->d, g, t->set->rays, e, by, SAMPLES, 1, t->lo);
        keep(g, t->lo, t->shadowed[v].lo[k % 3]);
        difference(&t->shadowed[v], lanes, k, by->name, &t->worst_shadowed[group_of(by)]);
    }
}

static void say_turning(const struct turning *t)
{
    holds_below("a sun over a cube edge: energy of the map", "tables", "relative change", t->energy, 1e-5, "");
    for (int q = 0; q < BY_CELLS; q++) {
        holds_below("popping: unshadowed", group_names[q], "second difference in samples", t->worst_open[q].value,
                    q == BY_LIGHT ? 4.0 : 8.0, t->worst_open[q].where);
        holds_below("popping: shadow edges", group_names[q], "second difference in samples", t->worst_shadowed[q].value,
                    q == BY_LIGHT ? 9.5 : 9.0, t->worst_shadowed[q].where);
    }
    fails_above("popping: unshadowed", group_names[BY_CELLS], "second difference in samples",
                t->worst_open[BY_CELLS].value, 6.0, t->worst_open[BY_CELLS].where);
    say_rewritten("popping", &t->again, 2.5, 1.5, 1.7);
}

/* Under the overcast sky samples move to other rows now and then, which is about as large as a sample that comes or
 * goes. For a sun alone all are alike, and only counts can pop. (With even shares only 5 of 32 samples are in the
 * sun's face, so each counts six times.) */
static void a_map_that_turns_by_a_hundredth_of_a_texel_does_not_pop(void **state)
{
    static struct turning sky, alone;
    struct environment *e = small_environment();
    (void)state;
    sky.set = alone.set = yard();
    sky.d = alone.d = direct_create(best_kernels());
    sky.lo = alone.lo = mem_alloc(sky.set->gbuffer->packet_count, 3 * PACKET * sizeof(float));
    assert_true(sky.set->gbuffer->packet_count * PACKET <= LANES_MAX);
    omp_set_num_threads(1);
    for (int k = 0; k < FRAMES; k++) {
        turned_sky(e, k, false);
        turn(&sky, e, k, true);
        turned_sky(e, k, true);
        turn(&alone, e, k, false);
    }
    environment_destroy(e);
    direct_destroy(sky.d);
    mem_free(sky.lo);
    set_destroy(sky.set);
    say_turning(&sky);
    holds_below("a sun alone over a cube edge", group_names[BY_LIGHT], "second difference in samples",
                alone.worst_open[BY_LIGHT].value, 1.7, alone.worst_open[BY_LIGHT].where);
    say_rewritten("a sun alone over a cube edge", &alone.again, 0.4, 0.7, 1.5);
    verdict();
}

/* The sky is still and normals turn, in equally small steps, over the border between +X and +Z at 16 heights: shares
 * and counts change, samples do not. */
static void normals_that_turn_across_a_face_border_do_not_pop(void **state)
{
    static struct series all[VARIANTS];
    static struct rewritten r;
    struct worst worst[GROUPS] = { { 0.0, "" } };
    float lo[3 * PACKET];
    (void)state;
    struct environment *e = small_environment();
    turned_sky(e, FRAMES / 2 + 37, false);
    struct gbuffer g = points_make(1, LOBE_LAMBERT, 0.6f, 0.0f, 0.0f);
    struct direct *d = direct_create(best_kernels());
    omp_set_num_threads(1);
    for (int k = 0; k < FRAMES; k++) {
        struct shade_packet *p = g.packets;
        for (int l = 0; l < PACKET; l++) {
            const double phi = 0.25 * PI + TEXEL_DEGREES * PI / 180.0 * (k - FRAMES / 2) / 100.0;
            const double up = (l - 7.5) / 8.0, s = sqrt(1.0 - up * up);
            p->ns_x[l] = p->ng_x[l] = p->wo_x[l] = (float)(s * sin(phi));
            p->ns_y[l] = p->ng_y[l] = p->wo_y[l] = (float)up;
            p->ns_z[l] = p->ng_z[l] = p->wo_z[l] = (float)(s * cos(phi));
        }
        for (int v = 0; v < VARIANTS; v++) {
            const struct variant *by = &variants[v];
            if (!(by->claims & SMALL_SUN))
                continue;
            shade_by(d, &g, NULL, e, by, SAMPLES, 1, lo);
            keep(&g, lo, all[v].lo[k % 3]);
            memcpy(all[v].unit, all[v].lo[k % 3], sizeof(all[v].unit));
            difference(&all[v], PACKET, k, by->name, &worst[group_of(by)]);
            if (is_plain_faces(by))
                rewrite(&r, &g, d, all[v].unit, k);
        }
    }
    direct_destroy(d);
    points_free(&g);
    environment_destroy(e);
    holds_below("normals over a face's border", group_names[BY_LIGHT], "second difference in samples",
                worst[BY_LIGHT].value, 0.1, worst[BY_LIGHT].where);
    holds_below("normals over a face's border", group_names[BY_BOTH], "second difference in samples",
                worst[BY_BOTH].value, 6.0, worst[BY_BOTH].where);
    say_rewritten("normals over a face's border", &r, 0.1, 0.5, 20.0);
    verdict();
}

/* ---- Shadows by the cache ---- */

enum { STEPS = 32, ACROSS = 32, TEXELS = 64, HOLE = 2 };

/* A cutout image with holes of 9 cm. */
static uint32_t add_leaf(struct scene *s)
{
    struct material m = { .diffuse = { 0.2f, 0.2f, 0.2f },
                          .texture = MATERIAL_NO_TEXTURE,
                          .alpha_mode = ALPHA_MASK,
                          .alpha = 1.0f,
                          .alpha_cutoff = 0.5f };
    struct texture t;
    uint32_t index;

    assert_int_equal(texture_init(&t, TEXELS, TEXELS, TEXTURE_CUTOUT), ERR_OK);
    memset(t.texels, 255, 4 * TEXELS * TEXELS);
    for (uint32_t i = 0; i < TEXELS * TEXELS; i++)
        t.texels[4 * (size_t)i + 3] = (i % TEXELS / HOLE + i / TEXELS / HOLE) % 2 ? 255 : 0;
    texture_build_levels(&t);
    assert_int_equal(scene_add_texture(s, &t, &m.alpha_texture), ERR_OK);
    assert_int_equal(scene_add_material(s, &m, &index), ERR_OK);
    return index;
}

/* A floor under such a mask, or under slats that are 20 cm wide. */
static struct prepared_scene *under_roof(bool leaves)
{
    static const struct camera above = { "above", { 0, 1.4f, 0.01f }, { 0, 0, 0 }, { 0, 0, -1 }, 0.9f };
    struct scene *s = scene_create();

    add_wall(s, add_lambert(s, 0.6f), 1, 0.0f, (const float[2]){ -4, -4 }, (const float[2]){ 4, 4 });
    if (leaves) {
        struct mesh m = { .vertex_count = 4, .triangle_count = 2, .material = add_leaf(s) };
        static const float corners[4][3] = {
            { -1.5f, 1.5f, -1.5f }, { -1.5f, 1.5f, 1.5f }, { 1.5f, 1.5f, 1.5f }, { 1.5f, 1.5f, -1.5f }
        };
        static const float uv[8] = { 0, 0, 0, 1, 1, 1, 1, 0 };
        static const uint32_t corner_of[6] = { 0, 1, 2, 0, 2, 3 };
        m.positions = mem_alloc(12, sizeof(float));
        m.uvs = mem_alloc(8, sizeof(float));
        m.indices = mem_alloc(6, sizeof(uint32_t));
        memcpy(m.positions, corners, sizeof(corners));
        memcpy(m.uvs, uv, sizeof(uv));
        memcpy(m.indices, corner_of, sizeof(corner_of));
        assert_int_equal(scene_add_mesh(s, &m), ERR_OK);
    }
    for (int k = -8; k < 8 && !leaves; k++)
        add_box(s, add_lambert(s, 0.2f), (const float[3]){ 0.4f * (float)k, 1.5f, -4 },
                (const float[3]){ 0.4f * (float)k + 0.2f, 1.52f, 4 });
    return set_of(s, &above, ACROSS, ACROSS * 3 / 4, 1);
}

/* A black sky with a sun of 0.53 degrees, turned by so many degrees. */
static struct environment *sun_alone(double degrees)
{
    struct environment *e = environment_create(&(struct environment_desc){ .n = 256 });
    struct frame f = sky_constant(1024, 512, 0.0f);
    double w[3] = { 0.5, 1.0, 0.2 };
    struct reason why;

    unit3(w);
    sky_disc(&f, w, 0.265, 4e4f, 4e4f, 4e4f);
    environment_configure(e, &(struct environment_desc){ .layout = LAYOUT_LATLONG, .rotation_degrees = degrees });
    assert_int_equal(environment_update(e, &f, &why), ERR_OK);
    frame_finish(&f);
    return e;
}

/* The second difference of a point's light, over what it has without any shadow. */
static void glide_under(bool leaves, double bound)
{
    const struct transport_frame frame = { .end = 0 };
    struct prepared_scene *set = under_roof(leaves);
    const struct gbuffer *g = set->gbuffer;
    const size_t floats = (size_t)g->packet_count * 3 * PACKET;
    struct transport *t = transport_of(g, set->rays, &(struct transport_desc){ .per_cell = 1 });
    struct transport *open = transport_of(g, NULL, &(struct transport_desc){ .per_cell = 1 });
    float *lo[3], *all = mem_alloc(floats, sizeof(float));
    struct transport_frame_stats stats;
    double worst = 0.0;
    uint64_t part = 0, points = 0;

    for (int k = 0; k < 3; k++)
        lo[k] = mem_alloc(floats, sizeof(float));
    for (int k = 0; k < STEPS; k++) {
        struct environment *e = sun_alone(0.02 * k);
        assert_int_equal(transport_shade(t, e, &frame, lo[k % 3], &stats), ERR_OK);
        assert_int_equal(transport_shade(open, e, &frame, all, &stats), ERR_OK);
        environment_destroy(e);
        for (size_t i = 0; i < floats && k >= 2; i++) {
            const double full = (double)all[i];
            const double second = (double)lo[k % 3][i] - 2.0 * (double)lo[(k + 2) % 3][i] + (double)lo[(k + 1) % 3][i];
            worst = full > 0.0 ? fmax(worst, fabs(second) / full) : worst;
            part += full > 0.0 && lo[k % 3][i] > 0.05f * all[i] && lo[k % 3][i] < 0.95f * all[i];
            points += full > 0.0;
        }
    }
    const char *name = leaves ? "a sun that glides behind a mask of leaves" : "a sun that glides: penumbrae of slats";
    holds_below(name, "cached", "second difference in full suns", worst, bound, "");
    say_bounded(name, "cached", "share of points in penumbrae", (double)part / (double)points, ">=", 0.05,
                part * 20 >= points, "", "holds");
    for (int k = 0; k < 3; k++)
        mem_free(lo[k]);
    mem_free(all);
    transport_destroy(t);
    transport_destroy(open);
    set_destroy(set);
}

/* What a point sees of the sun is kept by direction, so that between frames only the directions' shares of the sun's
 * light change, and smoothly. In every other frame a direction too far, it is 0.46 full suns and more. */
static void shadows_of_a_gliding_sun_do_not_pop(void **state)
{
    (void)state;
    glide_under(false, 0.002);
    glide_under(true, 0.004);
    verdict();
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_map_that_turns_by_a_hundredth_of_a_texel_does_not_pop),
    cmocka_unit_test(normals_that_turn_across_a_face_border_do_not_pop),
    cmocka_unit_test(shadows_of_a_gliding_sun_do_not_pop),
};
UNIT_MAIN(tests)
