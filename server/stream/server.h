/* server/stream/server.h */
/* HTTP and WebSocket on one port: the viewer page, /healthz, and relight.v1 (protocol/PROTOCOL.md) on /ws.
 * A thread of its own owns all sockets. Others hand it immutable pictures and words about the state; the newest
 * picture wins, a slow viewer skips, and nothing here ever waits for a viewer. */
#ifndef STREAM_SERVER_H
#define STREAM_SERVER_H

#include "err.h"
#include "picture.h"

#include <stdbool.h>
#include <stdint.h>

struct server;

enum server_role {
    SERVER_VIEWER,
    SERVER_CONTROLLER,
    SERVER_PRODUCER,
    SERVER_ROLES,
};

/* Zero means the default. Strings are copied. */
struct server_desc {
    const char *address;              /* numeric IPv4 or IPv6, or "localhost"; default 127.0.0.1 */
    uint16_t port;                    /* 0: any free one, see server_port */
    const char *web_dir;              /* what is served over HTTP; default: clients/web of the source tree */
    uint32_t max_connections;         /* WebSockets at once; default 128 */
    bool allow_remote;                /* an address other than loopback, and any Host name, are taken */
    const char *tokens[SERVER_ROLES]; /* what hello must carry per role; NULL: none asked */
};

/* Starts listening and starts the thread. On any error *out is NULL.
 * ERR_IO: the address is taken or cannot be had, or web_dir has no index.html. ERR_USAGE: not an address, or neither
 * loopback nor allow_remote. ERR_NOMEM. */
MUST_CHECK enum err server_create(const struct server_desc *desc, struct server **out, struct reason *why);

/* Tells every viewer that the server goes (close code 1001), waits at most two seconds for them, ends the thread.
 * No other call may be under way or follow. NULL is allowed. */
void server_destroy(struct server *s);

uint16_t server_port(const struct server *s);
const char *server_url(const struct server *s); /* "http://127.0.0.1:8080/", to print; lives as long as s */

/* Gives the picture its sequence number and time and offers it to all viewers of its format. Takes over the caller's
 * reference. A picture is published once, to one server. Any thread. */
void server_publish(struct server *s, struct picture *picture);

enum server_source {
    SERVER_WAITING, /* no frame yet */
    SERVER_LIVE,
    SERVER_PAUSED,
    SERVER_ENDED,  /* the last frame was shown and stays */
    SERVER_FAILED, /* the last frame could not be used; the one before stays: `detail` says why */
};

/* What viewers are told about twice a second, and at once when source or detail change. Strings are copied; NULL is
 * "". Phrases without capital and full stop, as they stand inside a sentence. */
struct server_status {
    const char *scene;  /* "the built-in scene" */
    const char *sky;    /* "a computed sky" */
    const char *method; /* "mis" */
    uint32_t samples;   /* per shade point */
    uint32_t width, height;
    enum server_source source;
    const char *detail; /* of the source: what it waits for, or why it failed */
    uint64_t frame;     /* number of the last environment frame used */
    double fps;         /* pictures made per second, smoothed by the caller; 0: unknown */
    double queued_ms, decoded_ms, shaded_ms, encoded_ms; /* smoothed by the caller */
    uint64_t received, used, dropped, refused;           /* environment frames so far */
    const char *last_refusal;                            /* why, and which; "" when none was */
    uint64_t repaired;    /* NaN, infinite and negative texels set to something sane so far */
    bool has_sun;         /* the next three are known */
    double sun_elevation; /* degrees above the horizon */
    double sun_azimuth;   /* degrees, clockwise from north */
    const char *sky_time; /* the sky's own clock, "14:35" */
};

/* Any thread. */
void server_set_status(struct server *s, const struct server_status *status);

/* What is wanted just now, so that nothing is rendered or encoded that nobody looks at. Any thread. */
struct server_demand {
    uint32_t viewers; /* subscribed and not paused */
    uint32_t formats; /* bit 1 << enum protocol_format for each that somebody watches */
    int jpeg_quality; /* the best anyone wishes, 1..100; 0: nobody said */
    double max_rate;  /* the highest anyone takes, pictures per second; 0: no limit */
};
void server_demand(struct server *s, struct server_demand *out);

/* Counters since the start. Any thread. */
struct server_counters {
    uint64_t connections; /* WebSockets accepted */
    uint64_t open;        /* of these, still there */
    uint64_t refused;     /* handshakes and connections turned away */
    uint64_t errors;      /* protocol errors, whatever they cost */
    uint64_t published;   /* pictures */
    uint64_t sent;        /* pictures, whole, to any viewer */
    uint64_t skipped;     /* pictures that a viewer did not get since it was slow, paused or rate-limited */
    uint64_t acked;
    uint64_t bytes;   /* of pictures handed to the kernel */
    uint64_t stalled; /* connections cut since they took no bytes */
};
void server_counters(struct server *s, struct server_counters *out);

#endif
