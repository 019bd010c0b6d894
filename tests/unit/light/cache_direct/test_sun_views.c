/* What blocks see of a tile, packed: put, found again, and kept in a file. */
#include "light/cache_direct/sun_views.h"
#include "support/unit.h"

#include "base/mem.h"
#include "base/rng.h"

enum { BLOCKS = 3000 };

/* Of every shape: no rows to four, all lit, all dark, one packet to four. */
static uint32_t make_view(uint32_t block, uint32_t *packets, struct sun_view *out)
{
    uint64_t r = rng_mix(7, block);
    uint32_t rows = 0;

    *packets = 1 + block % TRANSPORT_PACKETS;
    memset(out, 0, sizeof(*out));
    if (block % 5 < 2) /* as a whole */
        *out = block % 5 ? sun_all_lit : sun_all_dark;
    for (uint32_t k = 0; k < *packets && block % 5 >= 2; k++) {
        r = rng_mix(r, k);
        out->whole[k] = (uint16_t)r;
        out->parts[k] = r >> 16 & 1u ? (uint16_t)(r >> 20 | 1u) : 0;
        for (uint32_t d = 0; d < SUN_TILE && out->parts[k]; d++)
            out->bits[rows][d] = (uint16_t)rng_mix(r, 99 + d);
        rows += out->parts[k] != 0;
    }
    out->known = block % 5 < 2 ? 0 : (uint16_t)(r >> 40);
    return rows;
}

static void fill(struct sun_views *v)
{
#pragma omp parallel for schedule(dynamic, 1)
    for (uint32_t k = 0; k < BLOCKS; k++) {
        struct sun_view view;
        uint32_t packets;
        const uint32_t rows = make_view(k, &packets, &view);
        sun_views_put(v, k, &view, packets, rows);
    }
}

static void assert_filled(const struct sun_views *v)
{
    uint32_t constant = 0;

    for (uint32_t k = 0; k < BLOCKS; k++) {
        struct sun_view view;
        uint32_t packets;
        const uint32_t rows = make_view(k, &packets, &view);
        const struct sun_view *found = sun_views_get(v, k);
        assert_non_null(found);
        constant += found == &sun_all_lit || found == &sun_all_dark;
        assert_memory_equal(found->whole, view.whole, packets * sizeof(view.whole[0]));
        assert_memory_equal(found->parts, view.parts, packets * sizeof(view.parts[0]));
        if (found != &sun_all_lit && found != &sun_all_dark)
            assert_memory_equal(found, &view, offsetof(struct sun_view, bits[rows]));
    }
    assert_true(constant >= BLOCKS / 5 * 2);
}

static void views_of_all_shapes_are_found_again(void **state)
{
    _Atomic uint64_t bytes = 0;
    struct sun_views v;
    (void)state;

    assert_int_equal(sun_views_begin(&v, BLOCKS, &bytes), ERR_OK);
    const uint64_t empty = bytes;
    assert_null(sun_views_get(&v, 17));
    fill(&v);
    assert_filled(&v);
    const uint64_t used = v.used * sizeof(uint16_t);
    printf("%.0f bytes for %d views, %.0f with chunks\n", (double)used, BLOCKS, (double)(bytes - empty));
    assert_true(used > 100000 && bytes - empty < used + used / 8);
    sun_views_forget(&v, 17);
    assert_null(sun_views_get(&v, 17));
    sun_views_finish(&v);
    assert_true(bytes == 0);
}

static void views_come_back_from_their_bytes(void **state)
{
    static struct transport_block blocks[BLOCKS];
    const struct digest key = { { 3 } };
    struct cache_writer *w = cache_writer_create();
    struct reason why = { "" };
    struct sun_views v, back;
    struct cache_reader *r;
    _Atomic uint64_t bytes = 0;
    uint8_t *stored;
    size_t size;
    (void)state;

    assert_int_equal(sun_views_begin(&v, BLOCKS, &bytes), ERR_OK);
    assert_int_equal(sun_views_begin(&back, BLOCKS, &bytes), ERR_OK);
    fill(&v);
    uint8_t *own = mem_alloc(sun_views_size(&v), 1);
    assert_ptr_equal(sun_views_save(&v, own), own + sun_views_size(&v));
    cache_writer_section(w, "views", &key);
    cache_writer_put(w, own, sun_views_size(&v));
    assert_int_equal(cache_writer_bytes(w, &stored, &size), ERR_OK);
    assert_int_equal(cache_reader_take("a test", stored, size, &r, &why), ERR_OK);
    assert_int_equal(cache_reader_find(r, "views", &key, &why), ERR_OK);
    for (uint32_t k = 0; k < BLOCKS; k++)
        blocks[k].packets = 1 + k % TRANSPORT_PACKETS;
    assert_int_equal(sun_views_load(&back, blocks, r, &why), ERR_OK);
    assert_int_equal(cache_reader_end(r, &why), ERR_OK);
    assert_filled(&back);
    cache_reader_close(r);
    cache_writer_destroy(w);
    mem_free(stored);
    mem_free(own);
    sun_views_finish(&v);
    sun_views_finish(&back);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(views_of_all_shapes_are_found_again),
    cmocka_unit_test(views_come_back_from_their_bytes),
};
UNIT_MAIN(tests)
