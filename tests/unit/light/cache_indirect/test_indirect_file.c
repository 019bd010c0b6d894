/* The cache of indirect light as a file: another run gets the same bits, and whatever is wrong is refused. */
#include "light/cache_direct/sealed.h"
#include "light/cache_direct/transport.h"
#include "light/cache_direct/transports.h"
#include "light/cache_indirect/indirect.h"
#include "light/cache_indirect/internal.h"
#include "light/estimators/points.h"
#include "light/frame/relight.h"
#include "scene/geometry/files.h"
#include "support/sets.h"

struct stage {
    struct folder folder;
    char path[256];
    struct prepared_scene *set;
    struct transport *direct;
    struct indirect_desc desc;
    struct digest direct_key, key;
    struct indirect_cache *made;
    uint8_t *bytes, *good; /* of the file, and as they were written */
    size_t size;
};

static void set_up(struct stage *s)
{
    const struct prepared_scene_desc set = { .width = 24, .height = 14, .edge_rays = 1 };
    const struct transport_desc direct = { .seed = 8, .per_cell = 1, .lobe_samples = 1 };
    struct cache_writer *w = cache_writer_create();
    struct reason why = { "" };

    *s = (struct stage){ .size = 0 };
    folder_make(&s->folder);
    snprintf(s->path, sizeof(s->path), "%s", folder_write(&s->folder, "court", "", 0));
    s->set = set_of(&set);
    s->direct = transport_of(s->set->gbuffer, s->set->rays, &direct);
    s->desc = (struct indirect_desc){ .scene = s->set->scene,
                                      .rays = s->set->rays,
                                      .gbuffer = s->set->gbuffer,
                                      .direct = s->direct,
                                      .gather = 4,
                                      .records = 300,
                                      .seed = 8 };
    s->direct_key = transport_key(s->set->gbuffer, s->set->scene, &direct);
    s->key = indirect_key(&s->direct_key, &s->desc);
    assert_int_equal(indirect_create(&s->desc, best_kernels(), &s->made, &why), ERR_OK);
    indirect_save(s->made, &s->key, w);
    assert_int_equal(cache_writer_store(w, s->path, &why), ERR_OK);
    cache_writer_destroy(w);
    s->bytes = sealed_read(s->path, &s->size);
    s->good = sealed_read(s->path, &s->size);
}

static void tear_down(struct stage *s)
{
    mem_free(s->bytes);
    mem_free(s->good);
    indirect_destroy(s->made);
    transport_destroy(s->direct);
    set_destroy(s->set);
    folder_remove(&s->folder);
}

static enum err load_with(const struct stage *s, const struct digest *key, uint64_t max_bytes,
                          struct indirect_cache **out, struct reason *why)
{
    struct indirect_desc desc = s->desc;
    struct cache_reader *r;

    desc.max_bytes = max_bytes;
    *out = NULL;
    enum err e = cache_reader_open(s->path, &r, why);
    assert_true(e || r);
    if (!e)
        e = indirect_load(r, key, &desc, best_kernels(), out, why);
    cache_reader_close(r);
    assert_true(!e == (*out != NULL));
    return e;
}

/* Asks for a refusal that names the file. */
static void assert_refused(const struct stage *s)
{
    struct indirect_cache *b;
    struct reason why = { "" };
    const enum err e = load_with(s, &s->key, 0, &b, &why);

    indirect_destroy(b);
    assert_int_equal(e, ERR_FORMAT);
    assert_non_null(strstr(why.text, s->path));
}

static void loaded_and_computed_give_the_same_bits(void **state)
{
    struct environment *e = sky_environment(sky_with_sun(64, 32, 2e3f), 32, 0.0);
    struct indirect_cache *loaded;
    struct reason why = { "" };
    struct stage s;
    float *lo[2], most = 0.0f;
    (void)state;

    set_up(&s);
    const size_t floats = (size_t)s.set->gbuffer->packet_count * 3 * PACKET;
    assert_int_equal(load_with(&s, &s.key, 0, &loaded, &why), ERR_OK);
    assert_memory_equal(indirect_stats(s.made), indirect_stats(loaded), sizeof(struct indirect_stats));
    assert_int_equal(indirect_left(s.made)->count, indirect_left(loaded)->count);
    for (int k = 0; k < 2; k++) {
        lo[k] = mem_alloc(floats, sizeof(float));
        add_indirect_alone(indirect_of_frame(k ? loaded : s.made), s.set->gbuffer, e, lo[k]);
    }
    assert_memory_equal(lo[0], lo[1], floats * sizeof(float));
    for (size_t i = 0; i < floats; i++)
        most = fmaxf(most, lo[0][i]);
    assert_true(most > 0.0f);
    mem_free(lo[0]);
    mem_free(lo[1]);
    indirect_destroy(loaded);
    environment_destroy(e);
    tear_down(&s);
}

static void cuts_and_flipped_bits_are_refused(void **state)
{
    const size_t front = 500, step = 4999;
    struct stage s;
    (void)state;

    set_up(&s);
    assert_true(s.size > 100000);
    for (size_t at = 0; at < s.size; at += at < front ? 7 : step) {
        folder_write(&s.folder, "court", s.bytes, at);
        assert_refused(&s);
    }
    for (size_t at = 0; at < s.size; at += at < front ? 1 : step) {
        s.bytes[at] ^= (uint8_t)(1u << at % 8);
        folder_write(&s.folder, "court", s.bytes, s.size);
        assert_refused(&s);
        s.bytes[at] ^= (uint8_t)(1u << at % 8);
    }
    tear_down(&s);
}

/* A key tells apart whatever would give another indirect light, colours that no point shows among it; memory is not
 * of that kind. */
static void what_was_made_of_something_else_is_refused(void **state)
{
    struct digest keys[12], other;
    struct indirect_cache *b;
    struct reason why = { "" };
    struct stage s;
    int count = 0;
    (void)state;

    set_up(&s);
    keys[count++] = s.key;
    struct indirect_desc d[4] = { s.desc, s.desc, s.desc, s.desc };
    d[0].seed++;
    d[1].gather = 8;
    d[2].records = 301;
    d[3].eye.y += 1e-3f;
    for (int k = 0; k < 4; k++)
        keys[count++] = indirect_key(&s.direct_key, &d[k]);
    other = s.direct_key;
    other.half[1]++;
    keys[count++] = indirect_key(&other, &s.desc);
    s.set->scene->materials[0].diffuse.y += 1e-3f;
    keys[count++] = indirect_key(&s.direct_key, &s.desc);
    s.set->scene->materials[0].diffuse.y -= 1e-3f;
    for (int k = 1; k < count; k++) {
        for (int j = 0; j < k; j++)
            assert_true(memcmp(&keys[k], &keys[j], sizeof(keys[k])) != 0);
        assert_int_equal(load_with(&s, &keys[k], 0, &b, &why), ERR_UNSUPPORTED);
        assert_non_null(strstr(why.text, s.path));
    }
    d[0] = s.desc;
    d[0].max_bytes = 1u << 26;
    other = indirect_key(&s.direct_key, &d[0]);
    assert_int_equal(load_with(&s, &other, 1u << 26, &b, &why), ERR_OK);
    indirect_destroy(b);
    assert_int_equal(load_with(&s, &other, 10000, &b, &why), ERR_RANGE);
    assert_non_null(strstr(why.text, "--cache-memory"));
    tear_down(&s);
}

/* ---- Forged files, with right checksums ---- */

/* The file: statistics and the basis' numbers, its rows, then by groups ranks and bytes. */
enum { NUMBERS = SEALED_HEADER + SEALED_ENTRY, REST = NUMBERS + 16, COUNT = REST + 8, ROWS = COUNT + 4, ROW_RANKS = 8 };

/* Writes the bytes at that place of the file, sealed; they are undone by the next. */
static void forge(struct stage *s, size_t at, const void *bytes, size_t count)
{
    memcpy(s->bytes, s->good, s->size);
    memcpy(s->bytes + at, bytes, count);
    seal(s->bytes, s->size);
    folder_write(&s->folder, "court", s->bytes, s->size);
}

static void assert_forged_refused(struct stage *s, size_t at, const void *bytes, size_t count)
{
    forge(s, at, bytes, count);
    assert_refused(s);
}

static void forged_numbers_with_right_checksums_are_refused(void **state)
{
    static const float gains[] = { NAN, INFINITY, -1.0f, 1e30f };
    struct indirect_cache *b;
    struct reason why = { "" };
    struct stage s;
    (void)state;

    set_up(&s);
    const struct indirect_group *g = &s.made->groups[0];
    const struct indirect_piece *q = &g->pieces[0];
    const size_t ranks = ROWS + (size_t)s.made->basis.count * SKY_CELLS * sizeof(float);
    const size_t blocks = ranks + g->rows * ROW_RANKS, bytes = blocks + g->count * g->rows;
    forge(&s, 0, s.good, 1); /* what is sealed and not changed is taken */
    assert_int_equal(load_with(&s, &s.key, 0, &b, &why), ERR_OK);
    indirect_destroy(b);
    assert_true(q->bytes && q->rank > 1 && g->rows < TRANSPORT_ROWS && s.made->blocks[0].rank[0] > 0);
    assert_forged_refused(&s, REST, &(double){ NAN }, 8);
    for (int k = 0; k < 4; k++) {
        static const uint32_t counts[4] = { 0, 8, 144, UINT32_MAX };
        assert_forged_refused(&s, COUNT, &counts[k], 4);
    }
    assert_forged_refused(&s, ROWS, &(float){ NAN }, 4);
    assert_forged_refused(&s, ranks - 4, &(float){ 2.0f }, 4);
    for (int k = 0; k < 4; k++) {
        static const uint32_t bad[4] = { 0, 1, 1025, UINT32_MAX }, lengths[4] = { 0, 8, 144, UINT32_MAX };
        assert_forged_refused(&s, ranks, &bad[k], 4);
        assert_forged_refused(&s, ranks + 4, &lengths[k], 4);
    }
    for (int k = 0; k < 3; k++) {
        static const uint8_t bad[3] = { 0, 65, 255 };
        assert_forged_refused(&s, blocks, &bad[k], 1);
    }
    for (int k = 0; k < 4; k++)
        assert_forged_refused(&s, bytes + (size_t)q->rank * 3 * q->basis, &gains[k], 4);
    tear_down(&s);
}

/* Bytes at random anywhere, sealed: what is loaded all the same can be used. */
static void forged_files_that_are_taken_do_no_harm(void **state)
{
    struct environment *e = sky_environment(sky_overcast(32, 16), 16, 0.0);
    struct rng random = { 5 };
    struct indirect_cache *b;
    struct reason why = { "" };
    struct stage s;
    uint32_t taken = 0;
    (void)state;

    set_up(&s);
    const size_t floats = (size_t)s.set->gbuffer->packet_count * 3 * PACKET;
    const size_t basis = ROWS + (size_t)s.made->basis.count * SKY_CELLS * sizeof(float);
    float *lo = mem_alloc(floats, sizeof(float));
    for (int k = 0; k < 100; k++) {
        const size_t from = k % 2 ? NUMBERS : basis, until = k % 2 ? basis : s.size;
        const size_t at = from + (size_t)(rng_next(&random) * (double)(until - from));
        const uint8_t byte = (uint8_t)(256.0 * rng_next(&random));
        forge(&s, at, &byte, 1);
        if (load_with(&s, &s.key, 0, &b, &why))
            continue;
        add_indirect_alone(indirect_of_frame(b), s.set->gbuffer, e, lo);
        for (size_t i = 0; i < floats; i++)
            assert_true(isfinite(lo[i]));
        indirect_destroy(b);
        taken++;
    }
    assert_true(taken > 10 && taken < 100);
    mem_free(lo);
    environment_destroy(e);
    tear_down(&s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(loaded_and_computed_give_the_same_bits),
    cmocka_unit_test(cuts_and_flipped_bits_are_refused),
    cmocka_unit_test(what_was_made_of_something_else_is_refused),
    cmocka_unit_test(forged_numbers_with_right_checksums_are_refused),
    cmocka_unit_test(forged_files_that_are_taken_do_no_harm),
};
UNIT_MAIN(tests)
