/* What one client may take from the others. A client is an address; of IPv6 its first 64 bits, because one owner has
 * all addresses below them, and IPv4 mapped to IPv6 counts as IPv4. A connection is one socket of a client. It arrives,
 * and is admitted when its hello is accepted, or while a request for images over plain HTTP (watcher.c) is answered.
 * Arriving connections are cheap but unauthenticated, so they have places of their own: when these are full, the
 * client with the most of them loses its oldest, so a newcomer from elsewhere always gets one. When the places of
 * admitted connections are full, a newcomer whose client has fewer replaces the newest of the client with the most.
 * Wrong tokens, messages and bytes beside messages are limited by token buckets. limits.c has no sockets; connection.c
 * has them. Thread: service, unless noted. */
#pragma once

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct lws;
struct server;
struct sockaddr;
struct watcher;
struct websocket;

#define ARRIVING_MOST 128        /* places before hello: enough for 20 pages that load at once */
#define CLIENT_GUESSES 10.0      /* wrong tokens that a client may send: a token bucket, */
#define CLIENT_GUESSES_A_S 0.1   /* refilled at this rate per second */
#define GROUP_GUESSES 60.0       /* likewise for all clients of a group together, */
#define GROUP_GUESSES_A_S 1.0    /* but for those from which a right token came */
#define FIRST_GUESSES 20.0       /* and when these are used up, for those of it that never sent a wrong one, so that */
#define FIRST_GUESSES_A_S 0.5    /* a few clients cannot lock out all others */
#define CLIENTS_REMEMBERED 1024u /* clients without a connection that are remembered */
#define FLOOD_BURST (256 << 10)  /* bytes beside messages at once: a token bucket, */
#define FLOOD_RATE (64 << 10)    /* refilled at this rate per second */
#define CLIENT_NAME 64

/* ---- Token buckets ---- */

struct bucket {
    double left;
    int64_t at_us; /* when it was filled last, monotonic; 0: never, and it is full */
};

/* Refills it at `rate` per second, up to `most`. Returns what is in it. */
double bucket_fill(struct bucket *b, double most, double rate, int64_t now_us);
/* The same, and takes one; false: there is less. */
bool bucket_take(struct bucket *b, double most, double rate, int64_t now_us);

/* ---- Clients and their connections ---- */

enum connection_state {
    CONNECTION_ARRIVING,
    CONNECTION_ADMITTED,
    CONNECTION_LEAVING, /* lost its place; will be closed */
    CONNECTION_STATES,
};

struct client {
    uint8_t address[16]; /* as IPv6 */
    bool used;           /* else the row is free */
    bool loopback;       /* a local address */
    bool named;          /* a proxy named it, and may have invented it */
    bool known;          /* a right token came from it */
    bool guessed;        /* a wrong one did */
    uint32_t connections[CONNECTION_STATES];
    struct bucket guesses;
    uint64_t answered; /* {lock of the server} the turn in which a question of its about a pixel was taken last */
};

struct connection {
    struct connection *previous, *next; /* in struct limits */
    struct lws *wsi;
    struct client *client;
    enum connection_state state;
    struct watcher *watcher;     /* of a request for images; NULL: none */
    struct websocket *websocket; /* after the upgrade; NULL: none */
};

enum limit {
    LIMIT_ARRIVALS, /* places of arriving connections; one was closed for a newcomer */
    LIMIT_CLIENTS,  /* --max-connections */
    LIMIT_ADDRESS,  /* --max-per-address */
    LIMIT_NAMES,    /* names of lockstep sequences */
    LIMIT_GUESSES,  /* wrong tokens */
    LIMIT_MEMORY,   /* images and texts that clients hold (holdings.c); a connection was cut */
    LIMIT_WIDTHS,   /* renditions for plain HTTP (watcher.c) */
    LIMIT_PIXELS,   /* questions about pixels that wait, or followed pixels */
    LIMITS,
};

struct limit_count {
    atomic_uint_fast64_t reached; /* how often, since the start. Any thread may read it */
    uint64_t logged;              /* of these, those that the log has told */
    int64_t logged_us;            /* when; 0: never */
    char address[CLIENT_NAME];    /* of the last one; "": unknown */
};

/* Clients of which one person may have any number: those that a proxy names, which it may have invented, and those of
 * this machine, 127.0.0.0/8. */
enum guess_group { GROUP_NAMED, GROUP_LOCAL, GUESS_GROUPS };

struct limits {
    struct client *clients; /* [count] */
    uint32_t count;
    struct {
        struct bucket all, first;
    } guesses[GUESS_GROUPS];
    struct connection *first, *last;         /* by the time of their last change of state, the oldest first */
    uint32_t connections[CONNECTION_STATES]; /* their numbers */
    uint32_t most_arriving, most_admitted, per_address;
    bool per_address_given; /* then loopback is limited too */
    struct limit_count reached[LIMITS];
};

/* Room for this many clients with connections. False: out of memory. */
bool limits_init(struct limits *l, uint32_t connections);
void limits_finish(struct limits *l); /* zeroed memory is allowed */

/* An address as IPv6. False: neither IPv4 nor IPv6. Any thread. */
bool address_take(const struct sockaddr *address, uint8_t out[16]);
bool address_read(const char *text, uint8_t out[16]);

/* Finds or creates the client of an address. NULL: all rows have connections. now_us: monotonic. The row is valid while
 * it has a connection. */
struct client *client_find(struct limits *l, const uint8_t address[16], int64_t now_us);
/* The same for the last address of an X-Forwarded-For header ("a, b, c"), which our own proxy wrote. NULL also when
 * that is no address. */
struct client *client_forwarded(struct limits *l, const char *header, int64_t now_us);

/* The address as text; of IPv6 the first half. Returns out. */
char *client_name(const struct client *c, char out[CLIENT_NAME]);
/* In any state. */
uint32_t client_connections(const struct client *c);

/* Of a resource with a fixed number of places, all taken, by holders[count] (NULL: by several): the last place of the
 * client that has most, if that has at least two more than `by`; -1: nobody gives way. */
int client_crowds(const struct client *const holders[], unsigned count, const struct client *by);

/* Whether a token from this client may be checked; and notes a wrong one. */
bool client_may_guess(struct limits *l, struct client *c, int64_t now_us);
void client_guessed_wrong(struct limits *l, struct client *c, int64_t now_us);

/* ---- Reports ---- */

/* As in the labels of /metrics. */
const char *limit_name(enum limit limit);
/* Counts that a client reached the limit; c NULL: an unknown one. */
void limit_reached(struct limits *l, enum limit limit, const struct client *c);
/* Logs what has not been logged, each limit at most once a minute. */
void limits_tick(struct limits *l, int64_t now_us);

/* ---- connection.c ---- */

/* The connection of a socket; NULL if it was refused. */
struct connection *connection_of(struct lws *wsi);
/* A socket opens; -1: refused, because its client has too many or memory is out. It closes. */
int connection_open(struct server *s, struct lws *wsi);
void connection_close(struct server *s, struct lws *wsi);
/* Before the upgrade: behind a proxy, the connection is one of the client in X-Forwarded-For. False: bad header. */
bool connection_forwarded(struct server *s, struct lws *wsi);

/* Why it could not be admitted now, counted, in text; NULL: it could. */
const char *connection_refusal(struct server *s, const struct connection *c, char *text, size_t size);
/* Admits it, in another's place if necessary. Call it only after connection_refusal returned NULL. False: it has lost
 * its place meanwhile. */
bool connection_admit(struct server *s, struct connection *c);
/* Its request is answered: it is an arriving one again. */
void connection_dismiss(struct server *s, struct connection *c);

enum token_check {
    TOKEN_RIGHT,
    TOKEN_WRONG,
    TOKEN_LATER, /* not compared, because its client sent too many wrong ones */
};
/* Compares the token that a connection has given with that of the role, NULL: none, in constant time. A wrong one
 * counts against the client. */
enum token_check token_check(struct server *s, struct lws *wsi, const char *given, const char *wanted);
/* The same for a request's Authorization: Bearer, or Basic with the token as password. */
enum token_check token_check_header(struct server *s, struct lws *wsi, const char *wanted);

/* Bytes that a WebSocket sends outside messages: pings, pongs and empty frames. libwebsockets handles these itself and
 * reports few of them, so bytes are counted: those that TCP has delivered, minus those of messages. */
struct flood {
    int64_t read, messages; /* bytes read at the start, and bytes of messages since */
    int64_t beside;         /* the most that other bytes have been */
    struct bucket bucket;
};
/* Begins to count; closes ws if it sent too much else. Who receives a piece of a message adds it to flood.messages. */
void flood_begin(struct websocket *ws);
void flood_check(struct websocket *ws);
