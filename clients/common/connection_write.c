#include "connection_parts.h"

#include "clock.h"
#include "mem.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

void connection_outbox_clear(struct connection *c)
{
    for (; c->out_count > 0; c->out_count--) {
        mem_free(c->outbox[c->out_first]);
        c->out_first = (c->out_first + 1) % CONNECTION_OUTBOX;
    }
}

void connection_want_write(struct connection *c)
{
    if (c->wsi && (c->state == STATE_OPEN || c->state == STATE_WELCOMED || c->state == STATE_CLOSING))
        lws_callback_on_writable(c->wsi);
}

void connection_queue(struct connection *c, json_t *object)
{
    char *text = object ? json_dumps(object, JSON_COMPACT) : NULL;
    const size_t size = text ? strlen(text) + 1 : 0;

    json_decref(object);
    if (text && c->out_count < CONNECTION_OUTBOX) {
        char *kept = mem_alloc(size, 1);
        if (kept) {
            memcpy(kept, text, size);
            c->outbox[(c->out_first + c->out_count++) % CONNECTION_OUTBOX] = kept;
        }
    } else if (text) { /* the server asks for more answers than it reads */
        connection_fail(c, CONNECTION_LOST, "%s reads nothing of what it asks for", c->address.named);
    }
    free(text);
    connection_want_write(c);
}

void connection_say(struct connection *c, json_t *object)
{
    if (c->state == STATE_WELCOMED)
        connection_queue(c, object);
    else
        json_decref(object);
}

void connection_send(struct connection *c, const uint8_t *head, size_t head_size, const uint8_t *payload, size_t size)
{
    assert(c->state == STATE_WELCOMED && !c->sending && head_size <= PROTOCOL_HEADER_MAX);
    memcpy(c->head, head, head_size);
    c->head_size = head_size;
    c->payload = payload;
    c->payload_size = size;
    c->sent = 0;
    c->sending = true;
    connection_want_write(c);
}

bool connection_is_sending(const struct connection *c)
{
    return c->sending;
}

bool connection_is_open(const struct connection *c)
{
    return c->state == STATE_WELCOMED;
}

void connection_ping(struct connection *c)
{
    c->pinged_ms = clock_ms();
    c->pinged_us = clock_wall_us();
    if (c->finishing && !c->finish_ping)
        c->finish_ping = c->ping + 1;
    connection_queue(c, json_pack("{s:s, s:I}", "op", "ping", "id", (json_int_t)++c->ping));
}

/* ---- lws: writing. One lws_write per callback. ---- */

static int write_text(struct connection *c)
{
    char *text = c->outbox[c->out_first];
    const size_t size = strlen(text);

    assert(size <= CONNECTION_CHUNK);
    memcpy(c->staging + LWS_PRE, text, size);
    mem_free(text);
    c->out_first = (c->out_first + 1) % CONNECTION_OUTBOX;
    c->out_count--;
    return lws_write(c->wsi, c->staging + LWS_PRE, size, LWS_WRITE_TEXT) < 0 ? -1 : 0;
}

static int write_fragment(struct connection *c)
{
    const size_t total = c->head_size + c->payload_size;
    const size_t count = total - c->sent < CONNECTION_CHUNK ? total - c->sent : CONNECTION_CHUNK;
    const bool first = c->sent == 0, last = c->sent + count == total;
    uint8_t *to = c->staging + LWS_PRE;
    size_t left = count;

    if (c->sent < c->head_size) {
        const size_t n = c->head_size - c->sent < left ? c->head_size - c->sent : left;
        memcpy(to, c->head + c->sent, n);
        to += n;
        left -= n;
        c->sent += n;
    }
    if (left > 0)
        memcpy(to, c->payload + (c->sent - c->head_size), left);
    c->sent += left;
    const enum lws_write_protocol flags = (enum lws_write_protocol)lws_write_ws_flags(LWS_WRITE_BINARY, first, last);
    if (lws_write(c->wsi, c->staging + LWS_PRE, count, flags) < 0)
        return -1;
    if (last) {
        c->sending = false;
        if (c->desc.hooks.sent)
            c->desc.hooks.sent(c->desc.user);
    }
    return 0;
}

/* A close frame goes between two fragments at the latest: what is left of a large message is not sent. */
int connection_write_more(struct connection *c)
{
    int result = 0;

    if (c->state == STATE_CLOSING && (!c->out_count || c->sending)) {
        lws_close_reason(c->wsi, LWS_CLOSE_STATUS_NORMAL, NULL, 0);
        return -1;
    }
    if (c->out_count > 0 && (!c->sending || c->sent == 0))
        result = write_text(c);
    else if (c->sending)
        result = write_fragment(c);
    if (c->out_count > 0 || c->sending || c->state == STATE_CLOSING)
        connection_want_write(c);
    return result;
}
