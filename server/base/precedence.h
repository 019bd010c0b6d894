/* Short urgent work goes before long work on the same processors: the long work waits between its items while urgent
 * work runs, but no longer than it had run since it last waited. So it gets at least half of the time, at normal
 * priority; with a low one it would starve beside any other program. */
#pragma once

#include <stdatomic.h>

struct precedence {
    _Atomic double until_s; /* clock_seconds: urgent work goes first until then */
    double ended_s;         /* when urgent work last ended; the urgent thread's */
};

/* credit_s: the long work counts as having run that long. */
void precedence_init(struct precedence *p, double credit_s);

/* Bracket urgent work, on one thread. p may be NULL. */
void precedence_begin(struct precedence *p);
void precedence_end(struct precedence *p);

/* Before each item of long work, on any thread: waits. p may be NULL. */
void precedence_give_way(const struct precedence *p);
