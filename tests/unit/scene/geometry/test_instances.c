/* Instances against copies whose vertices this test transforms itself: rays, surfaces, normal maps, masks. */
#include "scene/geometry/files.h"

#include "base/rng.h"
#include "scene/geometry/coverage.h"
#include "scene/geometry/mesh_read.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scatter_hit.h"
#include "scene/geometry/scene_digest.h"
#include "scene/surface/scatter.h"

#include <math.h>

enum { PLACES = 7, SHARDS = 120, RAYS = 4000 };

/* Rows of 3 x 4: as they are; turned; mirrored; stretched, sheared and mirrored; small; large; far away. */
static const float matrices[PLACES][3][4] = {
    { { 1, 0, 0, 0 }, { 0, 1, 0, 0 }, { 0, 0, 1, 0 } },
    { { 0.6f, -0.8f, 0, 3 }, { 0.8f, 0.6f, 0, 0 }, { 0, 0, 1, 0.5f } },
    { { -1, 0, 0, -3 }, { 0, 1, 0, 0 }, { 0, 0, 1, 0 } },
    { { 0.5f, 0.3f, 0, 0 }, { 0, -1.5f, 0.2f, 3 }, { 0.1f, 0, 0.7f, 0 } },
    { { 0.02f, 0, 0, 0 }, { 0, 0, -0.02f, -2 }, { 0, 0.02f, 0, 0 } },
    { { 300, 0, 0, 0 }, { 0, 200, 100, -700 }, { 0, 0, 300, 0 } },
    { { 0.8f, 0, 0.6f, 40000 }, { 0, 1, 0, -30000 }, { -0.6f, 0, 0.8f, 20000 } },
};

static double draw(uint64_t *n)
{
    return (double)(rng_mix(77, (*n)++) >> 11) * 0x1p-53 * 2.0 - 1.0;
}

static float *random_floats(size_t count, uint64_t seed)
{
    uint64_t n = seed << 32;
    float *v = mem_alloc(count + 1, sizeof(*v));

    assert_non_null(v);
    for (size_t i = 0; i < count; i++)
        v[i] = (float)draw(&n);
    return v;
}

static void make_unit(float *v, size_t count, size_t stride)
{
    for (size_t i = 0; i < count; i++, v += stride) {
        const float l = sqrtf(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        for (int k = 0; k < 3; k++)
            v[k] /= l;
        if (stride == 4)
            v[3] = v[3] < 0.0f ? -1.0f : 1.0f;
    }
}

/* Single triangles in a cube of edge 2, with all arrays. */
static struct mesh shards(uint32_t material)
{
    const uint32_t n = 3 * SHARDS;
    struct mesh m = { .vertex_count = n, .triangle_count = SHARDS, .material = material };
    uint64_t k = 5;

    m.positions = random_floats(3 * (size_t)n, 1);
    m.normals = random_floats(3 * (size_t)n, 2);
    m.uvs = random_floats(2 * (size_t)n, 3);
    m.tangents = random_floats(4 * (size_t)n, 4);
    m.colours = random_floats(4 * (size_t)n, 5);
    m.indices = mem_alloc(n, sizeof(uint32_t));
    assert_non_null(m.indices);
    for (uint32_t i = 0; i < n; i++)
        m.indices[i] = i;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t a = 0; a < 3; a++) {
            /* normals near that of the triangle are not needed, but alike ones: their mean must not vanish */
            m.normals[3 * i + a] = (a == 1 ? 1.0f : 0.0f) + 0.4f * m.normals[3 * i + a];
            m.tangents[4 * i + a] = (a == 0 ? 1.0f : 0.0f) + 0.3f * m.tangents[4 * i + a];
            m.positions[3 * i + a] = (float)draw(&k);
        }
    for (uint32_t i = 0; i < 4 * n; i++)
        m.colours[i] = fabsf(m.colours[i]);
    make_unit(m.normals, n, 3);
    make_unit(m.tangents, n, 4);
    for (uint32_t i = 0; i < n; i++) /* one side for each triangle */
        m.tangents[4 * i + 3] = m.tangents[4 * (i - i % 3) + 3];
    return m;
}

/* The same mesh in world space. Normals by the inverse, solved for each. */
static struct mesh copy_at(const struct mesh *m, const float a[3][4])
{
    struct mesh c = shards(m->material);
    const double det = (double)a[0][0] * ((double)a[1][1] * a[2][2] - (double)a[1][2] * a[2][1]) -
                       (double)a[0][1] * ((double)a[1][0] * a[2][2] - (double)a[1][2] * a[2][0]) +
                       (double)a[0][2] * ((double)a[1][0] * a[2][1] - (double)a[1][1] * a[2][0]);

    for (uint32_t i = 0; i < m->vertex_count; i++) {
        const float *n = m->normals + 3 * i, *t = m->tangents + 4 * i;
        for (int r = 0; r < 3; r++) {
            double p = a[r][3], along = 0.0, normal = 0.0;
            for (int k = 0; k < 3; k++) {
                const int r1 = (r + 1) % 3, r2 = (r + 2) % 3, k1 = (k + 1) % 3, k2 = (k + 2) % 3;
                p += (double)a[r][k] * m->positions[3 * i + (uint32_t)k];
                along += (double)a[r][k] * t[k];
                normal += ((double)a[r1][k1] * a[r2][k2] - (double)a[r1][k2] * a[r2][k1]) / det * n[k];
            }
            c.positions[3 * i + (uint32_t)r] = (float)p;
            c.tangents[4 * i + (uint32_t)r] = (float)along;
            c.normals[3 * i + (uint32_t)r] = (float)normal;
        }
        c.tangents[4 * i + 3] = det < 0.0 ? -t[3] : t[3];
    }
    make_unit(c.normals, c.vertex_count, 3);
    make_unit(c.tangents, c.vertex_count, 4);
    for (uint32_t i = 0; det < 0.0 && i < c.triangle_count; i++) { /* hits keep their corners' order: see swapped */
        c.indices[3 * i + 1] = 3 * i + 2;
        c.indices[3 * i + 2] = 3 * i + 1;
    }
    return c;
}

static uint32_t add_stripes(struct scene *s)
{
    struct texture t;
    uint32_t index;

    assert_int_equal(texture_init(&t, 64, 64, TEXTURE_CUTOUT), ERR_OK);
    for (uint32_t i = 0; i < 64 * 64; i++) {
        const uint8_t texel[4] = { (uint8_t)(100 + i % 50), (uint8_t)(90 + i % 64), 220,
                                   (i % 64 + i / 640) % 12 < 7 ? 255 : 0 };
        memcpy(t.texels + 4 * (size_t)i, texel, 4);
    }
    texture_build_levels(&t);
    assert_int_equal(scene_add_texture(s, &t, &index), ERR_OK);
    return index;
}

static uint32_t add_surface(struct scene *s, enum alpha_mode mode)
{
    const struct material m = { .diffuse = { 0.5f, 0.5f, 0.5f },
                                .texture = MATERIAL_NO_TEXTURE,
                                .emission_texture = MATERIAL_NO_TEXTURE,
                                .alpha_mode = mode,
                                .alpha = 0.6f,
                                .alpha_cutoff = 0.3f,
                                .alpha_texture = mode == ALPHA_BLEND ? MATERIAL_NO_TEXTURE : add_stripes(s),
                                .maps = MAP_NORMAL,
                                .normal_scale = 1.0f };
    uint32_t index = 0;

    assert_int_equal(scene_add_material(s, &m, &index), ERR_OK);
    return index;
}

static struct scene *scene_of(enum alpha_mode mode, bool instances)
{
    struct scene *s = scene_create();

    assert_non_null(s);
    const uint32_t material = add_surface(s, mode);
    struct mesh m = shards(material);
    for (uint32_t i = 0; i < PLACES && !instances; i++) {
        const struct mesh c = copy_at(&m, matrices[i]);
        assert_int_equal(scene_add_mesh(s, &c), ERR_OK);
    }
    if (instances) {
        assert_int_equal(mesh_place(&m, matrices[0]), ERR_OK);
        assert_int_equal(scene_add_mesh(s, &m), ERR_OK);
        for (uint32_t i = 1; i < PLACES; i++) /* of an instance, too */
            assert_int_equal(scene_add_instance(s, i - 1, "", matrices[i]), ERR_OK);
        assert_ptr_equal(s->meshes[PLACES - 1].positions, s->meshes[0].positions);
    } else {
        mesh_finish(&m);
    }
    assert_int_equal(scene_finish(s, "shards", NULL), ERR_OK);
    return s;
}

/* From around a place to within it, or of a packet's lane. */
static void random_ray(uint64_t i, struct vec3 *from, struct vec3 *dir)
{
    const float(*a)[4] = matrices[i % PLACES];
    uint64_t n = i * 16;
    float p[2][3], w[2][3];

    for (int k = 0; k < 3; k++) {
        p[0][k] = (float)(4.0 * draw(&n));
        p[1][k] = (float)(0.8 * draw(&n));
    }
    for (int e = 0; e < 2; e++)
        for (int r = 0; r < 3; r++)
            w[e][r] = a[r][0] * p[e][0] + a[r][1] * p[e][1] + a[r][2] * p[e][2] + a[r][3];
    *from = vec3_make(w[0][0], w[0][1], w[0][2]);
    *dir = vec3_normalize(vec3_sub(vec3_make(w[1][0], w[1][1], w[1][2]), *from));
}

static double distance(struct vec3 a, struct vec3 b)
{
    const struct vec3 d = vec3_sub(a, b);
    return sqrt(vec3_dot_double(d, d));
}

static bool is_mirrored(uint32_t mesh)
{
    return mesh == 2 || mesh == 3;
}

static void assert_same_surface(const struct scene *s, const struct surface *a, const struct surface *b, double scale)
{
    assert_true(distance(a->position, b->position) < 1e-4 * scale);
    assert_true(distance(a->geometric, b->geometric) < 1e-3);
    assert_true(distance(a->shading, b->shading) < 1e-3);
    assert_true(distance(a->colour, b->colour) < 1e-3);
    assert_int_equal(a->outside, b->outside);
    assert_true(fabsf(a->uv[0] - b->uv[0]) + fabsf(a->uv[1] - b->uv[1]) < 1e-3f);
    (void)s;
}

/* Of two scenes with the same surface: a few rays meet edges, and far away positions are coarse. */
static void compare_hits(enum alpha_mode mode, enum cpu_level level)
{
    struct scene *s[2] = { scene_of(mode, true), scene_of(mode, false) };
    struct rays *r[2] = { rays_create_for(s[0], level), rays_create_for(s[1], level) };
    uint32_t met[PLACES] = { 0 }, differ = 0;

    assert_true(r[0] && r[1]);
    for (uint64_t i = 0; i < RAYS; i++) {
        struct vec3 from, dir;
        struct surface at[2];
        struct hit h[2];
        bool hit[2];

        random_ray(i, &from, &dir);
        for (int k = 0; k < 2; k++)
            hit[k] = rays_intersect(r[k], from, dir, 0.0f, &h[k]);
        if (hit[0] != hit[1] || (hit[0] && (h[0].mesh != h[1].mesh || h[0].triangle != h[1].triangle))) {
            differ++;
            continue;
        }
        for (int k = 0; k < 2; k++)
            assert_int_equal(rays_blocked(r[k], from, dir, 0.0f, INFINITY), hit[k]);
        if (!hit[0])
            continue;
        met[h[0].mesh]++;
        if (is_mirrored(h[1].mesh)) { /* the copy's corners are in another order */
            const float u = h[1].u;
            h[1].u = h[1].v;
            h[1].v = u;
        }
        const bool far = h[0].mesh == 6;
        const float slack = far ? 0.05f : 1e-3f;
        if (fabsf(h[0].u - h[1].u) + fabsf(h[0].v - h[1].v) > slack) {
            differ++; /* thin triangles seen from the side */
            continue;
        }
        h[1].u = h[0].u;
        h[1].v = h[0].v;
        for (int k = 0; k < 2; k++) {
            struct hit own = h[k];
            if (k == 1 && is_mirrored(own.mesh)) {
                own.u = h[1].v;
                own.v = h[1].u;
            }
            rays_surface(r[k], &own, vec3_scale(dir, -1.0f), &at[k]);
            if (far) /* the copy's corners are rounded to 4 mm */
                continue;
            normal_map_turn(s[k], &own, NULL, &at[k]);
        }
        if (!far)
            assert_same_surface(s[0], &at[0], &at[1], h[0].mesh == 5 ? 300.0 : 1.0);
        assert_true(at[0].offset > 0.0f && (far || at[0].offset < 1e-3f * (h[0].mesh == 5 ? 300.0f : 1.0f)));
    }
    for (int p = 0; p < PLACES; p++)
        assert_true(met[p] > 50);
    if (differ > RAYS / 50)
        fail_msg("%u of %d rays differ", differ, RAYS);
    for (int k = 0; k < 2; k++) {
        rays_destroy(r[k]);
        scene_destroy(s[k]);
    }
}

static void instances_are_met_where_copies_are(void **state)
{
    (void)state;
    for (enum cpu_level level = CPU_BASELINE; level <= cpu_best(); level++)
        compare_hits(ALPHA_OPAQUE, level);
}

static void holes_of_instances_are_those_of_copies(void **state)
{
    (void)state;
    for (enum cpu_level level = CPU_BASELINE; level <= cpu_best(); level++)
        compare_hits(ALPHA_MASK, level);
}

/* Packets of each kind against single rays, at every CPU level; the random answers of ALPHA_BLEND are the same
 * everywhere, and each instance's are its own. */
static void packets_and_single_rays_agree(void **state)
{
    (void)state;
    for (int mode = ALPHA_OPAQUE; mode <= ALPHA_BLEND; mode++) {
        struct scene *s = scene_of((enum alpha_mode)mode, true);
        static bool first[RAYS];
        uint32_t differ = 0;

        for (enum cpu_level level = CPU_BASELINE; level <= cpu_best(); level++) {
            struct rays *r = rays_create_for(s, level);
            for (uint64_t i = 0; i + PACKET <= RAYS; i += PACKET) {
                struct ray16 p;
                int32_t valid[PACKET];
                memset(&p, 0, sizeof(p));
                for (uint32_t l = 0; l < PACKET; l++) {
                    struct vec3 from, dir;
                    random_ray(i + l, &from, &dir);
                    p.org_x[l] = from.x, p.org_y[l] = from.y, p.org_z[l] = from.z;
                    p.dir_x[l] = dir.x, p.dir_y[l] = dir.y, p.dir_z[l] = dir.z;
                    p.tfar[l] = INFINITY;
                    p.mask[l] = UINT32_MAX;
                    valid[l] = l % 5 == 4 ? 0 : -1;
                }
                rays_occluded16(r, i % 32 ? RAYS_TOGETHER : RAYS_APART, valid, &p);
                for (uint32_t l = 0; l < PACKET; l++) {
                    struct vec3 from, dir;
                    const bool blocked = p.tfar[l] < 0.0f;
                    random_ray(i + l, &from, &dir);
                    if (!valid[l]) {
                        assert_false(blocked);
                        continue;
                    }
                    differ += blocked != rays_blocked(r, from, dir, 0.0f, INFINITY);
                    if (level == CPU_BASELINE)
                        first[i + l] = blocked;
                    differ += blocked != first[i + l];
                }
            }
            rays_destroy(r);
        }
        if (differ > 10) /* at edges */
            fail_msg("mode %d: %u rays differ", mode, differ);
        scene_destroy(s);
    }
}

/* Coherent packets, where all rays start at one point: Embree 3 must not be told that they are. */
static void rays_from_one_point_come_back(void **state)
{
    struct scene *s = scene_of(ALPHA_MASK, true);

    (void)state;
    for (enum cpu_level level = CPU_BASELINE; level <= cpu_best(); level++) {
        struct rays *r = rays_create_for(s, level);
        uint32_t blocked = 0;
        for (uint64_t i = 0; i < 2000; i++) {
            struct ray16 p;
            int32_t valid[PACKET];
            uint64_t n = i;
            const float from[3] = { (float)draw(&n), (float)draw(&n), (float)draw(&n) };
            memset(&p, 0, sizeof(p));
            memset(valid, -1, sizeof(valid));
            for (uint32_t l = 0; l < PACKET; l++) {
                p.org_x[l] = from[0], p.org_y[l] = from[1], p.org_z[l] = from[2];
                p.dir_x[l] = 0.7f + 0.01f * (float)(l % 4), p.dir_y[l] = 0.5f + 0.01f * (float)(l / 4),
                p.dir_z[l] = 0.4f;
                p.tfar[l] = INFINITY;
                p.mask[l] = UINT32_MAX;
            }
            rays_occluded16(r, RAYS_TOGETHER, valid, &p);
            for (uint32_t l = 0; l < PACKET; l++)
                blocked += p.tfar[l] < 0.0f;
        }
        assert_true(blocked > 2000);
        rays_destroy(r);
    }
    scene_destroy(s);
}

/* Surface of opacity 0.6, one sheet at three places: each lets through 40 % by draws of its own. */
static void each_instance_draws_its_own_coverage(void **state)
{
    const float glass[4][3] = { { -1, -1, 0 }, { 1, -1, 0 }, { 1, 1, 0 }, { -1, 1, 0 } };
    struct scene *s = scene_create();
    uint32_t through = 0;

    (void)state;
    add_quads(s, add_surface(s, ALPHA_BLEND), glass, 1);
    assert_int_equal(mesh_place(&s->meshes[0], matrices[0]), ERR_OK);
    for (int i = 1; i < 3; i++) {
        const float matrix[3][4] = { { 1, 0, 0, 0 }, { 0, 1, 0, 0 }, { 0, 0, 1, (float)i } };
        assert_int_equal(scene_add_instance(s, 0, "", matrix), ERR_OK);
    }
    struct rays *r = rays_create_for(s, cpu_best());
    for (uint64_t i = 0; i < 20000; i++) {
        uint64_t n = 2 * i;
        const struct vec3 from = { (float)(0.9 * draw(&n)), (float)(0.9 * draw(&n)), -1 };
        through += !rays_blocked(r, from, vec3_make(0, 0, 1), 0.0f, INFINITY);
    }
    if (fabs(through / 20000.0 - 0.064) > 5.0 * sqrt(0.064 * 0.936 / 20000.0))
        fail_msg("%g of the rays come through, not 0.064", through / 20000.0);
    rays_destroy(r);
    scene_destroy(s);
}

/* No ray that leaves a surface meets its own triangle. */
static void assert_left(const struct scene *s, uint32_t least)
{
    struct rays *r = rays_create_for(s, cpu_best());
    uint32_t left = 0;

    for (uint64_t i = 0; i < 10 * RAYS; i++) {
        struct vec3 from, dir;
        struct hit h, next;
        struct surface at;
        uint64_t n = i << 20;

        random_ray(i, &from, &dir);
        if (!rays_intersect(r, from, dir, 0.0f, &h))
            continue;
        rays_surface(r, &h, vec3_scale(dir, -1.0f), &at);
        struct vec3 to = vec3_normalize(vec3_make((float)draw(&n), (float)draw(&n), (float)draw(&n)));
        if (vec3_dot(to, at.geometric) < 0.0f)
            to = vec3_scale(to, -1.0f);
        if (vec3_dot(to, at.geometric) < 1e-3f)
            continue;
        left++;
        if (rays_intersect(r, surface_start(&at, 1.0f), to, 0.0f, &next) && next.mesh == h.mesh &&
            next.triangle == h.triangle)
            fail_msg("ray %d leaves mesh %u and meets it again at %g m", (int)i, h.mesh, (double)next.t);
    }
    assert_true(left > least);
    rays_destroy(r);
}

static void rays_leave_the_surfaces_of_instances(void **state)
{
    struct scene *s = scene_of(ALPHA_OPAQUE, true);

    (void)state;
    assert_left(s, RAYS);
    scene_destroy(s);
}

/* As of georeferenced models: coordinates are large, and the place takes them back to the origin. Only there are the
 * numbers of a query large. */
static void rays_leave_instances_that_come_from_far_away(void **state)
{
    static const float away[3] = { 5000, -3000, 2000 };
    struct scene *s = scene_create();
    struct mesh m = shards(add_lambert(s, 0.5f));
    float back[3][4];

    (void)state;
    for (uint32_t i = 0; i < 3 * m.vertex_count; i++)
        m.positions[i] += away[i % 3];
    for (int r = 0; r < 3; r++) {
        double moved = 0.0;
        for (int k = 0; k < 3; k++) {
            back[r][k] = matrices[1][r][k];
            moved += (double)back[r][k] * away[k];
        }
        back[r][3] = (float)((double)matrices[1][r][3] - moved);
    }
    assert_int_equal(mesh_place(&m, (const float(*)[4])back), ERR_OK);
    assert_int_equal(scene_add_mesh(s, &m), ERR_OK);
    assert_left(s, RAYS / 2);
    scene_destroy(s);
}

static void the_box_is_that_of_copies(void **state)
{
    struct scene *s[2] = { scene_of(ALPHA_OPAQUE, true), scene_of(ALPHA_OPAQUE, false) };

    (void)state;
    assert_true(distance(s[0]->low, s[1]->low) < 0.01 && distance(s[0]->high, s[1]->high) < 0.01);
    assert_int_equal(s[0]->triangle_count, PLACES * SHARDS);
    scene_destroy(s[0]);
    scene_destroy(s[1]);
}

static bool same_digests(const struct scene *a, const struct scene *b,
                         void (*of)(struct digest *, const struct scene *))
{
    struct digest d[2] = { { { 0 } }, { { 0 } } };

    of(&d[0], a);
    of(&d[1], b);
    return memcmp(&d[0], &d[1], sizeof(d[0])) == 0;
}

static void digests_tell_where_instances_stand(void **state)
{
    struct scene *s[2] = { scene_of(ALPHA_OPAQUE, true), scene_of(ALPHA_OPAQUE, true) };

    (void)state;
    assert_true(same_digests(s[0], s[1], digest_scene) && same_digests(s[0], s[1], digest_geometry));
    s[1]->meshes[3].place.matrix[1][3] += 0.5f;
    assert_false(same_digests(s[0], s[1], digest_scene) || same_digests(s[0], s[1], digest_geometry));
    scene_destroy(s[0]);
    scene_destroy(s[1]);
}

static void unsuitable_places_are_refused(void **state)
{
    static const float wrong[][3][4] = {
        { { 1, 0, 0, 0 }, { 0, 0, 0, 0 }, { 0, 0, 1, 0 } },
        { { 1, 0, 0, 0 }, { 0, 1e-4f, 0, 0 }, { 0, 0, 1, 0 } },
        { { 1, 1, 0, 0 }, { 1, 1, 0, 0 }, { 0, 0, 1, 0 } },
        { { 1e7f, 0, 0, 0 }, { 0, 1e7f, 0, 0 }, { 0, 0, 1e7f, 0 } },
        { { 1, 0, 0, 2e15f }, { 0, 1, 0, 0 }, { 0, 0, 1, 0 } },
        { { 1e-7f, 0, 0, 0 }, { 0, 1e-7f, 0, 0 }, { 0, 0, 1e-7f, 0 } },
        { { 1, 0, 0, 0 }, { 0, NAN, 0, 0 }, { 0, 0, 1, 0 } },
        { { 1, 0, 0, INFINITY }, { 0, 1, 0, 0 }, { 0, 0, 1, 0 } },
        { { 1, 0, 0, 0 }, { 0, 1, 0, NAN }, { 0, 0, 1, 0 } },
        { { 1e30f, 0, 0, 0 }, { 0, 1, 0, 0 }, { 0, 0, 1, 0 } },
    };
    struct mesh m = shards(0);

    (void)state;
    for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
        assert_int_equal(mesh_place(&m, wrong[i]), ERR_RANGE);
        assert_false(m.placed);
    }
    mesh_finish(&m);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(instances_are_met_where_copies_are),
    cmocka_unit_test(holes_of_instances_are_those_of_copies),
    cmocka_unit_test(packets_and_single_rays_agree),
    cmocka_unit_test(rays_from_one_point_come_back),
    cmocka_unit_test(each_instance_draws_its_own_coverage),
    cmocka_unit_test(rays_leave_the_surfaces_of_instances),
    cmocka_unit_test(rays_leave_instances_that_come_from_far_away),
    cmocka_unit_test(the_box_is_that_of_copies),
    cmocka_unit_test(digests_tell_where_instances_stand),
    cmocka_unit_test(unsuitable_places_are_refused),
};

UNIT_MAIN(tests)
