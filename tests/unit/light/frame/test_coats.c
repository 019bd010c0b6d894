/* Clear coats and sheen: what they and the surfaces below reflect, by quadrature, and under every estimator.
 *
 * The scene of the estimators is a court seen from above: a floor with a rough coat, which the camera sees alone, and
 * around it walls with coats as smooth as mirrors, over a matte and over a sharp metal surface, which cast caustics. */
#include "light/frame/agreement.h"

#include "light/cache_direct/transports.h"
#include "light/cache_indirect/indirect.h"
#include "light/estimators/courts.h"
#include "scene/geometry/scatter_hit.h"
#include "scene/surface/lobe.h"
#include "scene/surface/scatter.h"

enum { WIDTH = 24, HEIGHT = 18 };

static struct material coated(float metallic, float roughness, float coat, float coat_roughness)
{
    return (struct material){ .kind = MATERIAL_GGX,
                              .diffuse = { 0.8f, 0.7f, 0.6f },
                              .metallic = metallic,
                              .roughness = roughness,
                              .coat = coat,
                              .coat_roughness = coat_roughness };
}

static struct scene *court(struct material floor)
{
    struct scene *s = scene_from(vec3_make(0, 2.5f, 0.01f), vec3_make(0, 0, 0), 0.47f);

    add_box(s, floor, vec3_make(-1, -0.2f, -1), vec3_make(1, 0, 1));
    add_box(s, coated(0, 0.8f, 1.0f, 0.0f), vec3_make(1, 0, -1), vec3_make(1.1f, 1, 1));
    add_box(s, coated(1, 0.0f, 0.6f, 0.0f), vec3_make(-1.1f, 0, -1), vec3_make(-1, 1, 1));
    add_box(s, coated(0.5f, 0.6f, 0.9f, 0.4f), vec3_make(-1, 0, -1.1f), vec3_make(1, 1, -1));
    s->low = vec3_make(-1.1f, -0.2f, -1.1f);
    s->high = vec3_make(1.1f, 1, 1);
    return s;
}

/* Brighter towards a part of the sky. */
static struct environment *sky(void)
{
    struct frame f = sky_constant(32, 16, 1.0f);

    for (uint32_t x = 3; x < 9; x++)
        for (uint32_t y = 3; y < 6; y++)
            sky_paint(&f, x, y, 12.0f, 10.0f, 8.0f);
    return sky_environment(f, 32, 0.0);
}

static struct world world_of(struct scene *s)
{
    struct world w = { .scene = s, .direct = direct_create(best_kernels()) };

    omp_set_num_threads(1);
    w.environment = sky();
    world_look(&w, WIDTH, HEIGHT);
    return w;
}

/* Each technique agrees with the first of its class by agreement.h; counts make joint errors about two
 * thirds of what is allowed. */
static void assert_agreement(struct scene *s, const struct technique *of, size_t count)
{
    struct world w = world_of(s);
    struct estimate first = { { 0.0 }, { 0.0 } };
    uint32_t class = 0;

    for (size_t i = 0; i < count; i++) {
        const struct estimate got = measure(&w, &of[i]);
        const uint32_t own = of[i].who == BY_DIRECT ? PATH_DIRECT : of[i].classes;
        printf("%s, %u: %.6f +- %.6f\n", of[i].name, own, got.mean[0], got.error[0]);
        if (own != class) {
            first = got;
            class = own;
            assert_true(got.mean[0] > 1e-4);
            continue;
        }
        assert_agree(of[i].name, &got, &first, of[i].worst, of[i].allowed);
    }
    world_finish(&w);
}

static void estimators_agree_on_coats(void **state)
{
    static const struct technique of[] = {
        { "path", BY_PATH, PATH_DIRECT, .count = 512 },
        { "brdf", BY_DIRECT, .count = 512, .direct = { .method = METHOD_BRDF }, .worst = 2e-3 },
        { "mis", BY_DIRECT, .count = 1024, .direct = { .method = METHOD_MIS }, .worst = 3e-3 },
        { "faces", BY_DIRECT, .count = 1024, .direct = { .method = METHOD_FACES }, .worst = 3e-3 },
        { "path", BY_PATH, PATH_INDIRECT_LIT, .count = 128 },
        { "eye paths", BY_EYE, PATH_INDIRECT_LIT, .count = 128, .worst = 8e-3 },
        { "light tracer", BY_LIGHT, PATH_INDIRECT_LIT, .count = 400000, .worst = 1e-2 },
        { "mlt", BY_MLT, PATH_INDIRECT_LIT, .count = 128, .worst = 8e-3 },
    };

    (void)state;
    assert_agreement(court(coated(0, 0.5f, 0.8f, 0.3f)), of, sizeof(of) / sizeof(of[0]));
}

static void estimators_agree_on_the_caustics_of_coats(void **state)
{
    static const struct technique of[] = {
        { "path", BY_PATH, PATH_CAUSTICS, .count = 256 },
        { "eye paths", BY_EYE, PATH_CAUSTICS, .count = 256, .worst = 5e-3 },
        { "light tracer", BY_LIGHT, PATH_CAUSTICS, .count = 200000, .worst = 5e-3 },
        { "stored", BY_STORED, PATH_CAUSTICS, .count = 200000, .worst = 1e-2 },
        { "light tracer", BY_LIGHT, PATH_INDIRECT_CAUSTIC, .count = 200000 },
        { "path", BY_PATH, PATH_INDIRECT_CAUSTIC, .count = 256, .worst = 2e-2 },
        { "eye paths", BY_EYE, PATH_INDIRECT_CAUSTIC, .count = 320, .worst = 3e-2 },
    };

    (void)state;
    assert_agreement(court(coated(0, 0.5f, 0.8f, 0.3f)), of, sizeof(of) / sizeof(of[0]));
}

/* The mean of the pixels. */
static double mean_of_pixels(const struct lit *x)
{
    const struct gbuffer *g = x->gbuffer;
    double sum = 0.0;

    for (uint32_t i = 0; i < g->entry_first[WIDTH * HEIGHT]; i++)
        for (int c = 0; c < 3; c++) {
            static const double luminance[3] = { 0.2126, 0.7152, 0.0722 };
            const uint32_t at = g->entries[i].point;
            sum += luminance[c] * (double)g->entries[i].weight[c] *
                   (double)x->lo[((size_t)(at / PACKET) * 3 + (size_t)c) * PACKET + at % PACKET];
        }
    return sum / (WIDTH * HEIGHT);
}

/* Both caches, whose rays are drawn once, against the reference. The caustics of the walls belong to no cache. */
static void assert_caches_agree(struct material floor)
{
    struct world w = world_of(court(floor));
    struct lit x = lit_create(court(floor), WIDTH, HEIGHT);
    struct environment *e = sky();
    struct transport *t = transport_of(x.gbuffer, x.rays, &(struct transport_desc){ .per_cell = 1 });
    const struct indirect_desc desc = { .scene = x.scene,
                                        .rays = x.rays,
                                        .gbuffer = x.gbuffer,
                                        .direct = t,
                                        .eye = x.scene->cameras[0].position,
                                        .records = 3000 };
    const struct technique direct = { "path", BY_PATH, PATH_DIRECT, .count = 512 },
                           indirect = { "path", BY_PATH, PATH_INDIRECT_LIT, .count = 512 };
    const double want = measure(&w, &direct).mean[0], want_later = measure(&w, &indirect).mean[0];
    struct transport_frame_stats stats;
    struct indirect_cache *b;
    struct reason why;

    clear(&x);
    assert_int_equal(transport_shade(t, e, &(struct transport_frame){ .end = 0 }, x.lo, &stats), ERR_OK);
    const double got = mean_of_pixels(&x);
    assert_int_equal(indirect_create(&desc, best_kernels(), &b, &why), ERR_OK);
    clear(&x);
    add_indirect_alone(indirect_of_frame(b), x.gbuffer, e, x.lo);
    const double got_later = mean_of_pixels(&x);
    printf("transport %.5f, want %.5f; bounce %.5f, want %.5f\n", got, want, got_later, want_later);
    assert_true(fabs(got / want - 1.0) < 0.02);
    assert_true(fabs(got_later / want_later - 1.0) < 0.03);
    indirect_destroy(b);
    transport_destroy(t);
    environment_destroy(e);
    lit_destroy(&x);
    world_finish(&w);
}

static void caches_agree_on_coats(void **state)
{
    (void)state;
    assert_caches_agree(coated(0, 0.5f, 0.8f, 0.3f));
}

/* What the lobe's microfacets reflect of an even sky to wo. The integral is over half vectors, whose density divides
 * out of the integrand: a grid of directions misses most of a sharp lobe at grazing angles. */
static double albedo_of_facets(struct lobe l, struct vec3 wo)
{
    enum { RINGS = 200, SPOKES = 64 };
    const double a = l.gloss;
    double sum = 0.0;

    l.diffuse = vec3_make(0, 0, 0);
    for (int i = 0; i < RINGS && a > 0.0; i++) {
        const double u = (i + 0.5) / RINGS, tangent = a * sqrt(u / (1.0 - u)), z = 1.0 / sqrt(1.0 + tangent * tangent);
        const double q = a * a + tangent * tangent, density = a * a / (PI * z * z * z * q * q); /* D times cosine */
        for (int k = 0; k < SPOKES; k++) {
            const double phi = 2.0 * PI * (k + 0.5) / SPOKES, r = z * tangent;
            const struct vec3 h = frame_direction(l.shading, r * cos(phi), r * sin(phi), z);
            const double facing = vec3_dot_double(wo, h);
            const struct vec3 wi = vec3_sub(vec3_scale(h, 2.0f * (float)facing), wo);
            double brdf[3];
            if (facing <= 0.0)
                continue;
            lobe_evaluate(&l, wo, wi, brdf);
            sum += brdf[0] * vec3_dot_double(l.shading, wi) * 4.0 * facing / density;
        }
    }
    return sum / (RINGS * SPOKES);
}

/* Of the matte part, which is what the lobe loses without it. */
static double albedo_of_matte(const struct lobe *l, struct vec3 wo)
{
    enum { RINGS = 500, SPOKES = 4 };
    struct lobe bare = *l;
    double sum = 0.0;

    bare.diffuse = vec3_make(0, 0, 0);
    for (int i = 0; i < RINGS; i++) {
        const double z2 = (i + 0.5) / RINGS, r = sqrt(1.0 - z2);
        for (int k = 0; k < SPOKES; k++) {
            const double phi = 2.0 * PI * (k + 0.25) / SPOKES;
            const struct vec3 wi = frame_direction(l->shading, r * cos(phi), r * sin(phi), sqrt(z2));
            double with[3], without[3];
            lobe_evaluate(l, wo, wi, with);
            lobe_evaluate(&bare, wo, wi, without);
            sum += PI * (with[0] - without[0]);
        }
    }
    return sum / (RINGS * SPOKES);
}

/* The share of an even sky's light that a layer sends to wo. */
static double albedo_of(const struct scatter *at, struct vec3 wo)
{
    const struct lobe l = lobe_of(at);
    struct delta_ray out[2];
    double sum = at->rough ? albedo_of_facets(l, wo) + albedo_of_matte(&l, wo) : 0.0;

    const uint32_t count = scatter_eye(at, vec3_scale(wo, -1.0f), out);
    for (uint32_t i = 0; i < count; i++)
        sum += (double)out[i].weight[0];
    return (double)at->weight * sum;
}

/* Of a white surface, both layers. */
static double whole_albedo(struct material m, double cosine, double *of_coat)
{
    static const float q[4][3] = { { -1, 0, -1 }, { -1, 0, 1 }, { 1, 0, 1 }, { 1, 0, -1 } };
    static const uint32_t two[6] = { 0, 1, 2, 0, 2, 3 };
    struct scene *s = scene_from(vec3_make(0, 1, 0), vec3_make(0, 0, 0), 1.0f);
    const struct vec3 wo = vec3_make((float)sqrt(1.0 - cosine * cosine), (float)cosine, 0.0f);
    struct scatter at;
    struct hit h;

    m.diffuse = vec3_make(1, 1, 1);
    struct mesh *mesh = add_mesh(s, m, 4, 2);
    memcpy(mesh->indices, two, sizeof(two));
    memcpy(mesh->positions, q, sizeof(q));
    struct rays *r = rays_create_for(s, cpu_best());
    assert_true(rays_intersect(r, wo, vec3_scale(wo, -1.0f), 0.0f, &h));
    rays_surface(r, &h, wo, &at.surface);
    scatter_on(s, &h, NULL, &at);
    double below = albedo_of(&at, wo);
    *of_coat = 0.0;
    if (at.veil.sheen > 0.0f) {
        struct scatter sheen = at;
        scatter_sheen(&sheen);
        below += albedo_of(&sheen, wo);
    }
    if (at.veil.coat > 0.0f) {
        scatter_coat(&at);
        *of_coat = albedo_of(&at, wo);
    }
    rays_destroy(r);
    scene_destroy(s);
    return below + *of_coat;
}

/* A white furnace: nothing returns more than it gets. The coat takes nothing either, but what glTF's formula takes of
 * the light at grazing angles under rough coats. */
static void coats_return_no_more_than_they_get(void **state)
{
    static const float roughness[] = { 0.0f, 0.05f, 0.1f, 0.2f, 0.3f, 0.5f, 1.0f }, below[] = { 0.0f, 0.3f, 1.0f };
    double least = 1.0, most = 0.0;

    (void)state;
    for (int i = 0; i < 7; i++)
        for (int k = 0; k < 3; k++)
            for (int metal = 0; metal < 2; metal++)
                for (double cosine = 0.05; cosine < 1.0; cosine += 0.1) {
                    struct material m = coated((float)metal, below[k], 1.0f, roughness[i]);
                    double coat, none;
                    const double whole = whole_albedo(m, cosine, &coat);
                    m.coat = 0.0f;
                    const double bare = whole_albedo(m, cosine, &none);
                    assert_true(whole <= 1.0 + 5e-4 && coat > 0.0);
                    most = fmax(most, whole);
                    if (i < 2 && cosine > 0.2) { /* smooth coats of all but grazing angles */
                        assert_true(whole > bare - 0.01);
                        least = fmin(least, whole - bare);
                    }
                }
    printf("at most %.5f; a smooth coat takes at most %.5f\n", most, -least);
}

static struct material cloth(float metallic, float roughness, float sheen_roughness, float coat)
{
    struct material m = coated(metallic, roughness, coat, 0.3f);

    m.sheen = vec3_make(0.9f, 0.7f, 0.8f);
    m.sheen_roughness = sheen_roughness;
    m.sheen_texture = MATERIAL_NO_TEXTURE;
    return m;
}

/* Lambda of [Estevez and Kulla 2017], by the fit of KHR_materials_sheen. */
static double sheen_slope(double x, double alpha)
{
    static const double a[5] = { 25.3245, 3.32435, 0.16801, -1.27393, -4.85967 },
                        b[5] = { 21.5473, 3.82987, 0.19823, -1.97760, -4.32054 };
    const double t = (1.0 - alpha) * (1.0 - alpha);
    double k[5];

    for (int i = 0; i < 5; i++)
        k[i] = t * a[i] + (1.0 - t) * b[i];
    return k[0] / (1.0 + k[1] * pow(x, k[2])) + k[3] * x + k[4];
}

static double sheen_lambda(double cosine, double alpha)
{
    return exp(cosine < 0.5 ? sheen_slope(cosine, alpha)
                            : 2.0 * sheen_slope(0.5, alpha) - sheen_slope(1.0 - cosine, alpha));
}

/* The table against the integral of D V cos, between its own places. */
static void sheen_reflects_what_its_lobe_does(void **state)
{
    enum { RINGS = 150, SPOKES = 50 };
    double worst[2] = { 0.0, 0.0 }; /* below a roughness of 0.2, where the lobe is sharp, and above */

    (void)state;
    for (double roughness = 0.15; roughness < 1.0; roughness += 0.2)
        for (double c = 0.02; c < 1.0; c += 0.13) {
            const double alpha = roughness * roughness, s = sqrt(1.0 - c * c), own = sheen_lambda(c, alpha);
            double sum = 0.0;
            for (int i = 0; i < RINGS; i++) {
                const double theta = (i + 0.5) / RINGS * 0.5 * PI, z = cos(theta), r = sin(theta);
                const double v = fmin(1.0, 1.0 / ((1.0 + own + sheen_lambda(z, alpha)) * 4.0 * c * z));
                for (int k = 0; k < SPOKES; k++) {
                    const double phi = (k + 0.5) / SPOKES * PI, x = s + r * cos(phi), y = r * sin(phi);
                    const double sine = sqrt((x * x + y * y) / (x * x + y * y + (c + z) * (c + z)));
                    sum += v * z * r * (2.0 + 1.0 / alpha) * pow(sine, 1.0 / alpha);
                }
            }
            const double want = fmin(1.0, sum / SPOKES / RINGS * 0.5 * PI);
            double *most = &worst[roughness > 0.2];
            *most = fmax(*most, fabs((double)sheen_albedo((float)c, (float)roughness) - want));
        }
    printf("off by at most %.4f and %.4f\n", worst[0], worst[1]);
    assert_true(worst[0] < 0.06 && worst[1] < 0.012);
    assert_true(sheen_albedo(0.05f, 0.0f) == sheen_albedo(0.05f, 0.1f));
}

/* Sheen adds what it reflects, and takes as much from below as its largest channel; the red is that of whole_albedo. */
static void sheen_returns_no_more_than_it_gets(void **state)
{
    double most = 0.0, coat, none;

    (void)state;
    for (int k = 0; k < 8; k++)
        for (double cosine = 0.05; cosine < 1.0; cosine += 0.15) {
            const struct material m = cloth((float)(k & 1), k & 2 ? 0.3f : 1.0f, k & 4 ? 0.3f : 0.9f, 0.0f);
            struct material bare = m, both = m;
            bare.sheen = vec3_make(0, 0, 0);
            both.coat = 1.0f;
            const double e = (double)sheen_albedo((float)cosine, m.sheen_roughness);
            const double whole = whole_albedo(m, cosine, &none), below = whole_albedo(bare, cosine, &none);
            assert_float_equal(whole, below * (1.0 - 0.9 * e) + 0.9 * e, 1e-4);
            most = fmax(fmax(most, whole), whole_albedo(both, cosine, &coat));
        }
    printf("at most %.5f\n", most);
    assert_true(most <= 1.0 + 5e-4);
}

static void estimators_agree_on_sheen(void **state)
{
    static const struct technique of[] = {
        { "path", BY_PATH, PATH_DIRECT, .count = 512 },
        { "brdf", BY_DIRECT, .count = 512, .direct = { .method = METHOD_BRDF }, .worst = 2e-3 },
        { "path", BY_PATH, PATH_INDIRECT_LIT, .count = 128 },
        { "eye paths", BY_EYE, PATH_INDIRECT_LIT, .count = 128, .worst = 8e-3 },
        { "light tracer", BY_LIGHT, PATH_INDIRECT_LIT, .count = 400000, .worst = 1e-2 },
        { "mlt", BY_MLT, PATH_INDIRECT_LIT, .count = 128, .worst = 8e-3 },
        { "path", BY_PATH, PATH_CAUSTICS, .count = 256 },
        { "light tracer", BY_LIGHT, PATH_CAUSTICS, .count = 200000, .worst = 5e-3 },
        { "stored", BY_STORED, PATH_CAUSTICS, .count = 200000, .worst = 1e-2 },
    };

    (void)state;
    assert_agreement(court(cloth(0, 0.5f, 0.6f, 0.5f)), of, sizeof(of) / sizeof(of[0]));
}

static void caches_agree_on_sheen(void **state)
{
    (void)state;
    assert_caches_agree(cloth(0, 0.5f, 0.6f, 0.0f));
}

/* Half a coat is half of its light, and half of what it takes from below. */
static void a_coat_may_cover_a_part(void **state)
{
    const struct material whole = coated(0, 0.5f, 1.0f, 0.3f), half = coated(0, 0.5f, 0.5f, 0.3f),
                          bare = coated(0, 0.5f, 0.0f, 0.3f);

    (void)state;
    for (double cosine = 0.1; cosine < 1.0; cosine += 0.2) {
        double a, b, c;
        const double with = whole_albedo(whole, cosine, &a), some = whole_albedo(half, cosine, &b),
                     without = whole_albedo(bare, cosine, &c);
        assert_float_equal(b, 0.5 * a, 1e-6);
        assert_float_equal(some, 0.5 * (with + without), 1e-4);
    }
}

/* The camera sees a point of each layer, or behind a smooth coat what it mirrors; weights by the angle. */
static void the_camera_sees_both_layers(void **state)
{
    (void)state;
    for (int smooth = 0; smooth < 2; smooth++) {
        struct lit x = lit_create(court(coated(0, 0.5f, 0.5f, smooth ? 0.0f : 0.3f)), WIDTH, HEIGHT);
        const struct gbuffer *g = x.gbuffer;
        double base = 0.0, coat = 0.0, missed = 0.0;

        for (uint32_t i = 0; i < g->entry_first[WIDTH * HEIGHT]; i++) {
            const struct gbuffer_entry *e = &g->entries[i];
            const struct shade_packet *p = &g->packets[e->point / PACKET];
            const uint32_t l = e->point % PACKET;
            *(p->layer[l] == LAYER_COAT ? &coat : &base) += (double)e->weight[0];
            assert_true(p->layer[l] == LAYER_BASE || (p->diffuse[0][l] == 0.0f && p->specular[0][l] == COAT_F0 &&
                                                      fabsf(p->gloss[l] - 0.09f) < 1e-6f));
        }
        for (uint32_t i = 0; i < g->miss_first[WIDTH * HEIGHT]; i++)
            missed += (double)g->misses[i].weight[0];
        /* nearly square on: 0.04 of the light, of half of the surface */
        assert_float_equal(base / (WIDTH * HEIGHT), 1.0 - 0.5 * 0.04 * 1.027, 1e-3);
        assert_float_equal(coat / (WIDTH * HEIGHT), smooth ? 0.0 : 0.5, 1e-3);
        assert_float_equal(missed / (WIDTH * HEIGHT), smooth ? 0.5 * 0.04 : 0.0, 1e-3);
        lit_destroy(&x);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(coats_return_no_more_than_they_get),
    cmocka_unit_test(a_coat_may_cover_a_part),
    cmocka_unit_test(the_camera_sees_both_layers),
    cmocka_unit_test(sheen_reflects_what_its_lobe_does),
    cmocka_unit_test(sheen_returns_no_more_than_it_gets),
    cmocka_unit_test(estimators_agree_on_sheen),
    cmocka_unit_test(caches_agree_on_sheen),
    cmocka_unit_test(estimators_agree_on_coats),
    cmocka_unit_test(estimators_agree_on_the_caustics_of_coats),
    cmocka_unit_test(caches_agree_on_coats),
};
UNIT_MAIN(tests)
