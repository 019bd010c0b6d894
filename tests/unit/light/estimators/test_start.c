/* Where light paths begin: densities against closed forms, against counts of what was drawn, and against brute force.
 * Directions are all over the sphere, with those along axes and planes among them. */
#include "light/estimators/light_tracer.h"

#include "base/rng.h"

#include <math.h>

#include "support/unit.h"

#define CELLS 12 /* of the grid in which drawn lines are counted, a side */

static const struct box scene_bounds = { { -9.0f, -9.0f, -9.0f }, { 9.0f, 9.0f, 9.0f } };
static const struct box one_box = { { -1.0f, 0.5f, 2.0f }, { 0.2f, 1.1f, 4.5f } };
static const struct box flat_box = { { -2.0f, 1.0f, -1.0f }, { 1.0f, 1.0f, 2.0f } };
static const struct box three_boxes[3] = { { { -1.0f, -1.0f, -1.0f }, { 1.0f, 1.0f, 1.0f } },
                                           { { 0.0f, -0.5f, 0.3f }, { 3.0f, 0.8f, 1.5f } },
                                           { { -2.0f, 2.0f, -3.0f }, { 2.0f, 2.0f, 1.0f } } };

static struct vec3 direction(uint32_t k, struct rng *r)
{
    static const struct vec3 special[] = {
        { 1, 0, 0 }, { 0, -1, 0 }, { 0, 0, 1 }, { 0.6f, -0.8f, 0 }, { 0, 0.8f, 0.6f }
    };
    const double y = 2.0 * rng_next(r) - 1.0, phi = 2.0 * PI * rng_next(r), s = sqrt(1.0 - y * y);

    return k < 5 ? special[k] : vec3_make((float)(s * sin(phi)), (float)y, (float)(s * cos(phi)));
}

static double product(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* A line meets a box if no axis that is perpendicular to the line and to one of the box's edges separates them. */
static bool meets(const struct start *s, const struct start_shape *k, const double p[3])
{
    const double d[3] = { p[0] - k->centre[0], p[1] - k->centre[1], p[2] - k->centre[2] }, *n = s->along;

    if (s->kind == START_QUAD)
        return fabs(product(d, k->side[0])) <= k->reach[0] && fabs(product(d, k->side[1])) <= k->reach[1];
    if (s->kind == START_DISC)
        return product(d, d) - product(d, n) * product(d, n) <= k->reach[0] * k->reach[0];
    for (int i = 0; i < 3; i++) {
        const int u = (i + 1) % 3, v = (i + 2) % 3;
        if (fabs(d[u] * n[v] - d[v] * n[u]) > k->half[u] * fabs(n[v]) + k->half[v] * fabs(n[u]))
            return false;
    }
    return true;
}

/* The density, m^-2, of the line through p by its definition; 0 if it cannot be sampled. */
static double density_at(const struct start *s, const double p[3])
{
    uint32_t count = 0;

    for (uint32_t k = 0; k < s->count; k++)
        count += s->areas[k] > 0.0 && meets(s, &s->shapes[k], p);
    return count / s->area;
}

static void across(const double n[3], double t[3], double u[3])
{
    const int axis = fabs(n[0]) < 0.6 ? 0 : 1;
    double length = 0.0;

    for (int i = 0; i < 3; i++) {
        t[i] = (i == axis) - n[axis] * n[i];
        length += t[i] * t[i];
    }
    for (int i = 0; i < 3; i++)
        t[i] /= sqrt(length);
    for (int i = 0; i < 3; i++)
        u[i] = n[(i + 1) % 3] * t[(i + 2) % 3] - n[(i + 2) % 3] * t[(i + 1) % 3];
}

static void projected_areas_are_those_of_closed_forms(void **state)
{
    struct rng r = { 1 };
    (void)state;
    for (uint32_t k = 0; k < 200; k++) {
        const struct vec3 d = direction(k, &r);
        const double x = 1.2f, y = 0.6f, z = 2.5f;
        struct start s;
        start_init(&s, START_FACES, &one_box, 1, &scene_bounds, d);
        const double faces = y * z * fabs(d.x) + z * x * fabs(d.y) + x * y * fabs(d.z);
        assert_true(fabs(s.area - faces) < 1e-5 * faces);
        start_init(&s, START_DISC, &one_box, 1, &scene_bounds, d);
        assert_true(fabs(s.area - PI * 0.25 * (x * x + y * y + z * z)) < 1e-5);
        start_init(&s, START_QUAD, &one_box, 1, &scene_bounds, d);
        assert_true(s.area >= faces * (1.0 - 1e-6) && s.area <= 2.0 * faces * (1.0 + 1e-6));
    }
}

/* The area of the rectangle around the projected corners, one side of it turned by `angle`. */
static double turned_area(const struct box *b, const double n[3], double angle)
{
    double t[3], u[3], low[2] = { INFINITY, INFINITY }, high[2] = { -INFINITY, -INFINITY };

    across(n, t, u);
    for (int c = 0; c < 8; c++) {
        const double p[3] = { c & 1 ? b->high.x : b->low.x, c & 2 ? b->high.y : b->low.y,
                              c & 4 ? b->high.z : b->low.z };
        const double x = p[0] * t[0] + p[1] * t[1] + p[2] * t[2], y = p[0] * u[0] + p[1] * u[1] + p[2] * u[2];
        const double q[2] = { x * cos(angle) + y * sin(angle), y * cos(angle) - x * sin(angle) };
        for (int i = 0; i < 2; i++) {
            low[i] = fmin(low[i], q[i]);
            high[i] = fmax(high[i], q[i]);
        }
    }
    return (high[0] - low[0]) * (high[1] - low[1]);
}

static void quad_is_the_smallest_of_all_angles(void **state)
{
    enum { ANGLES = 4096 };
    const struct box *boxes[2] = { &one_box, &flat_box };
    struct rng r = { 2 };
    (void)state;
    for (uint32_t k = 0; k < 100; k++) {
        const struct box *b = boxes[k % 2];
        struct start s;
        start_init(&s, START_QUAD, b, 1, &scene_bounds, direction(k, &r));
        double least = INFINITY, corner = 0.0;
        for (int a = 0; a < ANGLES; a++)
            least = fmin(least, turned_area(b, s.along, 0.5 * PI * a / ANGLES));
        corner = turned_area(b, s.along, 0.5 * PI * 0.37); /* some angle or other */
        assert_true(s.area <= least * (1.0 + 1e-9) + 1e-9);
        /* brute force is within the change of an angle's step of it: d(area) <= perimeter^2 d(angle) */
        assert_true(least <= s.area + 100.0 * 0.5 * PI / ANGLES && corner >= s.area * (1.0 - 1e-9));
    }
}

/* A grid across the direction, in which lines are counted. */
struct grid {
    double t[3], u[3], cell;
};

static int cell_of(const struct grid *g, const double p[3])
{
    const double a = (p[0] * g->t[0] + p[1] * g->t[1] + p[2] * g->t[2]) / g->cell + 0.5 * CELLS;
    const double b = (p[0] * g->u[0] + p[1] * g->u[1] + p[2] * g->u[2]) / g->cell + 0.5 * CELLS;

    assert_true(a >= 0.0 && a < CELLS && b >= 0.0 && b < CELLS);
    return (int)a * CELLS + (int)b;
}

/* Lines that were drawn, by cell, against the integral of the density over each cell by as many places thrown evenly on
 * the grid: a chi-square of the differences over their variances, made normal by [Wilson and Hilferty 1931] and held
 * to 4.2. That is one in 7e4 by chance, for some 70 comparisons; a density that is 5 % off on half of the lines gives
 * z > 6. */
static void check_density(const struct box *boxes, uint32_t count, enum start_kind kind, struct vec3 d, uint64_t seed)
{
    enum { LINES = 100000, HITS = 12 };
    double drawn[CELLS * CELLS] = { 0 }, want[CELLS * CELLS] = { 0 }, squares[CELLS * CELLS] = { 0 },
                         hits[CELLS * CELLS] = { 0 };
    double chi2 = 0.0;
    struct grid g = { .cell = 12.0 / CELLS };
    struct rng r = { seed };
    struct start s;
    int cells = 0, otherwise = 0; /* lines of which another density was told when they were drawn */

    start_init(&s, kind, boxes, count, &scene_bounds, d);
    across(s.along, g.t, g.u);
    for (int i = 0; i < LINES; i++) {
        const double x[2] = { rng_next(&r), rng_next(&r) };
        const double a = 12.0 * (rng_next(&r) - 0.5), b = 12.0 * (rng_next(&r) - 0.5);
        const double p[3] = { a * g.t[0] + b * g.u[0], a * g.t[1] + b * g.u[1], a * g.t[2] + b * g.u[2] };
        struct vec3 o;
        double density;
        assert_true(start_sample(&s, x, &o, &density));
        const double q[3] = { o.x, o.y, o.z };
        drawn[cell_of(&g, q)] += 1.0;
        otherwise += fabs(density_at(&s, q) - density) > 1e-9 * density;
        const double share = density_at(&s, p) * 144.0; /* of the lines, if all places were as this one */
        want[cell_of(&g, p)] += share;
        squares[cell_of(&g, p)] += share * share;
        hits[cell_of(&g, p)] += share > 0.0;
    }
    for (int i = 0; i < CELLS * CELLS; i++) {
        assert_true(hits[i] > 0.0 || drawn[i] * s.area < HITS * 144.0); /* a sliver that was missed */
        if (hits[i] >= HITS) {
            chi2 += (drawn[i] - want[i]) * (drawn[i] - want[i]) / (want[i] + squares[i]);
            cells++;
        }
    }
    assert_true(otherwise < LINES / 1000); /* but for rounding at borders */
    const double v = 2.0 / (9.0 * cells), z = (cbrt(chi2 / cells) - (1.0 - v)) / sqrt(v);
    if (!(cells >= 4 && z < 4.2))
        printf("kind %d, direction %g %g %g: %d cells, z %.2f\n", kind, d.x, d.y, d.z, cells, z);
    assert_true(cells >= 4 && z < 4.2);
}

static void lines_are_drawn_evenly_over_the_silhouette(void **state)
{
    struct rng r = { 3 };
    (void)state;
    for (uint32_t k = 0; k < 8; k++) {
        const struct vec3 d = direction(k, &r);
        for (int kind = START_FACES; kind <= START_DISC; kind++)
            check_density(&one_box, 1, (enum start_kind)kind, d, 100 + k);
    }
}

static void a_mixture_has_the_density_that_it_says(void **state)
{
    struct rng r = { 4 };
    (void)state;
    for (uint32_t k = 0; k < 12; k++) {
        const struct vec3 d = direction(k, &r);
        for (int kind = START_FACES; kind <= START_DISC; kind++)
            check_density(three_boxes, 3, (enum start_kind)kind, d, 200 + k);
    }
}

static void a_flat_box_is_drawn_from_and_not_along_its_plane(void **state)
{
    struct vec3 o;
    double density;
    struct start s;
    (void)state;
    check_density(&flat_box, 1, START_FACES, vec3_make(0.0f, -1.0f, 0.0f), 5);
    check_density(&flat_box, 1, START_FACES, vec3_make(0.36f, 0.48f, 0.8f), 6);
    check_density(&flat_box, 1, START_QUAD, vec3_make(0.36f, 0.48f, 0.8f), 7);
    start_init(&s, START_FACES, &flat_box, 1, &scene_bounds, vec3_make(0.6f, 0.0f, 0.8f));
    assert_false(start_sample(&s, (const double[2]){ 0.3, 0.7 }, &o, &density));
    assert_true(density == 0.0);
    /* a plane that is all there is */
    start_init(&s, START_FACES, &flat_box, 1, &flat_box, vec3_make(0.36f, -0.48f, 0.8f));
    assert_true(start_sample(&s, (const double[2]){ 0.3, 0.7 }, &o, &density));
    assert_true(o.y > 1.0f && o.y < 1.001f && fabs(density * 9.0 * 0.48 - 1.0) < 1e-6);
}

static void every_line_that_meets_a_box_can_be_drawn(void **state)
{
    struct rng r = { 11 };
    (void)state;
    for (uint32_t k = 0; k < 300; k++) {
        const struct vec3 d = direction(k, &r);
        for (int kind = START_FACES; kind <= START_DISC; kind++) {
            struct start s;
            start_init(&s, (enum start_kind)kind, three_boxes, 3, &scene_bounds, d);
            for (int i = 0; i < 60; i++) {
                const struct box *b = &three_boxes[i % 3];
                const double x[3] = { rng_next(&r), rng_next(&r), rng_next(&r) };
                const double p[3] = { b->low.x + x[0] * (b->high.x - b->low.x),
                                      b->low.y + x[1] * (b->high.y - b->low.y),
                                      b->low.z + x[2] * (b->high.z - b->low.z) };
                if (i % 3 < 2 || d.y != 0.0f) /* the flat one has no silhouette from its side */
                    assert_true(density_at(&s, p) > 0.0);
            }
        }
    }
}

/* A density that is sampled is the one that is told for the line, and the start is outside of everything. */
static void starts_are_before_the_scene(void **state)
{
    const struct box wide = { { -1000.0f, 0.0f, -1000.0f }, { 1000.0f, 3.0f, 1000.0f } };
    const struct box low = { { 3.0f, 1.4f, 5.0f }, { 4.0f, 1.6f, 5.5f } };
    struct rng r = { 8 };
    (void)state;
    for (uint32_t k = 0; k < 3000; k++) {
        const double x[2] = { rng_next(&r), rng_next(&r) };
        const struct vec3 d = direction(k, &r);
        struct start s;
        struct vec3 o;
        double density;
        start_init(&s, START_FACES, &low, 1, &wide, d);
        if (!start_sample(&s, x, &o, &density))
            continue;
        assert_true(o.x < wide.low.x || o.x > wide.high.x || o.y < wide.low.y || o.y > wide.high.y ||
                    o.z < wide.low.z || o.z > wide.high.z);
        const float to_box[3] = { 3.5f - o.x, 1.5f - o.y, 5.25f - o.z };
        assert_true(to_box[0] * d.x + to_box[1] * d.y + to_box[2] * d.z > 0.0f);
        assert_true(fabs(density_at(&s, (const double[3]){ 3.5, 1.5, 5.25 }) - density) <= 1e-9 * density);
    }
}

static void any_number_of_boxes_is_joined_into_few_that_hold_them(void **state)
{
    enum { MANY = 300 };
    static struct box boxes[MANY], before[MANY];
    struct rng r = { 9 };
    (void)state;
    for (int i = 0; i < MANY; i++) {
        const float x = 5.0f * (float)(i % 3), y = (float)rng_next(&r), z = (float)rng_next(&r);
        before[i] = boxes[i] = (struct box){ { x, y, z }, { x + 0.1f, y + 0.1f, z } };
    }
    assert_int_equal(start_join(boxes, 5), 5);
    assert_memory_equal(boxes, before, sizeof(boxes));
    const uint32_t count = start_join(boxes, MANY);
    assert_int_equal(count, START_BOXES_MAX);
    for (int i = 0; i < MANY; i++) {
        uint32_t holders = 0;
        for (uint32_t k = 0; k < count; k++) {
            const struct box *b = &boxes[k], *m = &before[i];
            holders += b->low.x <= m->low.x && b->low.y <= m->low.y && b->low.z <= m->low.z && b->high.x >= m->high.x &&
                       b->high.y >= m->high.y && b->high.z >= m->high.z;
            assert_true(b->high.x - b->low.x < 1.0f); /* never across the gaps of 5 m */
        }
        assert_true(holders >= 1);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(projected_areas_are_those_of_closed_forms),
    cmocka_unit_test(quad_is_the_smallest_of_all_angles),
    cmocka_unit_test(lines_are_drawn_evenly_over_the_silhouette),
    cmocka_unit_test(a_mixture_has_the_density_that_it_says),
    cmocka_unit_test(a_flat_box_is_drawn_from_and_not_along_its_plane),
    cmocka_unit_test(every_line_that_meets_a_box_can_be_drawn),
    cmocka_unit_test(starts_are_before_the_scene),
    cmocka_unit_test(any_number_of_boxes_is_joined_into_few_that_hold_them),
};
UNIT_MAIN(tests)
