/* Pixels at edges: how evenly their camera rays are spread, and which of them are merged. */
#include "scene/geometry/quads.h"

#include <math.h>

/* The share of a pixel of edge 1 where nx x + ny y < d, with nx, ny > 0. */
static double share_below(double nx, double ny, double d)
{
    const double cuts[4] = { d, d - nx, d - ny, d - nx - ny };
    double sum = 0.0;

    for (int i = 0; i < 4; i++)
        sum += (i == 0 || i == 3 ? 0.5 : -0.5) * fmax(0.0, cuts[i]) * fmax(0.0, cuts[i]) / (nx * ny);
    return sum;
}

/* The rms error of coverage is 0.032 of a pixel; rays at random within their cells leave 0.045. */
static void rays_are_spread_evenly(void **state)
{
    double sum = 0.0;
    uint32_t cut = 0;

    (void)state;
    for (int k = 0; k < 12; k++) {
        /* all below a slanted edge through (0.01, 0.02), in pixels from the upper left corner: down is positive */
        const double a = (k + 0.5) * PI / 24.0, nx = cos(a), ny = sin(a), d = 32.0 * (nx * 1.01 + ny * 0.98);
        const float c = (float)nx, s = (float)-ny, px = 0.01f, py = 0.02f;
        const float below[4][3] = { { px - 9 * s, py + 9 * c, 0 },
                                    { px - 9 * s - 9 * c, py + 9 * c - 9 * s, 0 },
                                    { px + 9 * s - 9 * c, py - 9 * c - 9 * s, 0 },
                                    { px + 9 * s, py - 9 * c, 0 } };
        struct view v = view_quads(below, 1, 0);
        for (uint32_t i = 0; i < 64 * 64; i++) {
            const double share = share_below(nx, ny, d - nx * (double)(i % 64) - ny * (double)(i / 64));
            const double error = (double)weight_of_points(v.g, i % 64, i / 64) - share;
            const bool is_cut = share > 1e-9 && share < 1.0 - 1e-9;
            sum += is_cut ? error * error : 0.0;
            cut += is_cut;
        }
        view_end(&v);
    }
    assert_true(cut > 500 && sqrt(sum / cut) < 0.037);
}

/* Bits of the cells in which a point's rays start. */
static uint32_t cells_of(const struct shade_packet *p, uint32_t lane)
{
    uint32_t bits = 0;

    for (uint32_t i = 0; i < PIXEL_CELLS; i++)
        bits |= 1u << (p->cells[i / 8][lane] >> i % 8 * 4 & 15u);
    return bits;
}

/* A quad before another, with a slanted edge: both points of a pixel share its cells as they share its weight. */
static void points_share_the_cells_of_their_pixel(void **state)
{
    const float quads[8][3] = { { -9, -9, -1 }, { 9, -9, -1 }, { 9, 9, -1 }, { -9, 9, -1 },
                                { -9, -9, 0 },  { 9, -9, 0 },  { 9, 5, 0 },  { -9, -4.6f, 0 } };
    struct view v = view_quads(quads, 2, 0);
    uint32_t shared = 0;

    (void)state;
    for (uint32_t i = 0; i < 64 * 64; i++) {
        uint32_t all = 0;
        for (uint32_t k = v.g->entry_first[i]; k < v.g->entry_first[i + 1]; k++) {
            const uint32_t lane = v.g->entries[k].point % PACKET;
            const struct shade_packet *p = &v.g->packets[v.g->entries[k].point / PACKET];
            const uint32_t cells = cells_of(p, lane);
            assert_float_equal(v.g->entries[k].weight[0], (float)__builtin_popcount(cells) / 16.0f, 1e-5f);
            const float edge = (1.0f - p->z[lane]) / 32.0f; /* of a pixel in the middle */
            assert_true(p->pixel[lane] > 0.5f * edge && p->pixel[lane] < 1.01f * edge);
            assert_true(p->cell[lane] == PIXEL_CELLS ? cells == PIXEL_WHOLE : cells >> p->cell[lane] & 1u);
            assert_int_equal(all & cells, 0);
            all |= cells;
        }
        assert_int_equal(all, PIXEL_WHOLE);
        shared += v.g->entry_first[i + 1] - v.g->entry_first[i] == 2;
    }
    assert_true(shared > 50);
    view_end(&v);
}

/* Where a wall stands on a floor, rays of the floor's pixels would start behind it, and the other way about. */
static void rays_do_not_start_behind_what_rises_in_the_pixel(void **state)
{
    const float bend[8][3] = { { -9, -0.3f, -1 }, { -9, -0.3f, 9 }, { 9, -0.3f, 9 }, { 9, -0.3f, -1 },
                               { -9, -0.3f, -1 }, { 9, -0.3f, -1 }, { 9, 9, -1 },    { -9, 9, -1 } };
    uint32_t alone = 0;

    (void)state;
    struct view v = view_quads(bend, 2, 0);
    for (uint32_t i = 0; i < v.g->packet_count; i++)
        for (uint32_t l = 0; l < v.g->packets[i].count; l++) {
            const struct shade_packet *p = &v.g->packets[i];
            const float reach = p->ng_y[l] > 0.5f ? p->z[l] + 1.0f : p->y[l] + 0.3f;
            const bool whole = p->pixel[l] > 0.0f && p->cell[l] == PIXEL_CELLS;
            assert_true(!whole || reach > p->pixel[l]);
            alone += !whole;
        }
    view_end(&v);
    assert_true(alone >= 128);
}

static void facets_within_a_pixel_are_kept_apart(void **state)
{
    /* a roof whose ridge runs down the middle of pixel column 32 */
    const float m = 0.5f / 32.0f;
    const float roof[8][3] = { { -2, -2, -2 }, { m, -2, 0 },  { m, 2, 0 },  { -2, 2, -2 },
                               { m, -2, 0 },   { 2, -2, -2 }, { 2, 2, -2 }, { m, 2, 0 } };

    (void)state;
    struct view v = view_quads(roof, 2, 4);
    for (uint32_t y = 0; y < 64; y++) {
        const size_t i = (size_t)y * 64 + 32;
        const uint32_t k = v.g->entry_first[i];
        assert_int_equal(v.g->entry_first[i + 1] - k, 2);
        const uint32_t a = v.g->entries[k].point, b = v.g->entries[k + 1].point;
        const float na = v.g->packets[a / PACKET].ng_x[a % PACKET], nb = v.g->packets[b / PACKET].ng_x[b % PACKET];
        assert_true(na * nb < 0.0f);
        assert_float_equal(v.g->entries[k].weight[0], 0.5f, 1e-6f);
    }
    view_end(&v);
}

/* Points in pixel column 32 of a roof whose ridge runs down its middle and whose sides fall by `fall` per metre, when
 * the normals at its left and right vertices are as given. */
static uint32_t points_on_ridge_of(struct material stuff, float fall, const float left[3], const float right[3])
{
    const float m = 0.5f / 32.0f, f = -2.0f * fall;
    const float roof[8][3] = { { -2 + m, -2, f }, { m, -2, 0 },     { m, 2, 0 },     { -2 + m, 2, f },
                               { m, -2, 0 },      { 2 + m, -2, f }, { 2 + m, 2, f }, { m, 2, 0 } };
    const struct gbuffer_desc d = { .camera = &front, .width = 64, .height = 64 };
    struct scene *s = scene_create();

    stuff.texture = MATERIAL_NO_TEXTURE;
    assert_int_equal(scene_add_material(s, &stuff, NULL), ERR_OK);
    add_quads(s, 0, roof, 2);
    float *n = mem_alloc(8, 3 * sizeof(*n));
    for (int i = 0; i < 8; i++)
        memcpy(n + 3 * i, i < 4 ? left : right, 3 * sizeof(*n));
    s->meshes[0].normals = n;
    struct rays *r = rays_create_for(s, cpu_best());
    struct gbuffer *g = gbuffer_of(s, r, &d);
    const size_t i = (size_t)20 * 64 + 32;
    const uint32_t points = g->entry_first[i + 1] - g->entry_first[i];
    gbuffer_destroy(g);
    rays_destroy(r);
    scene_destroy(s);
    return points;
}

static uint32_t points_on_ridge(float fall, const float left[3], const float right[3])
{
    return points_on_ridge_of((struct material){ .diffuse = { 0.5f, 0.5f, 0.5f } }, fall, left, right);
}

static void interpolated_normals_decide_where_there_are_any(void **state)
{
    const float ahead[3] = { 0, 0, 1 }, left[3] = { -0.1f, 0, 0.994987f }, right[3] = { 0.1f, 0, 0.994987f };

    (void)state;
    assert_int_equal(points_on_ridge(0.0f, ahead, ahead), 1);
    assert_int_equal(points_on_ridge(0.0f, left, right), 2);  /* a plane that pretends to have a ridge */
    assert_int_equal(points_on_ridge(0.1f, ahead, ahead), 1); /* facets 11 degrees apart that pretend to be smooth */
    assert_int_equal(points_on_ridge(0.5f, ahead, ahead), 2); /* 53 degrees: the light's horizon is another */
}

static void sharp_lobes_are_merged_within_their_width(void **state)
{
    const float left[3] = { -0.05f, 0, 0.998749f }, right[3] = { 0.05f, 0, 0.998749f }; /* 5.7 degrees apart */
    const struct material phong = { .kind = MATERIAL_PHONG, .specular = { 0.5f, 0.5f, 0.5f } };
    const struct material ggx = { .kind = MATERIAL_GGX, .metallic = 1.0f, .diffuse = { 0.5f, 0.5f, 0.5f } };
    struct material dull = phong, sharp = phong, rough = ggx, smooth = ggx;

    (void)state;
    dull.exponent = 10.0f;
    sharp.exponent = 100.0f;
    rough.roughness = 0.5f;
    smooth.roughness = 0.2f;
    assert_int_equal(points_on_ridge(0.0f, left, right), 1);
    assert_int_equal(points_on_ridge_of(dull, 0.0f, left, right), 1);
    assert_int_equal(points_on_ridge_of(sharp, 0.0f, left, right), 2);
    assert_int_equal(points_on_ridge_of(rough, 0.0f, left, right), 1);
    assert_int_equal(points_on_ridge_of(smooth, 0.0f, left, right), 2);
}

/* A floor 1 m below the eye: 1.6 m away a pixel is 1.9 times as long as it is wide, and 13 m away 13 times. */
static void points_far_apart_are_not_merged(void **state)
{
    const float floor[4][3] = { { -90, -1, 1 }, { 90, -1, 1 }, { 90, -1, -90 }, { -90, -1, -90 } };
    const struct gbuffer_desc d = { .camera = &front, .width = 64, .height = 64, .every_pixel = true };
    struct view v = view_quads(floor, 1, 1);
    struct gbuffer *g = gbuffer_of(v.scene, v.rays, &d);
    const size_t near = (size_t)52 * 64 + 32, far = (size_t)34 * 64 + 32;

    (void)state;
    assert_int_equal(g->entry_first[near + 1] - g->entry_first[near], 1);
    assert_in_range(g->entry_first[far + 1] - g->entry_first[far], 2, 4);
    gbuffer_destroy(g);
    view_end(&v);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(rays_are_spread_evenly),
    cmocka_unit_test(points_share_the_cells_of_their_pixel),
    cmocka_unit_test(rays_do_not_start_behind_what_rises_in_the_pixel),
    cmocka_unit_test(facets_within_a_pixel_are_kept_apart),
    cmocka_unit_test(interpolated_normals_decide_where_there_are_any),
    cmocka_unit_test(sharp_lobes_are_merged_within_their_width),
    cmocka_unit_test(points_far_apart_are_not_merged),
};

UNIT_MAIN(tests)
