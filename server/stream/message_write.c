#include "message.h"

#include "mem.h"

#include <jansson.h>

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

const char *const message_formats[MESSAGE_FORMATS] = { "jpeg", "exr_half", "exr_float", "h264" };

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

/* The number of a connection, as texts name it. */
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

    for (int f = PROTOCOL_JPEG; f <= PROTOCOL_H264; f++)
        if (f != PROTOCOL_H264 || w->h264)
            json_array_append_new(formats, json_string(message_formats[f - PROTOCOL_JPEG]));
    all = with(all, "formats", formats);
    if (w->controllers)
        json_array_append_new(roles, json_string("controller"));
    if (w->producers)
        json_array_append_new(roles, json_string("producer"));
    all = with(all, "roles", roles);
    if (w->producer)
        all = with(all, "producer",
                   json_pack("{s:o s:i s:I s:b}", "resume_after", number_or_null(w->has_after, w->after), "credit",
                             (int)w->credit, "frame_bytes", (json_int_t)w->frame_bytes, "raw", 1));
    if (w->recorder)
        all = with(all, "recorder", json_pack("{s:o}", "stored_after", number_or_null(w->has_after, w->after)));
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

    if (fault->request > 0)
        all = with(all, "request", json_integer((json_int_t)fault->request));
    return dump(all);
}

char *message_control_shared(const struct server_control *c)
{
    json_t *all = json_object();

    if (c->has_rotate)
        all = with(all, "rotate_degrees", json_real(figure(c->rotate_degrees)));
    if (c->has_scale)
        all = with(all, "scale_stops", json_real(figure(c->scale_stops)));
    if (c->has_method)
        all = with(all, "method", words(c->method));
    if (c->has_samples) {
        all = with(all, "samples", json_integer(c->samples));
        all = with(all, "counted", json_boolean(c->counted));
    }
    if (c->has_tone)
        all = with(all, "tone", words(c->tone));
    if (c->has_exposure)
        all = with(all, "exposure_stops", c->exposure_auto ? json_null() : json_real(figure(c->exposure_stops)));
    if (c->has_bias)
        all = with(all, "bias_stops", json_real(figure(c->bias_stops)));
    if (c->has_error)
        all = with(all, "error", c->error > 0.0 ? json_real(figure(c->error)) : json_null());
    if (c->has_fps)
        all = with(all, "fps", json_real(figure(c->fps)));
    if (c->has_paths)
        all = with(all, "paths", words(c->paths));
    if (c->has_camera)
        all = with(all, "camera", words(c->camera));
    return dump(with(all, "paused", json_boolean(c->paused)));
}

char *message_control(const char *shared, uint64_t by, uint64_t request)
{
    static const char format[] = "{\"op\":\"control\",\"by\":\"%llu\",\"request\":%llu,%s";

    assert(shared[0] == '{' && shared[1] != '}');
    const size_t room = sizeof(format) + 2 * 20 + strlen(shared);
    char *text = mem_alloc(room, 1);
    if (text)
        snprintf(text, room, format, (unsigned long long)by, (unsigned long long)request, shared + 1);
    return text;
}

char *message_probed(const char *object, uint64_t request)
{
    static const char format[] = "{\"op\":\"probed\",\"request\":%llu,%s";

    assert(object[0] == '{' && object[1] != '}');
    const size_t room = sizeof(format) + 20 + strlen(object);
    char *text = mem_alloc(room, 1);
    if (text)
        snprintf(text, room, format, (unsigned long long)request, object + 1);
    return text;
}

char *message_radiance(const struct server_follow *pixel, const struct server_radiance *r)
{
    return dump(json_pack("{s:s s:i s:i s:I s:I s:b s:[f,f,f]}", "op", "radiance", "x", (int)pixel->x, "y",
                          (int)pixel->y, "frame", (json_int_t)r->frame, "capture_us", (json_int_t)r->capture_us,
                          "finer", r->finer, "radiance", figure((double)r->rgb[0]), figure((double)r->rgb[1]),
                          figure((double)r->rgb[2])));
}

/* Names that stand one a line. */
static json_t *list(const char *lines)
{
    json_t *all = json_array();

    for (const char *at = lines ? lines : ""; *at;) {
        const size_t length = strcspn(at, "\n");
        char name[64];
        snprintf(name, sizeof(name), "%.*s", (int)length, at);
        json_array_append_new(all, words(name));
        at += length + (at[length] != '\0');
    }
    return all;
}

/* Where in its source the picture's frame stands, and what may be asked for. */
static json_t *with_offers(json_t *all, const struct server_status *s)
{
    json_t *source = json_object_get(all, "source");

    if (!source) /* out of memory, which dump says */
        return all;
    json_object_set_new(source, "since_us", number_or_null(s->since_us > 0, (uint64_t)s->since_us));
    json_object_set_new(source, "kind", words(s->kind));
    json_object_set_new(source, "position", json_integer((json_int_t)s->position));
    json_object_set_new(source, "length", number_or_null(s->length > 0, s->length));
    json_object_set_new(source, "hour", s->has_hour ? json_real(figure(s->hour)) : json_null());
    all = with(all, "camera", words(s->camera));
    all = with(all, "preparing",
               s->preparing && s->preparing[0]
                   ? json_pack("{s:o s:f}", "camera", words(s->preparing), "share", figure(s->prepared))
                   : json_null());
    return with(all, "offers",
                json_pack("{s:o s:o s:o s:o}", "cameras", list(s->cameras), "methods", list(s->methods), "tones",
                          list(s->tones), "paths", list(s->paths_known)));
}

char *message_status_shared(const struct server_status *s)
{
    static const char *const sources[] = { "waiting", "live", "paused", "ended", "failed" };
    json_t *sun = s->has_sun
                      ? json_pack("{s:f s:f}", "elevation", figure(s->sun_elevation), "azimuth", figure(s->sun_azimuth))
                      : json_null();
    json_t *all = json_pack(
        "{s:o s:o s:o s:I s:I s:I s:{s:s s:o} s:I s:f s:{s:f s:f s:f s:f} s:{s:I s:I s:I s:I s:o s:I} "
        "s:{s:o s:o s:o s:o s:o s:o s:o s:o}}",
        "scene", words(s->scene), "sky", words(s->sky), "method", words(s->method), "samples", (json_int_t)s->samples,
        "width", (json_int_t)s->width, "height", (json_int_t)s->height, "source", "state", sources[s->source], "detail",
        words(s->detail), "frame", (json_int_t)s->frame, "fps", figure(s->fps), "stages_ms", "queued",
        figure(s->queued_ms), "decoded", figure(s->decoded_ms), "shaded", figure(s->shaded_ms), "encoded",
        figure(s->encoded_ms), "frames", "received", (json_int_t)s->received, "used", (json_int_t)s->used, "dropped",
        (json_int_t)s->dropped, "refused", (json_int_t)s->refused, "last_refusal", words(s->last_refusal), "repaired",
        (json_int_t)s->repaired, "light", "sun", sun, "time", words(s->sky_time), "paths", words(s->paths), "left_out",
        words(s->left_out), "error", s->error > 0.0 ? json_real(figure(s->error)) : json_null(), "computed",
        s->computing ? json_real(figure(s->computed)) : json_null(), "passes", number_or_null(s->passes > 0, s->passes),
        "converged", s->passes > 0 ? json_boolean(s->converged) : json_null());

    return dump(with_offers(all, s));
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
