/* clients/feed/feeder.h */
/* A producer of relight.v1: takes parcels from a reader and sends them as credit allows, hears what became of each, and
 * after a loss goes on where the server says. Lives on the thread that calls feeder_run. */
#ifndef FEED_FEEDER_H
#define FEED_FEEDER_H

#include "connection.h"
#include "reader.h"

#include <signal.h>

struct feeder;

struct feeder_desc {
    bool lockstep;
    bool watched;                      /* the source cannot begin again with the same numbers */
    double rate;                       /* frames per second; 0: as fast as credit allows */
    const char *sequence;              /* of lockstep */
    const char *token;                 /* NULL: none */
    struct reader_desc reader;         /* but for wake and user */
    struct connection_desc connection; /* but for hooks and user */
    const volatile sig_atomic_t
        *stops; /* how often it was asked to stop: once, after the frames under way; twice, now */
};

struct feeder_report {
    uint64_t sent; /* whole, with repetitions */
    uint64_t used, superseded;
    uint64_t refused; /* by the server, or since they could not be read or sent: each was named on standard error */
    uint64_t lost;    /* live: sent, but the fate went with the connection */
    uint64_t passed;  /* not sent, since the server had them */
    uint64_t bytes;
    bool complete; /* all frames have their fate, and in lockstep their pictures are stored */
    bool resumed;  /* the first welcome named a frame, resume_after */
    uint64_t resume_after;
    bool has_last; /* something was sent; the last was frame `last` */
    uint64_t last;
    unsigned connections;
    bool has_clock; /* the server's against ours */
    int64_t ahead_us, uncertain_us;
};

/* Errors as of reader_create and connection_create. Strings must outlive the feeder. */
MUST_CHECK enum err feeder_create(const struct feeder_desc *d, struct feeder **out, struct reason *why);
void feeder_destroy(struct feeder *f); /* NULL is allowed */

/* Until all is sent, or the connection has ended for good; *why as connection_run's. */
enum connection_end feeder_run(struct feeder *f, struct reason *why);

void feeder_report(struct feeder *f, struct feeder_report *out);

#endif
