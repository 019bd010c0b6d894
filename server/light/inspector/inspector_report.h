/* The report on where a pixel's light comes from: the JSON that relightd sends in reply to `inspection` and
 * relight-render prints for --probe (protocol/PROTOCOL.md 4.16). Thread: one per struct inspector. */
#pragma once

#include "light/frame/relight.h"
#include "light/inspector/inspector.h"

#define INSPECT_SKY_WIDTH 256 /* size of the sky image, lat-long */
#define INSPECT_SKY_HEIGHT 128
#define INSPECT_TEXT_MAX ((size_t)60 << 10) /* bytes of a report, which omits the sky image if it would not fit */

struct inspect_request {
    uint32_t x, y;    /* must lie in the image */
    uint32_t samples; /* 1..INSPECT_SAMPLES_MAX; 0: those of `light` */
    bool figure;      /* use the preset of probe.h */
    bool sky;         /* include the sky image */
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
