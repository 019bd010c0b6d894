/* Fair shares of connections. A guest is a TCP connection. It arrives, and becomes a client when its hello is accepted;
 * until then it costs little and has proved nothing, so arriving guests have places of their own. A request for
 * pictures by plain HTTP (watcher.c) makes it a client, too, until that is answered. When these are taken, the address
 * with most of them loses its oldest: a newcomer from another address always gets a place. When the places of clients
 * are taken, a newcomer whose address has fewer clients takes the place of the newest viewer of the address with most.
 * Thread: service. */
#ifndef STREAM_GUESTS_H
#define STREAM_GUESTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define GUESTS_ARRIVING 128 /* places before hello: enough for 20 pages that load at once */

struct lws;
struct server;
struct viewer;
struct visitor;
struct watcher;

enum guest_state {
    GUEST_ARRIVING,
    GUEST_CLIENT,
    GUEST_LEAVING, /* lost its place; will be closed */
};

struct guest {
    struct guest *previous, *next; /* in guests.first, oldest first, while it arrives */
    struct lws *wsi;
    struct visitor *visitor; /* its address */
    enum guest_state state;
    struct watcher *watcher; /* of a request for pictures; NULL: none */
};

struct guests {
    struct guest *first, *last; /* those that arrive */
    uint32_t arriving, clients; /* their numbers */
    uint32_t most_arriving;     /* places; those of clients are server.max_connections */
};

/* The guest of a connection; NULL: none, since it was refused. */
struct guest *guest_of(struct lws *wsi);

/* A TCP connection opens (-1: refused, too many from its address, or out of memory) and closes. */
int guest_arrive(struct server *s, struct lws *wsi);
void guest_leave(struct server *s, struct lws *wsi);

/* The guest turns out to be of another address (behind a proxy). */
void guest_move(struct guest *g, struct visitor *to);

enum guest_room {
    GUEST_ROOM,
    GUEST_FULL,    /* all places are taken */
    GUEST_CROWDED, /* the address has its share */
};

/* Whether the guest could become a client now. */
enum guest_room guest_room(const struct server *s, const struct guest *g);

/* Makes the guest a client, in place of another one if need be; only after guest_room returned GUEST_ROOM. False: it
 * has lost its place meanwhile. */
bool guest_admit(struct server *s, struct guest *g);
/* The client's request is answered: it becomes a guest that arrives. */
void guest_dismiss(struct server *s, struct guest *g);

/* guest_room, with the refusal counted and logged. Text for the client; NULL: there is room. */
const char *guest_refusal(struct server *s, const struct guest *g, char *text, size_t size);

#endif
