/* server/stream/visitors.h */
/* Who comes from where: of each address, how many connections it holds and how many wrong tokens came from it, so that
 * nobody takes all places and nobody guesses for long. An IPv6 address counts by its first 64 bits, since whoever has
 * one has all the others; an IPv4 one that is written as IPv6 is the IPv4 one. No socket is touched here.
 * Thread: one at a time. */
#ifndef STREAM_VISITORS_H
#define STREAM_VISITORS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct sockaddr;

#define VISITORS_GUESSES 10.0     /* wrong tokens that an address may send at once, */
#define VISITORS_GUESSES_A_S 0.1  /* and this many a second in the long run */
#define VISITORS_REMEMBERED 1024u /* addresses without a connection whose guesses are remembered */

struct visitor {
    uint8_t address[16]; /* as IPv6 */
    bool used;           /* else the row is free */
    bool loopback;       /* this machine's own */
    bool told;           /* of its guesses it was said that they are not looked at any more */
    uint32_t connections;
    uint32_t sockets; /* of these, WebSockets */
    double guesses;   /* that it may still make, as of guesses_us */
    int64_t guesses_us;
};

struct visitors {
    struct visitor *rows;
    uint32_t count;
};

/* Room for so many addresses with connections. False: out of memory. */
bool visitors_init(struct visitors *g, uint32_t connections);
void visitors_finish(struct visitors *g); /* zeroed memory is allowed */

/* The row of that address, made if need be; NULL: it is neither IPv4 nor IPv6, or all rows hold connections. now_us:
 * any clock that only rises. What it returns stays while it holds a connection. */
struct visitor *visitors_find(struct visitors *g, const struct sockaddr *address, int64_t now_us);

/* The same for the last address of an X-Forwarded-For header, which is the one that our own proxy wrote: "a, b, c".
 * Its text goes into out. NULL also when that is no address. */
struct visitor *visitors_forwarded(struct visitors *g, const char *header, int64_t now_us, char *out, size_t size);

/* Its address as text, of IPv6 the first half. Returns out. */
#define VISITOR_NAME 64
char *visitor_name(const struct visitor *v, char out[VISITOR_NAME]);

/* Whether a token from there may be looked at; and that one was wrong. */
bool visitor_may_guess(struct visitor *v, int64_t now_us);
void visitor_guessed_wrong(struct visitor *v, int64_t now_us);

#endif
