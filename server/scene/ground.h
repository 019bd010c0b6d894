/* The ground: a shadow catcher below the model. It is a Lambert disc of GROUND_ALBEDO at the model's lowest point, a
 * ten-thousandth of the model's radius below it so that a flat bottom does not lie in it. It takes part in light
 * transport like any surface; the camera sees the background there, times what the model changes of the ground's light
 * (light/ground.h). With r the radius of the sphere around the model's box, it is solid to GROUND_SOLID r and fades out
 * to GROUND_FAR r, as fractional coverage (coverage.h). Thread: one at a time per scene. */
#ifndef SCENE_GROUND_H
#define SCENE_GROUND_H

#include "scene/scene.h"

#define GROUND_ALBEDO 0.2f /* as dry soil, grass and concrete; of the computed sky's own ground, too */
#define GROUND_SOLID 8.0f
#define GROUND_FAR 16.0f /* a uniform sky's shadow of the model is below 0.03 % there */

/* Adds it, sets scene->ground, and moves a camera that frames the model (scene_framing_camera) back. The scene must be
 * complete; one that has a ground stays as it is. ERR_NOMEM. ERR_RANGE: the model has no size, or the disc would exceed
 * the limit of coordinates; `name` begins the message. */
MUST_CHECK enum err scene_add_ground(struct scene *s, const char *name, struct reason *why);

/* ERR_RANGE if the camera is below the ground, from where nothing could be seen of the model. Without a ground always
 * ERR_OK. */
MUST_CHECK enum err ground_check_camera(const struct scene *s, const struct camera *c, const char *name,
                                        struct reason *why);

#endif
