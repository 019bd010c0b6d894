/* Fields of the server's text messages, read with limits; what a server sends is outside data. Any thread. */
#pragma once

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define MESSAGE_TEXT_MAX ((size_t)256 << 10) /* bytes of a text message from a server; 1.0's have below 16 KiB */

/* The message as an object with a string `op`, which goes to *op; NULL when it is anything else. The caller decrefs. */
json_t *message_read(const uint8_t *bytes, size_t size, const char **op);

/* An integer 0..2^53-1 (times: also negative). False, and *out untouched, where there is none. */
bool message_number(const json_t *object, const char *name, uint64_t *out);
bool message_time(const json_t *object, const char *name, int64_t *out);

/* The string's beginning with all but printable ASCII as '?', for a terminal or a log; "" where there is none.
 * Returns out. */
const char *message_plain(const json_t *object, const char *name, char *out, size_t room);

/* The same for any bytes, up to a NUL. */
const char *message_plain_bytes(const void *bytes, size_t size, char *out, size_t room);

/* Whether a lockstep sequence may have this name: 1 to 64 letters, digits, '.', '_' and '-'. */
bool message_is_sequence_name(const char *name);

/* ---- The server's clock ---- */

/* Estimates how far the server's clock is ahead of this computer's, from pings (PROTOCOL.md 5.6): the shortest of the
 * last twenty round trips counts, with an error of at most half of it. Pure; one thread per estimate. */

#define OFFSET_TRIPS 20 /* 20 s: a ping a second */

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
