/* Where the light of a pixel comes from, as text: what relightd answers to `probe` and relight-render prints for
 * --probe, the same JSON, described in protocol/PROTOCOL.md 4.16. One thread of control. */
#ifndef FILM_PROBE_REPORT_H
#define FILM_PROBE_REPORT_H

#include "probe.h"
#include "relight.h"

#define PROBE_SKY_WIDTH 256 /* of the sky's picture, lat-long */
#define PROBE_SKY_HEIGHT 128
#define PROBE_TEXT_MAX ((size_t)60 << 10) /* bytes that a report has at most; the sky is left out before that */

struct probe_question {
    uint32_t x, y;    /* pixel; must lie in the picture */
    uint32_t samples; /* 1..PROBE_SAMPLES_MAX; 0: the light's own */
    bool figure;      /* the preset of probe.h */
    bool sky;         /* with the sky's picture */
};

struct prober;

/* set and kernels must outlive it. NULL when out of memory. */
struct prober *prober_create(const struct set *set, const struct kernels *kernels);
void prober_destroy(struct prober *p); /* NULL is allowed */

/* light: what the picture is made by; rgb: the picture, float[height][width][3], or NULL. On ERR_OK *text is a JSON
 * object, to be freed with mem_free. ERR_NOMEM, and what probe_run refuses. */
MUST_CHECK enum err prober_report(struct prober *p, const struct environment *e, const struct relight_desc *light,
                                  const struct probe_question *q, const float *rgb, char **text);

/* The sky alone: the JSON object of PROTOCOL.md 4.16.10, likewise. ERR_NOMEM. */
MUST_CHECK enum err prober_sky(struct prober *p, const struct environment *e, char **text);

/* The same as prober_report, as a line on standard output. ERR_IO too. */
MUST_CHECK enum err prober_print(struct prober *p, const struct environment *e, const struct relight_desc *light,
                                 const struct probe_question *q, const float *rgb, struct reason *why);

#endif
