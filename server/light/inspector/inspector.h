/* Explains the light of one pixel. Splits the estimate of direct light at the pixel's heaviest shading point into its
 * samples, as in [LPG13, Fig. 1], maps the visibility from there, and computes a reference with many more samples.
 * The samples are those of direct_shade itself, recorded by direct.h: with the frame's own method, samples, seed
 * and pass they add up to the frame's value. No data of the renderer is modified. Deterministic. Thread: one per
 * struct inspection. */
#pragma once

#include "light/estimators/direct.h"
#include "light/frame/relight.h"
#include "scene/geometry/view.h"
#include "scene/surface/scatter.h"
#include "sky/daylight/sun.h"

#include <stdbool.h>
#include <stdint.h>

#define INSPECT_MAP_WIDTH 64 /* of the visibility map, a small lat-long image */
#define INSPECT_MAP_HEIGHT 32
#define INSPECT_SAMPLES_MAX 256 /* bounds the message with all of them */

/* The preset: the settings of [LPG13, Fig. 1], independent of the surface's material. */
#define PROBE_FIGURE_SAMPLES 50
#define PROBE_FIGURE_EXPONENT 150.0f

enum probe_visibility {
    INSPECT_BEHIND,  /* below the surface, by its geometric or shading normal */
    INSPECT_BLOCKED, /* occluded */
    INSPECT_OPEN,    /* the sky is visible */
};

struct inspect_desc { /* borrowed */
    const struct scene *scene;
    const struct view *view;
    const struct gbuffer *gbuffer;
    const struct rays *rays;
    const struct environment *environment;
    /* Method, samples, seed, pass and options. METHOD_MIS replaces methods whose strata are not the cube faces, methods
     * without light samples, METHOD_CACHED and references. samples is limited to INSPECT_SAMPLES_MAX. only, keep,
     * counts and log are ignored. */
    struct direct_desc direct;
    uint32_t classes; /* of the image: PATH_* of paths.h; 0: PATH_BACKGROUND | PATH_DIRECT */
    uint32_t x, y;    /* pixel */
    bool figure; /* use the preset: METHOD_MIS, its number of samples, and a Phong lobe of its exponent at the point */
};

struct inspect_mean { /* independent estimates; of direct light INSPECT_SAMPLES_MAX samples by METHOD_AUTO each */
    double mean[3], error[3]; /* error: standard error of the mean */
    uint32_t estimates;
};

enum inspect_part { INSPECT_DIRECT, INSPECT_INDIRECT, INSPECT_CAUSTICS, INSPECT_BACKGROUND, INSPECT_PARTS };

/* The pixel's light by class of paths.h, of which only those of the image are computed. Light of lamps is not in it. */
struct inspect_parts {
    bool known; /* false: the preset, or the pixel shows the ground, which is no sum of them (light/resolve/resolve.h)
                 */
    uint32_t classes;
    struct inspect_mean of[INSPECT_PARTS]; /* independent of each other; the background has no error */
    double share[INSPECT_PARTS];           /* of their luminance; their sum is 1, or 0 if all is black */
};

struct inspect_result {
    enum method method; /* the method that was used */
    uint32_t samples;   /* N_s */
    uint32_t points;    /* shading points of the pixel; 0: nothing in it scatters light from the sky directly */
    uint32_t misses;    /* directions in which it sees the sky, directly or through mirrors and glass */
    struct vec3 miss;   /* the heaviest of them; unit */
    bool hit;           /* the camera ray through the pixel's centre hits a surface */
    struct scatter first;
    /* `first` is that surface. */

    /* The whole pixel: all its points and escapes. Not set for the preset. */
    float radiance[3];             /* summed as in resolve_pixels */
    float background[3];           /* the part that comes directly from the sky */
    struct inspect_mean reference; /* of the radiance */
    struct inspect_parts parts;

    /* The heaviest shading point; set if points > 0. */
    uint32_t point;            /* packet * 16 + lane, as gbuffer_entry.point */
    float weight[3];           /* its weight in the pixel */
    struct shade_packet lane0; /* a copy of the point, as shaded, in lane 0 */
    float lo[3];               /* its radiance: the sum of log's samples divided by N_s */
    struct inspect_mean lo_reference;
    struct direct_log log;                              /* owned by the struct inspection; valid until its next run */
    uint8_t map[INSPECT_MAP_HEIGHT][INSPECT_MAP_WIDTH]; /* enum probe_visibility */
    double open;                                        /* share of the hemisphere that is open sky, by solid angle */
    double open_cosine;                                 /* the same, weighted by the cosine with the shading normal */
};

struct inspection;

struct inspection *inspect_create(const struct kernels *kernels); /* NULL when out of memory */
void inspect_destroy(struct inspection *p);                       /* NULL is allowed */

/* Analyses a pixel. x, y must lie in the image, and the environment must be ready. Uses OpenMP. The probe owns
 * out->log. ERR_NOMEM; errors of direct_shade. */
MUST_CHECK enum err inspect_run(struct inspection *p, const struct inspect_desc *desc, struct inspect_result *out);

/* Whether the part was computed. */
bool inspect_has_part(const struct inspect_parts *parts, enum inspect_part part);

/* The direction (unit, world) through the centre of a cell of the visibility map. */
void inspect_map_direction(uint32_t column, uint32_t row, float w[3]);

/* ---- inspector_parts.c ---- */

/* Divides the light of a pixel by the classes of paths.h. Direct light is the probe's reference, the background is
 * exact, and each other class has eye paths of its own (eye_paths.h) at the pixel's shading points, without a limit on
 * their light: unbiased. Thread: one at a time; runs on all OpenMP threads. */

/* Fills a->parts. Of *a it reads `reference`, which includes the background, and `background`. desc must not use the
 * preset. ERR_NOMEM. */
MUST_CHECK enum err inspect_divide(const struct inspect_desc *desc, struct inspect_result *a);

/* ---- Reports ---- */

/* The report on where a pixel's light comes from: the JSON that relightd sends in reply to `inspection` and
 * relight-render prints for --probe (protocol/PROTOCOL.md 4.16). Thread: one per struct inspector. */

#define INSPECT_SKY_WIDTH 256 /* size of the sky image, lat-long */
#define INSPECT_SKY_HEIGHT 128
#define INSPECT_TEXT_MAX ((size_t)60 << 10) /* bytes of a report, which omits the sky image if it would not fit */

struct inspect_request {
    uint32_t x, y;             /* must lie in the image */
    uint32_t samples;          /* 1..INSPECT_SAMPLES_MAX; 0: those of `light` */
    bool figure;               /* use the preset of probe.h */
    bool sky;                  /* include the sky image */
    const struct sun_day *day; /* of the sun's known way, in the scene; borrowed; NULL: not known */
};

/* What the scene's own lamps give the pixel. */
struct probe_lamps {
    double scale; /* that the image has of them */
    float rgb[3]; /* their radiance at scale 1 */
};

struct inspector;

/* set and kernels must outlive the prober. NULL: out of memory. */
struct inspector *inspector_create(const struct prepared_scene *set, const struct kernels *kernels);
void inspector_destroy(struct inspector *p); /* NULL is allowed */

/* light: the settings that rendered the image; rgb: the image, float[height][width][3], or NULL; lamps: NULL if
 * the scene has none. On ERR_OK *text is a JSON object that the caller frees with mem_free. ERR_NOMEM; errors of
 * inspect_run. */
MUST_CHECK enum err inspector_report(struct inspector *p, const struct environment *e, const struct relight_desc *light,
                                     const struct inspect_request *q, const float *rgb, const struct probe_lamps *lamps,
                                     char **text);

/* The sky image alone, as the JSON object of PROTOCOL.md 4.16.10. The caller frees *text with mem_free. ERR_NOMEM. */
MUST_CHECK enum err inspector_sky(struct inspector *p, const struct environment *e, char **text);

/* As inspector_report, printed as one line to standard output. Also ERR_IO. */
MUST_CHECK enum err inspector_print(struct inspector *p, const struct environment *e, const struct relight_desc *light,
                                    const struct inspect_request *q, const float *rgb, const struct probe_lamps *lamps,
                                    struct reason *why);
