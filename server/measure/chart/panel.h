/* One panel of the chart: a scene under a sky in one class of light, with the results of every technique at every
 * budget. One thread of control. */
#pragma once

#include "light/frame/relight.h"
#include "measure/chart/technique.h"
#include "measure/chart/truth.h"

#include <jansson.h>
#include <stdint.h>

struct progress;

#define BUDGETS_MAX 16 /* bound tables */
#define SEEDS_MAX 256

struct panel_desc {
    const char *scene, *source; /* titles */
    const struct prepared_scene *set;
    const struct kernels *kernels;
    struct environment *environment; /* of `frame`; decoded and rebuilt again and again, always to the same */
    const struct frame *frame;
    enum light_class light_class;
    const uint32_t *budgets; /* ascending */
    uint32_t budget_count, seeds;
    const char *techniques; /* a list of names with commas between; NULL: all */
    uint32_t truth_samples;
    const char *cache;     /* folder; NULL: none */
    double table_ms;       /* as the caller measured it */
    struct progress *line; /* stepped by panel_work in all; may be NULL */
};

/* The steps of the progress line, which take about the same time each. */
uint64_t panel_work(const struct panel_desc *desc);

/* Measures a panel: for each seed, for each budget, all techniques in turn, so that a noisy moment of the machine
 * affects all alike. All images are kept until they are compared: 12 bytes times pixels, techniques,
 * budgets and seeds, 660 MB for 12, 5 and 16 at 320x180; ERR_RANGE above 8 GiB. Other errors: those of truth.h,
 * ERR_NOMEM. *out, owned by the caller, which may be NULL on an error; times in seconds but for those named ms, none of
 * them of a whole frame:
 *   scene, source, light, pace (the technique whose time auto has), width, height, seeds, points (shade points),
 *   gbuffer_bytes, load_ms, bvh_ms, gbuffer_ms, table_ms: once, before the first frame; table: of resampling
 *   common_ms   of stages that all techniques share: decode, rebuild (resampling onto the cube map, and its sampling
 *               tables), tone, encode (JPEG), [budgets * seeds] each
 *   reference_samples, reference_noise, reference_doubt (judge.h), truth: its image
 *   curves      in the order of the legend: technique, about, colour, kind, method, prepared_ms, prepared_bytes, bias
 * (of technique.h; null: none), and left_out (the reason why it was not measured; null: it was) points    one for each
 * budget: budget, samples, eye_paths, particles, rays, and over the seeds seconds and expected; errors: by error_names,
 * null for infinity; floor: judge_floor's; image, map: of the first seed Images are data: addresses of JPEG. */
MUST_CHECK enum err panel_measure(const struct panel_desc *desc, json_t **out, struct reason *why);

/* The references that a panel needs. */
struct truth_desc panel_truth(const struct panel_desc *desc);
