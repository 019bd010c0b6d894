/* Draco's C++ library behind functions of C. Private to this room. Thread: one at a time. */
#pragma once

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct draco_mesh;

enum draco_number { /* types of glTF that an attribute can become */
                    DRACO_INT8,
                    DRACO_UINT8,
                    DRACO_INT16,
                    DRACO_UINT16,
                    DRACO_UINT32,
                    DRACO_FLOAT32,
};

enum draco_result {
    DRACO_OK,
    DRACO_DAMAGED, /* why has the reason */
    DRACO_NO_MEMORY,
};

/* Decompresses a mesh. On DRACO_OK the caller owns *out; free it with draco_mesh_destroy. */
enum draco_result draco_mesh_decode(const void *bytes, size_t size, struct draco_mesh **out, char why[128]);
void draco_mesh_destroy(struct draco_mesh *m); /* NULL is allowed */

size_t draco_mesh_points(const struct draco_mesh *m);    /* vertices */
size_t draco_mesh_triangles(const struct draco_mesh *m); /* faces */

/* Writes three indices per triangle, each below draco_mesh_points. */
void draco_mesh_indices(const struct draco_mesh *m, uint32_t *out);

/* Writes the attribute with this unique id, `components` numbers of that type for each point. False: it does not exist
 * or cannot be converted. */
bool draco_mesh_attribute(const struct draco_mesh *m, uint32_t id, enum draco_number type, size_t components,
                          void *out);

#ifdef __cplusplus
}
#endif
