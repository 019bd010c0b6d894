/* server/choose/plan.h */
/* Which estimator is to take which class of light paths in a picture, and with how many samples: model no more than the
 * scene needs. The classes are those of estimators/paths.h; each is taken by exactly one estimator, or left out with a
 * reason. Direct light is not chosen here: it is always worth its price. Pure functions; any thread. */
#ifndef CHOOSE_PLAN_H
#define CHOOSE_PLAN_H

#include "base/choice.h"

#include <stdbool.h>
#include <stdint.h>

enum plan_estimator {
    PLAN_AUTO,   /* as a wish: choose. Never in an answer */
    PLAN_NONE,   /* left out */
    PLAN_LIGHT,  /* the light tracer; what it cannot reach (points behind mirrors and glass) by eye paths */
    PLAN_EYE,    /* eye paths */
    PLAN_STORED, /* caustics: light paths that are kept and lit anew, and the light tracer for the sun. Not asked of
                  * interreflection, which has it for what caustics throw on where they have */
    PLAN_CACHE,  /* interreflection: what stands still, computed beforehand. Neither a wish nor the plan's own answer:
                  * whoever has such a cache lets it take what the plan gave to eye paths */
};

/* What is known of scene, picture and sky. */
struct plan_facts {
    uint64_t casters; /* meshes that scatter by a delta lobe */
    uint64_t points;  /* shade points */
    uint64_t behind;  /* of them, seen in a mirror or through glass */
    uint64_t pixels;
    double albedo;     /* mean luminance of what the shade points give back of a white sky, 0..1 */
    double peakedness; /* mean square of the sky's luminance over the square of its mean, >= 1; 0: unknown, black */
};

struct plan_wish {
    bool caustics, indirect; /* the classes that were asked for */
    enum plan_estimator caustics_by, indirect_by;
    uint64_t particles; /* 0: choose */
    uint32_t eye_paths; /* per shade point; 0: choose */
    uint32_t samples;   /* N_s of direct light, by which the rest is measured */
    bool stored;        /* what stands still is kept from frame to frame: caustics, unless they are asked of another */
};

#define PLAN_LEFT_OUT_MAX 10

struct plan {
    enum plan_estimator caustics, indirect;  /* at points that the camera sees directly */
    enum plan_estimator indirect_caustics;   /* interreflection of caustics, which may have another than the rest */
    bool behind_caustics, behind_indirect;   /* at the others, by eye paths */
    uint64_t particles;                      /* 0 where the light tracer has nothing to do */
    uint32_t eye_paths;                      /* per shade point; 0 where nobody needs them */
    const char *left_out[PLAN_LEFT_OUT_MAX]; /* sentences without a full stop */
    uint32_t left_out_count;
};

void plan_make(const struct plan_facts *facts, const struct plan_wish *wish, struct plan *out);

/* "none", "light tracer", "eye paths", "stored light paths", "cache". */
const char *plan_estimator_name(enum plan_estimator e);

/* What may be asked for, of each class. */
extern const struct setting_choice caustics_choices[], indirect_choices[];

#endif
