/* Measures each stage of the pipeline, and the whole pipeline, against its bare limit in one process. Both are timed
 * in turns, and the report has medians over the rounds, so that a noisy machine does not decide the result. Main
 * thread. */
#pragma once

#include "base/err.h"
#include "base/progress.h"
#include "image/codec/encode.h"
#include "image/codec/frame.h"
#include "image/film/film.h"
#include "import/reader/reader.h"
#include "light/estimators/method.h"
#include "light/frame/relight.h"
#include "measure/chart/judge.h"

#include <jansson.h>
#include <stdbool.h>
#include <stdint.h>

#define BENCH_ROUNDS_MAX 99 /* bounds a table */

struct bench_desc {
    const char *scene;            /* a path; NULL: the built-in one */
    struct scene_reading reading; /* of reading it */
    const char *scene_fine;       /* the same with 16 times the triangles; NULL: made by halving edges twice */
    const char *source;           /* of the eight skies that repeated work takes in turns */
    const char *scenes, *sources; /* of bench_speed: lists as relight-chart's (measure/chart/chart.h) */
    const char *cpu;              /* level of the kernels; NULL: the best */
    uint32_t width, height;       /* of the images, pixels */
    enum method method;
    uint32_t samples;   /* N_s per shade point */
    uint32_t particles; /* of the light tracer */
    uint32_t viewers;
    int rounds;    /* 3..BENCH_ROUNDS_MAX */
    int threads;   /* 0: as many as there are processors */
    bool progress; /* show a progress line on standard error, if that is a terminal */
};

/* Two figures of one unit and their ratio ours / bare, which is the median of the rounds' own ratios. */
struct bench_row {
    double ours, bare, ratio; /* medians; bare 0: there is nothing to compare with, and the ratio is `ours` */
    int rounds;               /* over so many */
    char note[400];           /* what the second figure is, or why there is none */
    char skipped[160];        /* why the row could not be measured; "" where it was */
};

struct script;

/* Measures all rows and tells them to bench.py, which prints them. A row that cannot be measured says so and is no
 * error. Errors are those of the scene and the source, ERR_NOMEM and ERR_IO: of the script. */
MUST_CHECK enum err bench_run(const struct bench_desc *desc, struct script *to, struct reason *why);

/* What an image by the cache of light transport costs, of each scene under each source, at desc's size and at twice
 * its width and height, by the best kernels and by those for AVX2 (or by desc->cpu alone): bench.py gets
 * them one by one, and prints one table with the targets. Errors as bench_run's. */
MUST_CHECK enum err bench_speed(const struct bench_desc *desc, struct script *to, struct reason *why);

/* Data and functions that the rows share. Private to this room; main thread. */

struct part;

#define BENCH_QUALITY 85 /* of JPEG, as relightd's default */
#define BENCH_SKIES 8
#define BENCH_COMPUTED 0.99 /* the least share of a frame that counts as a whole one */

/* One of the skies that repeated work takes in turns, so that none is spared because its input has not changed. */
struct bench_sky {
    struct environment *environment;  /* with its tables */
    const struct frame *frame, *file; /* as it came, and as a file in memory */
    float *rgb;                       /* the image under it: of bench_run alone, */
    float gain;                       /* and of its exposure */
    uint8_t *display;
};

struct bench {
    const struct bench_desc *desc;
    struct prepared_scene *set;
    const struct kernels *kernels;
    struct relight_desc light;
    struct frame frames[BENCH_SKIES], files[BENCH_SKIES];
    uint32_t frame_count;                      /* where they are fewer than skies, they turn */
    struct bench_sky skies[BENCH_SKIES], *sky; /* the current one */
    uint64_t turn, turns[2];                   /* of `sky`, and of the last one of either side of a row */
    double computed;                           /* the least share of a frame since bench_time began */
    int threads;
    struct progress line;
};

/* Threads, kernels, scene and empty environments, of a bench that has its desc alone; then skies, which replace those
 * before: the source's first frames, those of a computed sky 15 s apart unless it says a speed. Frames that are fewer
 * than the skies are taken again, turned by some degrees. Errors as bench_run's; bench_end all the same. */
MUST_CHECK enum err bench_begin(struct bench *b, struct reason *why);
MUST_CHECK enum err bench_take_skies(struct bench *b, const char *source, struct reason *why);
void bench_end(struct bench *b);

/* What the skies are, for a title. Returns out. */
const char *bench_skies_text(const struct bench *b, char out[80]);
/* The next sky becomes the current one; the first one. */
void bench_next_sky(struct bench *b);
void bench_first_sky(struct bench *b);
/* Whether rebuilds of the skies are lean (sky/tables/environment.h). */
void bench_make_lean(struct bench *b, bool lean);
/* Reads a sky's file and rebuilds its environment. */
MUST_CHECK enum err bench_read_sky(const struct bench_sky *sky);

/* Notes which share of a frame's light was computed, not taken over from the frame before. */
void bench_count(struct bench *b, const struct relight_stats *stats);

struct bench_pair {
    enum err (*work[2])(void *context); /* ours, bare; without a bare one, ours alone is timed */
    void *context;
    double scale[2]; /* the row's figures are seconds * scale or, with `rate`, scale / seconds */
    bool rate;
    const double *seconds[2]; /* what the last call took by its own count; NULL: the clock's */
    const double *units[2];   /* how much the last call did, by which the scale is multiplied or, without `rate`,
                                 divided; NULL: 1 */
};

/* Times both in turns after one call of each that warms up, calling the short ones several times, each under the next
 * sky, and fills the row's figures. A row of which a frame was not computed whole is refused: skipped. Errors are those
 * of the work. */
MUST_CHECK enum err bench_time(struct bench *b, const struct bench_pair *pair, struct bench_row *row);

/* Fills the row from the figures of all rounds: medians, and that of the rounds' ratios. Sorts them. */
void bench_take(struct bench_row *row, double *ours, double *bare, int rounds);

/* Fills the row with a figure that there is nothing to compare with. */
void bench_state(struct bench_row *row, double figure, int rounds);

/* A row's figures, for the script. Owned by the caller. */
json_t *bench_row_json(const struct bench_row *row);

/* Sorts the values. */
double bench_median(double *v, int n);

/* Runs work with so many OpenMP threads; returns its error. */
enum err bench_threads(const struct bench *b, int count, enum err (*work)(void *), void *context);

/* Marks the row as not measured, and says why. */
void bench_skip(struct bench_row *row, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* An eighth of the image, spread over it, shaded once by desc. Its shadow rays are recorded unless
 * desc->no_visibility is set; *rays: their number. The caller destroys *out, after an error too. ERR_NOMEM; ERR_RANGE:
 * too many to record. */
MUST_CHECK enum err bench_part_create(struct bench *b, const struct direct_desc *desc, struct part **out,
                                      uint64_t *rays);
/* Traces the recorded rays and nothing else. */
MUST_CHECK enum err bench_part_replay(void *part);
/* True when there is nothing to replay. Too many rays or none skip the row: then *created becomes ERR_OK. */
bool bench_part_skip(enum err *created, uint64_t rays, struct bench_row *row);
void bench_part_destroy(struct part *p); /* NULL is allowed */

/* Fills the row with the images per second of the whole pipeline, lit by this relighter as `light` says. *processor:
 * processor time per image, seconds of all threads. Errors are those of the stages. */
MUST_CHECK enum err bench_pipeline_rate(struct bench *b, struct relighter *r, const struct relight_desc *light,
                                        struct bench_row *row, double *processor);

/* The stages of an image whose time depends on its size: light, exposure, tone curve, JPEG. */
struct image_maker {
    struct bench *bench;
    struct relighter *relighter;
    const struct relight_desc *light;
    const char *level; /* of the kernels */
    struct exposure exposure;
    struct jpeg_encoder *jpeg;
    float *rgb;
    uint8_t *display;
    uint32_t width, height;
};
/* Of any set, with the bench's light, which may be replaced before the first image. ERR_NOMEM; finish it all
 * the same. */
MUST_CHECK enum err image_maker_init(struct image_maker *m, struct bench *b, const struct prepared_scene *set);
void image_maker_finish(struct image_maker *m);
/* Light of the bench's sky into m->rgb; exposure, tone curve and JPEG of m->rgb. Errors are those of relighter_run and
 * jpeg_encode. */
MUST_CHECK enum err image_maker_light(struct image_maker *m);
MUST_CHECK enum err image_maker_encode(struct image_maker *m);

/* The rows: each fills figures and note of *row. ERR_NOMEM and errors of the stages. */
enum err bench_decode(struct bench *b, struct bench_row *row);
enum err bench_rebuild(struct bench *b, struct bench_row *row);
enum err bench_shadow_rays(struct bench *b, struct bench_row *row);
enum err bench_terms(struct bench *b, struct bench_row *row);
enum err bench_light_rays(struct bench *b, struct bench_row *row);
enum err bench_no_visibility(struct bench *b, struct bench_row *row);
enum err bench_tone(struct bench *b, struct bench_row *row);
enum err bench_jpeg(struct bench *b, struct bench_row *row);
enum err bench_delivery(struct bench *b, struct bench_row *row);
enum err bench_pipeline(struct bench *b, struct bench_row *row);
enum err bench_threads_light(struct bench *b, struct bench_row *row);
enum err bench_threads_whole(struct bench *b, struct bench_row *row);
enum err bench_pixels(struct bench *b, struct bench_row *row);
enum err bench_triangles(struct bench *b, struct bench_row *row);
enum err bench_allocations(struct bench *b, struct bench_row *row);

/* Each of the scene's triangles cut into four at the middles of its edges, `times` times over; the
 * surface is the same. ERR_NOMEM; ERR_RANGE: indices would no longer fit. */
MUST_CHECK enum err subdivide(struct scene *s, int times);

/* Calls of the C library's allocator so far, by any library on any thread of this process. False where they cannot be
 * counted: in builds with sanitizers, which have an allocator of their own. */
bool allocations_count(uint64_t *out);

/* ---- The cache and its references ---- */

/* The cache of light transport and the references that --speed judges it by. Private to this room; main thread. */

#define CACHED_SAMPLES 64 /* N_s of `cached` and of `mis` beside it, whatever the other rows use */

/* Two references of one sky and the same shading points with different random numbers: the product of an image's
 * differences from both is free of their noise. */
struct cached_truth {
    float *half[2]; /* [height][width][3] */
};

struct cached {
    struct relighter *relighter;
    struct relight_desc light;  /* direct light and the background */
    struct relight_stats stats; /* of the last frame */
    struct reason why;
    float *rgb;    /* [height][width][3]: room for an image */
    uint8_t *mask; /* [height][width]: pixels with shade points */
    size_t values; /* in rgb */
};

/* Builds the cache of direct light and lights the bench's sky. ERR_NOMEM; ERR_RANGE: there can be none. */
MUST_CHECK enum err cached_create(struct bench *b, struct cached **out, struct reason *why);
void cached_destroy(struct cached *c); /* NULL is allowed */

/* Computes both references under e by METHOD_AUTO: as many samples as some 20 seconds allow, at most 2048. ERR_NOMEM;
 * finish it all the same. */
MUST_CHECK enum err cached_truth_make(struct cached *c, const struct environment *e, struct cached_truth *t);
void cached_truth_finish(struct cached_truth *t);

/* relMSE of x over pixels with shade points against two references (measure/chart/judge.h). ERR_NOMEM. */
MUST_CHECK enum err cached_rel_mse(const struct bench *b, const struct cached *c, float *const half[2], const float *x,
                                   double *out);

/* The bias of direct light (rows_bias.c): figures, or why there are none. ERR_NOMEM, and errors of the stages.
 * cached_bias: the errors under the bench's sky without its sun, if it has one: the relMSE, and the roots of
 * mean squares of delta E within tiles. cached_seams: per cent of the border pixels of blocks whose compression shows.
 * cached_motion: how uneven a turning sky changes, in 8-bit codes. */
MUST_CHECK enum err cached_bias(struct bench *b, struct cached *c, bool sun, struct bench_row *rel_mse,
                                struct bench_row *delta_e);
MUST_CHECK enum err cached_seams(struct bench *b, struct bench_row *row);
MUST_CHECK enum err cached_motion(struct bench *b, struct cached *c, struct bench_row *row);
