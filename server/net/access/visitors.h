/* Limits per address: open connections and wrong tokens, so that no client takes all places or keeps guessing. IPv6
 * addresses count by their first 64 bits, because one client owns all addresses below; IPv4 mapped to IPv6 counts as
 * IPv4. No sockets here. Thread: one at a time. */
#pragma once

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct sockaddr;

#define VISITORS_GUESSES 10.0          /* wrong tokens that an address may send: a token bucket, */
#define VISITORS_GUESSES_A_S 0.1       /* refilled at this rate per second */
#define VISITORS_NAMED_GUESSES 60.0    /* likewise for all addresses together that a proxy names, */
#define VISITORS_NAMED_GUESSES_A_S 1.0 /* but for those from which a right token came */
#define VISITORS_REMEMBERED 1024u      /* addresses without a connection that are remembered */

struct visitor {
    uint8_t address[16]; /* as IPv6 */
    bool used;           /* else the row is free */
    bool loopback;       /* a local address */
    bool named;          /* a proxy named it, and may have invented it */
    bool known;          /* a right token came from it */
    uint32_t connections;
    uint32_t arriving, clients; /* of these, by guest_state */
    double guesses;             /* left in the bucket at guesses_us */
    int64_t guesses_us;
};

struct visitors {
    struct visitor *rows;
    uint32_t count;
    double named_guesses; /* left in the bucket of all named addresses at named_us */
    int64_t named_us;     /* 0: never used */
};

/* Room for this many addresses with connections. False: out of memory. */
bool visitors_init(struct visitors *g, uint32_t connections);
void visitors_finish(struct visitors *g); /* zeroed memory is allowed */

/* Finds or creates the row of an address. NULL: neither IPv4 nor IPv6, or all rows have connections. now_us: monotonic.
 * The row is valid while it has a connection. */
struct visitor *visitors_find(struct visitors *g, const struct sockaddr *address, int64_t now_us);

/* The same for the last address of an X-Forwarded-For header ("a, b, c"), which our own proxy wrote. Writes its text to
 * out[size]. NULL also when that is no address. */
struct visitor *visitors_forwarded(struct visitors *g, const char *header, int64_t now_us, char *out, size_t size);

#define VISITOR_NAME 64

/* The address as text; of IPv6 the first half. Returns out. */
char *visitor_name(const struct visitor *v, char out[VISITOR_NAME]);

/* Whether a token from this address may be checked; and notes a wrong one. */
bool visitor_may_guess(struct visitors *g, struct visitor *v, int64_t now_us);
void visitor_guessed_wrong(struct visitors *g, struct visitor *v, int64_t now_us);
