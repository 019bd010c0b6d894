/* The cache of interreflection in a file of tables (scene/cache_file.h), beside that of direct light. What is loaded
 * gives the same bits as what was saved. */
#ifndef SHADE_BOUNCE_FILE_H
#define SHADE_BOUNCE_FILE_H

#include "bounce.h"
#include "cache_file.h"
#include "digest.h"

/* Of all that decides what it is: direct, which is the direct light's key (transport_file.h), how all surfaces look,
 * and desc but for its memory. */
struct digest bounce_key(const struct digest *direct, const struct bounce_desc *desc);

/* Puts its sections; b must outlive the writer. */
void bounce_save(const struct bounce *b, const struct digest *key, struct cache_writer *w);

/* As bounce_create, out of a file. Errors as of transport_load. */
MUST_CHECK enum err bounce_load(struct cache_reader *r, const struct digest *key, const struct bounce_desc *desc,
                                const struct kernels *kernels, struct bounce **out, struct reason *why);

#endif
