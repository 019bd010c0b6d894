/* The report on where a pixel's light comes from: the JSON that relightd sends in reply to `probe` and relight-render
 * prints for --probe (protocol/PROTOCOL.md 4.16). Thread: one per struct prober. */
#pragma once

#include "light/frame/relight.h"
#include "light/inspector/probe.h"

#define PROBE_SKY_WIDTH 256 /* size of the sky image, lat-long */
#define PROBE_SKY_HEIGHT 128
#define PROBE_TEXT_MAX ((size_t)60 << 10) /* bytes of a report, which omits the sky image if it would not fit */

struct probe_request {
    uint32_t x, y;    /* must lie in the image */
    uint32_t samples; /* 1..PROBE_SAMPLES_MAX; 0: those of `light` */
    bool figure;      /* use the preset of probe.h */
    bool sky;         /* include the sky image */
};

/* What the scene's own lamps give the pixel. */
struct probe_lamps {
    double scale; /* that the image has of them */
    float rgb[3]; /* their radiance at scale 1 */
};

struct prober;

/* set and kernels must outlive the prober. NULL: out of memory. */
struct prober *prober_create(const struct set *set, const struct kernels *kernels);
void prober_destroy(struct prober *p); /* NULL is allowed */

/* light: the settings that rendered the image; rgb: the image, float[height][width][3], or NULL; lamps: NULL if
 * the scene has none. On ERR_OK *text is a JSON object that the caller frees with mem_free. ERR_NOMEM; errors of
 * probe_run. */
MUST_CHECK enum err prober_report(struct prober *p, const struct environment *e, const struct relight_desc *light,
                                  const struct probe_request *q, const float *rgb, const struct probe_lamps *lamps,
                                  char **text);

/* The sky image alone, as the JSON object of PROTOCOL.md 4.16.10. The caller frees *text with mem_free. ERR_NOMEM. */
MUST_CHECK enum err prober_sky(struct prober *p, const struct environment *e, char **text);

/* As prober_report, printed as one line to standard output. Also ERR_IO. */
MUST_CHECK enum err prober_print(struct prober *p, const struct environment *e, const struct relight_desc *light,
                                 const struct probe_request *q, const float *rgb, const struct probe_lamps *lamps,
                                 struct reason *why);
