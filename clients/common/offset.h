/* Estimates how far the server's clock is ahead of this computer's, from pings (PROTOCOL.md 5.6): the shortest of the
 * last twenty round trips counts, with an error of at most half of it. Pure; one thread per estimate. */
#pragma once

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define OFFSET_TRIPS 20

struct offset_trip {
    int64_t ahead_us, trip_us;
};

struct offset { /* zeroed memory is an estimate without any ping */
    struct offset_trip trips[OFFSET_TRIPS];
    size_t count; /* trips so far; the last OFFSET_TRIPS are kept */
};

/* One answer: sent and received on this computer's clock, server_us on the server's. A clock that stepped back in
 * between makes it useless: it is left out. */
void offset_add(struct offset *o, int64_t sent_us, int64_t received_us, int64_t server_us);

/* The estimate and what it may be off by; false while there is none. */
bool offset_get(const struct offset *o, int64_t *ahead_us, int64_t *uncertain_us);
