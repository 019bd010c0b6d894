/* One live view of relight-bench --first-minute: a scene under a still sky, from the start of the process on.
 * Private to the room. Main thread. */
#pragma once

#include "bench/bench.h"

#define FIRST_MINUTE_ROWS 20
#define FIRST_MINUTE_GOOD 2e-2   /* relMSE, */
#define FIRST_MINUTE_BETTER 5e-3 /* likewise */
#define FIRST_MINUTE_EQUAL 1.1   /* times the error of the finished cache: as good as that */

struct first_minute_row { /* of one picture */
    double wall_s, processor_s;
    double share;  /* of the cache */
    double error;  /* relMSE against the truth */
    double stated; /* relMSE as the picture states it; 0: it states none */
    int flicker; /* since the row before: 99 % of the second differences in time are at most so many 8-bit codes; below
                  * 0: there were fewer than three pictures */
    const char *by;
};

struct first_minute_result { /* times in seconds; below 0: not reached */
    struct first_minute_row rows[FIRST_MINUTE_ROWS];
    size_t count;
    double first_s, good_s, better_s, equal_s;
    double again_s;        /* as good as the finished cache after a second start */
    double finished_error; /* relMSE; below 0: no cache was finished */
    int flicker;           /* of all pictures */
    uint64_t stated, held; /* pictures that state an error, those of them within 0.67 to 1.5 of the true one */
    bool complete;         /* the cache */
};

/* Runs desc's scene and source: first the truth, 2 x desc->rounds passes; then live pictures, for at least `least_s`
 * and with `until_complete` until the cache is complete, which goes to `folder`; then, if `finished`, another folder or
 * the same, has a complete one, a second start with that. Errors are those of bench_run. */
MUST_CHECK enum err first_minute_run(const struct bench_desc *desc, const char *folder, const char *finished,
                                     double least_s, bool until_complete, struct first_minute_result *out,
                                     struct reason *why);
