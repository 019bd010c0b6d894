#include "connection_parts.h"

#include "clock.h"
#include "log.h"
#include "mem.h"
#include "message.h"

#include <stdio.h>
#include <string.h>

#define FIRST_ROOM ((size_t)64 << 10)

static bool grow(struct connection_in *g, size_t more)
{
    if (g->room - g->size >= more)
        return true;
    size_t room = g->room ? g->room : FIRST_ROOM;
    while (room - g->size < more)
        room *= 2; /* sizes are bounded far below overflow */
    uint8_t *bytes = mem_grow(g->bytes, g->size, room, 1);
    if (!bytes)
        return false;
    g->bytes = bytes;
    g->room = room;
    return true;
}

static void on_welcome(struct connection *c, const json_t *welcome)
{
    uint64_t major = 0;

    if (c->state != STATE_OPEN)
        return;
    if (!message_number(json_object_get(welcome, "version"), "major", &major) || major != PROTOCOL_MAJOR) {
        connection_fail(c, CONNECTION_REFUSED, "%s speaks another version of relight than ours (%d)", c->address.named,
                        PROTOCOL_MAJOR);
        return;
    }
    connection_move_to(c, STATE_WELCOMED);
    c->open = true;
    c->welcomed++;
    if (c->told.text[0] && !c->desc.quiet)
        log_info("connected to %s", c->address.named);
    c->told.text[0] = '\0';
    connection_ping(c);
    if (c->desc.hooks.welcome)
        c->desc.hooks.welcome(c->desc.user, welcome);
}

static void on_pong(struct connection *c, const json_t *pong)
{
    uint64_t id;
    int64_t server_us;

    if (message_number(pong, "id", &id) && id == c->ping && message_time(pong, "server_us", &server_us))
        offset_add(&c->offset, c->pinged_us, clock_wall_us(), server_us);
    if (c->finishing && c->finish_ping && message_number(pong, "id", &id) && id >= c->finish_ping)
        connection_stop(c);
}

static void on_error(struct connection *c, const json_t *error)
{
    char code[40], clause[16], message[200];

    message_plain(error, "code", code, sizeof(code));
    message_plain(error, "clause", clause, sizeof(clause));
    message_plain(error, "message", message, sizeof(message));
    snprintf(c->complaint, sizeof(c->complaint), "%s: %s%s%s", code, message, clause[0] ? ", PROTOCOL.md " : "",
             clause);
    if (json_is_true(json_object_get(error, "fatal")))
        return; /* the connection is closed next, and that says it */
    log_warning("%s: %s", c->address.named, c->complaint);
    if (c->state == STATE_WELCOMED && c->desc.hooks.text)
        c->desc.hooks.text(c->desc.user, "error", error);
}

static void on_text(struct connection *c)
{
    const char *op;
    json_t *message = message_read(c->in.bytes, c->in.size, &op);

    if (!message) {
        connection_fail(c, CONNECTION_LOST, "%s sent a text that is no message of relight.v1", c->address.named);
        return;
    }
    if (strcmp(op, "welcome") == 0)
        on_welcome(c, message);
    else if (strcmp(op, "pong") == 0)
        on_pong(c, message);
    else if (strcmp(op, "error") == 0)
        on_error(c, message);
    else if (c->state == STATE_WELCOMED && c->desc.hooks.text)
        c->desc.hooks.text(c->desc.user, op, message);
    json_decref(message);
}

void connection_receive(struct connection *c, const uint8_t *in, size_t size)
{
    if (lws_is_first_fragment(c->wsi)) {
        c->in.size = 0;
        c->in_binary = lws_frame_is_binary(c->wsi);
    }
    const size_t most = c->in_binary ? c->desc.binary_most : MESSAGE_TEXT_MAX;
    if (size > most - c->in.size || lws_remaining_packet_payload(c->wsi) > most - c->in.size - size) {
        connection_fail(c, CONNECTION_LOST, "%s sent a %s message of more than %zu bytes", c->address.named,
                        c->in_binary ? "binary" : "text", most);
        return;
    }
    if (size > 0 && !grow(&c->in, size)) {
        connection_fail(c, CONNECTION_LOST, "no memory for a message of more than %zu bytes", c->in.size);
        return;
    }
    if (size > 0)
        memcpy(c->in.bytes + c->in.size, in, size);
    c->in.size += size;
    if (!lws_is_final_fragment(c->wsi) || lws_remaining_packet_payload(c->wsi) > 0)
        return;
    if (!c->in_binary)
        on_text(c);
    else if (c->state == STATE_WELCOMED && c->desc.hooks.binary)
        c->desc.hooks.binary(c->desc.user, c->in.bytes, c->in.size);
    c->in.size = 0;
}
