#include "clients/common/message.h"

#include "protocol/relight_protocol.h"

#include <string.h>

#define NAME_MOST 64 /* bounds names from the network */

json_t *message_read(const uint8_t *bytes, size_t size, const char **op)
{
    json_t *object = json_loadb((const char *)bytes, size, JSON_REJECT_DUPLICATES, NULL);

    *op = json_string_value(json_object_get(object, "op")); /* NULL in, NULL out */
    if (*op)
        return object;
    json_decref(object);
    return NULL;
}

bool message_time(const json_t *object, const char *name, int64_t *out)
{
    const json_t *v = json_object_get(object, name);

    if (!json_is_integer(v) || json_integer_value(v) > PROTOCOL_NUMBER_MAX ||
        json_integer_value(v) < -PROTOCOL_NUMBER_MAX)
        return false;
    *out = json_integer_value(v);
    return true;
}

bool message_number(const json_t *object, const char *name, uint64_t *out)
{
    int64_t v;

    if (!message_time(object, name, &v) || v < 0)
        return false;
    *out = (uint64_t)v;
    return true;
}

const char *message_plain_bytes(const void *bytes, size_t size, char *out, size_t room)
{
    const unsigned char *in = bytes;
    size_t n = 0;

    for (; n < size && n + 1 < room && in[n]; n++)
        out[n] = in[n] >= ' ' && in[n] <= '~' ? (char)in[n] : '?';
    out[n] = '\0';
    return out;
}

const char *message_plain(const json_t *object, const char *name, char *out, size_t room)
{
    const json_t *v = json_object_get(object, name);

    return message_plain_bytes(json_is_string(v) ? json_string_value(v) : "", json_string_length(v), out, room);
}

bool message_is_sequence_name(const char *name)
{
    static const char allowed[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-";
    const size_t n = strlen(name);

    return n >= 1 && n <= NAME_MOST && strspn(name, allowed) == n;
}
