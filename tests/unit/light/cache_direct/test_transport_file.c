/* The cache of light transport as a file: another run gets the same bits, and whatever is wrong is refused. */
#include "light/cache_direct/internal.h"
#include "light/cache_direct/sealed.h"
#include "light/cache_direct/transport.h"
#include "light/cache_direct/transports.h"
#include "light/estimators/points.h"
#include "light/frame/relight.h"
#include "scene/geometry/files.h"
#include "support/sets.h"

struct stage {
    struct folder folder;
    char path[256];
    struct prepared_scene *set;
    struct transport_desc desc;
    struct digest key;
    uint8_t *bytes;
    size_t size;
};

static void set_up(struct stage *s)
{
    const struct prepared_scene_desc desc = { .width = 24, .height = 14, .edge_rays = 1 };

    *s = (struct stage){ .desc = { .seed = 8, .per_cell = 1, .lobe_samples = 8 } };
    folder_make(&s->folder);
    snprintf(s->path, sizeof(s->path), "%s", folder_write(&s->folder, "court", "", 0));
    s->set = set_of(&desc);
    s->key = transport_key(s->set->gbuffer, s->set->scene, &s->desc);
}

static void tear_down(struct stage *s)
{
    mem_free(s->bytes);
    set_destroy(s->set);
    folder_remove(&s->folder);
}

static struct transport *make(const struct stage *s)
{
    return transport_of(s->set->gbuffer, s->set->rays, &s->desc);
}

/* Puts it to disk; the file's bytes are then in s->bytes. */
static void store(struct stage *s, const struct transport *t)
{
    struct cache_writer *w = cache_writer_create();
    struct reason why = { "" };

    transport_save(t, &s->key, w);
    assert_int_equal(cache_writer_store(w, s->path, &why), ERR_OK);
    cache_writer_destroy(w);
    mem_free(s->bytes);
    s->bytes = sealed_read(s->path, &s->size);
}

static enum err load_with(const struct stage *s, const struct digest *key, const struct transport_desc *desc,
                          struct transport **out, struct reason *why)
{
    struct cache_reader *r;

    *out = NULL;
    enum err e = cache_reader_open(s->path, &r, why);
    assert_true(e || r);
    if (!e)
        e = transport_load(r, key, s->set->gbuffer, s->set->rays, best_kernels(), desc, out, why);
    cache_reader_close(r);
    assert_true(!e == (*out != NULL));
    return e;
}

static enum err load(const struct stage *s, struct transport **out, struct reason *why)
{
    return load_with(s, &s->key, &s->desc, out, why);
}

/* Asks for a refusal that names the file. */
static void assert_refused(const struct stage *s, enum err want)
{
    struct transport *t;
    struct reason why = { "" };
    const enum err e = load(s, &t, &why);

    transport_destroy(t);
    assert_int_equal(e, want);
    assert_non_null(strstr(why.text, s->path));
}

static void loaded_and_computed_give_the_same_bits(void **state)
{
    struct environment *e = sky_environment(sky_with_sun(64, 32, 2e3f), 32, 0.0);
    struct transport_frame_stats stats;
    struct transport *made[2];
    struct reason why = { "" };
    struct stage s;
    float *lo[2];
    (void)state;

    set_up(&s);
    const size_t floats = (size_t)s.set->gbuffer->packet_count * 3 * PACKET;
    for (int raw = 0; raw < 2; raw++) {
        s.desc.tolerance = s.desc.tolerance_glossy = raw ? -1.0f : 0.0f;
        s.key = transport_key(s.set->gbuffer, s.set->scene, &s.desc);
        made[0] = make(&s);
        store(&s, made[0]);
        assert_int_equal(load(&s, &made[1], &why), ERR_OK);
        assert_memory_equal(transport_stats(made[0]), transport_stats(made[1]), sizeof(struct transport_stats));
        for (int k = 0; k < 2; k++) {
            lo[k] = mem_alloc(floats, sizeof(float));
            const struct transport_frame frame = { .end = 0 };
            assert_int_equal(transport_shade(made[k], e, &frame, lo[k], &stats), ERR_OK);
            transport_destroy(made[k]);
        }
        assert_true(stats.sun > 0);
        assert_memory_equal(lo[0], lo[1], floats * sizeof(float));
        mem_free(lo[0]);
        mem_free(lo[1]);
    }
    environment_destroy(e);
    tear_down(&s);
}

/* All of the index and every 997th byte of what follows; cuts likewise. */
static void cuts_and_flipped_bits_are_refused(void **state)
{
    struct stage s;
    (void)state;

    set_up(&s);
    struct transport *t = make(&s);
    const size_t front = 1000, step = 997;
    store(&s, t);
    transport_destroy(t);
    assert_true(s.size > 100000);
    for (size_t at = 0; at < s.size; at += at < front ? 7 : step) {
        folder_write(&s.folder, "court", s.bytes, at);
        assert_refused(&s, ERR_FORMAT);
    }
    for (size_t at = 0; at < s.size; at += at < front ? 1 : step) {
        s.bytes[at] ^= (uint8_t)(1u << at % 8);
        folder_write(&s.folder, "court", s.bytes, s.size);
        assert_refused(&s, ERR_FORMAT);
        s.bytes[at] ^= (uint8_t)(1u << at % 8);
    }
    tear_down(&s);
}

/* A key tells apart whatever would give another transport, and memory is not of that kind. */
static void what_was_made_of_something_else_is_refused(void **state)
{
    const struct prepared_scene_desc others[] = { { .width = 24, .height = 15, .edge_rays = 1 },
                                                  { .width = 24, .height = 14, .edge_rays = 2 } };
    struct stage s;
    struct transport *t;
    struct reason why = { "" };
    (void)state;

    set_up(&s);
    t = make(&s);
    store(&s, t);
    transport_destroy(t);
    struct digest keys[16] = { s.key };
    int count = 1;
    struct transport_desc d = s.desc;
    d.seed++;
    keys[count++] = transport_key(s.set->gbuffer, s.set->scene, &d);
    d = s.desc;
    d.no_visibility = true;
    keys[count++] = transport_key(s.set->gbuffer, s.set->scene, &d);
    d = s.desc;
    d.per_cell = 2;
    keys[count++] = transport_key(s.set->gbuffer, s.set->scene, &d);
    d = s.desc;
    d.lobe_samples = 64;
    keys[count++] = transport_key(s.set->gbuffer, s.set->scene, &d);
    d = s.desc;
    d.tolerance = 0.03f;
    keys[count++] = transport_key(s.set->gbuffer, s.set->scene, &d);
    s.set->scene->meshes[0].positions[1] += 1e-3f;
    keys[count++] = transport_key(s.set->gbuffer, s.set->scene, &s.desc);
    s.set->scene->meshes[0].positions[1] -= 1e-3f;
    s.set->gbuffer->packets[3].diffuse[1][15] += 1e-3f;
    keys[count++] = transport_key(s.set->gbuffer, s.set->scene, &s.desc);
    s.set->gbuffer->packets[3].diffuse[1][15] -= 1e-3f;
    for (int k = 0; k < 2; k++) {
        struct prepared_scene *other;
        assert_int_equal(set_create(&others[k], &other, &why), ERR_OK);
        keys[count++] = transport_key(other->gbuffer, other->scene, &s.desc);
        set_destroy(other);
    }
    for (int k = 0; k < count; k++)
        for (int j = 0; j < k; j++)
            assert_true(memcmp(&keys[k], &keys[j], sizeof(keys[k])) != 0);
    for (int k = 1; k < count; k++) {
        assert_int_equal(load_with(&s, &keys[k], &s.desc, &t, &why), ERR_UNSUPPORTED);
        assert_non_null(strstr(why.text, s.path));
    }
    d = s.desc;
    d.max_bytes = 1u << 26;
    d.tolerance = 0.015f; /* the default, said */
    const struct digest same = transport_key(s.set->gbuffer, s.set->scene, &d);
    assert_int_equal(load_with(&s, &same, &d, &t, &why), ERR_OK);
    transport_destroy(t);
    d.max_bytes = 100000;
    assert_int_equal(load_with(&s, &same, &d, &t, &why), ERR_RANGE);
    assert_non_null(strstr(why.text, "--cache-memory"));
    tear_down(&s);
}

/* ---- Forged files, with right checksums ---- */

enum { BLOCKS = SEALED_HEADER + SEALED_ENTRY + 8, SHAPE = sizeof(struct transport_shape) };

/* Where a block's bytes begin in the file: its pieces, each behind its shape, then its gazes, then its sight. */
static size_t place_of(const struct transport *t, uint32_t block)
{
    size_t at = BLOCKS;

    for (uint32_t k = 0; k < block; k++)
        at += t->blocks[k].rows * SHAPE + transport_block_bytes(&t->blocks[k]);
    return at;
}

/* Writes the bytes at that place of the file, sealed; they are undone by the next. */
static void forge(struct stage *s, const uint8_t *good, size_t at, const void *bytes, size_t count)
{
    memcpy(s->bytes, good, s->size);
    memcpy(s->bytes + at, bytes, count);
    seal(s->bytes, s->size);
    folder_write(&s->folder, "court", s->bytes, s->size);
}

static void assert_forged_record_refused(struct stage *s, const uint8_t *good, size_t at, const void *bytes,
                                         size_t count)
{
    forge(s, good, at, bytes, count);
    assert_refused(s, ERR_FORMAT);
}

static void forged_numbers_with_right_checksums_are_refused(void **state)
{
    static const uint32_t ranks[] = { 0, 1, 63, 64, 65, 0x80000001u, UINT32_MAX };
    static const uint32_t scales[] = { 0, 0x80000000u, 0xbf800000u, 0x7fc00000u, 0x7f800000u, 0x3fc00000u };
    const size_t first = BLOCKS;
    struct transport *t;
    struct reason why = { "" };
    struct stage s;
    (void)state;

    set_up(&s);
    struct transport *made = make(&s);
    const struct transport_piece *q = &made->blocks[0].pieces[0];
    const struct transport_shape *shape = &q->shape;
    assert_true(q->bytes && shape->chunk_count > 2 && shape->chunk_count < SKY_CHUNKS);
    assert_int_equal(shape->form, TRANSPORT_BYTES);
    store(&s, made);
    uint8_t *good = mem_alloc(s.size, 1);
    memcpy(good, s.bytes, s.size);
    forge(&s, good, 0, good, 1); /* what is sealed and not changed is taken */
    assert_int_equal(load(&s, &t, &why), ERR_OK);
    transport_destroy(t);
    for (size_t k = 0; k < sizeof(ranks) / sizeof(ranks[0]); k++)
        if (ranks[k] != shape->rank)
            assert_forged_record_refused(&s, good, first, &ranks[k], 4);
    for (size_t k = 0; k < sizeof(scales) / sizeof(scales[0]); k++)
        assert_forged_record_refused(&s, good, first + 4, &scales[k], 4);
    assert_forged_record_refused(&s, good, first + 8, &(uint8_t){ 1 }, 1);
    assert_forged_record_refused(&s, good, first + 8, &(uint8_t){ TRANSPORT_HALVES }, 1);
    assert_forged_record_refused(&s, good, first + 8, &(uint8_t){ TRANSPORT_BYTES + 1 }, 1);
    assert_forged_record_refused(&s, good, first + 9, &(uint8_t){ 255 }, 1);
    assert_forged_record_refused(&s, good, first + 9, &(uint8_t){ (uint8_t)(shape->chunk_count - 1) }, 1);
    assert_forged_record_refused(&s, good, first + 11, &shape->chunks[0], 1);
    assert_forged_record_refused(&s, good, first + 9 + shape->chunk_count, &(uint8_t){ SKY_CHUNKS }, 1);
    uint32_t narrow = 0;
    while (!made->blocks[narrow].narrow)
        narrow++;
    const size_t gaze = place_of(made, narrow + 1) - sizeof(struct transport_sight) - sizeof(struct transport_gaze);
    assert_forged_record_refused(&s, good, gaze, &(uint32_t){ 6u << 28 }, 4); /* a seventh face */
    for (size_t k = 0; k < 3; k++) { /* light, light, density: infinite; no number; negative */
        static const uint16_t bad[3] = { 0x7c00, 0x7e01, 0x8001 };
        const size_t halves = gaze + offsetof(struct transport_gaze, by_specular) + k * PACKET * sizeof(uint16_t);
        for (size_t i = 0; i < 3; i++)
            assert_forged_record_refused(&s, good, halves, &bad[i], sizeof(bad[i]));
    }
    const size_t piece = first + SHAPE, end = piece + transport_piece_bytes(q, made->blocks[0].packets * PACKET);
    assert_forged_record_refused(&s, good, end - 2, &(uint16_t){ 0x7c00 }, 2);  /* infinite */
    assert_forged_record_refused(&s, good, end - 32, &(uint16_t){ 0xfc01 }, 2); /* no number */
    for (uint32_t k = 0; k < 4; k++) {
        static const float bad[4] = { NAN, INFINITY, -1.0f, 1e7f };
        assert_forged_record_refused(&s, good, piece, &bad[k], sizeof(float));
    }
    mem_free(good);
    transport_destroy(made);
    tear_down(&s);
}

/* Bytes at random anywhere, sealed: what is loaded all the same can be used. */
static void forged_files_that_are_taken_do_no_harm(void **state)
{
    struct environment *e = sky_environment(sky_overcast(32, 16), 16, 0.0);
    struct transport_frame_stats stats;
    struct rng random = { 5 };
    struct transport *t;
    struct reason why = { "" };
    struct stage s;
    uint32_t taken = 0;
    (void)state;

    set_up(&s);
    t = make(&s);
    store(&s, t);
    const size_t floats = (size_t)s.set->gbuffer->packet_count * 3 * PACKET;
    size_t shapes[64]; /* of the first blocks' first pieces */
    for (uint32_t k = 0; k < 64; k++)
        shapes[k] = place_of(t, k % t->block_count);
    float *lo = mem_alloc(floats, sizeof(float));
    uint8_t *good = mem_alloc(s.size, 1);
    transport_destroy(t);
    memcpy(good, s.bytes, s.size);
    for (int k = 0; k < 150; k++) {
        const size_t anywhere = BLOCKS + (size_t)(rng_next(&random) * (double)(s.size - BLOCKS));
        const size_t at = k % 2 ? shapes[k / 2 % 64] + (size_t)(rng_next(&random) * SHAPE) : anywhere;
        const uint8_t byte = (uint8_t)(256.0 * rng_next(&random));
        forge(&s, good, at, &byte, 1);
        if (load(&s, &t, &why))
            continue;
        const struct transport_frame frame = { .end = 0 };
        assert_int_equal(transport_shade(t, e, &frame, lo, &stats), ERR_OK);
        for (size_t i = 0; i < floats; i++)
            assert_true(isfinite(lo[i]));
        transport_destroy(t);
        taken++;
    }
    assert_true(taken > 20 && taken < 150);
    mem_free(lo);
    mem_free(good);
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
