/* The cache of light transport in a file of tables (scene/cache_file.h), which another run may load instead of
 * computing it. What is loaded gives the same bits as what was saved. */
#ifndef SHADE_TRANSPORT_FILE_H
#define SHADE_TRANSPORT_FILE_H

#include "cache_file.h"
#include "digest.h"
#include "transport.h"

/* Of all that decides what the transport is: shade points, geometry, and desc but for its memory. */
struct digest transport_key(const struct gbuffer *g, const struct scene *scene, const struct transport_desc *desc);

/* Puts its sections; t must outlive the writer. */
void transport_save(const struct transport *t, const struct digest *key, struct cache_writer *w);

/* As transport_create, out of a file. ERR_FORMAT: the sections do not hold what they should, ERR_UNSUPPORTED: they are
 * of something else, ERR_END: they are not there, ERR_IO; what can then be done is to compute it. ERR_RANGE, ERR_NOMEM.
 * On an error *out is NULL. */
MUST_CHECK enum err transport_load(struct cache_reader *r, const struct digest *key, const struct gbuffer *g,
                                   const struct rays *rays, const struct kernels *kernels,
                                   const struct transport_desc *desc, struct transport **out, struct reason *why);

#endif
