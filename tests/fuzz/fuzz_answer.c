/* Server messages as the command-line clients parse them: an image header, or a text message with its fields. The
 * first byte selects which. */
#include "harness.h"

#include "clients/common/message.h"
#include "protocol/relight_protocol.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void read_picture(const uint8_t *bytes, size_t size)
{
    struct protocol_picture p;
    uint8_t again[PROTOCOL_PICTURE_BYTES];
    size_t offset = 0;
    const enum protocol_result result = protocol_picture_decode(bytes, size, &p, &offset);

    if (result) {
        require(protocol_clause(result, 1)[0] == '6' && protocol_result_text(result)[0], "a fault names its clause");
        return;
    }
    require(offset >= PROTOCOL_PICTURE_BYTES && offset <= PROTOCOL_HEADER_MAX, "the header's length");
    require(p.payload > 0 && offset + p.payload == size, "header and payload add up");
    require(p.width >= 1 && p.width <= PROTOCOL_SIDE_MAX && p.height >= 1 && p.height <= PROTOCOL_SIDE_MAX, "sides");
    require(p.sequence >= 1 && p.sequence <= PROTOCOL_NUMBER_MAX && p.frame <= PROTOCOL_NUMBER_MAX, "numbers");
    require(isfinite(p.gain) && p.gain >= 0.0f, "gain");
    require(p.format >= PROTOCOL_JPEG && p.format <= PROTOCOL_CHANGES, "format");
    protocol_picture_encode(&p, again); /* the same bytes, except fields of later versions */
    require(memcmp(again + 8, bytes + 8, 68) == 0, "what was read is what was written");
}

static void read_text(const uint8_t *bytes, size_t size)
{
    static const char *const names[] = { "sequence", "number", "frames", "id", "credit", "server_us", "stored_after" };
    const char *op = NULL;
    json_t *m = message_read(bytes, size, &op);
    char plain[40];

    if (!m)
        return;
    require(size <= MESSAGE_TEXT_MAX && op != NULL, "a message is bounded and has an op");
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
        uint64_t number = 7;
        int64_t time = 7;
        require(!message_number(m, names[i], &number) || number <= PROTOCOL_NUMBER_MAX, "a number's range");
        require(!message_time(m, names[i], &time) || llabs(time) <= PROTOCOL_NUMBER_MAX, "a time's range");
        const char *text = message_plain(m, names[i], plain, sizeof(plain));
        for (; *text; text++)
            require(*text >= 0x20 && *text < 0x7f, "plain text is plain");
    }
    message_plain(m, "message", plain, 1);
    require(plain[0] == '\0', "a text fits its room");
    require(message_is_sequence_name(op) == (strlen(op) <= PROTOCOL_NAME_MAX && message_is_sequence_name(op)),
            "a name");
    json_decref(m);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    if (size == 0)
        return 0;
    /* a separate allocation, so that sanitizers detect overruns */
    uint8_t *copy = malloc(size > 1 ? size - 1 : 1);
    if (!copy)
        return 0;
    memcpy(copy, bytes + 1, size - 1);
    if (bytes[0] & 1)
        read_picture(copy, size - 1);
    else
        read_text(copy, size - 1);
    free(copy);
    return 0;
}
