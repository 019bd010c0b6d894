#include "light/plan/buy.h"

#include <stddef.h>

static double bias_of(const struct buy_facts *f)
{
    return f->indirect ? BUY_BIAS_INDIRECT : BUY_BIAS;
}

bool buy_is_allowed(const struct buy_facts *f)
{
    return f->allowed >= bias_of(f);
}

bool buy_suits(const struct buy_facts *f)
{
    return buy_is_allowed(f) && f->error >= bias_of(f);
}

/* In light samples a point. */
static double build_of(const struct buy_facts *f)
{
    return BUY_SAMPLES + (f->indirect ? BUY_SAMPLES_INDIRECT : 0.0);
}

/* Frames of so many samples each. 0: it never pays. */
static double break_even_of(const struct buy_facts *f, double samples)
{
    const double saved = (f->indirect ? 2.0 : 1.0) * samples - BUY_FRAME_SAMPLES;

    return saved > 0.0 ? build_of(f) / saved : 0.0;
}

void buy_by_counts(const struct buy_facts *f, struct buy *out)
{
    *out = (struct buy){ .break_even = break_even_of(f, f->samples) };
    const char *const no = !buy_is_allowed(f) ? "--allow-bias does not permit its bias"
                           : (f->indirect ? BUY_NOISE_INDIRECT : BUY_NOISE) / f->samples < bias_of(f)
                               ? "this many samples have less error than its bias"
                           : out->break_even <= 0.0 ? "a frame from it takes as long"
                                                    : NULL;
    out->yes = !no;
    out->why = no ? no : "--allow-bias permits its bias";
}

void buy_by_clock(const struct buy_facts *f, struct buy *out)
{
    const double point_s = f->sample_s * (double)f->points, saved_s = f->frame_s - BUY_FRAME_SAMPLES * point_s;
    const bool many = f->frames == 0 && (double)f->made > break_even_of(f, BUY_GOOD_SAMPLES);

    *out = (struct buy){ .build_s = build_of(f) * point_s };
    out->break_even = many ? break_even_of(f, BUY_GOOD_SAMPLES) : saved_s > 0.0 ? out->build_s / saved_s : 0.0;
    const bool more = f->frames > 0 && (double)f->frames > out->break_even, spent = f->spent_s >= out->build_s;
    const char *const no = !buy_is_allowed(f)                         ? "--allow-bias does not permit its bias"
                           : f->made < BUY_MADE || f->sample_s <= 0.0 ? "too few frames were measured"
                           : f->error <= 0.0                          ? "the error is not known yet"
                           : !buy_suits(f)                            ? "the requested error is below its bias"
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
