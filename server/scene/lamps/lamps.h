/* Computes the radiance of a G-buffer's shading points from the scene's own emitters, in successive batches of samples.
 * Sample i of a point does not depend on the batch sizes; sums are in float, in the order of batches. Thread: one at a
 * time; runs on all OpenMP threads, and the result does not depend on their number. */
#pragma once

#include "base/rng.h"
#include "base/vec.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"
#include "scene/surface/lobe.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct lamps;

struct lamps_desc { /* all must outlive the lamps */
    const struct scene *scene;
    const struct rays *rays;
    const struct gbuffer *gbuffer;
    uint64_t seed;
    bool by_lobes_alone; /* as below; for tests */
};

struct lamps_stats {
    uint64_t triangles, lights; /* emissive triangles, punctual lights */
    uint64_t samples;           /* per shading point */
    uint64_t rays;
};

/* Needs 192 bytes per packet of shading points. The caller owns the result. NULL when out of memory. */
struct lamps *lamps_create(const struct lamps_desc *desc);
void lamps_destroy(struct lamps *l); /* NULL is allowed */

/* Adds `samples` paths per shading point. Once *cancel is true (NULL: never), abandons the batch and returns false; the
 * sums are then invalid. */
bool lamps_refine(struct lamps *l, uint32_t samples, const atomic_bool *cancel);

/* float[packet_count][3][16]: the sums over all samples, in the layout for resolve_pixels. Borrowed. */
const float *lamps_sums(const struct lamps *l);
void lamps_get_stats(const struct lamps *l, struct lamps_stats *out);

/* ---- Emitters ---- */

/* The emitters of a scene: a table of its emissive triangles, and its punctual lights. Immutable once created. Thread:
 * any number may read. */

struct emitters;

/* scene and rays must outlive the emitters. The caller owns the result. NULL when out of memory. */
struct emitters *emitters_create(const struct scene *scene, const struct rays *rays);
void emitters_destroy(struct emitters *e); /* NULL is allowed */

/* The numbers of emissive triangles and of punctual lights. */
uint64_t emitters_triangles(const struct emitters *e);
uint64_t emitters_lights(const struct emitters *e);

/* Light that arrives at a point, without occlusion. */
struct arrival {
    struct vec3 dir; /* towards the light; length 1 */
    struct vec3 to;  /* from the point to the end of the shadow ray, not normalised; equals dir for directional light */
    float tfar;      /* of a shadow ray along `to` */
    double rgb[3];   /* triangles: radiance; punctual lights: irradiance of a surface that faces the light, divided by
                        the probability of picking this light */
    double density;  /* sr^-1; triangles only */
};

/* Samples a point on the emissive triangles: selects a triangle in proportion to area times luminance of its emission,
 * and a uniform point on it. False: there are none, or the triangle is edge-on or emits nothing at the point. x: three
 * numbers in [0, 1). */
bool emitters_sample(const struct emitters *e, struct vec3 from, const double x[3], struct arrival *out);

/* The density, sr^-1, with which emitters_sample picks the direction of a hit at distance t (in units of dir's length,
 * which is 1) on a surface with this geometric normal. */
double emitters_density(const struct emitters *e, const struct hit *h, struct vec3 geometric, struct vec3 dir);

/* Picks a punctual light in proportion to its unoccluded irradiance at the point, by one number in [0, 1). False: none
 * reaches it. */
bool emitters_pick_light(const struct emitters *e, struct vec3 from, double x, struct arrival *out);

/* The irradiance of a surface at `from` that faces the light. dir: towards the light, unit; *distance: INFINITY for
 * directional lights. The spot's falloff is the square of a linear function of the cosine [KHR_lights_punctual]. */
void light_arrive(const struct punctual_light *l, struct vec3 from, struct vec3 *dir, double *distance, double rgb[3]);

/* ---- Paths to the emitters ---- */

/* One path from a shading point to the scene's emitters. With f the BRDF and w a direction from the rough lobe,
 *     Lo = integral of f(wo, w) max(0, n.w) L(w) dw + sum over the punctual lights of f(wo, w_i) max(0, n.w_i) E_i,
 * where L(w) is the light that the surface along w emits, plus the emitters' light that it reflects. At the point and
 * at every further rough surface, an emissive triangle is sampled and a BRDF ray continues the path; the balance
 * heuristic combines the two [Veach 1997, Eq. 9.8]. Mirrors and glass block shadow rays: behind them the BRDF ray
 * counts with weight 1, and punctual lights, which no ray can hit, contribute no light. One ray continues from each
 * event, selected in proportion to throughput; Russian roulette ends paths without bias [Veach 1997, section 10.4].
 * Thread: any. */

/* Maximum number of events of a path, see PATH_EVENTS_MAX. */
#define WALK_EVENTS_MAX 256

/* Numbers in [0, 1) for the first event; later events use a stream of the path's own. */
enum walk_number {
    WALK_PICK_TRIANGLE,
    WALK_PICK_LOBE,
    WALK_TRIANGLE, /* two: the position on it */
    WALK_LOBE = 4, /* two: the direction */
    WALK_NUMBERS = 6,
};

struct walk_world { /* borrowed */
    const struct scene *scene;
    const struct rays *rays;
    const struct emitters *emitters;
    bool by_lobes_alone; /* sample no triangles, for tests: the same mean with more noise */
};

struct walk_start { /* a shading point */
    struct lobe lobe;
    struct vec3 origin, wo;
};

/* Adds the radiance of one path to sum, and its rays to *rays. */
void walk_sample(const struct walk_world *world, const struct walk_start *start, const double x[WALK_NUMBERS],
                 struct rng *rng, double sum[3], uint64_t *rays);
