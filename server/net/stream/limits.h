/* Counts, for /metrics, how often clients reach a limit, and logs each limit at most once a minute. */
#pragma once

#include <stdint.h>

struct server;
struct visitor;

enum limit {
    LIMIT_ARRIVALS, /* places of connections before hello; one was closed for a newcomer */
    LIMIT_CLIENTS,  /* --max-connections */
    LIMIT_ADDRESS,  /* --max-per-address */
    LIMIT_NAMES,    /* names of lockstep sequences */
    LIMIT_GUESSES,  /* wrong tokens */
    LIMITS,
};

struct limit_count {
    uint64_t reached;  /* how often, since the start */
    uint64_t logged;   /* of these, those that the log has told */
    int64_t logged_us; /* when; 0: never */
    char address[64];  /* of the last one; "": unknown */
};

/* As in the labels of /metrics. */
const char *limit_name(enum limit limit);

/* Thread: service. The limit was reached. v: the address that did; NULL: unknown. */
void limit_reached(struct server *s, enum limit limit, const struct visitor *v);

/* Thread: service. Logs what has not been logged, if it is due. */
void limits_tick(struct server *s, int64_t now_us);
