/* Stores the cache of indirect light in a file (light/cache/cache_file.h), next to the cache of direct light. A loaded
 * cache has the same bits as the saved one. Thread: one per reader and writer. */
#pragma once

#include "base/digest.h"
#include "light/cache/cache_file.h"
#include "light/cache_indirect/indirect.h"

/* The digest of everything that determines the cache: `direct`, the key of transport_key, the materials, and desc
 * except max_bytes, progress and cancel. */
struct digest indirect_key(const struct digest *direct, const struct indirect_desc *desc);

/* Adds the sections of b to w, which borrows them: b must outlive w. */
void indirect_save(const struct indirect_cache *b, const struct digest *key, struct cache_writer *w);

/* Loads the result of indirect_create. The caller frees *out with indirect_destroy. Errors are those of transport_load.
 */
MUST_CHECK enum err indirect_load(struct cache_reader *r, const struct digest *key, const struct indirect_desc *desc,
                                  const struct kernels *kernels, struct indirect_cache **out, struct reason *why);
