/* server/bench/bench_parts.h */
/* What the rows share. Inside this room only; main thread. */
#ifndef BENCH_BENCH_PARTS_H
#define BENCH_BENCH_PARTS_H

#include "bench/bench.h"
#include "film/film.h"
#include "codec/frame.h"
#include "codec/jpeg.h"
#include "base/progress.h"
#include "light/relight.h"

struct scene;
struct cached;
struct part;

#define BENCH_QUALITY 85 /* of JPEG, as relightd's default */

struct bench {
    const struct bench_desc *desc;
    struct set *set;
    struct environment *environment;
    const struct kernels *kernels;
    struct relighter *relighter;
    struct relight_desc light;
    struct frame frame;
    uint8_t *exr; /* the sky as a file in memory */
    size_t exr_size;
    float *rgb; /* the picture, made once under the sky */
    float gain; /* of its exposure */
    uint8_t *display;
    int threads;
    uint64_t decode_allocations, encode_allocations; /* what the libraries alone take for one frame */
    struct cached *cached;                           /* cached.h; NULL until a row asks for it */
    struct progress line;
};

struct bench_pair {
    enum err (*ours)(void *);
    enum err (*bare)(void *); /* NULL: `ours` alone is timed */
    void *context;
    /* What one call of each is worth: the row's figures are seconds * scale, or with `rate` scale / seconds. */
    double ours_scale, bare_scale;
    bool rate;
};

/* Times both in turns after one call of each that warms up, calling the short ones several times, and fills the row's
 * figures. */
MUST_CHECK enum err bench_time(struct bench *b, const struct bench_pair *pair, struct bench_row *row);

/* From figures that were taken elsewhere, one of each per round. Sorts them. */
void bench_take(struct bench_row *row, double *ours, double *bare, int rounds);
double bench_median(double *v, int n);

/* How many rounds of so many seconds a row takes: what was asked for, fewer where that would take too long, more where
 * it takes next to nothing. At most BENCH_ROUNDS_MAX. */
int bench_rounds(const struct bench *b, double seconds);

/* Marks the row as not measured. */
void bench_skip(struct bench_row *row, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* An eighth of the picture, spread over it, whose shadow rays by METHOD_MIS are written down; bench_part_replay asks
 * them again, with nothing around. *rays: how many they are. ERR_RANGE: too many to write down. */
MUST_CHECK enum err bench_part_create(struct bench *b, uint32_t samples, struct part **out, uint64_t *rays);
MUST_CHECK enum err bench_part_replay(void *part);
void bench_part_destroy(struct part *p); /* NULL is allowed */

/* Pictures a second of the whole pipeline, lit by this relighter as `light` says: fills the row's figures. *processor:
 * seconds a picture, of all threads. */
MUST_CHECK enum err bench_pipeline_rate(struct bench *b, struct relighter *r, const struct relight_desc *light,
                                        struct bench_row *row, double *processor);

/* One picture of a set, as far as it depends on its size: light, exposure, tone curve, JPEG. */
struct picture_maker {
    struct relighter *relighter;
    const struct environment *environment;
    const struct relight_desc *light;
    const char *level; /* of the kernels */
    struct exposure exposure;
    struct jpeg_encoder *jpeg;
    float *rgb;
    uint8_t *display;
    uint32_t width, height;
};
MUST_CHECK enum err picture_maker_init(struct picture_maker *m, const struct bench *b, const struct set *set);
void picture_maker_finish(struct picture_maker *m);
MUST_CHECK enum err picture_maker_light(struct picture_maker *m);
MUST_CHECK enum err picture_maker_encode(struct picture_maker *m);

/* The rows, each with name, target and figures. */
enum err bench_decode(struct bench *b, struct bench_row *row);
enum err bench_rebuild(struct bench *b, struct bench_row *row);
enum err bench_shadow_rays(struct bench *b, struct bench_row *row);
enum err bench_terms(struct bench *b, struct bench_row *row);
enum err bench_light_rays(struct bench *b, struct bench_row *row);
enum err bench_stored_caustics(struct bench *b, struct bench_row *row);
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
enum err bench_cached_shading(struct bench *b, struct bench_row *row);
enum err bench_cached_pipeline(struct bench *b, struct bench_row *row);
enum err bench_cached_bounce(struct bench *b, struct bench_row *row);
enum err bench_cached_error(struct bench *b, struct bench_row *row);
enum err bench_cached_colour(struct bench *b, struct bench_row *row);
enum err bench_cached_seams(struct bench *b, struct bench_row *row);
enum err bench_cached_motion(struct bench *b, struct bench_row *row);

/* Each of the scene's triangles cut into four at the middles of its edges, `times` times over; the
 * surface is the same. ERR_NOMEM; ERR_RANGE: indices would no longer fit. */
MUST_CHECK enum err subdivide(struct scene *s, int times);

/* Calls of the C library's allocator so far, by whomever in this process, all threads; false where they cannot be
 * counted: in builds with sanitizers, which have an allocator of their own. */
bool allocations_count(uint64_t *out);

/* How many of them one call of `work` makes, on threads of its own included; 0 where they cannot be counted. */
uint64_t allocations_of(enum err (*work)(void *), void *context);

/* Instructions that this thread has executed outside the kernel while `work` ran once; false where the machine does not
 * let its counters be read. */
bool instructions_of(enum err (*work)(void *), void *context, uint64_t *out);

#endif
