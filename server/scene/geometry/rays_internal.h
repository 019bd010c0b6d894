/* The parts of rays.h. Private to this room. Thread: any. */
#pragma once

#include "scene/geometry/coverage.h"
#include "scene/geometry/embree.h"
#include "scene/geometry/rays.h"

struct rays {
    const struct scene *scene;
    struct mask *masks; /* [mesh_count]; filled for the meshes with holes */
    bool has_masks;     /* some are filled, */
    bool placed_masks;  /* of placed meshes, too */
    RTCDevice device;
    RTCScene bvh;        /* meshes in world space and instances of parts: an id is that of the mesh */
    RTCScene *parts;     /* [mesh_count], of placed meshes with arrays of their own; NULL: no mesh is placed */
    int width;           /* lanes of the widest packets that Embree traces natively: 16, 8 or 4 */
    struct ray_log *log; /* NULL except in benchmarks */
};

/* Embree's filter function for meshes with holes: rejects hits in holes. Embree may call it more than once per ray and
 * triangle. */
void rays_drop_holes(const struct RTCFilterFunctionNArguments *a);
