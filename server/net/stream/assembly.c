#include "net/stream/ingest.h"

#include "base/half.h"
#include "base/mem.h"

#include <assert.h>
#include <string.h>

enum err block_reserve(struct block *b, size_t size)
{
    if (b->bytes && b->capacity >= size)
        return ERR_OK;
    block_finish(b);
    b->bytes = mem_alloc_raw(size, 1);
    if (!b->bytes)
        return ERR_NOMEM;
    b->capacity = size;
    return ERR_OK;
}

void block_finish(struct block *b)
{
    mem_free(b->bytes);
    *b = (struct block){ 0 };
}

void assembly_finish(struct assembly *a)
{
    block_finish(&a->payload);
    *a = (struct assembly){ .limit = a->limit };
}

/* The message's size as its header states it; assembly_add checks it against what arrives. */
static uint64_t claimed_size(const uint8_t *head)
{
    const uint32_t header = head[4] | (uint32_t)head[5] << 8;
    const uint32_t payload = head[20] | (uint32_t)head[21] << 8 | (uint32_t)head[22] << 16 | (uint32_t)head[23] << 24;

    return (uint64_t)header + payload;
}

static enum fault_code say_result(enum protocol_result result, struct fault *fault)
{
    return fault_say(fault, FAULT_BAD_FIELD, protocol_clause(result, 0), "%s", protocol_result_text(result));
}

static enum fault_code take_header(struct assembly *a, struct fault *fault)
{
    const uint64_t claimed = claimed_size(a->head);
    const enum protocol_result result =
        protocol_environment_decode(a->head, sizeof(a->head), (size_t)claimed, &a->header, &a->offset);

    if (result)
        return say_result(result, fault);
    if (claimed > a->limit)
        return fault_say(fault, FAULT_TOO_BIG, "7.7", "a frame of %llu bytes exceeds the limit of %zu",
                         (unsigned long long)claimed, a->limit);
    if (block_reserve(&a->payload, a->header.payload))
        return fault_say(fault, FAULT_TOO_BIG, "7.7", "no memory for a frame of %llu bytes",
                         (unsigned long long)claimed);
    return FAULT_NONE;
}

/* Takes the bytes that belong to the known header. Returns their number. */
static size_t gather_header(struct assembly *a, const uint8_t *in, size_t length)
{
    const size_t lacking = a->received < sizeof(a->head) ? sizeof(a->head) - a->received : 0;
    const size_t n = length < lacking ? length : lacking;

    if (n > 0) /* in may be NULL at length 0 */
        memcpy(a->head + a->received, in, n);
    a->received += n;
    return n;
}

static void gather_payload(struct assembly *a, const uint8_t *in, size_t length)
{
    /* A later version's longer header: skip what we do not know. */
    const size_t unknown = a->received < a->offset ? a->offset - a->received : 0;
    const size_t passed = length < unknown ? length : unknown;

    a->received += passed;
    if (length > passed)
        memcpy(a->payload.bytes + (a->received - a->offset), in + passed, length - passed);
    a->received += length - passed;
}

static enum fault_code take_piece(struct assembly *a, const uint8_t *in, size_t length, size_t coming, bool last,
                                  struct fault *fault)
{
    if (coming == 0 && ++a->fragments > ASSEMBLY_FRAGMENTS)
        return fault_say(fault, FAULT_TOO_BIG, "7.8", "a message in more than %d fragments", ASSEMBLY_FRAGMENTS);
    if (length > a->limit - a->received || coming > a->limit - a->received - length)
        return fault_say(fault, FAULT_TOO_BIG, "7.7", "a frame has at most %zu bytes", a->limit);
    const size_t known = a->received + length + coming; /* bytes of the message announced so far */
    const size_t n = gather_header(a, in, length);
    if (a->received >= 4 && memcmp(a->head, "RLE1", 4) != 0)
        return say_result(PROTOCOL_MAGIC, fault);
    if (a->received < sizeof(a->head)) /* and the piece is used up */
        return last && coming == 0 ? say_result(PROTOCOL_SHORT, fault) : FAULT_NONE;
    if (a->offset == 0 && take_header(a, fault))
        return fault->code;
    const size_t size = a->offset + a->header.payload;
    if (known > size || (last && known < size))
        return say_result(PROTOCOL_LENGTH, fault);
    gather_payload(a, in + n, length - n);
    a->whole = last && coming == 0;
    a->under_way = !a->whole;
    return FAULT_NONE;
}

enum fault_code assembly_add(struct assembly *a, const uint8_t *in, size_t length, size_t coming, bool last,
                             struct fault *fault)
{
    if (!a->under_way)
        *a = (struct assembly){ .limit = a->limit, .payload = a->payload, .under_way = true };
    fault->code = FAULT_NONE;
    if (take_piece(a, in, length, coming, last, fault))
        a->under_way = false;
    return fault->code;
}

/* ---- Raw texels ---- */

/* Frames are little-endian, and so is every machine this is built for: what was received is the float's own bytes. */
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "raw texels are taken as they came");

static void convert_half(struct frame *f, const uint8_t *from, unsigned channels)
{
    const size_t texels = (size_t)f->width * f->height;

    for (size_t i = 0; i < texels; i++) {
        for (unsigned c = 0; c < 3; c++) {
            uint16_t bits;
            memcpy(&bits, from + 2 * (i * channels + c), sizeof(bits));
            f->rgb[3 * i + c] = half_widen(bits);
        }
    }
}

/* Closes the gaps that alpha leaves, from the front: what is written has been read. */
static void drop_alpha(float *rgb, size_t texels)
{
    for (size_t i = 1; i < texels; i++)
        for (unsigned c = 0; c < 3; c++)
            rgb[3 * i + c] = rgb[4 * i + c];
}

static void turn_over(struct frame *f)
{
    const size_t row = 3 * (size_t)f->width;

    for (uint32_t y = 0; y < f->height / 2; y++) {
        float *upper = f->rgb + row * y, *lower = f->rgb + row * (f->height - 1 - y);
        for (size_t i = 0; i < row; i++) {
            const float t = upper[i];
            upper[i] = lower[i];
            lower[i] = t;
        }
    }
}

static void take_float(struct frame *f, const struct protocol_environment *header, struct block *payload)
{
    const struct block old = { (uint8_t *)f->rgb, f->rgb_capacity * sizeof(float) };

    f->rgb = (float *)(void *)payload->bytes; /* of mem_alloc: aligned for anything */
    f->rgb_capacity = payload->capacity / sizeof(float);
    *payload = old;
    f->kind = FRAME_TEXELS;
    f->width = header->width;
    f->height = header->height;
    if (header->channels == 4)
        drop_alpha(f->rgb, (size_t)f->width * f->height);
}

enum err texels_take(struct frame *f, const struct protocol_environment *header, struct block *payload)
{
    assert(header->channels == 3 || header->channels == 4);
    if (header->encoding == PROTOCOL_RAW_FLOAT) {
        take_float(f, header, payload);
    } else {
        assert(header->encoding == PROTOCOL_RAW_HALF);
        const enum err e = frame_reserve_texels(f, header->width, header->height);
        if (e)
            return e;
        convert_half(f, payload->bytes, header->channels);
    }
    if (header->flags & PROTOCOL_BOTTOM_FIRST)
        turn_over(f);
    return ERR_OK;
}
