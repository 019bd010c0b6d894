/* tests/unit/film/pilots.h */
/* What the tests of the pilot share: sets, and a price list instead of the clock, so that choices are the same on every
 * machine. */
#ifndef TESTS_PILOTS_H
#define TESTS_PILOTS_H

#include "kernels.h"
#include "pilot.h"
#include "skies.h"

/* Seconds, about those of one core. */
static inline double price_list(const struct pilot_work *w)
{
    switch (w->part) {
    case PILOT_MATTE:
    case PILOT_GLOSSY: return 1e-4 + 60e-9 * (double)w->points * w->n + 80e-9 * (double)w->rays;
    case PILOT_EYE: return 250e-9 * (double)w->rays;
    case PILOT_AIMED:
    case PILOT_WHOLE: return 1e-3 + 300e-9 * (double)w->rays;
    default: return 15e-9 * (double)w->points;
    }
}

static inline struct set *set_of(const char *scene, uint32_t width, uint32_t height)
{
    const struct set_desc desc = { .scene = scene, .width = width, .height = height };
    struct set *s = NULL;
    struct reason why;

    if (set_create(&desc, &s, &why)) {
        printf("%s\n", why.text);
        fail();
    }
    return s;
}

static inline struct pilot *pilot_of(const struct set *set)
{
    const struct pilot_desc desc = { .price = price_list };
    const struct kernels *k;
    struct reason why;

    assert_int_equal(kernels_select(NULL, &k, &why), ERR_OK);
    struct pilot *p = pilot_create(set, k, &desc);
    assert_non_null(p);
    return p;
}

/* The last of `frames` pictures under one sky. */
static inline void fly(struct pilot *p, const struct environment *e, const struct relight_desc *light,
                       struct pilot_wish wish, int frames, float *rgb, struct relight_stats *stats,
                       struct pilot_stats *said)
{
    for (int k = 0; k < frames; k++)
        assert_int_equal(pilot_run(p, e, light, &wish, rgb, stats, said), ERR_OK);
}

#endif
