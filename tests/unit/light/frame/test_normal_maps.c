/* Energy below normal maps.
 *
 * A flat white card in an open, even sky of 1 has a radiance of 1 whatever its map does: a tilt of its normal by t
 * hides (1 - cos t) / 2 of the light from it, which the gain of its matte part returns (scatter.h). The sky's part
 * below the card never lights it, however much the normal turns there. */
#include "light/estimators/courts.h"
#include "light/estimators/points.h"

#include "light/estimators/direct.h"
#include "scene/geometry/scatter_hit.h"
#include "scene/geometry/scene_build.h"
#include "scene/surface/lobe.h"

enum { SEEDS = 8, SIDE = 16 };

#define Z_MAX 4.5

/* A card that fills the image, whose normals all lean by `tilt` towards +x. */
static struct scene *leaning(struct material m, double tilt)
{
    static const float corners[4][3] = { { -1, -1, 0 }, { 1, -1, 0 }, { 1, 1, 0 }, { -1, 1, 0 } };
    static const float uvs[8] = { 0, 0, 1, 0, 1, 1, 0, 1 };
    static const uint32_t two[6] = { 0, 1, 2, 0, 2, 3 };
    struct scene *s = scene_from(vec3_make(0, 0, 1), vec3_make(0, 0, 0), 1.0f);
    struct texture *t = mem_alloc(1, sizeof(*t));

    assert_int_equal(texture_init(t, SIDE, SIDE, TEXTURE_LINEAR), ERR_OK);
    for (uint32_t i = 0; i < SIDE * SIDE; i++)
        memcpy(t->texels + 4 * (size_t)i, (uint8_t[]){ 255, 128, 255, 255 }, 4);
    texture_build_levels(t);
    s->textures = t;
    s->texture_count = 1;
    m.maps = MAP_NORMAL;
    m.normal_scale = (float)tan(tilt);
    struct mesh *card = add_mesh(s, m, 4, 2);
    card->uvs = mem_alloc(8, sizeof(float));
    memcpy(card->positions, corners, sizeof(corners));
    memcpy(card->uvs, uvs, sizeof(uvs));
    memcpy(card->indices, two, sizeof(two));
    assert_int_equal(mesh_make_tangents(card, false), ERR_OK);
    s->low = vec3_make(-1, -1, 0);
    s->high = vec3_make(1, 1, 0);
    return s;
}

static double mean_of(const struct lit *x)
{
    double sum = 0.0, count = 0.0;

    for (uint32_t i = 0; i < x->gbuffer->packet_count; i++)
        for (uint32_t l = 0; l < x->gbuffer->packets[i].count; l++) {
            sum += (double)x->lo[((size_t)i * 3 + 1) * PACKET + l];
            count++;
        }
    return sum / count;
}

/* By one method, whose error is asserted to be below half a percent. */
static void assert_mean(const struct lit *x, const struct environment *e, enum method method, double want)
{
    struct direct *d = direct_create(best_kernels());
    struct tally tally = { 0 };

    for (uint64_t seed = 0; seed < SEEDS; seed++) {
        const struct direct_desc desc = { .method = method, .samples = 1024, .seed = seed };
        struct direct_stats stats;
        assert_int_equal(direct_shade(d, x->gbuffer, x->rays, e, &desc, x->lo, &stats), ERR_OK);
        tally_add(&tally, mean_of(x));
    }
    check_mean(method_name(method), &tally, want, Z_MAX, 5e-3);
    direct_destroy(d);
}

static void a_white_card_stays_white(void **state)
{
    static const enum method methods[] = { METHOD_UNIFORM, METHOD_BRDF, METHOD_LIGHT, METHOD_FACES, METHOD_MIS };
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);

    (void)state;
    for (double tilt = 0.2; tilt < 1.3; tilt += 0.5) {
        struct lit x = lit_create(leaning(lambert(1.0f), tilt), 8, 8);
        for (size_t i = 0; i < sizeof(methods) / sizeof(methods[0]); i++)
            assert_mean(&x, e, methods[i], 1.0);
        lit_destroy(&x);
    }
    environment_destroy(e);
}

/* Light from below the card, which a normal that leans by 60 degrees would see. The sky is 1 below z = 0. */
static void light_from_behind_does_not_count(void **state)
{
    struct lit x = lit_create(leaning(lambert(1.0f), 1.05), 8, 8);
    const struct shade_packet *p = &x.gbuffer->packets[0];
    const struct lobe lobe = lobe_of_lane(p, 0);
    double brdf[3];

    (void)state;
    assert_float_equal(p->ns_x[0], sin(1.05), 5e-3);
    lobe_evaluate(&lobe, vec3_make(0, 0, 1), vec3_normalize(vec3_make(1, 0, -0.1f)), brdf);
    assert_true(brdf[0] == 0.0);
    lobe_evaluate(&lobe, vec3_make(0, 0, 1), vec3_normalize(vec3_make(1, 0, 0.1f)), brdf);
    assert_true(brdf[0] > 0.0);
    lit_destroy(&x);
}

/* The albedo of a lobe seen from wo, by the midpoint rule. */
static double albedo_of(const struct lobe *l, struct vec3 wo)
{
    enum { ROWS = 300, COLUMNS = 300 };
    double sum = 0.0;

    for (int i = 0; i < ROWS; i++)
        for (int j = 0; j < COLUMNS; j++) {
            const double z = (i + 0.5) / ROWS, phi = 2.0 * PI * (j + 0.5) / COLUMNS, r = sqrt(1.0 - z * z);
            const struct vec3 wi = frame_direction(l->shading, r * cos(phi), r * sin(phi), z);
            double brdf[3];
            lobe_evaluate(l, wo, wi, brdf);
            sum += brdf[1] * z;
        }
    return sum * 2.0 * PI / (ROWS * COLUMNS);
}

/* White dielectrics and metals lose some of their highlight, and never reflect more than there is. */
static void no_lobe_reflects_more_than_it_receives(void **state)
{
    double least = 1.0, most = 0.0;

    (void)state;
    for (int metal = 0; metal < 2; metal++)
        for (float roughness = 0.4f; roughness < 1.01f; roughness += 0.3f)
            for (double tilt = 0.0; tilt < 1.3; tilt += 0.2) {
                const struct material m = {
                    .kind = MATERIAL_GGX, .diffuse = { 1, 1, 1 }, .metallic = (float)metal, .roughness = roughness
                };
                struct lit x = lit_create(leaning(m, tilt), 8, 8);
                const struct lobe lobe = lobe_of_lane(&x.gbuffer->packets[0], 0);
                for (double from = -1.4; from < 1.5; from += 0.4) {
                    const double a = albedo_of(&lobe, vec3_make((float)sin(from), 0, (float)cos(from)));
                    most = fmax(most, a);
                    least = fmin(least, metal ? 1.0 : a);
                }
                lit_destroy(&x);
            }
    printf("albedo of a dielectric at least %.4f, of any at most %.4f\n", least, most);
    assert_true(most < 1.002);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_white_card_stays_white),
    cmocka_unit_test(light_from_behind_does_not_count),
    cmocka_unit_test(no_lobe_reflects_more_than_it_receives),
};
UNIT_MAIN(tests)
