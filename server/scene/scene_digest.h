/* Parts of this room in a digest (base/digest.h), as they were loaded or made, wherever they stood. Any thread. */
#ifndef SCENE_SCENE_DIGEST_H
#define SCENE_SCENE_DIGEST_H

#include "digest.h"
#include "gbuffer.h"
#include "scene.h"
#include "view.h"

/* Geometry, materials and textures. */
void digest_scene(struct digest *d, const struct scene *scene);

/* What a ray can meet, and nothing of how it looks. */
void digest_geometry(struct digest *d, const struct scene *scene);

void digest_view(struct digest *d, const struct view *view);

/* Shade points with their colours, and the picture's size; not which pixels they are for. */
void digest_points(struct digest *d, const struct gbuffer *g);

#endif
