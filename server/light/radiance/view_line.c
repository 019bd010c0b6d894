#include "light/radiance/components.h"

#include "base/vec.h"

#include <math.h>
#include <stdio.h>

#define DEGREES (180.0 / PI)

/* A direction of ours in Radiance's axes. */
static void turn(const double w[3], double out[3])
{
    out[0] = -w[0];
    out[1] = w[2];
    out[2] = w[1];
}

/* Radiance's type of view, and the angles that width and height span. Radiance has no type for equal solid angles:
 * NULL. */
static const char *type_of(const struct view *v, double *across, double *down)
{
    if (v->projection == PROJECTION_EQUIDISTANT) {
        *down = DEGREES * v->step * v->height;
        *across = DEGREES * v->step * v->width;
        return "-vta";
    }
    *across = 2.0 * DEGREES * atan(0.5 * v->step * v->width);
    *down = 2.0 * DEGREES * atan(0.5 * v->step * v->height);
    return v->projection == PROJECTION_PERSPECTIVE ? "-vtv" : NULL;
}

void radiance_view_line(const struct view *v, char out[RADIANCE_VIEW_LINE])
{
    double from[3], ahead[3], up[3], across, down;
    const char *type = type_of(v, &across, &down);

    out[0] = '\0';
    if (!type)
        return;
    turn(v->origin, from);
    turn(v->ahead, ahead);
    turn(v->step_y, up); /* which goes down */
    for (int k = 0; k < 3; k++)
        up[k] /= -v->step;
    snprintf(out, RADIANCE_VIEW_LINE,
             "VIEW= %s -vp %.9g %.9g %.9g -vd %.9g %.9g %.9g -vu %.9g %.9g %.9g -vh %.9g -vv %.9g\n", type, from[0],
             from[1], from[2], ahead[0], ahead[1], ahead[2], up[0], up[1], up[2], across, down);
}
