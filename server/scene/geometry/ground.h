/* The ground: a shadow catcher below the model. It is a Lambertian disc with albedo GROUND_ALBEDO, a ten-thousandth of
 * the model's radius below the model's lowest point so that a flat bottom does not coincide with it. It takes part in
 * light transport like any surface, but the camera sees the background there, scaled by the model's effect on the
 * ground's light (light/ground.h). With r the radius of the sphere around the model's box, it is solid to GROUND_SOLID
 * r and fades out to GROUND_FAR r, as fractional coverage (coverage.h). Thread: one at a time per scene. */
#pragma once

#include "scene/geometry/scene.h"

#define GROUND_ALBEDO 0.2f /* as of dry soil, grass and concrete; also that of the computed sky's ground */
#define GROUND_SOLID 8.0f
#define GROUND_FAR 16.0f /* there a uniform sky's shadow of the model is below 0.03 % */

/* Adds the ground, sets scene->ground, and moves a camera that frames the model (scene_framing_camera) back. The scene
 * must be complete; a scene that has a ground already is left unchanged. ERR_NOMEM. ERR_RANGE: the model has no size,
 * or the disc would exceed the limit of coordinates; `name` begins the message. */
MUST_CHECK enum err scene_add_ground(struct scene *s, const char *name, struct reason *why);

/* ERR_RANGE if the camera is below the ground, which would hide the model. Always ERR_OK without a ground. */
MUST_CHECK enum err ground_check_camera(const struct scene *s, const struct camera *c, const char *name,
                                        struct reason *why);
