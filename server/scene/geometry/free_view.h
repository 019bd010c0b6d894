/* Free views, in addition to the scene's cameras, as text: "@X,Y,Z;X,Y,Z;DEGREES" gives the position, the target and
 * the vertical field of view. No camera's name begins with "@". Thread: any. */
#pragma once

#include "base/choice.h"
#include "base/err.h"
#include "scene/geometry/scene.h"

#include <stdbool.h>

#define FREE_VIEW_TEXT sizeof(((struct camera *)0)->name)

bool free_view_is(const char *name); /* tests the first character */

/* Parses a free view; the text becomes the camera's name. Up is +Y, or +Z where that is the viewing direction.
 * ERR_USAGE: *why says what is wrong. */
MUST_CHECK enum err free_view_read(const char *text, struct camera *out, struct reason *why);

/* Rounded to a tenth of a millimetre, or six digits; "" if the camera is so far away that it does not fit. */
void free_view_write(const struct camera *c, char out[FREE_VIEW_TEXT]);

/* Cameras' projections by name: "perspective" and so on. */
extern const struct setting_choice projection_choices[];

/* The changes that --position X,Y,Z, --look-at X,Y,Z, --fov DEGREES and --projection make to a camera. */
struct view_change {
    bool has_position, has_look_at;
    struct vec3 position, look_at; /* m */
    float fov_y;                   /* radians; 0: none */
    bool has_projection;
    enum camera_projection projection; /* a fisheye without fov_y spans 180 degrees */
};

/* position, look_at: NULL: not given; degrees 0: not given. ERR_USAGE names the flag. */
MUST_CHECK enum err view_change_read(const char *position, const char *look_at, double degrees, struct view_change *out,
                                     struct reason *why);
/* ERR_USAGE: the camera would see nothing. */
MUST_CHECK enum err view_change_apply(const struct view_change *change, struct camera *c, struct reason *why);
