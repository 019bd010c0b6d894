/* Adds parts of a scene to a digest (base/digest.h): their contents, independent of addresses. Thread: any. */
#pragma once

#include "base/digest.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/scene.h"
#include "scene/geometry/view.h"

/* Geometry, materials and textures. */
void digest_scene(struct digest *d, const struct scene *scene);

/* Geometry and its holes only, without colours. */
void digest_geometry(struct digest *d, const struct scene *scene);

void digest_view(struct digest *d, const struct view *view); /* camera and image size */

/* Shading points with their colours, and the image size, but not the assignment to pixels. */
void digest_points(struct digest *d, const struct gbuffer *g);
