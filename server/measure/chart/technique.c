#include "measure/chart/chart.h"

#include "base/clock.h"
#include "base/rng.h"
#include "light/estimators/paths.h"

#include <stdio.h>
#include <string.h>

#define DIRECT .light_class = LIGHT_DIRECT, .light.classes = PATH_BACKGROUND | PATH_DIRECT, .times = 1, .per = 1
/* All light: twice the samples, so that a budget of 4 comes to one eye path and one particle a pixel. */
#define ALL .light_class = LIGHT_ALL, .light.classes = PATH_ALL, .times = 2, .per = 1
/* A whole path for every four samples: it costs about as much. */
#define IMAGE_DIRECT                                                                                                   \
    .light_class = LIGHT_DIRECT, .kind = TECHNIQUE_BASELINE, .light.classes = PATH_BACKGROUND | PATH_DIRECT,           \
    .times = 1, .per = 4
#define IMAGE_ALL .light_class = LIGHT_ALL, .kind = TECHNIQUE_BASELINE, .light.classes = PATH_ALL, .times = 1, .per = 4

static const struct technique techniques[] = {
    { "uniform", "directions evenly from all around", DIRECT, .colour = 0x8c8c8c,
      .light.direct.method = METHOD_UNIFORM },
    { "brdf", "directions that the material reflects well", DIRECT, .colour = 0xa97bc4,
      .light.direct.method = METHOD_BRDF },
    { "light", "directions where the sky is bright", DIRECT, .colour = 0x3f95cf, .light.direct.method = METHOD_LIGHT },
    { "latlong", "bright directions from the sky's own image, by rows", DIRECT, .colour = 0x1fa894,
      .light.direct.method = METHOD_LATLONG },
    { "latlong-rows", "bright directions from the sky's own image, by one long table", DIRECT, .colour = 0x78a520,
      .light.direct.method = METHOD_LATLONG_ROWS },
    { "faces-uniform", "as many bright directions from each of the sky's six faces", DIRECT, .colour = 0xc79a00,
      .light.direct.method = METHOD_FACES_UNIFORM },
    { "faces", "bright directions, more from the faces that the surface faces", DIRECT, .colour = 0xef8122,
      .light.direct.method = METHOD_FACES },
    { "mis", "half bright directions by faces, half what the material reflects well", DIRECT, .colour = 0xdd4b4e,
      .light.direct.method = METHOD_MIS },
    { "mis+sun", "bright directions, the sun's by themselves, and what the material reflects well", DIRECT,
      .colour = 0xd1359b, .light.direct = { .method = METHOD_MIS, .sun = true } },
    { "mis+sun+cells", "as mis+sun, with 384 cells instead of six faces", DIRECT, .colour = 0x7a5af0,
      .light.direct = { .method = METHOD_MIS, .sun = true, .cells = 8, .compensate = COMPENSATE_AUTO } },
    { "rules", "the program's default, the sun as a separate stratum, compensated", DIRECT, .colour = 0x5b7f95,
      .light.direct.method = METHOD_AUTO },
    { "denoised", "the program's default, its noise filtered out", DIRECT, .colour = 0x0a6c74,
      .kind = TECHNIQUE_FILTERED, .light.direct.method = METHOD_AUTO, .light.denoise = true },
    { "auto", "what the program chooses by measuring, given the time", DIRECT, .kind = TECHNIQUE_AUTO,
      .light.direct.method = METHOD_AUTO },
    { "cached", "light transport computed in advance", DIRECT, .colour = 0x2e7d5b, .kind = TECHNIQUE_PREPARED,
      .light.direct.method = METHOD_CACHED },
    { "path", "whole paths from the eye, without precomputation", IMAGE_DIRECT, .colour = 0x94704a,
      .light.direct.method = METHOD_PATH },

    { "mis/light", "mis, paths from the light for caustics, paths from the eye for indirect light", ALL,
      .colour = 0xdd4b4e, .light.direct.method = METHOD_MIS, .light.caustics = PLAN_LIGHT, .light.indirect = PLAN_EYE },
    { "mis/eye", "mis, and paths from the eye for all indirect light", ALL, .colour = 0x3f95cf,
      .light.direct.method = METHOD_MIS, .light.caustics = PLAN_EYE, .light.indirect = PLAN_EYE },
    { "rules", "the program's default", ALL, .colour = 0x5b7f95, .light.direct.method = METHOD_AUTO },
    { "denoised", "the program's default, its noise filtered out", ALL, .colour = 0x0a6c74, .kind = TECHNIQUE_FILTERED,
      .light.direct.method = METHOD_AUTO, .light.denoise = true },
    { "auto", "what the program chooses by measuring, given the time", ALL, .kind = TECHNIQUE_AUTO,
      .light.direct.method = METHOD_AUTO },
    { "cached", "light transport and light paths computed in advance", ALL, .colour = 0x2e7d5b,
      .kind = TECHNIQUE_PREPARED, .light.direct.method = METHOD_CACHED },
    { "path", "whole paths from the eye, without precomputation", IMAGE_ALL, .colour = 0x94704a,
      .light.direct.method = METHOD_PATH },
    { "mlt", "chains of paths that dwell where it is bright (Metropolis)", IMAGE_ALL, .colour = 0x7a5af0,
      .light.direct.method = METHOD_MLT },
    { "photons", "a photon map, blurred", IMAGE_ALL, .colour = 0x1fa894, .light.direct.method = METHOD_PHOTONS },
    { "vpl", "virtual point lights, dim in corners", IMAGE_ALL, .colour = 0xc79a00, .light.direct.method = METHOD_VPL },
};

const struct technique *technique_all(size_t *count)
{
    *count = sizeof(techniques) / sizeof(techniques[0]);
    return techniques;
}

const char *const technique_kinds[] = { "fixed", "baseline", "prepared", "filtered", "auto" };

/* Whether the name stands in the list, whole. */
static bool is_listed(const char *list, const char *name)
{
    const size_t n = strlen(name);

    for (const char *at = list; *at; at += strcspn(at, ","), at += *at == ',')
        if (strcspn(at, ",") == n && memcmp(at, name, n) == 0)
            return true;
    return false;
}

bool technique_listed(const char *list, const struct technique *t)
{
    return !list || is_listed(list, t->name);
}

enum err technique_check_list(const char *list, struct reason *why)
{
    const size_t count = sizeof(techniques) / sizeof(techniques[0]);
    struct reason known = { "" };

    for (size_t t = 0; t < count; t++) {
        const size_t used = strlen(known.text);
        if (!is_listed(known.text, techniques[t].name))
            snprintf(known.text + used, sizeof(known.text) - used, "%s%s", used ? "," : "", techniques[t].name);
    }
    for (const char *at = list; at && *at; at += strcspn(at, ","), at += *at == ',') {
        char name[64];
        snprintf(name, sizeof(name), "%.*s", (int)strcspn(at, ","), at);
        if (!is_listed(known.text, name))
            return err_say(why, ERR_USAGE, "--techniques: '%s' is none; there are %s", name, known.text);
    }
    return ERR_OK;
}

uint32_t technique_samples(const struct technique *t, uint32_t budget)
{
    const uint64_t n = (uint64_t)budget * t->times / t->per;
    return n ? (uint32_t)n : 1;
}

const struct technique *technique_pace(enum light_class c)
{
    const char *name = c == LIGHT_DIRECT ? "mis" : "mis/eye";
    size_t k = 0;

    while (techniques[k].light_class != c || strcmp(techniques[k].name, name) != 0)
        k++;
    return &techniques[k];
}

enum err technique_run(const struct technique *t, const struct technique_stage *stage, uint32_t budget, uint64_t seed,
                       float *rgb, struct technique_cost *cost, struct reason *why)
{
    struct relight_desc light = t->light;
    struct frame_request request = {
        .asked = &light,
        .target.seconds = t->kind == TECHNIQUE_AUTO ? stage->seconds : 0.0,
        .no_cache = true,
    };
    struct decider decider = { 0 };
    struct relight_stats stats = { 0 };
    struct pilot_stats pilot = { 0 };
    enum err result = ERR_OK;
    double prepared = 0.0;

    light.direct.samples = technique_samples(t, budget);
    light.direct.seed = rng_mix(0x6368617274u, seed);
    light.direct.why = why;
    if (t->kind == TECHNIQUE_PREPARED) {
        result = relighter_run(stage->relighter, stage->other, &light, rgb, &stats);
        prepared = stats.cache_ms;
        if (result)
            return result;
    }
    decide(&decider, &request);
    const double start = clock_seconds();
    result = decider_run(&decider, stage->relighter, stage->environment, &request, rgb, &stats, &pilot);
    prepared += stats.cache_ms;
    *cost = (struct technique_cost){
        .seconds = clock_seconds() - start - 1e-3 * stats.cache_ms,
        .samples = light.direct.samples,
        .eye_paths = stats.plan.eye_paths,
        .particles = stats.plan.particles,
        .rays = stats.direct.rays + stats.eye.rays + stats.light.rays + stats.reference_rays,
        .bias = light.denoise && !stats.bias ? "light averaged over neighbouring points" : stats.bias,
        .prepared = 1e-3 * prepared,
        .prepared_bytes = stats.cache.bytes,
    };
    if (request.by == DECIDED_BY_MEASURES && !result) {
        /* The choice of auto. */
        cost->expected = pilot.error;
        cost->samples = (uint32_t)pilot.part[PILOT_DIRECT].n;
        cost->eye_paths = (uint32_t)pilot.part[PILOT_EYE].n;
        cost->particles = (uint64_t)(pilot.part[PILOT_AIMED].n + pilot.part[PILOT_WHOLE].n);
    }
    decider_finish(&decider);
    if (!result && t->kind == TECHNIQUE_PREPARED && stats.cache_frame.lit < stats.cache.packets)
        return err_say(why, ERR_RANGE, "%s: only %u of %u packets were computed", t->name, stats.cache_frame.lit,
                       stats.cache.packets);
    return result == ERR_NOMEM ? err_say(why, result, "no memory for the samples of %s", t->name) : result;
}
