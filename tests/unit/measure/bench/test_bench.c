#include "measure/bench/bench.h"

#include "base/mem.h"
#include "import/reader/reader.h"
#include "scene/geometry/scene.h"
#include "support/unit.h"

#include <math.h>

/* Twice the area, and the volume by the divergence theorem, which a hole or a turned triangle would change. */
static void measure(const struct scene *s, double *area, double *volume)
{
    *area = *volume = 0.0;
    for (size_t i = 0; i < s->mesh_count; i++) {
        const struct mesh *m = &s->meshes[i];
        for (size_t t = 0; t < m->triangle_count; t++) {
            double v[3][3], n[3];
            for (int k = 0; k < 3; k++) {
                assert_true(m->indices[3 * t + (size_t)k] < m->vertex_count);
                for (int c = 0; c < 3; c++)
                    v[k][c] = m->positions[3 * (size_t)m->indices[3 * t + (size_t)k] + (size_t)c];
            }
            for (int c = 0; c < 3; c++) {
                const int a = (c + 1) % 3, b = (c + 2) % 3;
                n[c] = (v[1][a] - v[0][a]) * (v[2][b] - v[0][b]) - (v[1][b] - v[0][b]) * (v[2][a] - v[0][a]);
                *volume += n[c] * v[0][c];
            }
            *area += sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        }
    }
}

static void subdivide_keeps_the_surface(void **state)
{
    double area[2], volume[2];
    struct scene *s = scene_create_builtin();
    (void)state;

    assert_non_null(s);
    const uint64_t triangles = s->triangle_count;
    measure(s, &area[0], &volume[0]);
    assert_int_equal(subdivide(s, 2), ERR_OK);
    measure(s, &area[1], &volume[1]);
    assert_true(s->triangle_count <= 16 * triangles && s->triangle_count > 15.9 * (double)triangles);
    assert_true(fabs(area[1] / area[0] - 1.0) < 1e-5);
    assert_true(fabs(volume[1] - volume[0]) < 1e-5 * fabs(area[0]));
    scene_destroy(s);
}

/* A new vertex has the mean of its edge's normals, at unit length. */
static void subdivide_keeps_normals_at_unit_length(void **state)
{
    static const float corners[12] = { 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1 };
    static const uint32_t faces[12] = { 0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3 };
    struct mesh m = { .vertex_count = 4, .triangle_count = 4 };
    struct scene s = { .meshes = &m, .mesh_count = 1 };
    (void)state;

    m.positions = mem_alloc(13, sizeof(float));
    m.normals = mem_alloc(12, sizeof(float));
    m.indices = mem_alloc(12, sizeof(uint32_t));
    memcpy(m.positions, corners, sizeof(corners));
    memcpy(m.indices, faces, sizeof(faces));
    for (int k = 0; k < 4; k++)
        m.normals[3 * k + k % 3] = 1.0f;
    assert_int_equal(subdivide(&s, 1), ERR_OK);
    assert_int_equal(s.triangle_count, 16);
    assert_int_equal(m.vertex_count, 4 + 12);
    for (uint32_t k = 0; k < m.vertex_count; k++) {
        const float *n = m.normals + 3 * (size_t)k;
        assert_true(fabsf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2] - 1.0f) < 1e-6f);
    }
    mem_free(m.positions);
    mem_free(m.normals);
    mem_free(m.indices);
}

static void medians_are_what_they_say(void **state)
{
    double odd[3] = { 3.0, 1.0, 2.0 }, even[4] = { 4.0, 1.0, 2.0, 9.0 };
    double ours[3] = { 8.0, 2.0, 6.0 }, bare[3] = { 4.0, 2.0, 2.0 }; /* the rounds' ratios are 2, 1 and 3 */
    struct bench_row row;
    (void)state;

    assert_true(bench_median(odd, 3) == 2.0);
    assert_true(bench_median(even, 4) == 3.0);
    bench_take(&row, ours, bare, 3);
    assert_true(row.ratio == 2.0 && row.ours == 6.0 && row.bare == 2.0 && row.rounds == 3);
}

static void allocations_are_counted(void **state)
{
    uint64_t before, after;
    (void)state;

    if (!allocations_count(&before))
        skip();
    void *volatile p = mem_alloc(100, 1);
    assert_non_null(p);
    mem_free(p);
    allocations_count(&after);
    assert_true(after - before == 1);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(subdivide_keeps_the_surface),
    cmocka_unit_test(subdivide_keeps_normals_at_unit_length),
    cmocka_unit_test(medians_are_what_they_say),
    cmocka_unit_test(allocations_are_counted),
};
UNIT_MAIN(tests)
