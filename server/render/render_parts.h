/* Inside a rendering: what render.c and statistics.c share. */
#ifndef RENDER_RENDER_PARTS_H
#define RENDER_RENDER_PARTS_H

#include "base/progress.h"
#include "light/relight_lamps.h"
#include "render/render.h"

#include <stdio.h>

struct render {
    struct render_desc desc;
    struct source *source;
    struct set *set;
    struct relighter *relighter;
    struct relight_lamps *lamps; /* NULL: the scene has none, or they are off */
    struct decider decider;
    struct decision decision; /* of the frame */
    double cache_ms;          /* of computing or loading what --method cached needs, once */
    double beside_s;          /* of a frame, what is not light: reading and writing it, smoothed */
    struct environment *environment;
    struct output *output; /* NULL: no images */
    struct prober *prober; /* NULL: no pixel is asked about */
    float *rgb;            /* [height][width][3] */
    float *rgba;           /* [height][width][4]: the foreground; NULL: not asked for */
    FILE *stats;           /* NULL: none */
    struct frame frame;
    uint64_t rendered, refused;
    bool warned_clipped;
    struct progress line;         /* of the whole sequence */
    struct render_layers *layers; /* NULL: not asked for */
    bool unmetered;               /* --exposure auto has no value yet */
};

/* meter.c. render_expose fixes r->output's exposure, or sets r->unmetered where --exposure auto has to wait for the
 * first frame; render_meter then measures the one that r->environment holds. Errors are those of source_open,
 * source_next, environment_decode and relighter_run; ERR_USAGE: --exposure-frame with such a source. */
MUST_CHECK enum err render_expose(struct render *r, struct reason *why);
MUST_CHECK enum err render_meter(struct render *r, struct reason *why);

/* layers.c: --layers. render_layers_create makes r->layers, after r->lamps and r->output; render_layers_run lights a
 * frame in place of decider_run. ERR_NOMEM; errors of relighter_run_layers. */
MUST_CHECK enum err render_layers_create(struct render *r, struct reason *why);
MUST_CHECK enum err render_layers_run(struct render *r, struct relight_stats *stats);
void render_layers_destroy(struct render_layers *l); /* NULL is allowed */

/* Appends the JSON object of the last frame to r->stats. ms: decoding, rebuilding the tables, writing. Thread: the
 * caller's; errors show when the file is closed. */
void render_write_stats(struct render *r, const struct relight_stats *s, const struct pilot_stats *pilot,
                        const double ms[3]);

#endif
