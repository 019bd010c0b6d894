/* server/render/render.h */
/* Renders a sequence: every frame of a source, one after another, to an output and to statistics. What relight-render
 * does once its flags are read; rendering a sequence on several machines would deal out its frames here. One thread of
 * control; the light runs on all OpenMP threads. */
#ifndef RENDER_RENDER_H
#define RENDER_RENDER_H

#include "light/decide.h"
#include "output/output.h"
#include "probe/probe_report.h"
#include "settings/settings.h"

struct render_desc {
    struct setup setup;         /* all but `initial` */
    struct pilot_target target; /* zeroed: the sample counts of `setup` */
    struct output_desc output;  /* pattern NULL: no images */
    /* With EXPOSURE_AUTO: the number of the frame that is measured; the first one if none is given. */
    bool exposure_frame_given;
    uint64_t exposure_frame;
    bool layers;                       /* of EXR: not by a reference method, nor with a target or alpha */
    const char *stats_path;            /* JSON, one object per frame; "-": standard output; NULL: none */
    const struct probe_request *probe; /* printed to standard output per frame; NULL: none */
};

/* Frames that cannot be read are reported and skipped; then, and on ERR_IO and ERR_NOMEM, the result is an error.
 * ERR_USAGE: one output file for many frames. Errors are also those of source_open and set_create. */
MUST_CHECK enum err render_sequence(const struct render_desc *desc, struct reason *why);

#endif
