#include "import/formats/import.h"

#include "base/log.h"

#include <string.h>

/* A float resolves a 2^24th of a coordinate: beyond both, no more than 1/16,000 of the model and 0.06 mm of one in
 * metres, */
#define FAR_RADII 512.0
#define FAR_LEAST 1000.0
/* or 8 mm of a model in metres, unless it reaches from here to there. */
#define FAR 1e5
#define FAR_RADII_ABSOLUTE 4.0

void wide_box_grow(struct wide_box *b, const double m[16], const double low[3], const double high[3])
{
    for (int corner = 0; corner < 8; corner++) {
        double p[3];
        for (int k = 0; k < 3; k++)
            p[k] = corner >> k & 1 ? high[k] : low[k];
        for (int row = 0; row < 3; row++) {
            const double v = m[row] * p[0] + m[4 + row] * p[1] + m[8 + row] * p[2] + m[12 + row];
            if (isfinite(v)) {
                b->low[row] = fmin(b->low[row], v);
                b->high[row] = fmax(b->high[row], v);
            }
        }
    }
}

void origin_choose(struct scene *s, const struct wide_box *model, const char *path)
{
    double radius = 0.0, distance = 0.0, centre[3];

    for (int k = 0; k < 3; k++) {
        if (!(model->low[k] <= model->high[k]))
            return;
        centre[k] = 0.5 * (model->low[k] + model->high[k]);
        radius = hypot(radius, 0.5 * (model->high[k] - model->low[k]));
        distance = fmax(distance, fabs(centre[k]));
    }
    const bool far = (distance > FAR_LEAST && distance > FAR_RADII * radius) ||
                     (distance > FAR && distance > FAR_RADII_ABSOLUTE * radius);
    if (s->mesh_count > 0 || !far)
        return;
    for (int k = 0; k < 3; k++)
        s->origin[k] = round(centre[k]);
    log_info("%s: the model lies far from the origin of its coordinates: views and probed points are relative to "
             "(%.10g, %.10g, %.10g), those of flags and of sensors are the file's",
             path, s->origin[0], s->origin[1], s->origin[2]);
}

void origin_start(const struct scene *s, const double transform[16], double out[16])
{
    memmove(out, transform, 16 * sizeof(*out)); /* may be the same */
    for (int k = 0; k < 3; k++)
        out[12 + k] -= s->origin[k];
}
