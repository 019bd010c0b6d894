/* clients/common/connection_parts.h */
/* What the files of connection.h share; no client includes this. Everything on the thread of connection_run. */
#ifndef CLIENTS_CONNECTION_PARTS_H
#define CLIENTS_CONNECTION_PARTS_H

#include "address.h"
#include "connection.h"
#include "offset.h"
#include "relight_protocol.h"
#include "rng.h"

#include <libwebsockets.h>

#define CONNECTION_CHUNK ((size_t)64 << 10) /* of a message that goes out */
#define CONNECTION_OUTBOX 64                /* text messages waiting: acks, pings */

enum connection_state {
    STATE_AWAY, /* no socket; a timer may be set */
    STATE_CONNECTING,
    STATE_OPEN, /* hello is said */
    STATE_WELCOMED,
    STATE_CLOSING, /* a close frame is to go or has gone */
};

struct connection_in { /* a message coming in */
    uint8_t *bytes;
    size_t size, room;
};

struct connection {
    struct connection_desc desc;
    struct address address;
    struct lws_context *context;
    struct lws_protocols protocols[2];
    struct lws *wsi;
    enum connection_state state;
    int64_t since_ms; /* when this state began */
    lws_sorted_usec_list_t tick, retry;
    struct rng rng;

    unsigned tries;           /* since the last success */
    int64_t away_ms;          /* when the server was last there, or the start */
    bool open;                /* this connection was welcomed */
    unsigned welcomed;        /* connections so far */
    struct reason told;       /* the last trouble that was printed */
    char complaint[320];      /* of the server, before it closed; "" none */
    int close_code;           /* of its close frame; 0 none */
    bool finishing, stopping; /* asked for */
    uint64_t ping, finish_ping;
    int64_t pinged_ms, pinged_us;
    struct offset offset;

    bool over; /* connection_run returns */
    enum connection_end end;
    struct reason why;

    char *outbox[CONNECTION_OUTBOX]; /* a ring */
    size_t out_first, out_count;
    uint8_t head[PROTOCOL_HEADER_MAX];
    size_t head_size;
    const uint8_t *payload;
    size_t payload_size, sent; /* sent: of head and payload together */
    bool sending;

    struct connection_in in;
    bool in_binary;
    uint8_t staging[LWS_PRE + CONNECTION_CHUNK]; /* lws masks in place: a private copy of what goes out */
};

/* connection.c */
void connection_move_to(struct connection *c, enum connection_state state);
void connection_over(struct connection *c, enum connection_end end, const char *text); /* connection_run returns */

/* connection_write.c */
void connection_want_write(struct connection *c);
void connection_queue(struct connection *c, json_t *object); /* takes the object over */
void connection_ping(struct connection *c);
void connection_outbox_clear(struct connection *c);
int connection_write_more(struct connection *c); /* one lws_write; -1: the connection ends */

/* connection_read.c: one piece of a message */
void connection_receive(struct connection *c, const uint8_t *in, size_t size);

#endif
