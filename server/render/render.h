/* server/render/render.h */
/* Renders a sequence: every frame of a source, one after another, to an output and to statistics. What relight-render
 * does once its flags are read; rendering a sequence on several machines would deal out its frames here. One thread of
 * control; the light runs on all OpenMP threads. */
#ifndef RENDER_RENDER_H
#define RENDER_RENDER_H

#include "env/environment.h"
#include "light/decide.h"
#include "light/relight.h"
#include "output/output.h"
#include "probe/probe_report.h"
#include "source/source.h"

struct render_desc {
    struct source_desc source;
    struct set_desc set;
    struct relight_desc light;
    struct environment_desc environment;
    const struct kernels *kernels;
    struct pilot_target target;        /* zeroed: the sample counts of `light` */
    struct output_desc output;         /* pattern NULL: no images */
    const char *stats_path;            /* JSON, one object per frame; "-": standard output; NULL: none */
    const struct probe_request *probe; /* printed to standard output per frame; NULL: none */
    bool reseed;                       /* other random numbers in each frame */
};

/* Frames that cannot be read are reported and skipped; then, and on ERR_IO and ERR_NOMEM, the result is an error.
 * ERR_USAGE: one output file for many frames. Errors are also those of source_open and set_create. */
MUST_CHECK enum err render_sequence(const struct render_desc *desc, struct reason *why);

#endif
