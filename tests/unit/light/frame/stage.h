/* What the tests of the relighter share: a set, its relighter, a sky, and an image. */
#pragma once

#include "light/estimators/points.h"
#include "support/sets.h"

struct stage {
    struct prepared_scene *set;
    struct relighter *relighter;
    struct environment *sky;
    float *rgb; /* [pixels][3] */
    struct reason why;
};

/* sky: taken over. For stage_finish. */
static inline struct stage stage_make(const struct prepared_scene_desc *desc, struct frame sky)
{
    struct stage s = { .set = set_of(desc), .sky = sky_environment(sky, 64, 0.0) };

    s.rgb = mem_alloc((size_t)desc->width * desc->height, 3 * sizeof(float));
    s.relighter = relighter_create(s.set, best_kernels());
    assert_non_null(s.relighter);
    return s;
}

static inline void stage_finish(struct stage *s)
{
    relighter_destroy(s->relighter);
    set_destroy(s->set);
    environment_destroy(s->sky);
    mem_free(s->rgb);
}

/* One image into s->rgb. */
static inline enum err stage_run(struct stage *s, const struct relight_desc *light, struct relight_stats *stats)
{
    struct relight_desc desc = *light;

    desc.direct.why = &s->why;
    return relighter_run(s->relighter, s->sky, &desc, s->rgb, stats);
}
