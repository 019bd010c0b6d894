/* ZIP chunks, unpacked with memory that stays. What files of them decode to is in test_decode_exr.c. */
#include "image/codec/exr_zip.h"

#include "base/rng.h"
#include "support/unit.h"

#include <zlib.h>

static void differences_are_undone_as_specified(void **state)
{
    enum { MOST = 131, GUARD = 16 };
    struct rng r = { 3 };
    uint8_t want[MOST + GUARD], got[MOST + GUARD];
    (void)state;

    for (int round = 0; round < 50; round++)
        for (size_t n = 0; n <= MOST; n++) { /* every tail and every start, and nothing at all */
            for (size_t i = 0; i < sizeof(want); i++)
                want[i] = got[i] = (uint8_t)(256.0 * rng_next(&r));
            const size_t from = n % 16 < MOST - n ? n % 16 : 0;
            exr_zip_sum_ref(want + from, n);
            exr_zip_sum(got + from, n);
            assert_memory_equal(want, got, sizeof(want));
        }
}

/* Deflates, for which the values need not be an image's. */
static size_t deflate_noise(uint8_t *packed, size_t room, uint8_t *plain, size_t size, uint64_t seed)
{
    struct rng r = { seed };
    uLongf packed_size = (uLongf)room;

    for (size_t i = 0; i < size; i++)
        plain[i] = (uint8_t)(128.0 + 8.0 * rng_next(&r));
    assert_int_equal(compress(packed, &packed_size, plain, (uLong)size), Z_OK);
    return packed_size;
}

/* By the format's definition: sums, then the two halves woven. */
static void expect(uint8_t *plain, size_t size, uint8_t *want)
{
    for (size_t i = 1; i < size; i++)
        plain[i] = (uint8_t)(plain[i] + plain[i - 1] - 128);
    for (size_t i = 0; i < size; i++)
        want[i] = plain[i / 2 + (i % 2 ? (size + 1) / 2 : 0)];
}

static void chunks_of_any_size_unpack_one_after_the_other(void **state)
{
    static const size_t sizes[] = { 1, 2, 15, 16, 17, 4000, 33, 70000, 1 };
    static uint8_t packed[80000], plain[70000], want[70000], got[70000 + 16];
    struct libdeflate_decompressor *inflater = NULL;
    struct exr_zip z = { .scratch = scratch_create(), .inflater = &inflater };
    (void)state;

    for (int file = 0; file < 3; file++) {
        scratch_begin(z.scratch);
        for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
            const size_t n = deflate_noise(packed, sizeof(packed), plain, sizes[i], i);
            expect(plain, sizes[i], want);
            memset(got, 0x55, sizeof(got));
            assert_null(exr_zip_unpack(&z, packed, n, got, sizes[i]));
            assert_memory_equal(got, want, sizes[i]);
            for (size_t k = 0; k < 16; k++)
                assert_int_equal(got[sizes[i] + k], 0x55);
        }
        exr_zip_finish(&z);
    }
    scratch_destroy(z.scratch);
    exr_inflater_destroy(inflater);
}

/* After each of them a good chunk unpacks. */
static void what_is_not_exactly_the_chunk_is_refused(void **state)
{
    enum { SIZE = 3000 };
    static uint8_t packed[4000], plain[SIZE], got[SIZE];
    const size_t n = deflate_noise(packed, sizeof(packed), plain, SIZE, 7);
    struct libdeflate_decompressor *inflater = NULL;
    struct exr_zip z = { .scratch = NULL, .inflater = &inflater };
    (void)state;

    for (size_t cut = 0; cut < n; cut++) {
        assert_non_null(exr_zip_unpack(&z, packed, cut, got, SIZE));
        if (cut % 97 == 0)
            assert_null(exr_zip_unpack(&z, packed, n, got, SIZE));
    }
    assert_non_null(exr_zip_unpack(&z, packed, n, got, SIZE - 1));
    assert_string_equal(exr_zip_unpack(&z, packed, n - 4, got, SIZE), "cannot inflate");
    static uint8_t longer[SIZE + 1];
    assert_string_equal(exr_zip_unpack(&z, packed, n, longer, SIZE + 1), "too few bytes");
    assert_null(exr_zip_unpack(&z, packed, n, got, SIZE));
    exr_zip_finish(&z);
    exr_inflater_destroy(inflater);
}

/* Unpacked by zlib and the format's definition, so that an error made both ways would show. */
static void what_is_packed_unpacks_by_definition(void **state)
{
    enum { MOST = 5000 };
    static uint8_t packed[MOST], plain[MOST], sums[MOST], got[MOST];
    struct exr_deflater z;
    struct rng r = { 5 };
    size_t smaller = 0, same = 0;
    (void)state;

    assert_int_equal(exr_deflater_init(&z, MOST), ERR_OK);
    for (size_t n = 1; n <= MOST; n += 1 + n / 3)
        for (int noise = 0; noise < 2; noise++) {
            uLongf back = MOST;
            for (size_t i = 0; i < n; i++)
                plain[i] = (uint8_t)(noise ? 256.0 * rng_next(&r) : 3.0 * rng_next(&r) + (double)i / 64.0);
            memcpy(z.plain, plain, n);
            const size_t size = exr_zip_pack(&z, n, packed);
            assert_true(size <= n);
            if (size == n) {
                assert_memory_equal(packed, plain, n);
                same++;
                continue;
            }
            assert_int_equal(uncompress(sums, &back, packed, (uLong)size), Z_OK);
            assert_int_equal(back, n);
            expect(sums, n, got);
            assert_memory_equal(got, plain, n);
            smaller++;
        }
    assert_true(smaller > 5 && same > 5);
    exr_deflater_finish(&z);
}

/* Five sixths of the floats have noise in their last 23 bits, or none. Deflate would save an eighth of the former. */
static void floats_with_noise_stay_as_they_are(void **state)
{
    enum { COUNT = 10000, SIZE = COUNT * (int)sizeof(float) };
    static uint8_t packed[SIZE];
    struct exr_deflater z;
    struct rng r = { 11 };
    (void)state;

    assert_int_equal(exr_deflater_init(&z, SIZE), ERR_OK);
    for (int noise = 0; noise < 2; noise++) {
        uint32_t bits[COUNT];
        for (uint32_t i = 0; i < COUNT; i++)
            bits[i] = 0x3f000000u + (i / 64 << 16) + (noise && i % 600 >= 100 ? (uint32_t)(0x1p23 * rng_next(&r)) : 0);
        memcpy(z.plain, bits, SIZE);
        const size_t size = exr_zip_pack(&z, SIZE, packed);
        if (noise) {
            assert_int_equal(size, SIZE);
            assert_memory_equal(packed, bits, SIZE);
            uLongf room = SIZE;
            for (size_t i = 0; i < SIZE; i++) /* as the file would have them */
                z.halves[i] = z.plain[2 * i % SIZE + (i >= SIZE / 2)];
            for (size_t i = SIZE - 1; i > 0; i--)
                z.halves[i] = (uint8_t)(z.halves[i] - z.halves[i - 1] + 128);
            assert_int_equal(compress(packed, &room, z.halves, SIZE), Z_OK);
            assert_true(room < SIZE - SIZE / 8); /* so it is a choice, not a failure to pack */
        } else {
            assert_true(size < SIZE / 8);
        }
    }
    exr_deflater_finish(&z);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(differences_are_undone_as_specified),
    cmocka_unit_test(chunks_of_any_size_unpack_one_after_the_other),
    cmocka_unit_test(what_is_not_exactly_the_chunk_is_refused),
    cmocka_unit_test(what_is_packed_unpacks_by_definition),
    cmocka_unit_test(floats_with_noise_stay_as_they_are),
};
UNIT_MAIN(tests)
