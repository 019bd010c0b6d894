/* Which techniques win at equal time, at equal error and over all panels, and how far the others are behind. Pure
 * functions of panels; any thread. */
#pragma once

#include "measure/chart/panel.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define MARKS 3 /* a quarter, half and three quarters of the way through a panel's times, in log */
#define MARK_MIDDLE 1
#define TECHNIQUES_MAX 32

struct standing {              /* of one curve */
    bool has_error[MARKS];     /* it makes an image in that time at all */
    double error[MARKS];       /* at that time */
    bool error_at_most[MARKS]; /* all its budgets take less time: `error` is that of its last point */
    bool reached[MARKS];       /* it reaches that error within its budgets */
    bool at_most[MARKS];       /* its first point has less error already: `seconds` is that point's */
    double seconds[MARKS];     /* of the frame that has that error */
    double break_even; /* of TECHNIQUE_PREPARED: frames after which its precomputation pays off against the first
                        * of the others at the middle error; 0: never, or unknown */
};

struct winners {
    double seconds[MARKS]; /* equal times */
    double error[MARKS];   /* equal errors: the least at those times */
    int by_error[MARKS];   /* the curve with the least error at that time; -1: none has one there */
    int by_seconds[MARKS]; /* the curve that reaches that error first; -1: none does */
    struct standing of[TECHNIQUES_MAX];
    bool auto_known;
    struct envelope_verdict automatic; /* auto against the envelope of the fixed techniques */
    struct envelope_verdict filtered[ERROR_KINDS]; /* a TECHNIQUE_FILTERED against the same one unfiltered, by each
                                                    * kind of error; limit 1. Unknown if the panel lacks either */
};

#define ENVELOPE_LIMIT 1.1
#define WIN_MARGIN 1.05

/* By medians of this error. rounds: of the bootstrap. ERR_NOMEM. */
MUST_CHECK enum err winners_find(const struct panel *p, enum error_kind kind, uint32_t rounds, struct winners *out);

/* One technique over all panels of a class of light, by its error at the middle time over the best there. */
struct ranking {
    const struct technique *technique;
    uint32_t panels;    /* where it can be compared */
    uint32_t wins;      /* where its error is the least, or within WIN_MARGIN of it */
    double mean_ratio;  /* geometric mean */
    double worst_ratio; /* >= 1 */
    size_t worst_panel;
};

/* Sorted: those that are in all panels of the class by their worst ratio, then the others. panel_count panels with
 * their winners, of any class; room for TECHNIQUES_MAX. Returns how many. */
size_t winners_rank(const struct panel *const *panels, const struct winners *winners, size_t panel_count,
                    enum light_class light_class, struct ranking out[TECHNIQUES_MAX]);
