#include "message.h"

#include "mem.h"

#include <jansson.h>

#include <assert.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

static const struct {
    const char *name;
    uint16_t close_code;
} faults[FAULT_CODES] = {
    [FAULT_NONE] = { "none", 0 },
    [FAULT_BAD_JSON] = { "bad_json", 4001 },
    [FAULT_BAD_FIELD] = { "bad_field", 4002 },
    [FAULT_BAD_ORDER] = { "bad_order", 4003 },
    [FAULT_WRONG_ROLE] = { "wrong_role", 4004 },
    [FAULT_BAD_VERSION] = { "bad_version", 4005 },
    [FAULT_BAD_TOKEN] = { "bad_token", 4006 },
    [FAULT_FULL] = { "full", 4007 },
    [FAULT_NO_HELLO] = { "no_hello", 4008 },
    [FAULT_STALLED] = { "stalled", 4009 },
    [FAULT_TOO_FAST] = { "too_fast", 4010 },
    [FAULT_TOO_BIG] = { "too_big", 1009 },
    [FAULT_UNKNOWN_OP] = { "unknown_op", 0 },
    [FAULT_NOT_OFFERED] = { "not_offered", 0 },
};

const char *fault_name(enum fault_code code)
{
    return faults[code].name;
}

uint16_t fault_close_code(enum fault_code code)
{
    return faults[code].close_code;
}

enum fault_code fault_say(struct fault *f, enum fault_code code, const char *clause, const char *format, ...)
{
    va_list args;

    f->code = code;
    f->clause = clause;
    va_start(args, format);
    vsnprintf(f->text, sizeof(f->text), format, args);
    va_end(args);
    return code;
}

/* An integer field within [least, most]; absent: *out keeps its value, unless it is required. */
static enum fault_code take_integer(const json_t *object, const char *key, bool required, int64_t least, int64_t most,
                                    int64_t *out, const char *clause, struct fault *fault)
{
    const json_t *v = json_object_get(object, key);

    if (!v && !required)
        return FAULT_NONE;
    if (!json_is_integer(v) || json_integer_value(v) < least || json_integer_value(v) > most)
        return fault_say(fault, FAULT_BAD_FIELD, clause, "%s must be an integer from %lld to %lld", key,
                         (long long)least, (long long)most);
    *out = json_integer_value(v);
    return FAULT_NONE;
}

/* One of the words, by its place among them. */
static enum fault_code take_word(const json_t *object, const char *key, const char *const *words, size_t count,
                                 size_t *out, const char *clause, struct fault *fault)
{
    const char *text = json_string_value(json_object_get(object, key));

    for (size_t i = 0; text && i < count; i++) {
        if (strcmp(text, words[i]) == 0) {
            *out = i;
            return FAULT_NONE;
        }
    }
    return fault_say(fault, FAULT_BAD_FIELD, clause, "%s must be a known word, such as \"%s\"", key, words[0]);
}

static enum fault_code parse_hello(const json_t *object, struct message *m, struct fault *fault)
{
    static const char *const roles[SERVER_ROLES] = { "viewer", "controller", "producer" };
    const json_t *version = json_object_get(object, "version");
    const json_t *token = json_object_get(object, "token");
    int64_t major = 0, minor = 0;
    size_t role = 0;

    if (!json_is_object(version))
        return fault_say(fault, FAULT_BAD_FIELD, "4.1.2", "version must be an object with major and minor");
    if (take_integer(version, "major", true, 0, 65535, &major, "4.1.2", fault) ||
        take_integer(version, "minor", false, 0, 65535, &minor, "4.1.2", fault) ||
        take_word(object, "role", roles, SERVER_ROLES, &role, "4.1.1", fault))
        return fault->code;
    if (token && (!json_is_string(token) || json_string_length(token) >= sizeof(m->hello.token)))
        return fault_say(fault, FAULT_BAD_FIELD, "4.1.3", "token must be a string of at most %zu bytes",
                         sizeof(m->hello.token) - 1);
    m->hello.role = (enum server_role)role;
    m->hello.major = (uint32_t)major;
    m->hello.minor = (uint32_t)minor;
    if (token)
        memcpy(m->hello.token, json_string_value(token), json_string_length(token) + 1);
    return FAULT_NONE;
}

static const char *const formats[] = { "jpeg", "exr_half", "exr_float" };

static enum fault_code parse_subscribe(const json_t *object, struct message *m, struct fault *fault)
{
    const json_t *rate = json_object_get(object, "max_rate");
    const json_t *paused = json_object_get(object, "paused");
    int64_t quality = 0, request = 0;
    size_t format = 0;

    if (take_word(object, "format", formats, sizeof(formats) / sizeof(formats[0]), &format, "4.3.1", fault) ||
        take_integer(object, "quality", false, 1, 100, &quality, "4.3.2", fault) ||
        take_integer(object, "request", false, 0, PROTOCOL_NUMBER_MAX, &request, "4.3.5", fault))
        return fault->code;
    /* NaN cannot be written in JSON */
    if (rate && !(json_is_number(rate) && json_number_value(rate) > 0.0 && json_number_value(rate) <= 1000.0))
        return fault_say(fault, FAULT_BAD_FIELD, "4.3.3", "max_rate must be a number above 0, at most 1000");
    if (paused && !json_is_boolean(paused))
        return fault_say(fault, FAULT_BAD_FIELD, "4.3.4", "paused must be true or false");
    m->subscribe.format = (enum protocol_format)(PROTOCOL_JPEG + format);
    m->subscribe.quality = (int)quality;
    m->subscribe.request = (uint64_t)request;
    m->subscribe.max_rate = rate ? json_number_value(rate) : 0.0;
    m->subscribe.paused = json_is_true(paused);
    return FAULT_NONE;
}

static enum fault_code parse_ack(const json_t *object, struct message *m, struct fault *fault)
{
    int64_t sequence = 0, displayed = 0;

    if (take_integer(object, "sequence", true, 1, PROTOCOL_NUMBER_MAX, &sequence, "4.5.1", fault) ||
        take_integer(object, "displayed_us", false, -PROTOCOL_NUMBER_MAX, PROTOCOL_NUMBER_MAX, &displayed, "4.5.2",
                     fault))
        return fault->code;
    m->ack.sequence = (uint64_t)sequence;
    m->ack.displayed_us = displayed;
    return FAULT_NONE;
}

static enum fault_code parse_ping(const json_t *object, struct message *m, struct fault *fault)
{
    int64_t id = 0;

    if (take_integer(object, "id", true, 0, PROTOCOL_NUMBER_MAX, &id, "4.6.1", fault))
        return fault->code;
    m->ping.id = (uint64_t)id;
    return FAULT_NONE;
}

static enum fault_code parse_object(const json_t *object, struct message *m, struct fault *fault)
{
    static const struct {
        const char *op;
        enum message_op code;
        enum fault_code (*parse)(const json_t *, struct message *, struct fault *);
    } ops[] = {
        { "hello", MESSAGE_HELLO, parse_hello },
        { "subscribe", MESSAGE_SUBSCRIBE, parse_subscribe },
        { "ack", MESSAGE_ACK, parse_ack },
        { "ping", MESSAGE_PING, parse_ping },
    };
    const char *op = json_string_value(json_object_get(object, "op"));

    if (!op)
        return fault_say(fault, FAULT_BAD_FIELD, "3.2", "op must be a string");
    for (size_t i = 0; i < sizeof(ops) / sizeof(ops[0]); i++) {
        if (strcmp(op, ops[i].op) == 0) {
            m->op = ops[i].code;
            return ops[i].parse(object, m, fault);
        }
    }
    return fault_say(fault, FAULT_UNKNOWN_OP, "3.4", "op \"%.40s\" is not known to this server", op);
}

enum fault_code message_parse(const char *text, size_t length, struct message *m, struct fault *fault)
{
    json_error_t wrong;

    *fault = (struct fault){ .clause = "" };
    *m = (struct message){ 0 };
    json_t *object = json_loadb(text, length, JSON_REJECT_DUPLICATES, &wrong);
    if (!object)
        return fault_say(fault, FAULT_BAD_JSON, "3.1", "byte %d: %s", wrong.position, wrong.text);
    if (json_is_object(object))
        parse_object(object, m, fault);
    else
        fault_say(fault, FAULT_BAD_JSON, "3.1", "the message is not a JSON object");
    json_decref(object);
    return fault->code;
}

/* The text of an object, which is given back; NULL when it could not be made. */
static char *dump(json_t *object)
{
    const size_t length = object ? json_dumpb(object, NULL, 0, JSON_COMPACT) : 0;
    char *text = length > 0 ? mem_alloc(length + 1, 1) : NULL;

    if (text && json_dumpb(object, text, length, JSON_COMPACT) != length) {
        mem_free(text);
        text = NULL;
    }
    json_decref(object);
    return text;
}

char *message_welcome(const char *session, uint32_t max_connections)
{
    return dump(json_pack("{s:s s:{s:i s:i} s:s s:s s:[s] s:[s] s:{s:i s:i s:I}}", "op", "welcome", "version", "major",
                          PROTOCOL_MAJOR, "minor", PROTOCOL_MINOR, "server", "relightd " RELIGHT_VERSION, "session",
                          session, "roles", "viewer", "formats", "jpeg", "limits", "text_bytes", PROTOCOL_TEXT_MAX,
                          "credit", PROTOCOL_CREDIT, "connections", (json_int_t)max_connections));
}

char *message_subscribed(const struct message *m)
{
    assert(m->op == MESSAGE_SUBSCRIBE);
    return dump(json_pack("{s:s s:I s:s s:b}", "op", "subscribed", "request", (json_int_t)m->subscribe.request,
                          "format", formats[m->subscribe.format - PROTOCOL_JPEG], "paused", m->subscribe.paused));
}

char *message_pong(uint64_t id, int64_t server_us)
{
    return dump(json_pack("{s:s s:I s:I}", "op", "pong", "id", (json_int_t)id, "server_us", (json_int_t)server_us));
}

char *message_error(const struct fault *fault)
{
    return dump(json_pack("{s:s s:s s:s s:s s:b}", "op", "error", "code", fault_name(fault->code), "clause",
                          fault->clause, "message", fault->text, "fatal", fault_close_code(fault->code) != 0));
}

/* JSON has no NaN or infinity, and Jansson refuses them: a figure nobody knows is 0. */
static double figure(double x)
{
    return isfinite(x) ? x : 0.0;
}

/* Words from outside (a file's name in a reason) may not be UTF-8; then they are left out rather than the message. */
static json_t *words(const char *text)
{
    json_t *s = json_string(text ? text : "");
    return s ? s : json_string("(not UTF-8)");
}

char *message_status_shared(const struct server_status *s)
{
    static const char *const sources[] = { "waiting", "live", "paused", "ended", "failed" };
    json_t *sun = s->has_sun
                      ? json_pack("{s:f s:f}", "elevation", figure(s->sun_elevation), "azimuth", figure(s->sun_azimuth))
                      : json_null();
    json_t *all = json_pack(
        "{s:o s:o s:o s:I s:I s:I s:{s:s s:o} s:I s:f s:{s:f s:f s:f s:f} s:{s:I s:I s:I s:I s:o s:I} s:{s:o s:o}}",
        "scene", words(s->scene), "sky", words(s->sky), "method", words(s->method), "samples", (json_int_t)s->samples,
        "width", (json_int_t)s->width, "height", (json_int_t)s->height, "source", "state", sources[s->source], "detail",
        words(s->detail), "frame", (json_int_t)s->frame, "fps", figure(s->fps), "stages_ms", "queued",
        figure(s->queued_ms), "decoded", figure(s->decoded_ms), "shaded", figure(s->shaded_ms), "encoded",
        figure(s->encoded_ms), "frames", "received", (json_int_t)s->received, "used", (json_int_t)s->used, "dropped",
        (json_int_t)s->dropped, "refused", (json_int_t)s->refused, "last_refusal", words(s->last_refusal), "repaired",
        (json_int_t)s->repaired, "light", "sun", sun, "time", words(s->sky_time));

    return dump(all);
}

char *message_status(const char *shared, int64_t server_us, uint32_t viewers, uint64_t sent, uint64_t skipped)
{
    static const char format[] =
        "{\"op\":\"status\",\"server_us\":%lld,\"viewers\":%u,\"sent\":%llu,\"skipped\":%llu,%s";

    assert(shared[0] == '{' && shared[1] != '}');
    const size_t room = sizeof(format) + 4 * 20 + strlen(shared);
    char *text = mem_alloc(room, 1);
    if (text)
        snprintf(text, room, format, (long long)server_us, viewers, (unsigned long long)sent,
                 (unsigned long long)skipped, shared + 1);
    return text;
}

void message_free(char *text)
{
    mem_free(text);
}
