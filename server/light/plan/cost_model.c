#include "light/plan/cost_model.h"

#include <stddef.h>

static double bias_of(const struct cost_facts *f)
{
    return f->indirect ? COST_BIAS_INDIRECT : COST_BIAS;
}

bool cost_allows_cache(const struct cost_facts *f)
{
    return f->allowed >= bias_of(f);
}

bool cost_suits_cache(const struct cost_facts *f)
{
    return cost_allows_cache(f) && f->error >= bias_of(f);
}

/* In light samples a point. */
static double build_of(const struct cost_facts *f)
{
    return COST_SAMPLES + (f->indirect ? COST_SAMPLES_INDIRECT : 0.0);
}

/* Frames of so many samples each. 0: it never pays. */
static double break_even_of(const struct cost_facts *f, double samples)
{
    const double saved = (f->indirect ? 2.0 : 1.0) * samples - COST_FRAME_SAMPLES;

    return saved > 0.0 ? build_of(f) / saved : 0.0;
}

void cost_by_counts(const struct cost_facts *f, struct cost_verdict *out)
{
    *out = (struct cost_verdict){ .break_even = break_even_of(f, f->samples) };
    const char *const no = !cost_allows_cache(f) ? "--allow-bias does not permit its bias"
                           : (f->indirect ? COST_NOISE_INDIRECT : COST_NOISE) / f->samples < bias_of(f)
                               ? "this many samples have less error than its bias"
                           : out->break_even <= 0.0 ? "a frame from it takes as long"
                                                    : NULL;
    out->yes = !no;
    out->why = no ? no : "--allow-bias permits its bias";
}

void cost_by_clock(const struct cost_facts *f, struct cost_verdict *out)
{
    const double point_s = f->sample_s * (double)f->points, saved_s = f->frame_s - COST_FRAME_SAMPLES * point_s;
    const bool many = f->frames == 0 && (double)f->made > break_even_of(f, COST_GOOD_SAMPLES);

    *out = (struct cost_verdict){ .build_s = build_of(f) * point_s };
    out->break_even = many ? break_even_of(f, COST_GOOD_SAMPLES) : saved_s > 0.0 ? out->build_s / saved_s : 0.0;
    const bool more = f->frames > 0 && (double)f->frames > out->break_even, spent = f->spent_s >= out->build_s;
    const char *const no = !cost_allows_cache(f)                         ? "--allow-bias does not permit its bias"
                           : f->made < COST_MADE || f->sample_s <= 0.0 ? "too few frames were measured"
                           : f->error <= 0.0                          ? "the error is not known yet"
                           : !cost_suits_cache(f)                            ? "the requested error is below its bias"
                           : many                                     ? NULL
                           : saved_s <= 0.0                           ? "a frame from it takes as long"
                           : f->frames > 0                            ? more ? NULL : "there are too few frames"
                           : spent                                    ? NULL
                                                                      : "less time has gone into frames";
    out->yes = !no;
    out->why = no     ? no
               : many ? "as many frames of 64 samples would have taken as long"
               : more ? "more frames are to come"
                      : "as much time has gone into frames";
}
