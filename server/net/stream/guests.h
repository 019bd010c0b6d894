/* Fair shares of connections. A guest is a TCP connection. It begins as an arriving guest and becomes a client when its
 * hello is accepted. Arriving guests are cheap but unauthenticated, so they have a separate pool of places. A request
 * for images over plain HTTP (watcher.c) also makes a guest a client, until the request is answered. When the
 * arriving places are full, the address with the most of them loses its oldest guest, so a newcomer from another
 * address always gets a place. When the client places are full, a newcomer whose address has fewer clients replaces
 * the newest viewer of the address with the most clients. Thread: service. */
#pragma once

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
    struct guest *previous, *next; /* in guests.first, oldest first, while arriving */
    struct lws *wsi;
    struct visitor *visitor; /* its address */
    enum guest_state state;
    struct watcher *watcher; /* of a request for images; NULL: none */
};

struct guests {
    struct guest *first, *last; /* arriving guests */
    uint32_t arriving, clients; /* their numbers */
    uint32_t most_arriving;     /* places for arriving guests; those for clients are server.max_connections */
};

/* The guest of a connection; NULL if it was refused. */
struct guest *guest_of(struct lws *wsi);

/* guest_arrive: a TCP connection opens; -1: refused, because its address has too many or memory is out. guest_leave: it
 * closes. */
int guest_arrive(struct server *s, struct lws *wsi);
void guest_leave(struct server *s, struct lws *wsi);

/* The guest's address changes to that of its client (behind a proxy). */
void guest_move(struct guest *g, struct visitor *to);

enum guest_room {
    GUEST_ROOM,
    GUEST_FULL,    /* all places are taken */
    GUEST_CROWDED, /* the address has reached its share */
};

/* Whether the guest could become a client now. */
enum guest_room guest_room(const struct server *s, const struct guest *g);

/* Makes the guest a client, replacing another one if necessary. Call it only after guest_room returned GUEST_ROOM.
 * False: the guest has lost its place meanwhile. */
bool guest_admit(struct server *s, struct guest *g);
/* The client's request is answered: it becomes an arriving guest again. */
void guest_dismiss(struct server *s, struct guest *g);

/* As guest_room, and counts and logs a refusal. Returns a text for the client; NULL: there is room. */
const char *guest_refusal(struct server *s, const struct guest *g, char *text, size_t size);
