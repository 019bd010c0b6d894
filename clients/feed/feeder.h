/* A producer of relight.v1: sends a reader's parcels as credit allows, receives their fates, and after a lost
 * connection continues where the server says. Thread: the one that calls feeder_run. */
#pragma once

#include "clients/common/connection.h"
#include "clients/feed/reader.h"

struct feeder;

struct feeder_desc {
    bool lockstep;
    bool watched;                      /* the source cannot be replayed with the same numbers */
    double rate;                       /* frames per second; 0: as fast as credit allows */
    const char *sequence;              /* name of the lockstep sequence */
    struct reader_desc reader;         /* except wake and user */
    struct connection_desc connection; /* url and client_rows */
};

struct feeder_report {
    uint64_t sent; /* completely sent, including repetitions */
    uint64_t used, superseded;
    uint64_t
        refused;   /* by the server, or because they could not be read or sent; each was reported on standard error */
    uint64_t lost; /* live: sent, but the connection was lost before the fate arrived */
    bool images_lost; /* lockstep: the server lost frames that cannot be sent again */
    uint64_t passed;  /* not sent, because the server already had them */
    uint64_t bytes;
    bool complete; /* all frames have their fate and, in lockstep, their images are stored */
    bool resumed;  /* the first welcome named a frame, resume_after */
    uint64_t resume_after;
    bool has_last; /* something was sent; `last` is the last frame */
    uint64_t last;
    const struct connection *connection;
};

/* Creates a producer; the caller owns *out. Strings must outlive it. Errors of reader_create and connection_create. */
MUST_CHECK enum err feeder_create(const struct feeder_desc *d, struct feeder **out, struct reason *why);
void feeder_destroy(struct feeder *f); /* NULL is allowed */

/* Runs until everything is sent, the connection has ended for good, or a signal asks to stop; *why as in
 * connection_run. */
enum connection_end feeder_run(struct feeder *f, struct reason *why);

void feeder_report(struct feeder *f, struct feeder_report *out);
