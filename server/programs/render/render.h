/* Renders a sequence: every frame of a source, one after another, to an output and to statistics. This is what
 * relight-render does after it has read its flags. The ranks of a job share the frames: each renders those whose
 * numbers it takes, and rank 0 writes the statistics of all; or they light each frame together (job/team/team.h), which
 * rank 0 reads and writes. One thread of control; the light runs on all OpenMP threads. */
#pragma once

#include "base/luminance.h"
#include "base/progress.h"
#include "image/output/output.h"
#include "job/ranks/ranks.h"
#include "job/team/team.h"
#include "light/frame/changes.h"
#include "light/frame/decide.h"
#include "light/frame/relight_lamps.h"
#include "light/inspector/inspector.h"
#include "relightd/settings/settings.h"

#include <stdio.h>

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

/* Data and functions that the files of this room share. One thread: that of render_sequence. */

/* A frame's decoding. */
struct decoding {
    enum err result;
    struct reason why;
    double ms[2]; /* decoding, rebuilding the tables */
};

/* split.c: the frame after this one, taken while other ranks light this one. */
struct render_ahead {
    struct environment *environment;
    struct frame frame;
    bool taken; /* `result` and *why are source_next's */
    enum err result;
    struct reason why;
    bool decoded; /* into `environment`, as `decoding` says */
    struct decoding decoding;
    struct relight_desc light;
    struct frame_request request;
};

struct render {
    struct render_desc desc;
    struct source *source;
    struct prepared_scene *set;
    struct relighter *relighter;
    struct team *team;           /* NULL: one process per frame, */
    struct cache_share share;    /* which computes the cache with the others */
    struct relight_lamps *lamps; /* NULL: the scene has none, or they are off */
    struct decider decider;
    struct frame_request request; /* of the frame */
    double cache_ms;              /* of computing or loading what --method cached needs, once */
    double beside_s;              /* of a frame, what is not light: reading and writing it, smoothed */
    double owed_s;                /* what the frames so far took beyond those of --fps */
    bool warned_denoised, warned_late;
    struct environment *environment;
    struct output *output;       /* NULL: no images */
    struct changes changes;      /* of statistics and desc.changes */
    struct output *maps;         /* of desc.changes; NULL: none */
    struct inspector *inspector; /* NULL: no pixel is asked about */
    float *rgb;                  /* [height][width][3] */
    float *rgba;                 /* [height][width][4]: the foreground; NULL: not requested */
    FILE *stats;                 /* NULL: none */
    struct frame frame;
    bool decoded; /* already, as `decoding` says */
    struct decoding decoding;
    struct render_ahead ahead;
    uint64_t rendered, refused, kept;
    uint64_t *existing; /* [existing_count]: numbers of the images that rank 0 has, ascending; with desc.collect */
    size_t existing_count;
    uint64_t position; /* of the frame in the source; of a job */
    struct bytes {     /* of a job: statistics of this rank's frames, as share.c has them */
        char *at;
        size_t size, capacity;
    } texts;
    unsigned said;                /* by environment_report */
    double begun_s;               /* clock_seconds */
    struct progress line;         /* of the whole sequence */
    struct render_layers *layers; /* NULL: not requested */
    bool unmetered;               /* --exposure auto has no value yet */
};

/* render.c: what split.c needs of a frame, too. render_decode reads frame into e; render_request asks for its light,
 * described in *light, which must outlive the result. */
void render_decode(struct environment *e, const struct frame *frame, struct decoding *out);
struct frame_request render_request(const struct render *r, const struct frame *frame, struct relight_desc *light);

/* meter.c. render_expose fixes r->output's exposure, or sets r->unmetered where --exposure auto has to wait for the
 * first frame; render_meter then measures the one that r->environment holds. Errors are those of source_open,
 * source_next, environment_decode and relighter_run; ERR_USAGE: --exposure-frame with such a source. */
MUST_CHECK enum err render_expose(struct render *r, struct reason *why);
MUST_CHECK enum err render_meter(struct render *r, struct reason *why);

/* meter.c, too: sets the scale of r->environment by --calibrate, where it is given. ERR_RANGE: the first frame has no
 * light from above; else as render_expose. */
MUST_CHECK enum err render_calibrate(struct render *r, struct reason *why);

/* changes.c: change maps. render_changes_create makes r->maps if they are requested: errors of output_create.
 * render_changes takes the frame's image, if maps or statistics are wanted, and writes its map: ERR_NOMEM; errors of
 * output_write. */
MUST_CHECK enum err render_changes_create(struct render *r, struct reason *why);
MUST_CHECK enum err render_changes(struct render *r, const struct relight_stats *stats, struct reason *why);

/* layers.c: --layers. render_layers_create makes r->layers, after r->lamps and r->output; render_layers_run lights a
 * frame in place of decider_run. ERR_NOMEM; errors of relighter_run_layers. */
MUST_CHECK enum err render_layers_create(struct render *r, struct reason *why);
MUST_CHECK enum err render_layers_run(struct render *r, struct relight_stats *stats);
void render_layers_destroy(struct render_layers *l); /* NULL is allowed */

/* share.c: what ranks of a job share, and what --resume keeps. render_check_shared: ERR_USAGE if frames cannot be
 * distributed or kept. render_take: the next frame for this process, in r->frame; errors of source_next.
 * render_is_kept: whether a frame's image exists already. render_note records the statistics of a frame, `text`
 * (malloc; freed here), and render_join writes those of all ranks, collectively. ERR_NOMEM. */
bool render_deals(const struct render *r); /* one rank per frame */
MUST_CHECK enum err render_check_shared(const struct render *r, struct reason *why);
MUST_CHECK enum err render_take(struct render *r, struct reason *why);
bool render_is_kept(const struct render *r, const struct frame *frame);
MUST_CHECK enum err render_note(struct render *r, char *text);
MUST_CHECK enum err render_join(struct render *r, struct reason *why);

/* collect.c: --collect. render_collect_begin, collectively, tells all ranks which images exist. Other ranks send each
 * image; rank 0 writes those that have arrived, or with `all` waits for the rest. All ranks call render_collect_end
 * at the end. Errors are those of output_write; ERR_NOMEM; ERR_RANGE. */
bool render_collects(const struct render *r);
MUST_CHECK enum err render_collect_begin(struct render *r, struct reason *why);
bool render_collect_has(const struct render *r, uint64_t number);
MUST_CHECK enum err render_collect_post(struct render *r, struct reason *why);
MUST_CHECK enum err render_collect_take(struct render *r, bool all, struct reason *why);
MUST_CHECK enum err render_collect_end(struct render *r, enum err own, struct reason *why);

/* split.c: ranks light each frame together. render_split_begin joins them, collectively; then rank 0 renders and the
 * others run team_serve until team_destroy, which also logs the times. Errors are those of team.h;
 * ERR_USAGE: a ground. render_split_take makes the frame that was taken ahead the current one; errors of
 * source_next. */
MUST_CHECK enum err render_split_begin(struct render *r, struct reason *why);
MUST_CHECK enum err render_split_take(struct render *r, struct reason *why);

/* statistics.c: the JSON object of the last frame, to be freed with free; NULL when out of memory. ms: decoding,
 * rebuilding the tables, writing. */
char *render_stats_text(struct render *r, const struct relight_stats *s, const struct pilot_stats *pilot,
                        const double ms[3]);
