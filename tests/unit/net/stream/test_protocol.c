/* The C codec against the golden bytes of protocol/vectors: PROTOCOL.md sections 6, 7 and 10. */
#include "support/unit.h"

#include "protocol/relight_protocol.h"

#include <dirent.h>
#include <jansson.h>
#include <stdbool.h>

struct vector {
    json_t *about;
    bool picture;
    uint8_t bytes[2048];
    size_t size;
};

static const char *const formats[] = { "", "jpeg", "exr_half", "exr_float", "h264", "changes" };
static const char *const encodings[] = { "", "file_exr", "file_hdr", "raw_half", "raw_float" };
static const char *const layouts[] = { "auto", "latlong", "cube",     "hcross",  "vcross",
                                       "ball", "fisheye", "cube-3x2", "cube-6x1" };

static int64_t number_of(const json_t *header, const char *key)
{
    const json_t *v = json_object_get(header, key);
    assert_true(json_is_integer(v));
    return json_integer_value(v);
}

static const char *word_of(const json_t *header, const char *key)
{
    const char *word = json_string_value(json_object_get(header, key));
    assert_non_null(word);
    return word;
}

static enum protocol_result decode(const struct vector *v, size_t size, struct protocol_picture *p,
                                   struct protocol_environment *e, size_t *offset)
{
    /* A block of just this size: reading past its end is seen by the sanitizer. */
    uint8_t *exact = malloc(size ? size : 1);
    assert_non_null(exact);
    memcpy(exact, v->bytes, size);
    const enum protocol_result result = v->picture ? protocol_picture_decode(exact, size, p, offset)
                                                   : protocol_environment_decode(exact, size, size, e, offset);
    free(exact);
    return result;
}

static void image_equal(const struct protocol_picture *p, const json_t *header)
{
    assert_string_equal(formats[p->format], word_of(header, "format"));
    assert_int_equal(p->flags, number_of(header, "flags"));
    assert_int_equal(p->sequence, number_of(header, "sequence"));
    assert_int_equal(p->frame, number_of(header, "frame"));
    assert_int_equal(p->capture_us, number_of(header, "captureUs"));
    assert_int_equal(p->published_us, number_of(header, "publishedUs"));
    assert_int_equal(p->queued_us, number_of(header, "queuedUs"));
    assert_int_equal(p->decoded_us, number_of(header, "decodedUs"));
    assert_int_equal(p->shaded_us, number_of(header, "shadedUs"));
    assert_int_equal(p->encoded_us, number_of(header, "encodedUs"));
    assert_int_equal(p->width, number_of(header, "width"));
    assert_int_equal(p->height, number_of(header, "height"));
    assert_true((double)p->gain == json_number_value(json_object_get(header, "gain")));
    assert_int_equal(p->samples, number_of(header, "samples"));
    assert_int_equal(p->payload, number_of(header, "payload"));
}

static void environment_equal(const struct protocol_environment *e, const json_t *header)
{
    assert_string_equal(encodings[e->encoding], word_of(header, "encoding"));
    assert_string_equal(layouts[e->layout], word_of(header, "layout"));
    assert_int_equal(e->flags, number_of(header, "flags"));
    assert_int_equal(e->channels, number_of(header, "channels"));
    assert_int_equal(e->width, number_of(header, "width"));
    assert_int_equal(e->height, number_of(header, "height"));
    assert_int_equal(e->payload, number_of(header, "payload"));
    assert_int_equal(e->frame, number_of(header, "frame"));
    assert_int_equal(e->capture_us, number_of(header, "captureUs"));
}

static void payload_equal(const struct vector *v, size_t offset, size_t size)
{
    const char *hex = word_of(v->about, "payload_hex");

    assert_int_equal(strlen(hex), 2 * size);
    for (size_t i = 0; i < size; i++) {
        char two[3];
        snprintf(two, sizeof(two), "%02x", v->bytes[offset + i]);
        assert_memory_equal(two, hex + 2 * i, 2);
    }
}

static void for_each_vector(void (*check)(const struct vector *v, const char *name))
{
    DIR *d = opendir(VECTORS);
    int seen = 0;

    assert_non_null(d);
    for (struct dirent *entry; (entry = readdir(d)) != NULL;) {
        char path[1024], *dot = strrchr(entry->d_name, '.');
        struct vector v = { 0 };
        if (!dot || strcmp(dot, ".json") != 0)
            continue;
        snprintf(path, sizeof(path), "%s/%s", VECTORS, entry->d_name);
        v.about = json_load_file(path, 0, NULL);
        assert_non_null(v.about);
        snprintf(path, sizeof(path), "%s/%.*s.bin", VECTORS, (int)(dot - entry->d_name), entry->d_name);
        FILE *in = fopen(path, "rb");
        assert_non_null(in);
        v.size = fread(v.bytes, 1, sizeof(v.bytes), in);
        fclose(in);
        v.picture = strcmp(word_of(v.about, "kind"), "picture") == 0;
        check(&v, entry->d_name);
        json_decref(v.about);
        seen++;
    }
    closedir(d);
    assert_true(seen >= 30);
}

static void check_decode(const struct vector *v, const char *name)
{
    struct protocol_picture p = { 0 };
    struct protocol_environment e = { 0 };
    size_t offset = 0;
    const enum protocol_result result = decode(v, v->size, &p, &e, &offset);
    const char *fails = json_string_value(json_object_get(v->about, "fails"));

    if (strcmp(protocol_clause(result, v->picture), fails ? fails : "") != 0)
        fail_msg("%s: clause '%s' instead of '%s'", name, protocol_clause(result, v->picture), fails ? fails : "");
    if (fails)
        return;
    const json_t *header = json_object_get(v->about, "header");
    if (v->picture)
        image_equal(&p, header);
    else
        environment_equal(&e, header);
    payload_equal(v, offset, v->picture ? p.payload : e.payload);
}

static void decode_agrees_with_every_vector(void **state)
{
    (void)state;
    for_each_vector(check_decode);
}

static void check_cut(const struct vector *v, const char *name)
{
    struct protocol_picture p = { 0 };
    struct protocol_environment e = { 0 };
    size_t offset = 12345;

    if (json_object_get(v->about, "fails"))
        return;
    for (size_t size = 0; size < v->size; size++) {
        const enum protocol_result result = decode(v, size, &p, &e, &offset);
        if (result != PROTOCOL_SHORT && result != PROTOCOL_LENGTH)
            fail_msg("%s cut at %zu: %s", name, size, protocol_result_text(result));
    }
    assert_int_equal(offset, 12345); /* untouched on failure */
    assert_int_equal(p.width, 0);
    assert_int_equal(e.payload, 0);
}

static void decode_refuses_what_is_cut_at_any_byte(void **state)
{
    (void)state;
    for_each_vector(check_cut);
}

static void check_encode(const struct vector *v, const char *name)
{
    struct protocol_picture p = { 0 };
    struct protocol_environment e = { 0 };
    uint8_t out[PROTOCOL_PICTURE_BYTES];
    const size_t today = v->picture ? PROTOCOL_PICTURE_BYTES : PROTOCOL_ENVIRONMENT_BYTES;
    size_t offset = 0;

    (void)name;
    if (json_object_get(v->about, "fails") || json_object_get(v->about, "unknown"))
        return;
    assert_int_equal(decode(v, v->size, &p, &e, &offset), PROTOCOL_OK);
    if (v->picture)
        protocol_picture_encode(&p, out);
    else
        protocol_environment_encode(&e, out);
    assert_memory_equal(out, v->bytes, today);
}

static void encode_writes_the_golden_bytes(void **state)
{
    (void)state;
    for_each_vector(check_encode);
}

static void decode_survives_any_flipped_bit(void **state)
{
    (void)state;
    struct protocol_picture p = { .format = PROTOCOL_JPEG, .sequence = 5, .width = 4, .height = 4, .payload = 3 };
    uint8_t bytes[PROTOCOL_PICTURE_BYTES + 3] = { 0 };
    size_t offset;

    protocol_picture_encode(&p, bytes);
    for (size_t bit = 0; bit < sizeof(bytes) * 8; bit++) {
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        if (protocol_picture_decode(bytes, sizeof(bytes), &p, &offset) == PROTOCOL_OK)
            assert_true(offset + p.payload == sizeof(bytes) && p.width >= 1 && p.width <= PROTOCOL_SIDE_MAX);
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
}

static void environment_is_judged_before_its_payload_arrives(void **state)
{
    (void)state;
    const struct protocol_environment e = { .encoding = PROTOCOL_FILE_EXR, .frame = 3, .payload = 1000000 };
    struct protocol_environment d = { 0 };
    uint8_t head[PROTOCOL_ENVIRONMENT_BYTES];
    size_t offset = 0;

    protocol_environment_encode(&e, head);
    assert_int_equal(protocol_environment_decode(head, sizeof(head), sizeof(head) + 1000000, &d, &offset), PROTOCOL_OK);
    assert_int_equal(d.payload, 1000000);
    assert_int_equal(protocol_environment_decode(head, sizeof(head), sizeof(head) + 999999, &d, &offset),
                     PROTOCOL_LENGTH);
}

static void only_a_whole_images_number_is_read(void **state)
{
    const struct protocol_picture p = {
        .sequence = 77, .format = PROTOCOL_JPEG, .width = 4, .height = 3, .payload = 9
    };
    uint8_t bytes[PROTOCOL_PICTURE_BYTES];
    (void)state;
    protocol_picture_encode(&p, bytes);
    assert_int_equal(protocol_picture_sequence(bytes, sizeof(bytes)), 77);
    assert_int_equal(protocol_picture_sequence(bytes, sizeof(bytes) - 1), 0);
    bytes[0] = 'X';
    assert_int_equal(protocol_picture_sequence(bytes, sizeof(bytes)), 0);
    bytes[0] = 'R';
    bytes[15] = 0xff; /* beyond the numbers of clause 1.5 */
    assert_int_equal(protocol_picture_sequence(bytes, sizeof(bytes)), 0);
}

static void every_result_has_words_and_a_clause(void **state)
{
    (void)state;
    for (int r = PROTOCOL_SHORT; r <= PROTOCOL_VALUE; r++) {
        assert_true(strlen(protocol_result_text((enum protocol_result)r)) > 10);
        assert_int_equal(protocol_clause((enum protocol_result)r, 1)[0], '6');
        assert_int_equal(protocol_clause((enum protocol_result)r, 0)[0], '7');
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(decode_agrees_with_every_vector),
    cmocka_unit_test(decode_refuses_what_is_cut_at_any_byte),
    cmocka_unit_test(encode_writes_the_golden_bytes),
    cmocka_unit_test(decode_survives_any_flipped_bit),
    cmocka_unit_test(environment_is_judged_before_its_payload_arrives),
    cmocka_unit_test(every_result_has_words_and_a_clause),
    cmocka_unit_test(only_a_whole_images_number_is_read),
};
UNIT_MAIN(tests)
