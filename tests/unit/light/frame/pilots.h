/* What the tests of the pilot share: sets, and a price list instead of the clock, so that choices are the same on every
 * machine. */
#pragma once

#include "light/estimators/kernels.h"
#include "light/frame/pilot.h"
#include "support/sets.h"
#include "support/skies.h"

/* Seconds, about those of one core. */
static inline double price_list(const struct pilot_work *w)
{
    switch (w->part) {
    case PILOT_DIRECT: return 1e-4 + 60e-9 * (double)w->points * w->n + 80e-9 * (double)w->rays;
    case PILOT_EYE: return 250e-9 * (double)w->rays;
    case PILOT_AIMED:
    case PILOT_WHOLE: return 1e-3 + 300e-9 * (double)w->rays;
    default: return 15e-9 * (double)w->points;
    }
}

static struct relighter *pilot_relighter; /* of the one pilot there is */

static inline struct pilot *pilot_of(const struct prepared_scene *set)
{
    const struct pilot_desc desc = { .price = price_list };
    const struct kernels *k;
    struct reason why;

    assert_int_equal(kernels_select(NULL, &k, &why), ERR_OK);
    pilot_relighter = relighter_create(set, k);
    assert_non_null(pilot_relighter);
    struct pilot *p = pilot_create(pilot_relighter, &desc);
    assert_non_null(p);
    return p;
}

static inline void pilot_end(struct pilot *p)
{
    pilot_destroy(p);
    relighter_destroy(pilot_relighter);
}

/* The last of `frames` images under one sky. */
static inline void fly(struct pilot *p, const struct environment *e, const struct relight_desc *light,
                       struct budget_target target, int frames, float *rgb, struct relight_stats *stats,
                       struct pilot_stats *said)
{
    for (int k = 0; k < frames; k++)
        assert_int_equal(pilot_run(p, e, light, &target, rgb, stats, said), ERR_OK);
}
