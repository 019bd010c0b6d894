/* PROTOCOL.md section 7, without a network: frames from pieces of every size, and cut at every byte. */
#include "support/unit.h"

#include "base/half.h"
#include "base/mem.h"
#include "net/stream/ingest.h"

#include <math.h>

enum { SIZE = PROTOCOL_ENVIRONMENT_BYTES + 8 + 13 };

/* A message with a header two words longer than today's. */
static void message_make(uint8_t out[SIZE])
{
    const struct protocol_environment e = { .encoding = PROTOCOL_FILE_EXR, .payload = 13, .frame = 9 };

    memset(out, 0xee, SIZE);
    protocol_environment_encode(&e, out);
    out[4] = PROTOCOL_ENVIRONMENT_BYTES + 8;
    for (int i = 0; i < 13; i++)
        out[SIZE - 13 + i] = (uint8_t)(100 + i);
}

static void pieces_of_every_size_make_the_same_frame(void **state)
{
    (void)state;
    uint8_t bytes[SIZE];
    struct assembly a = { .limit = SIZE };
    struct fault fault;

    message_make(bytes);
    for (size_t piece = 1; piece <= SIZE; piece++) {
        for (size_t at = 0; at < SIZE; at += piece) {
            const size_t n = piece < SIZE - at ? piece : SIZE - at;
            assert_true(at == 0 || !a.whole);
            /* odd sizes as fragments of their own, even ones as pieces of one fragment */
            const size_t coming = piece % 2 ? 0 : SIZE - at - n;
            assert_int_equal(assembly_add(&a, bytes + at, n, coming, piece % 2 ? at + n == SIZE : true, &fault),
                             FAULT_NONE);
            assert_int_equal(a.under_way, at + n < SIZE);
        }
        assert_true(a.whole);
        assert_int_equal(a.header.frame, 9);
        assert_int_equal(a.header.payload, 13);
        assert_memory_equal(a.payload.bytes, bytes + SIZE - 13, 13);
    }
    assembly_finish(&a);
    assert_null(a.payload.bytes);
}

/* A payload of 0x10203 bytes, whose size has three bytes of its own, within the limit and one byte above it. */
static void a_large_payload_has_its_size(void **state)
{
    enum { PAYLOAD = 0x10203, ALL = PROTOCOL_ENVIRONMENT_BYTES + PAYLOAD };
    static uint8_t bytes[ALL];
    const struct protocol_environment e = { .encoding = PROTOCOL_FILE_EXR, .payload = PAYLOAD, .frame = 9 };
    struct fault fault;
    (void)state;
    protocol_environment_encode(&e, bytes);
    bytes[ALL - 1] = 77;
    for (int above = 0; above < 2; above++) {
        struct assembly a = { .limit = ALL - (size_t)above };
        const enum fault_code code = assembly_add(&a, bytes, ALL, 0, true, &fault);
        assert_int_equal(code, above ? FAULT_TOO_BIG : FAULT_NONE);
        if (above) {
            assert_non_null(strstr(fault.text, "at most 66098 bytes"));
        } else {
            assert_true(a.whole);
            assert_int_equal(a.payload.bytes[PAYLOAD - 1], 77);
        }
        assembly_finish(&a);
    }
}

static void a_message_that_ends_early_names_its_clause(void **state)
{
    (void)state;
    uint8_t bytes[SIZE];
    struct fault fault;

    message_make(bytes);
    for (size_t size = 0; size < SIZE; size++) {
        struct assembly a = { .limit = SIZE };
        uint8_t *exact = malloc(size ? size : 1);
        memcpy(exact, bytes, size);
        assert_int_equal(assembly_add(&a, exact, size, 0, true, &fault), FAULT_BAD_FIELD);
        assert_string_equal(fault.clause, size < PROTOCOL_ENVIRONMENT_BYTES ? "7.1" : "7.3");
        assert_false(a.under_way);
        assert_false(a.whole);
        free(exact);
        assembly_finish(&a);
    }
}

static void no_memory_is_taken_for_what_is_above_the_limit(void **state)
{
    (void)state;
    uint8_t bytes[SIZE];
    struct assembly a = { .limit = SIZE - 1 };
    struct fault fault;

    message_make(bytes);
    assert_int_equal(assembly_add(&a, bytes, 48, 0, false, &fault), FAULT_TOO_BIG);
    assert_string_equal(fault.clause, "7.7");
    assert_null(a.payload.bytes);
    assert_int_equal(assembly_add(&a, bytes, 1, SIZE_MAX - 1, false, &fault), FAULT_TOO_BIG);
    assert_null(a.payload.bytes);
    memset(bytes + 20, 0xff, 4);
    a.limit = SIZE_MAX;
    assert_int_equal(assembly_add(&a, bytes, 48, SIZE - 48, true, &fault), FAULT_BAD_FIELD);
    assert_string_equal(fault.clause, "7.3");
    assembly_finish(&a);
}

static void a_frame_follows_a_fault_as_if_nothing_had_been(void **state)
{
    (void)state;
    uint8_t bytes[SIZE];
    struct assembly a = { .limit = SIZE };
    struct fault fault;

    message_make(bytes);
    assert_int_equal(assembly_add(&a, bytes, 30, 0, true, &fault), FAULT_BAD_FIELD);
    assert_int_equal(assembly_add(&a, bytes, SIZE, 0, true, &fault), FAULT_NONE);
    assert_true(a.whole);
    const uint8_t *block = a.payload.bytes;
    assert_int_equal(assembly_add(&a, bytes, SIZE, 0, true, &fault), FAULT_NONE);
    assert_ptr_equal(a.payload.bytes, block); /* used again */
    assembly_finish(&a);
}

/* 2 x 2 texels: 10 y + x and the next two numbers, alpha 99, as floats and as half floats, upright and turned over. */
static void texels_come_without_alpha_and_the_right_way_up(void **state)
{
    static const uint16_t halves[] = { 0, 0x3c00, 0x4000, 0x4200, 0x4400, 0x4500, 0x4600, 0x4700, 0x4800 }; /* 0 .. 8 */
    (void)state;
    for (int k = 0; k < 8; k++) {
        const unsigned channels = k & 1 ? 4 : 3;
        const bool half = k & 2, turned = k & 4;
        const struct protocol_environment header = { .encoding = half ? PROTOCOL_RAW_HALF : PROTOCOL_RAW_FLOAT,
                                                     .flags = turned ? PROTOCOL_BOTTOM_FIRST : 0,
                                                     .width = 2,
                                                     .height = 2,
                                                     .channels = (uint8_t)channels };
        struct block payload = { mem_alloc(16, sizeof(float)), 16 * sizeof(float) };
        struct frame f = { .rgb = mem_alloc(20, sizeof(float)), .rgb_capacity = 20 };
        float *const before = f.rgb;
        for (unsigned i = 0; i < 4 * channels; i++) {
            const unsigned value = i % channels == 3 ? 8 : i / channels + i % channels; /* 0 .. 5, alpha 8 */
            const float real = (float)value;
            memcpy(payload.bytes + i * (half ? 2 : 4), half ? (const void *)&halves[value] : &real, half ? 2 : 4);
        }
        assert_int_equal(texels_take(&f, &header, &payload), ERR_OK);
        for (unsigned i = 0; i < 12; i++) {
            const unsigned texel = turned ? (i / 3 + 2) % 4 : i / 3;
            assert_true(f.rgb[i] == (float)(texel + i % 3));
        }
        /* Floats change places with the payload. */
        assert_ptr_equal(half ? (const void *)f.rgb : payload.bytes, before);
        assert_int_equal(f.rgb_capacity, half ? 20 : 16);
        assert_int_equal(payload.capacity, (half ? 16 : 20) * sizeof(float));
        frame_finish(&f);
        mem_free(payload.bytes);
    }
}

static void every_half_float_is_exact(void **state)
{
    (void)state;
    for (uint32_t bits = 0; bits < 65536; bits++) {
        const int sign = bits >> 15 ? -1 : 1, exponent = (int)(bits >> 10 & 31), mantissa = (int)(bits & 1023);
        const float got = half_widen((uint16_t)bits);
        if (exponent == 31 && mantissa) {
            assert_true(isnan(got));
            continue;
        }
        const double want = exponent == 31  ? sign * (double)INFINITY
                            : exponent == 0 ? sign * ldexp(mantissa, -24)
                                            : sign * ldexp(1024 + mantissa, exponent - 25);
        assert_true((double)got == want && !signbit(got) == (sign > 0));
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(pieces_of_every_size_make_the_same_frame),
    cmocka_unit_test(a_message_that_ends_early_names_its_clause),
    cmocka_unit_test(a_large_payload_has_its_size),
    cmocka_unit_test(no_memory_is_taken_for_what_is_above_the_limit),
    cmocka_unit_test(a_frame_follows_a_fault_as_if_nothing_had_been),
    cmocka_unit_test(every_half_float_is_exact),
    cmocka_unit_test(texels_come_without_alpha_and_the_right_way_up),
};
UNIT_MAIN(tests)
