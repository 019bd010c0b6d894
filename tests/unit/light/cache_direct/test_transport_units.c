/* Directions that need not be traced, since all about them agree. */
#include "light/cache_direct/internal.h"
#include "light/estimators/points.h"
#include "light/frame/relight.h"
#include "support/sets.h"

/* Units' own directions lie as near as those of neighbours do, and who is a neighbour has one: cells and chunks, across
 * edges of faces too. */
static void units_have_eight_neighbours(void **state)
{
    struct transport_directions d;
    (void)state;

    for (uint32_t edge = 1; edge <= 2; edge++) {
        const float size = edge == 1 ? 0.125f : 0.5f; /* a unit's, where it is largest */
        assert_int_equal(transport_directions_init(&d, 3 - edge, edge, 5), ERR_OK);
        assert_int_equal(d.units, edge == 1 ? SKY_CELLS : SKY_CHUNKS);
        for (uint32_t u = 0; u < d.units; u++)
            for (int k = 0; k < 8; k++) {
                const uint32_t v = d.around[u][k], a = u * TRANSPORT_UNIT, b = v * TRANSPORT_UNIT;
                bool back = u == v;
                assert_true(v < d.units);
                for (int i = 0; i < 8; i++)
                    back |= d.around[v][i] == u;
                const float x = d.x[a] - d.x[b], y = d.y[a] - d.y[b], z = d.z[a] - d.z[b];
                assert_true(sqrtf(x * x + y * y + z * z) < 3.0f * size);
                assert_true(back || k == 0 || k == 2 || k == 5 || k == 7); /* not over the corners of faces */
            }
        transport_directions_finish(&d);
    }
    assert_int_equal(transport_directions_init(&d, 4, 1, 5), ERR_OK);
    assert_int_equal(d.units, 0);
    transport_directions_finish(&d);
}

struct traced {
    struct transport_matrix *rows;
    struct transport_sight sight;
    uint64_t rays;
};

/* Of up to four packets of one kind, each with as many columns. */
static void trace(const struct transport_world *w, const struct shade_packet *p, uint32_t count,
                  const struct transport_neighbours *neighbours, struct traced *out)
{
    const struct transport_kernels *k = transport_kernels_of(best_kernels());

    memset(&out->sight, 0, sizeof(out->sight));
    out->rays += k->trace(w, p, count, TRANSPORT_ROWS, neighbours, out->rows, &out->sight);
}

static uint32_t alike(const struct gbuffer *g, uint32_t first)
{
    uint32_t count = 1;

    while (count < TRANSPORT_PACKETS && first + count < g->packet_count &&
           g->packets[first + count].kind == g->packets[first].kind)
        count++;
    return count;
}

static void compare(const struct traced *all, const struct traced *few, uint32_t points, double whole[2],
                    double squares[2])
{
    for (uint32_t c = 0; c < SKY_CELLS; c++)
        for (uint32_t p = 0; p < points; p++) {
            const double x = (double)all->rows[0].at[c][p], y = (double)few->rows[0].at[c][p];
            whole[0] += x;
            whole[1] += y;
            squares[0] += x * x;
            squares[1] += (x - y) * (x - y);
        }
}

/* Who has a whole block's packets, its points by turns; `none`: nobody is a neighbour. */
static const struct transport_neighbours *neighbours_of(const struct shade_packet *p, uint32_t count, bool none,
                                                        struct transport_neighbours *out)
{
    if (count < TRANSPORT_PACKETS)
        return NULL;
    transport_find_neighbours(p, out);
    out->alone = none ? UINT64_MAX : out->alone;
    return out;
}

struct bounds {
    double rays, light, error;
};

/* The court's points, by all directions and by those about which there is doubt: within `light` of the light of an
 * even sky, and with at most `rays` of the rays and the `error` in the root of the mean square over cells. */
static void missed(bool blocks, bool none, const struct bounds *most)
{
    const struct prepared_scene_desc desc = { .width = 128, .height = 72, .edge_rays = 1 };
    struct transport_neighbours *neighbours = mem_alloc(1, sizeof(*neighbours));
    struct transport_directions few, all;
    struct traced a = { .rows = mem_alloc(TRANSPORT_ROWS, sizeof(*a.rows)) },
                  b = { .rows = mem_alloc(TRANSPORT_ROWS, sizeof(*b.rows)) };
    double whole[2] = { 0.0 }, squares[2] = { 0.0 };
    struct prepared_scene *set = set_of(&desc);

    assert_int_equal(transport_directions_init(&few, 2, 1, 9), ERR_OK);
    all = few;
    all.units = 0;
    for (uint32_t i = 0, count; i < set->gbuffer->packet_count; i += count) {
        const struct shade_packet *p = &set->gbuffer->packets[i];
        count = blocks ? alike(set->gbuffer, i) : 1;
        trace(&(struct transport_world){ .rays = set->rays, .directions = &all }, p, count, NULL, &a);
        trace(&(struct transport_world){ .rays = set->rays, .directions = &few }, p, count,
              neighbours_of(p, count, none, neighbours), &b);
        compare(&a, &b, count * PACKET, whole, squares);
    }
    printf("rays %.3f, light %.6f, error %.2e\n", (double)b.rays / (double)a.rays, whole[1] / whole[0],
           sqrt(squares[1] / squares[0]));
    assert_true((double)b.rays < most->rays * (double)a.rays);
    assert_true(fabs(whole[1] / whole[0] - 1.0) < most->light);
    assert_true(squares[1] < most->error * most->error * squares[0]);
    transport_directions_finish(&few);
    mem_free(neighbours);
    mem_free(a.rows);
    mem_free(b.rows);
    set_destroy(set);
}

/* Measured 0.59 and 3.5e-3. */
static void what_is_not_traced_is_not_missed(void **state)
{
    (void)state;
    missed(false, true, &(struct bounds){ 0.65, 1e-3, 5e-3 });
}

/* Measured 0.54 and 1.0e-2. */
static void what_a_block_knows_is_not_missed(void **state)
{
    (void)state;
    missed(true, true, &(struct bounds){ 0.58, 1e-3, 1.3e-2 });
}

/* Measured 0.46 and 7.6e-2, mostly the coarseness of four directions; if no point is found odd, 0.26 and 0.17. */
static void what_neighbours_say_is_nearly_what_is_seen(void **state)
{
    (void)state;
    missed(true, false, &(struct bounds){ 0.5, 1e-3, 9e-2 });
}

/* A block's points on a slope, 8 x 8 and a bit out of line. */
static void set_slope(struct shade_packet packets[TRANSPORT_PACKETS])
{
    memset(packets, 0, TRANSPORT_PACKETS * sizeof(*packets));
    for (uint32_t i = 0; i < TRANSPORT_POINTS; i++) {
        struct shade_packet *p = &packets[i / PACKET];
        const uint32_t l = i % PACKET, x = i / PACKET % 2 * 4 + l % 4, y = i / PACKET / 2 * 4 + l / 4;
        p->count = PACKET;
        p->valid[l] = -1;
        p->x[l] = (float)x + 0.2f * sinf((float)i);
        p->z[l] = (float)y + 0.2f * cosf((float)(3 * i));
        p->y[l] = 0.75f * p->x[l];
        p->ns_x[l] = -0.6f;
        p->ns_y[l] = 0.8f;
    }
}

/* What grows evenly over a surface is found at each of its points from each turn's, also from the others' alone. */
static void neighbours_know_what_grows_evenly(void **state)
{
    struct transport_neighbours *n = mem_alloc(1, sizeof(*n));
    struct shade_packet packets[TRANSPORT_PACKETS];
    (void)state;

    set_slope(packets);
    transport_find_neighbours(packets, n);
    assert_true(n->alone == 0);
    for (uint32_t p = 0; p < TRANSPORT_POINTS; p++) {
        const float is = 3.0f + packets[p / PACKET].x[p % PACKET] - 2.0f * packets[p / PACKET].z[p % PACKET];
        float others = 0.0f;
        for (uint32_t turn = 0; turn < TRANSPORT_PACKETS; turn++) {
            float told = 0.0f;
            for (uint32_t l = 0; l < PACKET; l++) {
                const struct shade_packet *q = &packets[transport_turn_point(turn, l) / PACKET];
                told += n->plane[turn][l][p] * (3.0f + q->x[l] - 2.0f * q->z[l]);
                if (transport_turn_point(turn, p % PACKET) == p)
                    others += n->others[p][l] * (3.0f + q->x[l] - 2.0f * q->z[l]);
            }
            assert_float_equal(told, is, 0.05);
        }
        assert_float_equal(others, is, 0.05);
        assert_true(n->others[p][p % PACKET] == 0.0f);
    }
    mem_free(n);
}

/* Points that face elsewhere, or lie on another level, are no neighbours. */
static void other_surfaces_are_no_neighbours(void **state)
{
    struct transport_neighbours *n = mem_alloc(1, sizeof(*n));
    struct shade_packet packets[TRANSPORT_PACKETS];
    (void)state;

    set_slope(packets);
    packets[0].ns_x[5] = 0.6f; /* faces elsewhere */
    packets[3].y[9] += 5.0f;   /* lies above */
    transport_find_neighbours(packets, n);
    assert_true(n->alone == (UINT64_C(1) << 5 | UINT64_C(1) << (3 * PACKET + 9)));
    for (uint32_t turn = 0; turn < TRANSPORT_PACKETS; turn++)
        for (uint32_t p = 0; p < TRANSPORT_POINTS; p++) {
            assert_true(p == 5 || transport_turn_point(turn, 5) != 5 || n->plane[turn][5][p] == 0.0f);
            assert_true(p == 3 * PACKET + 9 || transport_turn_point(turn, 9) != 3 * PACKET + 9 ||
                        n->plane[turn][9][p] == 0.0f);
        }
    mem_free(n);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(units_have_eight_neighbours),       cmocka_unit_test(what_is_not_traced_is_not_missed),
    cmocka_unit_test(what_a_block_knows_is_not_missed),  cmocka_unit_test(what_neighbours_say_is_nearly_what_is_seen),
    cmocka_unit_test(neighbours_know_what_grows_evenly), cmocka_unit_test(other_surfaces_are_no_neighbours),
};
UNIT_MAIN(tests)
