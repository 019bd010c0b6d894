/* A camera as Radiance's VIEW line, for the header of an image. Thread: any. */
#pragma once

#include "scene/geometry/view.h"

#define RADIANCE_VIEW_LINE 512

/* "VIEW= -vtv -vp ...\n" in Radiance's axes: x east, y north, z up. -vd and -vu need not be perpendicular.
 * "" for an equisolid fisheye, which Radiance does not support. */
void radiance_view_line(const struct view *v, char out[RADIANCE_VIEW_LINE]);
