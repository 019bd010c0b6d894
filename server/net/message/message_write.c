#include "net/message/message.h"

#include "base/mem.h"
#include "base/text.h"

#include <jansson.h>

#include <assert.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

const char *const message_formats[MESSAGE_FORMATS] = { "jpeg", "exr_half", "exr_float", "h264", "changes" };

/* Serializes an object and releases it. NULL: out of memory. */
static char *dump(json_t *object)
{
    char *text = object ? json_dumps(object, JSON_COMPACT) : NULL;

    json_decref(object);
    return text;
}

/* JSON has no NaN or infinity: an unknown figure is 0. */
static double figure(double x)
{
    return isfinite(x) ? x : 0.0;
}

/* Text from outside (a file name in a reason) may not be UTF-8; then only the text is left out. */
static json_t *words(const char *text)
{
    json_t *s = json_string(text ? text : "");
    return s ? s : json_string("(not UTF-8)");
}

/* Adds to an object that may be NULL, and then frees the value: what could not be made ends as no message at all. */
static json_t *with(json_t *object, const char *key, json_t *value)
{
    if (json_object_set_new(object, key, value) == 0) /* else it has freed the value, also where there is no object */
        return object;
    json_decref(object);
    return NULL;
}

static json_t *number_or_null(bool known, uint64_t number)
{
    return known ? json_integer((json_int_t)number) : json_null();
}

/* A connection's number as text. */
static json_t *name_of(uint64_t id)
{
    char text[24];

    snprintf(text, sizeof(text), "%llu", (unsigned long long)id);
    return json_string(text);
}

char *message_welcome(const struct welcome *w)
{
    json_t *roles = json_pack("[s]", "viewer");
    json_t *all = json_pack("{s:s s:{s:i s:i} s:s s:s s:o s:{s:i s:i s:I}}", "op", "welcome", "version", "major",
                            PROTOCOL_MAJOR, "minor", PROTOCOL_MINOR, "server", "relightd " RELIGHT_VERSION, "session",
                            w->session, "id", name_of(w->id), "limits", "text_bytes", PROTOCOL_TEXT_MAX, "credit",
                            PROTOCOL_CREDIT, "connections", (json_int_t)w->max_connections);
    json_t *formats = json_array();

    for (int f = PROTOCOL_JPEG; f <= PROTOCOL_CHANGES; f++)
        if (f != PROTOCOL_H264 || w->h264)
            json_array_append_new(formats, json_string(message_formats[f - PROTOCOL_JPEG]));
    all = with(all, "formats", formats);
    if (w->controllers)
        json_array_append_new(roles, json_string("controller"));
    if (w->producers)
        json_array_append_new(roles, json_string("producer"));
    if (w->recorders)
        json_array_append_new(roles, json_string("recorder"));
    all = with(all, "roles", roles);
    if (w->producer)
        all = with(all, "producer",
                   json_pack("{s:o s:i s:I s:b}", "resume_after", number_or_null(w->has_after, w->after), "credit",
                             (int)w->credit, "frame_bytes", (json_int_t)w->frame_bytes, "raw", 1));
    if (w->recorder)
        all = with(all, "recorder", json_pack("{s:o}", "stored_after", number_or_null(w->has_after, w->after)));
    if (w->controls)
        all = with(all, "controls", settings_ranges(w->controls, FOR_CONTROL));
    return dump(all);
}

char *message_subscribed(const struct message *m)
{
    assert(m->op == MESSAGE_SUBSCRIBE);
    return dump(json_pack("{s:s s:I s:s s:b}", "op", "subscribed", "request", (json_int_t)m->subscribe.request,
                          "format", message_formats[m->subscribe.format - PROTOCOL_JPEG], "paused",
                          m->subscribe.paused));
}

char *message_pong(uint64_t id, int64_t server_us)
{
    return dump(json_pack("{s:s s:I s:I}", "op", "pong", "id", (json_int_t)id, "server_us", (json_int_t)server_us));
}

char *message_credit(uint32_t frames)
{
    return dump(json_pack("{s:s s:I}", "op", "credit", "frames", (json_int_t)frames));
}

char *message_fate(uint64_t number, enum server_fate fate, uint64_t sequence, const struct fault *fault)
{
    static const char *const fates[] = { "used", "superseded", "refused" };
    json_t *all = json_pack("{s:s s:I s:s}", "op", "frame", "number", (json_int_t)number, "fate", fates[fate]);

    if (sequence > 0)
        all = with(all, "sequence", json_integer((json_int_t)sequence));
    if (fault && fault->code) {
        all = with(all, "code", json_string(fault_name(fault->code)));
        all = with(all, "clause", json_string(fault->clause));
        all = with(all, "message", words(fault->text));
    }
    return dump(all);
}

char *message_sequence(const char *name, uint64_t stored)
{
    return dump(
        json_pack("{s:s s:s s:s s:I}", "op", "sequence", "name", name, "state", "ended", "stored", (json_int_t)stored));
}

char *message_error(const struct fault *fault)
{
    json_t *all = json_pack("{s:s s:s s:s s:o s:b}", "op", "error", "code", fault_name(fault->code), "clause",
                            fault->clause, "message", words(fault->text), "fatal", fault_close_code(fault) != 0);

    if (fault->has_request)
        all = with(all, "request", json_integer((json_int_t)fault->request));
    return dump(all);
}

char *message_control_shared(const struct setting *controls, const void *values)
{
    return dump(settings_to_json(controls, SETTING_TOLD, values));
}

/* The text of an object whose first members are these, and the others those of another's text. */
PRINTF_LIKE(2, 3) static char *join(const char *others, const char *first, ...)
{
    struct text t = { .bytes = NULL };
    char members[256];
    va_list args;

    assert(others[0] == '{' && others[1] != '}');
    va_start(args, first);
    vsnprintf(members, sizeof(members), first, args);
    va_end(args);
    text_add(&t, "{%s,%s", members, others + 1);
    if (t.failed)
        text_finish(&t);
    return t.bytes;
}

char *message_control(const char *shared, uint64_t by, uint64_t request)
{
    return join(shared, "\"op\":\"control\",\"by\":\"%llu\",\"request\":%llu", (unsigned long long)by,
                (unsigned long long)request);
}

char *message_inspected(const char *object, uint64_t request)
{
    return join(object, "\"op\":\"probed\",\"request\":%llu", (unsigned long long)request);
}

char *message_radiance(const struct server_follow *pixel, const struct server_radiance *r)
{
    return dump(json_pack("{s:s s:i s:i s:I s:I s:b s:[f,f,f]}", "op", "radiance", "x", (int)pixel->x, "y",
                          (int)pixel->y, "frame", (json_int_t)r->frame, "capture_us", (json_int_t)r->capture_us,
                          "finer", r->finer, "radiance", figure((double)r->rgb[0]), figure((double)r->rgb[1]),
                          figure((double)r->rgb[2])));
}

/* ended by NULL, or NULL */
static json_t *list(const char *const *names)
{
    json_t *all = json_array();

    for (; names && *names; names++)
        json_array_append_new(all, words(*names));
    return all;
}

static json_t *value_of(const struct figure *row, const struct server_figures *f)
{
    const void *at = (const char *)f + row->offset;

    switch (row->type) {
    case FIGURE_BOOL: return json_boolean(*(const bool *)at);
    case FIGURE_U32: return json_integer(*(const uint32_t *)at);
    case FIGURE_U64: return json_integer((json_int_t) * (const uint64_t *)at);
    case FIGURE_KNOWN:
    case FIGURE_DOUBLE: return json_real(figure(*(const double *)at));
    case FIGURE_TEXT: return words(at);
    case FIGURE_LIST: return list(*(const char *const *const *)at);
    }
    return NULL;
}

/* Sets a member by its path, "source.detail". Takes value over. False: out of memory. */
static bool set_at(json_t *object, const char *path, json_t *value)
{
    const char *dot = strchr(path, '.');
    char name[16];

    if (!dot)
        return json_object_set_new(object, path, value) == 0;
    snprintf(name, sizeof(name), "%.*s", (int)(dot - path), path);
    json_t *inner = json_object_get(object, name);
    if (!inner && json_object_set_new(object, name, inner = json_object()) != 0) {
        json_decref(value);
        return false;
    }
    return set_at(inner, dot + 1, value);
}

/* What is unknown is null. */
static bool set_unknown(json_t *all, const struct server_figures *f)
{
    const bool computing = f->cache_share > 0.0 && f->cache_share < 1.0;
    const struct {
        const char *path;
        bool known;
    } parts[] = {
        { "source.since_us", f->since_us > 0 }, { "source.length", f->length > 0 },
        { "source.hour", f->has_hour },         { "light.sun", f->has_sun },
        { "light.error", f->error > 0.0 },      { "light.computed", computing },
        { "light.passes", f->passes > 0 },      { "light.converged", f->passes > 0 },
        { "source.day", f->has_place },         { "place", f->has_place },
        { "preparing", f->preparing[0] },       { "lamps", f->lamp_samples_wanted > 0 },
    };
    bool ok = f->error_at_most > 0.0 || set_at(all, "light.error_at_most", json_null());

    for (size_t i = 0; i < sizeof(parts) / sizeof(parts[0]); i++)
        ok = ok && (parts[i].known || set_at(all, parts[i].path, json_null()));
    return ok;
}

static bool has_name(const char *const *names, const char *name)
{
    while (names && *names && strcmp(*names, name) != 0)
        names++;
    return names && *names;
}

/* The names of choices that controllers may ask for. */
static bool set_offers(json_t *all, const struct setting *controls, const struct server_figures *f)
{
    json_t *offers = json_object_get(all, "offers");
    bool ok = true;

    for (const struct setting *row = controls; row && row->key; row++) {
        json_t *names = row->offers ? json_array() : NULL;
        for (const struct setting_choice *c = row->choices; names && c->name; c++)
            if (choice_has(c->programs, FOR_CONTROL) && !has_name(f->not_offered, c->name))
                json_array_append_new(names, json_string(c->name));
        ok = ok && (!row->offers || json_object_set(offers, row->offers, names) == 0);
        json_decref(names);
    }
    return ok;
}

/* Where live images are published, as PROTOCOL.md 4.8 has it. */
static bool set_publish(json_t *all, const struct server_figures *f)
{
    json_t *list = json_array();
    bool ok = list != NULL;

    for (uint32_t i = 0; ok && i < f->publish_count; i++) {
        const struct server_publish *p = &f->publish[i];
        ok = 0 == json_array_append_new(list, json_pack("{s:o, s:s, s:o, s:f, s:I, s:I, s:I}", "to", words(p->to),
                                                        "state", server_publish_state_name(p->state), "detail",
                                                        words(p->detail), "mbit", figure(1e-6 * p->bits_per_second),
                                                        "frames", (json_int_t)p->frames, "dropped",
                                                        (json_int_t)p->dropped, "retries", (json_int_t)p->retries));
    }
    return json_object_set_new(all, "publish", list) == 0 && ok; /* which takes the list over in either case */
}

char *message_status_shared(const struct server_figures *f, const struct setting *controls)
{
    static const char *const sources[] = { "waiting", "live", "paused", "ended", "failed" };
    json_t *all = json_object();
    bool ok = all != NULL;

    for (const struct figure *row = server_figure_table; row->json || row->metric; row++)
        ok = ok && (!row->json || set_at(all, row->json, value_of(row, f)));
    ok = ok && set_at(all, "source.state", json_string(sources[f->source])) &&
         set_at(all, "source.since_us", json_integer(f->since_us)) && set_unknown(all, f) &&
         set_offers(all, controls, f) && set_publish(all, f);
    if (ok)
        return dump(all);
    json_decref(all);
    return NULL;
}

char *message_status(const char *shared, int64_t server_us, uint32_t viewers, uint64_t sent, uint64_t skipped)
{
    return join(shared, "\"op\":\"status\",\"server_us\":%lld,\"viewers\":%u,\"sent\":%llu,\"skipped\":%llu",
                (long long)server_us, viewers, (unsigned long long)sent, (unsigned long long)skipped);
}

void message_free(char *text)
{
    mem_free(text);
}
