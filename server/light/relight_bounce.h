/* Interreflection by a cache (bounce/bounce.h) beside that of direct light, where a picture asks for it and leaves to
 * the plan by whom. One thread. */
#ifndef LIGHT_RELIGHT_BOUNCE_H
#define LIGHT_RELIGHT_BOUNCE_H

#include "bounce/bounce.h"
#include "light/relight.h"
#include "light/relight_keep.h"
#include "transport/transport.h"

struct relight_bounce { /* zeroed at first */
    struct bounce *bounce;
    bool loaded;  /* out of a file */
    bool refused; /* it takes more memory than it may, which is said in the log; eye paths take its part */
};

void relight_bounce_finish(struct relight_bounce *b);

/* Whether it is to take PATH_INDIRECT_LIT. */
bool relight_bounce_wanted(const struct set *set, const struct relight_desc *desc);

/* Loads or makes it where it is wanted and not there yet, and adds to *ms what that took. direct: the cache of direct
 * light, whose packets it takes and beside which it is kept; NULL: it was cancelled, and so is this. */
MUST_CHECK enum err relight_bounce_make(struct relight_bounce *b, const struct transport *direct, const struct set *set,
                                        const struct kernels *kernels, const struct relight_desc *desc,
                                        const struct relight_keep *keep, bool progress, double *ms);

/* What transport_frame takes, or NULL where lo is given: then it is added there. Fills stats->bounce and bias. */
const struct transport_indirect *relight_bounce_take(struct relight_bounce *b, const struct environment *e,
                                                  const struct relight_desc *desc, float *lo,
                                                  struct relight_stats *stats);

#endif
