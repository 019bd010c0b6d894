/* server/chart/digest.h */
/* Names for what a reference shows: 128 bits that change with anything that would change the picture. Not for
 * adversaries. Any thread. */
#ifndef CHART_DIGEST_H
#define CHART_DIGEST_H

#include "frame.h"
#include "scene.h"
#include "view.h"

#include <stddef.h>
#include <stdint.h>

struct digest {
    uint64_t half[2];
};

void digest_begin(struct digest *d);
void digest_bytes(struct digest *d, const void *bytes, size_t size);
void digest_u64(struct digest *d, uint64_t value);

/* What was loaded, not the files it came from: geometry, materials and textures, wherever they stood. */
void digest_scene(struct digest *d, const struct scene *scene);
void digest_view(struct digest *d, const struct view *view);

/* The frame's bytes or texels and its layout, not its name or number. */
void digest_frame(struct digest *d, const struct frame *frame);

#endif
