/* DWA chunks: against files by the library that defines them, and built by hand with known coefficients. */
#define _GNU_SOURCE
#include "image/codec/decoding.h"

#include "image/codec/dwa/dwa.h"
#include "image/codec/dwa_files.h"

#include <sys/mman.h>
#include <unistd.h>
#include <zlib.h>

#define SIDE 8
#define PI_16 0.19634954084936207

/* What a chunk is to hold, not yet packed. Sizes in bytes, counts in values of 16 bits. */
struct parts {
    int version;
    const char *rules; /* each: name, NUL, colour and scheme and case, type; without the size in front */
    size_t rules_size;
    const uint8_t *plain, *rle;
    size_t plain_size, rle_size;
    const uint16_t *ac, *dc;
    size_t ac_count, dc_count;
};

static size_t deflate_onto(uint8_t *to, size_t room, const void *from, size_t size)
{
    uLongf got = (uLongf)room;

    if (size == 0)
        return 0;
    assert_int_equal(compress(to, &got, from, (uLong)size), Z_OK);
    return got;
}

static void put_u64(uint8_t *to, uint64_t v)
{
    for (int i = 0; i < 8; i++)
        to[i] = (uint8_t)(v >> 8 * i);
}

/* Low bytes, then high ones, then the differences between neighbours. */
static void difference(const uint16_t *values, size_t count, uint8_t *out)
{
    for (size_t i = 0; i < count; i++) {
        out[i] = (uint8_t)values[i];
        out[count + i] = (uint8_t)(values[i] >> 8);
    }
    for (size_t i = 2 * count; i-- > 1;)
        out[i] = (uint8_t)(out[i] - out[i - 1] + 128);
}

/* Packs the parts; returns the chunk's size. */
static size_t pack(const struct parts *p, uint8_t *out, size_t room)
{
    uint8_t bytes[1024];
    size_t at = 88, runs = 0, packed[4];

    memset(out, 0, 88);
    if (p->version == 2) {
        out[at++] = (uint8_t)(p->rules_size + 2);
        out[at++] = 0;
        memcpy(out + at, p->rules, p->rules_size);
        at += p->rules_size;
    }
    at += packed[0] = deflate_onto(out + at, room - at, p->plain, p->plain_size);
    at += packed[1] = deflate_onto(out + at, room - at, p->ac, 2 * p->ac_count);
    difference(p->dc, p->dc_count, bytes);
    at += packed[2] = deflate_onto(out + at, room - at, bytes, 2 * p->dc_count);
    for (size_t i = 0; i < p->rle_size; i++) { /* half as runs of two, half as they are */
        const bool run = i + 1 < p->rle_size && p->rle[i] == p->rle[i + 1];
        bytes[runs++] = run ? 1 : 0xff;
        bytes[runs++] = p->rle[i];
        i += run;
    }
    at += packed[3] = deflate_onto(out + at, room - at, bytes, runs);
    const uint64_t head[11] = { (uint64_t)p->version, p->plain_size, packed[0],   packed[1], packed[2], packed[3], runs,
                                p->rle_size,          p->ac_count,   p->dc_count, 1 };
    for (int i = 0; i < 11; i++)
        put_u64(out + 8 * i, head[i]);
    return at;
}

/* Packs and unpacks 8x8 texels; `out` must hold them. */
static const char *round_trip(const struct parts *p, const exr_coding_channel_info_t *channels, int count, void *out)
{
    uint8_t chunk[4096];
    struct dwa d = { NULL, 0, NULL };
    const size_t size = pack(p, chunk, sizeof(chunk));
    const char *fault = dwa_unpack(&d, channels, count, SIDE, SIDE, chunk, size, out);

    dwa_finish(&d);
    return fault;
}

static exr_coding_channel_info_t channel(const char *name, int type, bool linear)
{
    return (exr_coding_channel_info_t){ .channel_name = name,
                                        .data_type = (uint16_t)type,
                                        .p_linear = linear,
                                        .bytes_per_element = type == EXR_PIXEL_HALF ? 2 : 4 };
}

/* Half floats of plain numbers that they hold. */
static uint16_t half_of(float v)
{
    uint32_t bits;

    if (v == 0.0f)
        return 0;
    memcpy(&bits, &v, 4);
    return (uint16_t)((bits >> 16 & 0x8000) | ((bits & 0x7fffffff) - 0x38000000) >> 13);
}

/* Row and column of each coefficient: along the diagonals, one up and the next down, as [JPEG, Figure A.6] draws it. */
static void walk(uint8_t row[64], uint8_t column[64])
{
    int k = 0;

    for (int diagonal = 0; diagonal < 15; diagonal++)
        for (int i = 0; i <= diagonal; i++) {
            const int v = diagonal % 2 ? i : diagonal - i, u = diagonal - v;
            if (u < 8 && v < 8) {
                row[k] = (uint8_t)v;
                column[k++] = (uint8_t)u;
            }
        }
}

static void a_coefficient_becomes_its_cosine(void **state)
{
    const exr_coding_channel_info_t y = channel("Y", EXR_PIXEL_FLOAT, true);
    uint8_t row[64], column[64];
    (void)state;

    walk(row, column);
    for (int k = 1; k < 64; k++) {
        /* 8 everywhere by the DC value, then zeros up to the k-th, which is 2 */
        const uint16_t dc = half_of(64.0f), ac[3] = { (uint16_t)(0xff00 + k - 1), half_of(2.0f), 0xff00 };
        const struct parts p = { .version = 2,
                                 .rules = "Y\0\4\2",
                                 .rules_size = 4,
                                 .dc = &dc,
                                 .dc_count = 1,
                                 .ac = k == 1 ? ac + 1 : ac,
                                 .ac_count = k == 1    ? 2
                                             : k == 63 ? 2
                                                       : 3 };
        float got[SIDE][SIDE];
        assert_null(round_trip(&p, &y, 1, got));
        for (int i = 0; i < SIDE * SIDE; i++) {
            const int u = column[k], v = row[k];
            const double norm = (u ? 0.5 : sqrt(0.125)) * (v ? 0.5 : sqrt(0.125));
            const double want =
                8.0 + 2.0 * norm * cos((2 * (i % SIDE) + 1) * u * PI_16) * cos((2 * (i / SIDE) + 1) * v * PI_16);
            if (fabs((double)got[i / SIDE][i % SIDE] - want) > 0.005) /* half floats near 8 are 1/128 apart */
                fail_msg("coefficient %d, texel %d: %g, not %g", k, i, (double)got[i / SIDE][i % SIDE], want);
        }
    }
}

static void the_curve_is_a_power_below_one_and_an_exponential_above(void **state)
{
    static const float rows[] = { 0.0f, 0.25f, 0.5f, 1.0f, 1.5f, 2.0f, 4.0f, -0.5f, -2.0f };
    const exr_coding_channel_info_t y = channel("sky.Y", EXR_PIXEL_FLOAT, false);
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        const float v = fabsf(rows[i]), curve = v <= 1.0f ? powf(v, 2.2f) : expf(2.2f * (v - 1.0f));
        const float want = rows[i] < 0.0f ? -curve : curve;
        const uint16_t dc = half_of(8.0f * rows[i]), ac = 0xff00;
        const struct parts p = {
            .version = 2, .rules = "Y\0\4\2", .rules_size = 4, .dc = &dc, .dc_count = 1, .ac = &ac, .ac_count = 1
        };
        float got[SIDE][SIDE];
        assert_null(round_trip(&p, &y, 1, got));
        assert_true(fabsf(got[3][5] - want) <= 1e-3f * fabsf(want));
    }
}

static void red_green_and_blue_of_a_layer_come_from_luma_and_chroma(void **state)
{
    static const struct {
        int version;
        const char *names[3]; /* in the file's order */
        int place[3];         /* of red, green, blue in it */
    } rows[] = {
        { 2, { "B", "G", "R" }, { 2, 1, 0 } },
        { 2, { "sky.B", "sky.G", "sky.R" }, { 2, 1, 0 } },
        { 0, { "BLUE", "Grn", "red" }, { 2, 1, 0 } },
    };
    /* luma 0.5, blue chroma 0.125, red chroma -0.25 */
    const uint16_t dc[3] = { half_of(4.0f), half_of(1.0f), half_of(-2.0f) }, ac[3] = { 0xff00, 0xff00, 0xff00 };
    const double want[3] = { 0.5 - 0.25 * 1.5747, 0.5 - 0.1873 * 0.125 + 0.4682 * 0.25, 0.5 + 1.8556 * 0.125 };
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        const struct parts p = { .version = rows[i].version,
                                 .rules = "R\0\24\2G\0\44\2B\0\64\2",
                                 .rules_size = 12,
                                 .dc = dc,
                                 .dc_count = 3,
                                 .ac = ac,
                                 .ac_count = 3 };
        exr_coding_channel_info_t channels[3];
        float got[SIDE][3][SIDE];
        for (int c = 0; c < 3; c++)
            channels[c] = channel(rows[i].names[c], EXR_PIXEL_FLOAT, c == 1); /* linear or not makes no difference */
        assert_null(round_trip(&p, channels, 3, got));
        for (int c = 0; c < 3; c++)
            assert_true(fabs((double)got[7][rows[i].place[c]][7] - pow(want[c], 2.2)) < 1e-3 * want[c]);
    }
}

static void other_channels_come_back_to_the_byte(void **state)
{
    const exr_coding_channel_info_t channels[] = { channel("A", EXR_PIXEL_HALF, false),
                                                   channel("Z", EXR_PIXEL_FLOAT, false),
                                                   channel("id", EXR_PIXEL_UINT, false) };
    uint8_t plain[2 * SIDE * SIDE * 4], rle[SIDE * SIDE * 2], got[SIDE][10 * SIDE];
    const struct parts p = { .version = 2,
                             .rules = "A\0\10\1",
                             .rules_size = 4,
                             .plain = plain,
                             .rle = rle,
                             .plain_size = sizeof(plain),
                             .rle_size = sizeof(rle) };
    (void)state;

    for (size_t i = 0; i < sizeof(plain); i++)
        plain[i] = (uint8_t)(7 * i + i / 100);
    for (size_t i = 0; i < sizeof(rle); i++)
        rle[i] = (uint8_t)(i / 3);
    assert_null(round_trip(&p, channels, 3, got));
    for (size_t y = 0; y < SIDE; y++) {
        for (size_t x = 0; x < SIDE; x++) {
            assert_int_equal(got[y][2 * x], rle[SIDE * y + x]);                   /* low bytes of all texels */
            assert_int_equal(got[y][2 * x + 1], rle[SIDE * SIDE + SIDE * y + x]); /* then high bytes */
        }
        assert_memory_equal(got[y] + 2 * SIDE, plain + 4 * SIDE * y, 4 * SIDE);
        assert_memory_equal(got[y] + 6 * SIDE, plain + 4 * SIDE * (SIDE + y), 4 * SIDE);
    }
}

static void heads_that_disagree_with_the_texels_are_refused(void **state)
{
    const exr_coding_channel_info_t y = channel("Y", EXR_PIXEL_HALF, true);
    const uint16_t dc = half_of(8.0f), ac = 0xff00;
    const struct parts p = {
        .version = 2, .rules = "Y\0\4\1", .rules_size = 4, .dc = &dc, .dc_count = 1, .ac = &ac, .ac_count = 1
    };
    uint8_t chunk[512], out[SIDE * SIDE * 2];
    struct dwa d = { NULL, 0, NULL };
    const size_t size = pack(&p, chunk, sizeof(chunk));
    (void)state;

    assert_null(dwa_unpack(&d, &y, 1, SIDE, SIDE, chunk, size, out));
    for (size_t i = 0; i < 11; i++) {
        if (i == 6) /* the size of runs, of which there are none */
            continue;
        chunk[8 * i]++;
        assert_non_null(dwa_unpack(&d, &y, 1, SIDE, SIDE, chunk, size, out));
        chunk[8 * i]--;
        chunk[8 * i + 7] = 0xff;
        assert_non_null(dwa_unpack(&d, &y, 1, SIDE, SIDE, chunk, size, out));
        chunk[8 * i + 7] = 0;
    }
    assert_non_null(dwa_unpack(&d, &y, 1, SIDE, 2 * SIDE, chunk, size, out));
    for (size_t n = 0; n < size; n++)
        assert_non_null(dwa_unpack(&d, &y, 1, SIDE, SIDE, chunk, n, out));
    dwa_finish(&d);
}

static void counts_that_disagree_with_the_texels_are_refused(void **state)
{
    const exr_coding_channel_info_t y = channel("Y", EXR_PIXEL_HALF, true);
    uint16_t dc[2] = { half_of(8.0f), half_of(8.0f) }, ac[80];
    uint8_t out[SIDE * SIDE * 2];
    (void)state;

    for (size_t i = 0; i < 80; i++)
        ac[i] = half_of(1.0f);
    for (size_t dcs = 0; dcs < 3; dcs++) {
        for (size_t acs = 60; acs < 67; acs++) {
            const struct parts p = {
                .version = 2, .rules = "Y\0\4\1", .rules_size = 4, .dc = dc, .dc_count = dcs, .ac = ac, .ac_count = acs
            };
            const char *fault = round_trip(&p, &y, 1, out);
            assert_true(dcs == 1 && acs == 63 ? !fault : !!fault);
        }
    }
}

/* Bits from a text of 0 and 1, behind a head for the symbols 0..last. */
static size_t huffman_block(uint8_t last, const char *bits, uint8_t *out)
{
    size_t n = 0;

    memset(out, 0, 64);
    out[4] = last;
    for (; *bits; bits++)
        if (*bits != ' ') {
            out[20 + n / 8] |= (uint8_t)((*bits - '0') << (7 - n % 8));
            n++;
        }
    return 20 + (n + 7) / 8;
}

static void huffman_codes_are_canonical_and_repeat(void **state)
{
    /* lengths 2, none, none, 2, 1 of symbols 0..4: codes 00, 01 and 1; 4 repeats. Values from the next byte on. */
    static const char good[] = "000010 111011 000010 000001  01 1 00000011 00 1 00000000 01  000";
    static const char *const bad[] = {
        "000001 000001 000001 000000 000000  00000000",  /* three codes of one bit */
        "000010 000001 000000 000000 000000  00000000",  /* half of a code is left over */
        "000010 000000 000000 000000 000000  11111111",  /* bits that are no code */
        "000000 000000 000000 000000 000000  00000000",  /* no code at all */
        "111111 11111111 000000",                        /* zeros beyond the last symbol */
        "111001 000000",                                 /* 57 bits */
        "000010 111011 000010 000001  1 00000011 00000", /* repeats what is not there */
        "000010 111011 000010 000001  01 1 11111111 00", /* repeats beyond the end */
    };
    uint8_t block[64];
    uint16_t got[6];
    (void)state;

    assert_null(dwa_huffman(block, huffman_block(4, good, block), got, 6));
    assert_memory_equal(got, ((uint16_t[]){ 3, 3, 3, 3, 0, 3 }), sizeof(got));
    for (size_t n = 0; n < 20 + 5; n++)
        assert_non_null(dwa_huffman(block, n, got, 6));
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++)
        if (!dwa_huffman(block, huffman_block(4, bad[i], block), got, 6))
            fail_msg("'%s' is taken", bad[i]);
}

/* Lengths of 1 to 13 and twice 14, so that codes are both in the table of the first bits and beyond it; the last symbol
 * repeats. Symbols 13, 12, 0, 5 and 11. */
static void long_huffman_codes_are_read(void **state)
{
    static const char bits[] =
        "000001 000010 000011 000100 000101 000110 000111 001000 001001 001010 001011 001100 001101 "
        "001110 001110 000000 00000000000000 0000000000001 1 000001 000000000001";
    uint8_t block[64];
    uint16_t got[5];
    (void)state;

    const char *fault = dwa_huffman(block, huffman_block(14, bits, block), got, 5);
    if (fault)
        fail_msg("%s", fault);
    assert_memory_equal(got, ((uint16_t[]){ 13, 12, 0, 5, 11 }), sizeof(got));
}

/* A block that ends where memory does. */
static void huffman_codes_are_not_read_beyond_their_end(void **state)
{
    static const char good[] = "000010 111011 000010 000001  01 1 00000011 00 1 00000000 01  000";
    const size_t page = (size_t)sysconf(_SC_PAGESIZE);
    uint8_t block[64], *pages = mmap(NULL, 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    uint16_t got[6];
    (void)state;

    assert_true(pages != MAP_FAILED && mprotect(pages + page, page, PROT_NONE) == 0);
    const size_t size = huffman_block(4, good, block);
    memcpy(pages + page - size, block, size);
    assert_null(dwa_huffman(pages + page - size, size, got, 6));
    munmap(pages, 2 * page);
}

/* place: of the three channels in the file's list. */
static void check_even(const uint8_t *bytes, size_t size, uint32_t width, uint32_t height, const int place[3])
{
    struct image im = { 0 };

    must_decode(bytes, size, &im);
    assert_int_equal(im.width, width);
    assert_int_equal(im.height, height);
    for (uint32_t i = 0; i < 3 * width * height; i++) {
        const uint32_t x = i / 3 % width, y = i / 3 / width;
        const float want = 2.0f + (float)place[i % 3] + (float)x / 64.0f + (float)y / 128.0f;
        if (fabsf(im.rgb[i] - want) > 0.01f * want)
            fail_msg("texel %u, %u, channel %u: %g, not %g", x, y, i % 3, (double)im.rgb[i], (double)want);
    }
    image_finish(&im);
}

static void files_of_the_cxx_library_decode(void **state)
{
    (void)state;

    check_even(dwaa_file, sizeof(dwaa_file), 13, 34, (const int[]){ 3, 2, 1 });
    check_even(dwab_file, sizeof(dwab_file), 11, 9, (const int[]){ 1, 1, 1 });
}

static void files_cut_at_any_byte_are_refused(void **state)
{
    (void)state;

    must_refuse_each_cut(dwaa_file, sizeof(dwaa_file));
    must_refuse_each_cut(dwab_file, sizeof(dwab_file));
}

static void turned_bits_are_survived(void **state)
{
    uint8_t bytes[sizeof(dwaa_file)];
    (void)state;

    memcpy(bytes, dwaa_file, sizeof(dwaa_file));
    must_survive_turned_bits(bytes, sizeof(dwaa_file));
    memcpy(bytes, dwab_file, sizeof(dwab_file));
    must_survive_turned_bits(bytes, sizeof(dwab_file));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_coefficient_becomes_its_cosine),
    cmocka_unit_test(the_curve_is_a_power_below_one_and_an_exponential_above),
    cmocka_unit_test(red_green_and_blue_of_a_layer_come_from_luma_and_chroma),
    cmocka_unit_test(other_channels_come_back_to_the_byte),
    cmocka_unit_test(heads_that_disagree_with_the_texels_are_refused),
    cmocka_unit_test(counts_that_disagree_with_the_texels_are_refused),
    cmocka_unit_test(huffman_codes_are_canonical_and_repeat),
    cmocka_unit_test(long_huffman_codes_are_read),
    cmocka_unit_test(huffman_codes_are_not_read_beyond_their_end),
    cmocka_unit_test(files_of_the_cxx_library_decode),
    cmocka_unit_test(files_cut_at_any_byte_are_refused),
    cmocka_unit_test(turned_bits_are_survived),
};

UNIT_MAIN(tests)
