#include "scene/geometry/files.h"

#include "base/rng.h"
#include "scene/geometry/rays.h"

#include <math.h>

static struct scene *unit_cube(void)
{
    struct scene *s = scene_create();

    assert_non_null(s);
    add_box(s, add_lambert(s, 0.5f), (const float[3]){ -0.5f, -0.5f, -0.5f }, (const float[3]){ 0.5f, 0.5f, 0.5f });
    assert_int_equal(scene_finish(s, "cube", NULL), ERR_OK);
    return s;
}

static void ray_meets_cube_at_known_distance(void **state)
{
    struct scene *s = unit_cube();
    struct rays *r = rays_create_for(s, cpu_best());
    struct hit h;
    struct surface at;

    (void)state;
    assert_non_null(r);
    assert_true(rays_intersect(r, vec3_make(0.2f, 0.1f, 3.0f), vec3_make(0.0f, 0.0f, -1.0f), 0.0f, &h));
    assert_float_equal(h.t, 2.5f, 1e-6f);
    assert_int_equal(h.mesh, 0);
    rays_surface(r, &h, vec3_make(0.0f, 0.0f, 1.0f), &at);
    assert_float_equal(at.position.x, 0.2f, 1e-6f);
    assert_float_equal(at.position.y, 0.1f, 1e-6f);
    assert_float_equal(at.position.z, 0.5f, 1e-6f);
    assert_float_equal(at.geometric.z, 1.0f, 1e-6f);
    assert_true(at.outside);
    /* t counts in lengths of the direction, and tnear skips the first side */
    assert_true(rays_intersect(r, vec3_make(0.2f, 0.1f, 3.0f), vec3_make(0.0f, 0.0f, -2.0f), 1.5f, &h));
    assert_float_equal(h.t, 1.75f, 1e-6f);
    assert_false(rays_intersect(r, vec3_make(0.2f, 0.7f, 3.0f), vec3_make(0.0f, 0.0f, -1.0f), 0.0f, &h));
    rays_destroy(r);
    scene_destroy(s);
}

static void surface_faces_the_side_looked_from(void **state)
{
    struct scene *s = unit_cube();
    struct rays *r = rays_create_for(s, cpu_best());
    struct hit h;
    struct surface at;

    (void)state;
    assert_true(rays_intersect(r, vec3_make(0.0f, 0.0f, 0.0f), vec3_make(1.0f, 0.0f, 0.0f), 0.0f, &h));
    rays_surface(r, &h, vec3_make(-1.0f, 0.0f, 0.0f), &at);
    assert_float_equal(at.geometric.x, -1.0f, 1e-6f);
    assert_float_equal(at.shading.x, -1.0f, 1e-6f);
    assert_false(at.outside);
    rays_destroy(r);
    scene_destroy(s);
}

/* A packet of rays up from a plane y = -1 below the cube, lanes 0..15 from x = -2 to 2. */
static void rays_upwards(struct ray16 *p, float tfar)
{
    memset(p, 0, sizeof(*p));
    for (int i = 0; i < PACKET; i++) {
        p->org_x[i] = -2.0f + 4.0f * (float)i / 15.0f;
        p->org_y[i] = -1.0f;
        p->dir_y[i] = 1.0f;
        p->tfar[i] = tfar;
        p->mask[i] = UINT32_MAX;
    }
}

static void occluded16_tells_each_lane(void **state)
{
    struct scene *s = unit_cube();
    int32_t valid[PACKET];
    struct ray16 p;

    (void)state;
    memset(valid, -1, sizeof(valid));
    for (enum cpu_level level = CPU_BASELINE; level <= cpu_best(); level++) {
        struct rays *r = rays_create_for(s, level);
        rays_upwards(&p, INFINITY);
        rays_occluded16(r, RAYS_TOGETHER, valid, &p);
        for (int i = 0; i < PACKET; i++)
            assert_int_equal(p.tfar[i] == -INFINITY, fabsf(p.org_x[i]) < 0.5f);
        rays_upwards(&p, 0.4f); /* the cube begins at a distance of 0.5 */
        rays_occluded16(r, RAYS_TOGETHER, valid, &p);
        for (int i = 0; i < PACKET; i++)
            assert_float_equal(p.tfar[i], 0.4f, 0.0f);
        rays_destroy(r);
    }
    scene_destroy(s);
}

/* At every CPU level: Embree has packets of 16 with AVX-512 only, of 8 with AVX2, of 4 below, and answers wider ones
 * without looking at `valid`. */
static void occluded16_leaves_invalid_lanes_alone(void **state)
{
    struct scene *s = unit_cube();
    struct ray16 p;

    (void)state;
    for (enum cpu_level level = CPU_BASELINE; level <= cpu_best(); level++) {
        struct rays *r = rays_create_for(s, level);
        for (uint32_t pattern = 0; pattern < 1u << PACKET; pattern += 641) {
            int32_t valid[PACKET];
            for (int i = 0; i < PACKET; i++)
                valid[i] = pattern >> i & 1 ? -1 : 0;
            for (int spread = RAYS_TOGETHER; spread <= RAYS_APART; spread++) {
                rays_upwards(&p, 9.0f);
                rays_occluded16(r, (enum ray_spread)spread, valid, &p);
                for (int i = 0; i < PACKET; i++)
                    assert_int_equal(p.tfar[i] == -INFINITY, valid[i] && fabsf(p.org_x[i]) < 0.5f);
            }
        }
        rays_destroy(r);
    }
    scene_destroy(s);
}

static void normals_are_interpolated(void **state)
{
    struct scene *s = scene_create();
    const float corners[4][3] = { { 0, 0, 0 }, { 1, 0, 0 }, { 1, 1, 0 }, { 0, 1, 0 } };
    struct hit h;
    struct surface at;

    (void)state;
    add_quads(s, add_lambert(s, 0.5f), corners, 1);
    float *n = mem_alloc(12, sizeof(*n));
    const float left[3] = { -0.6f, 0.0f, 0.8f }, right[3] = { 0.6f, 0.0f, 0.8f };
    for (int i = 0; i < 4; i++)
        memcpy(n + 3 * i, i == 1 || i == 2 ? right : left, sizeof(left));
    s->meshes[0].normals = n;
    struct rays *r = rays_create_for(s, cpu_best());
    assert_true(rays_intersect(r, vec3_make(0.75f, 0.25f, 1.0f), vec3_make(0.0f, 0.0f, -1.0f), 0.0f, &h));
    rays_surface(r, &h, vec3_make(0.0f, 0.0f, 1.0f), &at);
    const float l = sqrtf(0.3f * 0.3f + 0.8f * 0.8f); /* a quarter left, three quarters right */
    assert_float_equal(at.shading.x, 0.3f / l, 1e-6f);
    assert_float_equal(at.shading.z, 0.8f / l, 1e-6f);
    assert_float_equal(at.geometric.z, 1.0f, 1e-6f);
    /* from behind both turn */
    rays_surface(r, &h, vec3_make(0.0f, 0.0f, -1.0f), &at);
    assert_float_equal(at.shading.x, -0.3f / l, 1e-6f);
    assert_float_equal(at.geometric.z, -1.0f, 1e-6f);
    /* no normal at the vertices: the geometric one */
    memset(n, 0, 12 * sizeof(*n));
    rays_surface(r, &h, vec3_make(0.0f, 0.0f, 1.0f), &at);
    assert_float_equal(at.shading.z, 1.0f, 1e-6f);
    rays_destroy(r);
    scene_destroy(s);
}

static float between(struct rng *g, double low, double high)
{
    return (float)(low + (high - low) * rng_next(g));
}

/* Two triangles in one plane, of any size, slant and distance from the origin, long and thin ones among them. */
static struct scene *random_plane(struct rng *g)
{
    const float size = powf(10.0f, between(g, -3.0, 4.0)), away = powf(10.0f, between(g, -3.0, 4.0));
    const float thin = powf(10.0f, between(g, -3.0, 0.0));
    const struct vec3 o = { away * between(g, -1, 1), away * between(g, -1, 1), away * between(g, -1, 1) };
    const struct vec3 a = { between(g, -1, 1), between(g, -1, 1), between(g, -1, 1) };
    const struct vec3 b = { between(g, -1, 1), between(g, -1, 1), between(g, -1, 1) };
    const struct vec3 e = vec3_scale(a, size);
    const struct vec3 f = vec3_scale(vec3_normalize(vec3_cross(a, b)), size * thin);
    const struct vec3 p[4] = { o, vec3_add(o, e), vec3_add(vec3_add(o, e), f), vec3_add(o, f) };
    float corners[4][3];
    struct scene *s = scene_create();

    for (int i = 0; i < 4; i++) {
        corners[i][0] = p[i].x;
        corners[i][1] = p[i].y;
        corners[i][2] = p[i].z;
    }
    add_quads(s, add_lambert(s, 0.5f), (const float(*)[3])corners, 1);
    (void)mesh_drop_degenerate(&s->meshes[0]);
    return s;
}

/* How many of 16 shadow rays into the hemisphere above the hit meet its own triangle. */
static int self_hits(const struct rays *r, const struct surface *at, struct rng *g)
{
    const struct vec3 n = at->geometric, o = vec3_add(at->position, vec3_scale(n, at->offset));
    struct ray16 p = { .org_x = { 0 } };
    int32_t valid[PACKET];
    int hits = 0;

    for (int i = 0; i < PACKET; i++) {
        struct vec3 d = vec3_normalize(vec3_make(between(g, -1, 1), between(g, -1, 1), between(g, -1, 1)));
        if (vec3_dot(d, n) < 0.0f)
            d = vec3_scale(d, -1.0f);
        valid[i] = vec3_dot(d, n) > 1e-3f ? -1 : 0;
        p.org_x[i] = o.x;
        p.org_y[i] = o.y;
        p.org_z[i] = o.z;
        p.dir_x[i] = d.x;
        p.dir_y[i] = d.y;
        p.dir_z[i] = d.z;
        p.tfar[i] = INFINITY;
        p.mask[i] = UINT32_MAX;
    }
    struct ray16 alone = p;
    rays_occluded16(r, RAYS_TOGETHER, valid, &p);
    rays_occluded16(r, RAYS_APART, valid, &alone);
    for (int i = 0; i < PACKET; i++)
        hits += p.tfar[i] == -INFINITY || alone.tfar[i] == -INFINITY;
    return hits;
}

static void starts_off_a_surface_do_not_meet_it(void **state)
{
    struct rng g = { 7 };
    int asked = 0;

    (void)state;
    for (int k = 0; k < 150; k++) {
        struct scene *s = random_plane(&g);
        struct rays *r = rays_create_for(s, cpu_best());
        const struct mesh *m = &s->meshes[0];
        for (int i = 0; i < 100 && m->triangle_count > 0; i++) {
            const float u = between(&g, 0, 1), v = between(&g, 0, 1) * (1.0f - u);
            const struct hit h = { 1.0f, 0, (uint32_t)i % m->triangle_count, u, v };
            struct surface at;
            rays_surface(r, &h, vec3_make(between(&g, -1, 1), between(&g, -1, 1), between(&g, -1, 1)), &at);
            const int hits = self_hits(r, &at, &g);
            if (hits)
                fail_msg("plane %d: %d rays of 16 met their own plane, offset %g at (%g %g %g)", k, hits,
                         (double)at.offset, (double)at.position.x, (double)at.position.y, (double)at.position.z);
            asked++;
        }
        rays_destroy(r);
        scene_destroy(s);
    }
    assert_true(asked > 10000);
}

/* 200 squares about a cube, turned any way, so that about half of the rays meet something. */
static struct scene *thicket(struct rng *g)
{
    struct scene *s = scene_create();
    float corners[4 * 200][3];

    assert_non_null(s);
    for (int q = 0; q < 200; q++) {
        const float size = between(g, 0.02f, 0.3f);
        float centre[3], side[2][3];
        for (int c = 0; c < 3; c++) {
            centre[c] = between(g, -1, 1);
            side[0][c] = size * between(g, -1, 1);
            side[1][c] = size * between(g, -1, 1);
        }
        for (int k = 0; k < 4; k++)
            for (int c = 0; c < 3; c++)
                corners[4 * q + k][c] =
                    centre[c] + (k == 1 || k == 2 ? side[0][c] : 0.0f) + (k >= 2 ? side[1][c] : 0.0f);
    }
    add_quads(s, add_lambert(s, 0.5f), (const float(*)[3])corners, 200);
    assert_int_equal(scene_finish(s, "thicket", NULL), ERR_OK);
    return s;
}

static void how_rays_lie_changes_no_answer(void **state)
{
    struct rng g = { 5 };
    struct scene *s = thicket(&g);
    struct rays *r = rays_create_for(s, cpu_best());
    int met = 0;

    (void)state;
    for (int k = 0; k < 4000; k++) {
        struct ray16 p = { .org_x = { 0 } };
        int32_t valid[PACKET];
        for (int i = 0; i < PACKET; i++) {
            valid[i] = between(&g, 0, 1) < 0.9f ? -1 : 0;
            p.org_x[i] = between(&g, -1, 1);
            p.org_y[i] = between(&g, -1, 1);
            p.org_z[i] = between(&g, -1, 1);
            p.dir_x[i] = between(&g, -1, 1);
            p.dir_y[i] = between(&g, -1, 1);
            p.dir_z[i] = between(&g, -1, 1);
            p.tfar[i] = k % 2 ? INFINITY : 0.7f;
            p.mask[i] = UINT32_MAX;
        }
        struct ray16 alone = p;
        rays_occluded16(r, RAYS_TOGETHER, valid, &p);
        rays_occluded16(r, RAYS_APART, valid, &alone);
        assert_memory_equal(p.tfar, alone.tfar, sizeof(p.tfar));
        for (int i = 0; i < PACKET; i++)
            met += p.tfar[i] == -INFINITY;
    }
    assert_in_range(met, 6400, 57600); /* of 64000: both answers occur */
    rays_destroy(r);
    scene_destroy(s);
}

static void offset_does_not_leak_through_a_sheet(void **state)
{
    struct scene *s = scene_create();
    /* a ground of 20 km, and a sheet of paper a tenth of a millimetre above it */
    const float ground[4][3] = { { -1e4f, 0, -1e4f }, { -1e4f, 0, 1e4f }, { 1e4f, 0, 1e4f }, { 1e4f, 0, -1e4f } };
    const float glass[4][3] = { { -1, 1e-4f, -1 }, { -1, 1e-4f, 1 }, { 1, 1e-4f, 1 }, { 1, 1e-4f, -1 } };
    struct rng g = { 3 };

    (void)state;
    const uint32_t grey = add_lambert(s, 0.5f);
    add_quads(s, grey, ground, 1);
    add_quads(s, grey, glass, 1);
    struct rays *r = rays_create_for(s, cpu_best());
    for (int i = 0; i < 1000; i++) {
        /* from below the ground, which is met first */
        const struct vec3 o = { between(&g, -0.5, 0.5), -1.0f, between(&g, -0.5, 0.5) };
        struct hit h;
        struct surface at;
        assert_true(rays_intersect(r, o, vec3_make(0.0f, 1.0f, 0.0f), 0.0f, &h));
        assert_int_equal(h.mesh, 0);
        rays_surface(r, &h, vec3_make(0.0f, 1.0f, 0.0f), &at); /* as though seen from above */
        assert_true(at.offset < 1e-6f);
        assert_true(self_hits(r, &at, &g) >= 13); /* the sheet, except at grazing angles left out */
    }
    rays_destroy(r);
    scene_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(ray_meets_cube_at_known_distance),    cmocka_unit_test(surface_faces_the_side_looked_from),
    cmocka_unit_test(occluded16_tells_each_lane),          cmocka_unit_test(occluded16_leaves_invalid_lanes_alone),
    cmocka_unit_test(how_rays_lie_changes_no_answer),      cmocka_unit_test(normals_are_interpolated),
    cmocka_unit_test(starts_off_a_surface_do_not_meet_it), cmocka_unit_test(offset_does_not_leak_through_a_sheet),
};

UNIT_MAIN(tests)
