#include "net/message/message.h"

#include <jansson.h>

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
    [FAULT_SUPERSEDED] = { "superseded", 4011 },
    [FAULT_BUSY] = { "busy", 4012 },
    [FAULT_TOO_SLOW] = { "too_slow", 4013 },
    [FAULT_NO_CREDIT] = { "no_credit", 4014 },
    [FAULT_BAD_UTF8] = { "bad_utf8", 1007 },
    [FAULT_TOO_BIG] = { "too_big", 1009 },
    [FAULT_UNKNOWN_OP] = { "unknown_op", 0 },
    [FAULT_NOT_OFFERED] = { "not_offered", 0 },
    [FAULT_BAD_FRAME] = { "bad_frame", 0 },
};

const char *fault_name(enum fault_code code)
{
    return faults[code].name;
}

uint16_t fault_close_code(const struct fault *f)
{
    return f->stays ? 0 : faults[f->code].close_code;
}

enum fault_code fault_say(struct fault *f, enum fault_code code, const char *clause, const char *format, ...)
{
    va_list args;

    f->code = code;
    f->clause = clause;
    f->stays = f->has_request = false;
    f->request = 0;
    va_start(args, format);
    vsnprintf(f->text, sizeof(f->text), format, args);
    va_end(args);
    return code;
}

char *fault_reason(const struct fault *f, char out[FAULT_REASON])
{
    snprintf(out, FAULT_REASON, "clause %s: %.100s", f->clause, f->text);
    /* A letter of several bytes may have been cut. */
    for (char *c = out; *c; c++)
        if (*c < 0x20 || *c > 0x7e)
            *c = '?';
    return out;
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

/* The name of a sequence into out[PROTOCOL_NAME_MAX + 1]; absent: "". */
static enum fault_code take_name(const json_t *object, const char *key, char *out, const char *clause,
                                 struct fault *fault)
{
    static const char allowed[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-";
    const json_t *v = json_object_get(object, key);
    const size_t length = json_string_length(v);

    out[0] = '\0';
    if (!v)
        return FAULT_NONE;
    if (length < 1 || length > PROTOCOL_NAME_MAX || strspn(json_string_value(v), allowed) != length)
        return fault_say(fault, FAULT_BAD_FIELD, clause, "%s must be 1 to %d of A-Z, a-z, 0-9, '.', '_' and '-'", key,
                         PROTOCOL_NAME_MAX);
    memcpy(out, json_string_value(v), length + 1);
    return FAULT_NONE;
}

static enum fault_code parse_pace(const json_t *object, struct message *m, struct fault *fault)
{
    static const char *const paces[] = { "live", "lockstep" };
    size_t pace = 0;

    if (take_name(object, "recorder", m->hello.recorder, "4.1.6", fault) ||
        take_name(object, "sequence", m->hello.sequence, "4.1.5", fault) ||
        (json_object_get(object, "pace") && take_word(object, "pace", paces, 2, &pace, "4.1.4", fault)))
        return fault->code;
    m->hello.lockstep = pace == 1;
    if (m->hello.role == SERVER_VIEWER && m->hello.recorder[0]) /* as in minor versions 0 and 1 */
        m->hello.role = SERVER_RECORDER;
    if (m->hello.role == SERVER_RECORDER && !m->hello.recorder[0])
        return fault_say(fault, FAULT_BAD_FIELD, "4.1.6", "recorder must name the sequence to record");
    if (m->hello.role == SERVER_PRODUCER && m->hello.lockstep && !m->hello.sequence[0])
        return fault_say(fault, FAULT_BAD_FIELD, "4.1.5", "sequence must name the sequence that is made in lockstep");
    return FAULT_NONE;
}

const char *const server_role_names[SERVER_ROLES] = { "viewer", "controller", "producer", "recorder" };

static enum fault_code parse_hello(const json_t *object, struct message *m, struct fault *fault)
{
    const json_t *version = json_object_get(object, "version");
    const json_t *token = json_object_get(object, "token");
    int64_t major = 0, minor = 0;
    size_t role = 0;

    if (!json_is_object(version))
        return fault_say(fault, FAULT_BAD_FIELD, "4.1.2", "version must be an object with major and minor");
    if (take_integer(version, "major", true, 0, 65535, &major, "4.1.2", fault) ||
        take_integer(version, "minor", false, 0, 65535, &minor, "4.1.2", fault) ||
        take_word(object, "role", server_role_names, SERVER_ROLES, &role, "4.1.1", fault))
        return fault->code;
    if (token && (!json_is_string(token) || json_string_length(token) >= sizeof(m->hello.token)))
        return fault_say(fault, FAULT_BAD_FIELD, "4.1.3", "token must be a string of at most %zu bytes",
                         sizeof(m->hello.token) - 1);
    m->hello.role = (enum server_role)role;
    m->hello.major = (uint32_t)major;
    if (token)
        memcpy(m->hello.token, json_string_value(token), json_string_length(token) + 1);
    return parse_pace(object, m, fault);
}

static enum fault_code parse_subscribe(const json_t *object, struct message *m, struct fault *fault)
{
    const json_t *rate = json_object_get(object, "max_rate");
    const json_t *paused = json_object_get(object, "paused");
    int64_t quality = 0, request = 0, width = 0, height = 0;
    size_t format = 0;

    if (take_word(object, "format", message_formats, MESSAGE_FORMATS, &format, "4.3.1", fault) ||
        take_integer(object, "quality", false, 1, 100, &quality, "4.3.2", fault) ||
        take_integer(object, "request", false, 0, PROTOCOL_NUMBER_MAX, &request, "4.3.5", fault) ||
        take_integer(object, "max_width", false, 1, PROTOCOL_SIDE_MAX, &width, "4.3.7", fault) ||
        take_integer(object, "max_height", false, 1, PROTOCOL_SIDE_MAX, &height, "4.3.7", fault))
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
    m->subscribe.max_width = (uint32_t)width;
    m->subscribe.max_height = (uint32_t)height;
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
    const json_t *stored = json_object_get(object, "stored");
    if (stored && !json_is_boolean(stored))
        return fault_say(fault, FAULT_BAD_FIELD, "4.5.3", "stored must be true or false");
    m->ack.sequence = (uint64_t)sequence;
    m->ack.stored = json_is_true(stored);
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

/* A slip of a hand at a control must not cost the connection. */
static enum fault_code parse_control(const json_t *object, const struct setting *controls, struct message *m,
                                     struct fault *fault)
{
    struct server_control *c = &m->control;
    struct reason why;
    const char *clause = "4.13";
    int64_t request = 0;

    if (!take_integer(object, "request", false, 0, PROTOCOL_NUMBER_MAX, &request, "4.13.1", fault) &&
        settings_from_json(controls, FOR_RELIGHTD, object, &c->asked, c->values, &clause, &why))
        fault_say(fault, FAULT_BAD_FIELD, clause, "%s", why.text);
    fault->stays = fault->has_request = true;
    c->request = fault->request = (uint64_t)request;
    return fault->code;
}

/* A boolean; absent: *has is false. */
static enum fault_code take_flag(const json_t *object, const char *key, bool *has, bool *out, const char *clause,
                                 struct fault *fault)
{
    const json_t *v = json_object_get(object, key);

    if (v && !json_is_boolean(v))
        return fault_say(fault, FAULT_BAD_FIELD, clause, "%s must be true or false", key);
    *has = v != NULL;
    *out = json_is_true(v);
    return FAULT_NONE;
}

/* A click beside the image must not cost the connection. */
static enum fault_code parse_probe(const json_t *object, struct message *m, struct fault *fault)
{
    static const char *const presets[] = { "fig1" };
    const json_t *preset = json_object_get(object, "preset");
    int64_t request = 0, x = 0, y = 0, samples = 0;
    struct server_inspection *q = &m->inspection.question;
    size_t word = 0;
    bool has_sky;

    if (take_integer(object, "request", false, 0, PROTOCOL_NUMBER_MAX, &request, "4.15.1", fault) ||
        take_flag(object, "follow", &m->inspection.has_follow, &m->inspection.follow, "4.15.5", fault) ||
        take_flag(object, "sky", &has_sky, &q->sky, "4.15.4", fault) ||
        take_integer(object, "samples", false, 1, MESSAGE_PROBE_SAMPLES_MAX, &samples, "4.15.3", fault) ||
        (preset && !json_is_null(preset) && take_word(object, "preset", presets, 1, &word, "4.15.3", fault)))
        goto failed;
    const bool somewhere = json_object_get(object, "x") || json_object_get(object, "y") || m->inspection.follow;
    q->sky_alone = q->sky && !somewhere;
    m->inspection.asks = somewhere || q->sky || !m->inspection.has_follow;
    if (m->inspection.asks && !q->sky_alone &&
        (take_integer(object, "x", true, 0, PROTOCOL_SIDE_MAX - 1, &x, "4.15.2", fault) ||
         take_integer(object, "y", true, 0, PROTOCOL_SIDE_MAX - 1, &y, "4.15.2", fault)))
        goto failed;
    q->request = (uint64_t)request;
    q->x = (uint32_t)x;
    q->y = (uint32_t)y;
    q->samples = (uint32_t)samples;
    q->figure = preset && !json_is_null(preset);
    return FAULT_NONE;
failed:
    fault->stays = fault->has_request = true;
    fault->request = (uint64_t)request;
    return fault->code;
}

static enum fault_code parse_object(const json_t *object, const struct setting *controls, struct message *m,
                                    struct fault *fault)
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
        { "end", MESSAGE_END, NULL },
        { "control", MESSAGE_CONTROL, NULL },
        { "probe", MESSAGE_PROBE, parse_probe },
    };
    const char *op = json_string_value(json_object_get(object, "op"));

    if (!op)
        return fault_say(fault, FAULT_BAD_FIELD, "3.2", "op must be a string");
    for (size_t i = 0; i < sizeof(ops) / sizeof(ops[0]); i++) {
        if (strcmp(op, ops[i].op) == 0) {
            m->op = ops[i].code;
            if (m->op == MESSAGE_CONTROL)
                return parse_control(object, controls, m, fault);
            return ops[i].parse ? ops[i].parse(object, m, fault) : FAULT_NONE;
        }
    }
    return fault_say(fault, FAULT_UNKNOWN_OP, "3.4", "op \"%.40s\" is not known to this server", op);
}

enum fault_code message_parse(const char *text, size_t length, const struct setting *controls, struct message *m,
                              struct fault *fault)
{
    json_error_t wrong;

    *fault = (struct fault){ .clause = "" };
    *m = (struct message){ 0 };
    json_t *object = json_loadb(text, length, JSON_REJECT_DUPLICATES, &wrong);
    if (!object && json_error_code(&wrong) == json_error_invalid_utf8)
        return fault_say(fault, FAULT_BAD_UTF8, "3.1", "byte %d: not UTF-8", wrong.position);
    if (!object)
        return fault_say(fault, FAULT_BAD_JSON, "3.1", "byte %d: %s", wrong.position, wrong.text);
    if (json_is_object(object))
        parse_object(object, controls, m, fault);
    else
        fault_say(fault, FAULT_BAD_JSON, "3.1", "the message is not a JSON object");
    json_decref(object);
    return fault->code;
}
