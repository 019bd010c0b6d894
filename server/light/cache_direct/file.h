/* Stores the cache of direct light in a file (light/cache/cache_file.h), which a later run loads instead of computing
 * it. A loaded cache has the same bits as the saved one. Thread: one per reader and writer. */
#pragma once

#include "base/digest.h"
#include "light/cache/cache_file.h"
#include "light/cache_direct/transport.h"

/* The digest of everything that determines the transport: shade points, geometry, and desc except max_bytes, progress
 * and cancel. */
struct digest transport_key(const struct gbuffer *g, const struct scene *scene, const struct transport_desc *desc);

/* Adds the sections of t to w, which borrows them: t must outlive w. cache_writer_store reports a lack of memory. */
void transport_save(const struct transport *t, const struct digest *key, struct cache_writer *w);

/* Loads the result of transport_create. The caller frees *out with transport_destroy; on an error it is NULL. The
 * caller may compute the cache after ERR_FORMAT (damaged sections), ERR_UNSUPPORTED (another key), ERR_END (no such
 * sections) and ERR_IO. ERR_RANGE: max_bytes is too small. ERR_NOMEM. */
MUST_CHECK enum err transport_load(struct cache_reader *r, const struct digest *key, const struct gbuffer *g,
                                   const struct rays *rays, const struct kernels *kernels,
                                   const struct transport_desc *desc, struct transport **out, struct reason *why);
