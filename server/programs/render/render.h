/* Renders a sequence: every frame of a source, one after another, to an output and to statistics. This is what
 * relight-render does after it has read its flags. The ranks of a job share the frames: each renders those whose
 * numbers it takes, and rank 0 writes the statistics of all; or they light each frame together (job/team/team.h), which
 * rank 0 reads and writes. One thread of control; the light runs on all OpenMP threads. */
#pragma once

#include "base/luminance.h"
#include "image/output/output.h"
#include "job/ranks/ranks.h"
#include "light/frame/decide.h"
#include "light/inspector/inspector.h"
#include "relightd/settings/settings.h"

struct render_desc {
    struct setup setup;          /* all but `initial` */
    struct budget_target target; /* zeroed: the sample counts of `setup` */
    struct output_desc output;   /* pattern NULL: no images */
    /* With EXPOSURE_AUTO: the number of the frame that is measured; the first one if none is given. */
    bool exposure_frame_given;
    uint64_t exposure_frame;
    double calibrate_lux; /* scale the environment so that the first frame's horizontal illuminance in the open is
                             this; 0: as it is */
    enum luminance_weights weights;           /* of calibrate_lux */
    bool layers;                              /* of EXR: not by a reference method, nor with a target or alpha */
    const char *stats_path;                   /* JSON, one object per frame; "-": standard output; NULL: none */
    const char *changes;                      /* pattern of change maps, PNG (light/frame/changes.h); NULL: none */
    bool resume;                              /* keep images that are there */
    struct ranks *ranks;                      /* NULL: this process renders all frames */
    bool collect;                             /* rank 0 writes the images of all ranks */
    bool split;                               /* ranks light each frame together, instead of one rank per frame */
    const struct inspect_request *inspection; /* printed to standard output per frame; NULL: none */
};

/* Frames that cannot be read are reported and skipped; then, and on ERR_IO and ERR_NOMEM, the result is an error.
 * ERR_USAGE: one output file for many frames; frames that cannot be distributed or kept. Collective in a job, in
 * which an error of one rank ends all. Errors are also those of source_open and set_create. */
MUST_CHECK enum err render_sequence(const struct render_desc *desc, struct reason *why);
