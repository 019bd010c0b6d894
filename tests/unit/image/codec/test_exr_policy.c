/* Which EXR files are taken from a network: headers made here byte by byte, and cut at every one of them. */
#include "support/unit.h"

#include "image/codec/decode.h"

#include <stdbool.h>

struct header {
    uint8_t bytes[65536];
    size_t size;
};

static void put(struct header *h, const void *bytes, size_t size)
{
    assert_true(h->size + size <= sizeof(h->bytes));
    memcpy(h->bytes + h->size, bytes, size);
    h->size += size;
}

static void put32(struct header *h, uint32_t v)
{
    const uint8_t b[4] = { (uint8_t)v, (uint8_t)(v >> 8), (uint8_t)(v >> 16), (uint8_t)(v >> 24) };
    put(h, b, 4);
}

static void put_attribute(struct header *h, const char *name, const char *type, const void *value, uint32_t size)
{
    put(h, name, strlen(name) + 1);
    put(h, type, strlen(type) + 1);
    put32(h, size);
    put(h, value, size);
}

/* Magic, version and flags, then compression; the caller ends it. */
static void begin(struct header *h, uint32_t version, uint8_t compression)
{
    static const uint8_t box[16] = { 0 };

    h->size = 0;
    put32(h, 20000630);
    put32(h, version);
    put_attribute(h, "dataWindow", "box2i", box, 16);
    put_attribute(h, "compression", "compression", &compression, 1);
}

static void end(struct header *h)
{
    put(h, "", 1);
}

/* Alone in memory, so that a sanitizer sees a step beyond its end. */
static enum err check(const struct header *h, size_t size, struct reason *why)
{
    uint8_t *exact = malloc(size ? size : 1);

    assert_non_null(exact);
    memcpy(exact, h->bytes, size);
    why->text[0] = '\0';
    const enum err e = exr_policy_check(exact, size, "sky", why);
    free(exact);
    if (e)
        assert_true(strncmp(why->text, "sky: ", 5) == 0);
    return e;
}

static struct header h;

static void compressions_are_taken_or_refused_by_name(void **state)
{
    (void)state;
    static const char *const names[] = { "PIZ", "PXR24", "B44 ", "B44A", "DWAA", "DWAB" };
    struct reason why;

    for (unsigned c = 0; c < 256; c++) {
        begin(&h, 2, (uint8_t)c);
        end(&h);
        const enum err e = check(&h, h.size, &why);
        if (c < 4) {
            assert_int_equal(e, ERR_OK);
        } else if (c < 10) {
            assert_int_equal(e, ERR_UNSUPPORTED);
            assert_non_null(strstr(why.text, names[c - 4]));
        } else {
            assert_int_equal(e, ERR_FORMAT);
        }
    }
}

static void every_flag_but_long_names_is_refused(void **state)
{
    (void)state;
    struct reason why;

    for (uint32_t bit = 0; bit < 32; bit++) {
        begin(&h, 2u ^ 1u << bit, 3);
        end(&h);
        assert_int_equal(check(&h, h.size, &why), bit == 10                            ? ERR_OK
                                                  : bit == 9 || bit == 11 || bit == 12 ? ERR_UNSUPPORTED
                                                                                       : ERR_FORMAT);
    }
}

static void a_header_cut_at_any_byte_is_refused(void **state)
{
    (void)state;
    struct reason why;

    begin(&h, 2, 2);
    put_attribute(&h, "type", "string", "scanlineimage", 13);
    end(&h);
    const size_t size = h.size;
    put(&h, "what follows", 12);
    for (size_t n = 0; n < size; n++)
        assert_int_equal(check(&h, n, &why), ERR_FORMAT);
    for (size_t n = size; n <= h.size; n++)
        assert_int_equal(check(&h, n, &why), ERR_OK);
}

static void what_is_said_twice_or_otherwise_is_not_believed(void **state)
{
    (void)state;
    static const uint8_t zip = 3, two[2] = { 3, 0 };
    struct reason why;

    begin(&h, 2, 3);
    put_attribute(&h, "compression", "compression", &zip, 1);
    end(&h);
    assert_int_equal(check(&h, h.size, &why), ERR_FORMAT);
    begin(&h, 2, 3);
    h.size -= 1 + 4 + 12 + 12; /* the compression again, of a size and of a type that it cannot have */
    put_attribute(&h, "compression", "compression", two, 2);
    end(&h);
    assert_int_equal(check(&h, h.size, &why), ERR_FORMAT);
    begin(&h, 2, 3);
    h.size -= 1 + 4 + 12 + 12;
    end(&h); /* none */
    assert_int_equal(check(&h, h.size, &why), ERR_FORMAT);
    assert_non_null(strstr(why.text, "no compression"));
    begin(&h, 2, 3);
    put_attribute(&h, "type", "string", "tiled\nimage", 11);
    end(&h);
    assert_int_equal(check(&h, h.size, &why), ERR_UNSUPPORTED);
    assert_non_null(strstr(why.text, "tiled?image"));
}

static void lengths_and_counts_that_lie_are_refused(void **state)
{
    (void)state;
    static const uint32_t lies[] = { 17, 1000000, 0x7fffffff, 0x80000000, 0xffffffff };
    struct reason why;

    for (size_t i = 0; i < sizeof(lies) / sizeof(lies[0]); i++) {
        h.size = 0;
        put32(&h, 20000630);
        put32(&h, 2);
        put(&h, "dataWindow\0box2i", 17);
        put32(&h, lies[i]);
        put(&h, "0123456789abcdef", 16);
        assert_int_equal(check(&h, h.size, &why), ERR_FORMAT);
    }
    begin(&h, 2, 3);
    for (int i = 0; i < EXR_POLICY_ATTRIBUTES; i++)
        put_attribute(&h, "n", "t", "", 0);
    end(&h);
    assert_int_equal(check(&h, h.size, &why), ERR_FORMAT);
    assert_non_null(strstr(why.text, "1024"));
    begin(&h, 2, 3);
    memset(h.bytes + h.size, 'a', 400); /* a name without end */
    h.size += 400;
    assert_int_equal(check(&h, h.size, &why), ERR_FORMAT);
    assert_non_null(strstr(why.text, "255"));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(compressions_are_taken_or_refused_by_name),
    cmocka_unit_test(every_flag_but_long_names_is_refused),
    cmocka_unit_test(a_header_cut_at_any_byte_is_refused),
    cmocka_unit_test(what_is_said_twice_or_otherwise_is_not_believed),
    cmocka_unit_test(lengths_and_counts_that_lie_are_refused),
};
UNIT_MAIN(tests)
