/* The light of lamps against closed forms without noise: punctual lights over a plane, lamps that are seen, and what
 * scale and threads may not change. */
#include "scene/lamps/rooms_lit.h"

#include "scene/lamps/lamps.h"

#include <omp.h>
#include <time.h>

enum { WIDTH = 32, HEIGHT = 24, PIXELS = WIDTH * HEIGHT };

#define DEGREE (PI / 180.0)

static const float albedo = 0.6f;

/* A floor of that albedo under these lights. */
static void floor_under(struct lit *out, const struct punctual_light *lights, size_t count)
{
    struct scene *s = scene_create();

    add_quads(s, add_lambert(s, albedo), floor_corners, 1);
    for (size_t i = 0; i < count; i++)
        add_light(s, lights[i]);
    lit_make(out, s, &above, WIDTH, HEIGHT, false);
}

/* Compares each pixel with albedo / pi times the irradiance that `expected` gives, to 2e-6 of it, and 2e-7 where a spot
 * ends. */
static void assert_irradiance(const struct lit *l, void (*expected)(struct vec3 at, double e[3]))
{
    static float rgb[3 * PIXELS];
    uint32_t lit = 0, dark = 0;

    lit_render(l, 2, 7, rgb);
    for (size_t i = 0; i < PIXELS; i++) {
        struct vec3 at;
        double e[3];
        if (!lit_point(l, i, &at))
            continue;
        expected(at, e);
        for (int c = 0; c < 3; c++)
            assert_float_equal(rgb[3 * i + (size_t)c], e[c] * (double)albedo / PI, 2e-6 * e[c] + 2e-7);
        lit += e[0] > 0.0;
        dark += !(e[0] > 0.0);
    }
    assert_true(lit > PIXELS / 8 && lit + dark > PIXELS / 2);
}

static const struct punctual_light bulb = { .kind = LIGHT_POINT,
                                            .position = { 0.7f, 1.3f, -0.4f },
                                            .intensity = { 10, 20, 5 } };

/* I cos(theta) / d^2. */
static void by_bulb(struct vec3 at, double e[3])
{
    const double d[3] = { 0.7f - (double)at.x, 1.3f - (double)at.y, -0.4f - (double)at.z };
    const double r2 = dot3(d, d);

    e[0] = 10.0 * d[1] / (r2 * sqrt(r2));
    e[1] = 2.0 * e[0];
    e[2] = 0.5 * e[0];
}

static void a_point_light_falls_off_by_the_inverse_square(void **state)
{
    struct lit l;

    (void)state;
    floor_under(&l, &bulb, 1);
    assert_irradiance(&l, by_bulb);
    lit_finish(&l);
}

static struct punctual_light spot(void)
{
    struct punctual_light l = {
        .kind = LIGHT_SPOT, .position = { 0, 3, 0 }, .direction = { 0, -1, 0 }, .intensity = { 8, 8, 8 }
    };

    light_set_cone(&l, 10.0 * DEGREE, 35.0 * DEGREE);
    return l;
}

/* Full within 10 degrees, dark from 35 on, between them ((cos - cos 35) / (cos 10 - cos 35))^2. */
static void by_spot(struct vec3 at, double e[3])
{
    const double d[3] = { at.x, 3.0 - (double)at.y, at.z };
    const double r2 = dot3(d, d), cosine = d[1] / sqrt(r2);
    const double in = (cosine - cos(35.0 * DEGREE)) / (cos(10.0 * DEGREE) - cos(35.0 * DEGREE));
    const double share = in < 0.0 ? 0.0 : in > 1.0 ? 1.0 : in * in;

    e[0] = e[1] = e[2] = 8.0 * cosine / r2 * share;
}

static void a_spot_fades_between_its_cones_as_gltf_says(void **state)
{
    const struct punctual_light light = spot();
    struct lit l;

    (void)state;
    floor_under(&l, &light, 1);
    assert_irradiance(&l, by_spot);
    lit_finish(&l);
}

/* 60 degrees from the normal: half the illuminance. */
static void by_moon(struct vec3 at, double e[3])
{
    (void)at;
    e[0] = e[1] = e[2] = 0.5 * 4.0;
}

static void a_directional_light_is_the_same_everywhere(void **state)
{
    const struct punctual_light moon = { .kind = LIGHT_DIRECTIONAL,
                                         .direction = { (float)sin(60.0 * DEGREE), -(float)cos(60.0 * DEGREE), 0 },
                                         .intensity = { 4, 4, 4 } };
    struct lit l;

    (void)state;
    floor_under(&l, &moon, 1);
    assert_irradiance(&l, by_moon);
    lit_finish(&l);
}

/* A box stands between lamp and floor: below it no light, away from it all. */
static void a_box_shades_the_floor_from_a_point_light(void **state)
{
    static float rgb[3 * PIXELS];
    struct scene *s = scene_create();
    uint32_t shaded = 0, lit = 0;
    struct lit l;

    (void)state;
    add_quads(s, add_lambert(s, albedo), floor_corners, 1);
    add_box(s, add_lambert(s, 0.0f), (const float[3]){ 0.2f, 0.5f, -0.9f }, (const float[3]){ 1.2f, 0.6f, 0.1f });
    add_light(s, bulb);
    lit_make(&l, s, &above, WIDTH, HEIGHT, false);
    lit_render(&l, 2, 7, rgb);
    for (size_t i = 0; i < PIXELS; i++) {
        struct vec3 at;
        double e[3];
        if (!lit_point(&l, i, &at) || at.y > 0.1f)
            continue;
        /* where the ray from the bulb to the floor crosses the box's upper side */
        const double t = (1.3 - 0.6) / 1.3, x = 0.7 + t * (at.x - 0.7), z = -0.4 + t * (at.z + 0.4);
        const double tb = (1.3 - 0.5) / 1.3, xb = 0.7 + tb * (at.x - 0.7), zb = -0.4 + tb * (at.z + 0.4);
        const bool in = x > 0.2 && x < 1.2 && z > -0.9 && z<0.1, below = xb> 0.2 && xb < 1.2 && zb > -0.9 && zb < 0.1;
        by_bulb(at, e);
        if (in) /* the upper side alone hides the bulb */
            assert_float_equal(rgb[3 * i], 0.0, 0.0);
        else if (!below)
            assert_float_equal(rgb[3 * i], e[0] * (double)albedo / PI, 2e-6 * e[0]);
        shaded += in;
        lit += !in && !below;
    }
    assert_true(shaded > 10 && lit > 100);
    lit_finish(&l);
}

/* A lamp is seen as bright as it is; in a mirror of reflectance 0.8, 0.8 times that; through a pane of glass by Fresnel
 * at normal incidence (1 - R) / (1 + R) = 12/13, R = 0.04, within what faint branches add or take (gbuffer_chain.c). */
static void a_lamp_is_seen_directly_in_a_mirror_and_through_glass(void **state)
{
    static const float mirror_corners[4][3] = { { -1, -1, 0 }, { 1, -1, 0 }, { 1, 1, 0 }, { -1, 1, 0 } };
    const struct camera at[3] = { { "lamp", { 0, 0, 3 }, { 0, 0, 10 }, { 0, 1, 0 }, 0.02f },
                                  { "mirror", { 0, 0, 3 }, { 0, 0, 0 }, { 0, 1, 0 }, 0.02f },
                                  { "pane", { 30, 0, 3 }, { 30, 0, 10 }, { 0, 1, 0 }, 0.02f } };
    const double expected[3] = { 5.0, 0.8 * 5.0, 12.0 / 13.0 * 5.0 };

    (void)state;
    for (int k = 0; k < 3; k++) {
        struct scene *s = scene_create();
        float rgb[3 * 16];
        struct lit l;
        const uint32_t lamp = add_glowing(s, 0.0f, vec3_make(5, 5, 5));
        const uint32_t mirror =
            add_stuff(s, (struct material){ .kind = MATERIAL_MIRROR, .diffuse = { 0.8f, 0.8f, 0.8f } });
        const uint32_t glass =
            add_stuff(s, (struct material){ .kind = MATERIAL_GLASS, .diffuse = { 1, 1, 1 }, .ior = 1.5f });
        add_box(s, lamp, (const float[3]){ -1, -1, 5 }, (const float[3]){ 1, 1, 6 });
        add_box(s, lamp, (const float[3]){ 29, -1, 5 }, (const float[3]){ 31, 1, 6 });
        add_quads(s, mirror, mirror_corners, 1);
        add_box(s, glass, (const float[3]){ 29, -1, 4 }, (const float[3]){ 31, 1, 4.1f });
        lit_make(&l, s, &at[k], 4, 4, true);
        lit_render(&l, 1, 0, rgb);
        double mean = 0.0;
        for (int i = 0; i < 3 * 16; i++) {
            assert_float_equal(rgb[i], expected[k], k == 2 ? 2e-2 : 1e-5);
            mean += (double)rgb[i] / (3 * 16);
        }
        assert_float_equal(mean, expected[k], k == 2 ? 5e-3 : 1e-5);
        lit_finish(&l);
    }
}

static struct scene *lamp_and_light(void)
{
    struct scene *s = corner_scene(0.7f, 0.9f);
    const float x[2] = { -1, 1 }, z[2] = { 0, 1 };

    add_panel(s, add_glowing(s, 0.2f, vec3_make(3, 2, 1)), x, 2.5f, z);
    add_light(s, bulb);
    return s;
}

/* The part is added as it is: to black it gives its multiple to the bit, and a factor of 0 changes nothing. */
static void scale_is_a_factor_of_the_part_alone(void **state)
{
    static float once[3 * PIXELS], thrice[3 * PIXELS], none[3 * PIXELS], before[3 * PIXELS];
    double sum = 0.0;
    struct lit l;

    (void)state;
    lit_make(&l, lamp_and_light(), &corner_camera, WIDTH, HEIGHT, true);
    struct relight_lamps *part = lit_part(&l, 4, 1);
    relight_lamps_add(part, 1.0, once);
    relight_lamps_add(part, 3.0, thrice);
    for (size_t i = 0; i < 3 * PIXELS; i++) {
        none[i] = before[i] = -0.0f + 0.1f * (float)(i % 7);
        assert_float_equal(thrice[i], 3.0f * once[i], 0.0f);
        sum += once[i];
    }
    assert_true(sum > 0.0);
    relight_lamps_add(part, 0.0, none);
    relight_lamps_add(NULL, 1.0, none);
    assert_memory_equal(none, before, sizeof(none));
    for (uint32_t i = 0; i < PIXELS; i += 37) {
        float rgb[3];
        relight_lamps_pixel(part, i % WIDTH, i / WIDTH, rgb);
        assert_memory_equal(rgb, once + 3 * (size_t)i, sizeof(rgb));
    }
    relight_lamps_destroy(part);
    lit_finish(&l);
}

/* Nor does it matter whether a thread of its own refines it. */
static void the_same_bits_at_any_number_of_threads(void **state)
{
    static float one[3 * PIXELS], many[3 * PIXELS], beside[3 * PIXELS];
    const int before = omp_get_max_threads();
    struct lit l;

    (void)state;
    lit_make(&l, lamp_and_light(), &corner_camera, WIDTH, HEIGHT, true);
    omp_set_num_threads(1);
    lit_render(&l, 11, 5, one);
    omp_set_num_threads(3);
    lit_render(&l, 11, 5, many);
    omp_set_num_threads(before);
    assert_memory_equal(one, many, sizeof(one));
    lit_render_beside(&l, 11, 5, beside);
    assert_memory_equal(one, beside, sizeof(one));
    lit_finish(&l);
}

static void a_thread_ends_when_its_part_is_destroyed(void **state)
{
    struct relight_lamps *part = NULL;
    struct reason why;
    struct lit l;

    (void)state;
    lit_make(&l, lamp_and_light(), &corner_camera, WIDTH, HEIGHT, true);
    assert_int_equal(relight_lamps_create(&(struct relight_lamps_desc){ &l.set, 1u << 30, 5 }, &part, &why), ERR_OK);
    assert_int_equal(relight_lamps_start(part, &why), ERR_OK);
    while (relight_lamps_samples(part) < 3)
        nanosleep(&(struct timespec){ .tv_nsec = 1000000 }, NULL);
    assert_false(relight_lamps_is_complete(part));
    relight_lamps_destroy(part);
    lit_finish(&l);
}

/* Emission changes nothing of what the sky lights: points, entries and escapes are the same bytes. */
static void lamps_leave_the_points_of_the_sky_as_they_are(void **state)
{
    struct lit l, dark;
    struct scene *s = lamp_and_light();
    struct relight_lamps *part = NULL;
    struct reason why;

    (void)state;
    s->light_count = 0;
    for (size_t i = 0; i < s->material_count; i++)
        s->materials[i].emission = vec3_make(0, 0, 0);
    lit_make(&dark, s, &corner_camera, WIDTH, HEIGHT, true);
    lit_make(&l, lamp_and_light(), &corner_camera, WIDTH, HEIGHT, true);
    const struct gbuffer *a = l.set.gbuffer, *b = dark.set.gbuffer;
    assert_non_null(a->glow);
    assert_null(b->glow);
    assert_int_equal(a->packet_count, b->packet_count);
    assert_memory_equal(a->packets, b->packets, a->packet_count * sizeof(*a->packets));
    assert_memory_equal(a->entry_first, b->entry_first, (PIXELS + 1) * sizeof(*a->entry_first));
    assert_memory_equal(a->entries, b->entries, a->entry_first[PIXELS] * sizeof(*a->entries));
    assert_memory_equal(a->misses, b->misses, a->miss_first[PIXELS] * sizeof(*a->misses));
    assert_int_equal(relight_lamps_create(&(struct relight_lamps_desc){ &dark.set, 1, 0 }, &part, &why), ERR_OK);
    assert_null(part);
    lit_finish(&l);
    lit_finish(&dark);
}

/* A triangle is picked in proportion to area times luminance, and its density is what emitters_density says of a hit.
 */
static void triangles_are_picked_by_area_and_luminance(void **state)
{
    const float x[2] = { 0, 1 }, x2[2] = { 2, 5 }, z[2] = { 0, 1 };
    struct scene *s = scene_create();
    const struct vec3 from = { 1, 0.1f, 0.5f };
    uint32_t wide = 0;
    struct lit l;

    (void)state;
    add_quads(s, add_lambert(s, 0.5f), floor_corners, 1);
    add_panel(s, add_glowing(s, 0.0f, vec3_make(2, 2, 2)), x, 2.0f, z);  /* power 2 */
    add_panel(s, add_glowing(s, 0.0f, vec3_make(2, 2, 2)), x2, 2.0f, z); /* 6 */
    lit_make(&l, s, &above, 4, 4, false);
    struct emitters *e = emitters_create(s, l.set.rays);
    assert_int_equal(emitters_triangles(e), 4);
    for (uint32_t i = 0; i < 1000; i++) {
        const double u[3] = { (i + 0.5) / 1000.0, (i * 7 % 1000 + 0.5) / 1000.0, (i * 13 % 1000 + 0.5) / 1000.0 };
        struct arrival a;
        struct hit h;
        struct surface at;
        assert_true(emitters_sample(e, from, u, &a));
        assert_true(rays_intersect(l.set.rays, from, a.dir, 0.0f, &h));
        wide += h.mesh == 2;
        rays_surface(l.set.rays, &h, vec3_scale(a.dir, -1.0f), &at);
        assert_float_equal(emitters_density(e, &h, at.geometric, a.dir) / a.density, 1.0, 1e-5);
        /* one point per m^2 of radiance 2: 1/4 of the whole area */
        const double r = h.t, cosine = a.dir.y;
        assert_float_equal(a.density, 0.25 * r * r / cosine, 1e-5 * a.density);
    }
    assert_int_equal(wide, 750);
    emitters_destroy(e);
    lit_finish(&l);
}

/* A panel of 1 m^2 that stands once more turned over and stretched to 3 m^2, and small; between them one that is not
 * placed, of 2 m^2 and twice as bright. The mean of distance^2 / (cosine density) is the whole area. */
static void instances_are_sampled_with_their_density(void **state)
{
    static const float places[3][3][4] = { { { 1, 0, 0, 0 }, { 0, 1, 0, 0 }, { 0, 0, 1, 0 } },
                                           { { 0, 0, -1, 2 }, { 0, 1, 0, 0.5f }, { 3, 0, 0, 3 } },
                                           { { 0.5f, 0, 0, -2 }, { 0, 0.5f, 0, 1 }, { 0, 0, -0.5f, 2 } } };
    const float x[2] = { 0, 1 }, x2[2] = { -3, -1 }, z[2] = { 0, 1 };
    const struct vec3 from = { 0.3f, 0.1f, 0.2f };
    struct scene *s = scene_create();
    uint32_t met[5][2] = { { 0 } };
    double area = 0.0;
    struct lit l;

    (void)state;
    add_quads(s, add_lambert(s, 0.5f), floor_corners, 1);
    const uint32_t glow = add_glowing(s, 0.0f, vec3_make(2, 2, 2));
    add_panel(s, glow, x, 2.0f, z);
    assert_int_equal(mesh_place(&s->meshes[1], places[0]), ERR_OK);
    add_panel(s, add_glowing(s, 0.0f, vec3_make(4, 4, 4)), x2, 2.0f, z);
    for (int i = 1; i < 3; i++)
        assert_int_equal(scene_add_instance(s, 1, "", places[i]), ERR_OK);
    lit_make(&l, s, &above, 4, 4, false);
    struct emitters *e = emitters_create(s, l.set.rays);
    assert_int_equal(emitters_triangles(e), 8);
    for (uint32_t i = 0; i < 20000; i++) {
        const double u[3] = { (i + 0.5) / 20000.0, (i * 7 % 1000 + 0.5) / 1000.0, (i * 13 % 997 + 0.5) / 997.0 };
        struct arrival a;
        struct hit h;
        struct surface at;
        assert_true(emitters_sample(e, from, u, &a));
        if (!rays_intersect(l.set.rays, from, a.dir, 0.0f, &h))
            continue; /* at an edge */
        met[h.mesh][h.triangle]++;
        rays_surface(l.set.rays, &h, vec3_scale(a.dir, -1.0f), &at);
        assert_float_equal(emitters_density(e, &h, at.geometric, a.dir) / a.density, 1.0, 1e-4);
        area += (double)h.t * h.t / (fabs(vec3_dot_double(at.geometric, a.dir)) * a.density) / 20000.0;
    }
    assert_float_equal(area, 1.0 + 2.0 + 3.0 + 0.25, 0.02);
    /* By area, where a stretch counts as the volume's scale to the power of 2/3; the second panel is twice as bright.
     */
    const double power[5] = { 0.0, 1.0, 4.0, pow(3.0, 2.0 / 3.0), 0.25 };
    for (int k = 0; k < 10; k++) /* two triangles each */
        assert_float_equal(met[k / 2][k % 2] / 20000.0, 0.5 * power[k / 2] / (5.25 + pow(3.0, 2.0 / 3.0)), 0.002);
    emitters_destroy(e);
    lit_finish(&l);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(instances_are_sampled_with_their_density),
    cmocka_unit_test(a_point_light_falls_off_by_the_inverse_square),
    cmocka_unit_test(a_spot_fades_between_its_cones_as_gltf_says),
    cmocka_unit_test(a_directional_light_is_the_same_everywhere),
    cmocka_unit_test(a_box_shades_the_floor_from_a_point_light),
    cmocka_unit_test(a_lamp_is_seen_directly_in_a_mirror_and_through_glass),
    cmocka_unit_test(scale_is_a_factor_of_the_part_alone),
    cmocka_unit_test(the_same_bits_at_any_number_of_threads),
    cmocka_unit_test(a_thread_ends_when_its_part_is_destroyed),
    cmocka_unit_test(lamps_leave_the_points_of_the_sky_as_they_are),
    cmocka_unit_test(triangles_are_picked_by_area_and_luminance),
};

UNIT_MAIN(tests)
