/* An encoded image: header and bytes, reference-counted and constant once published, so that all viewers share one
 * copy. All functions: any thread. */
#pragma once

#include "protocol/relight_protocol.h"

#include <stddef.h>
#include <stdint.h>

struct sent_image;

#define IMAGE_BYTES_MAX ((size_t)512 << 20) /* bounds memory */

/* Copies `size` bytes of an encoded image. This function or server_publish sets header->payload, sequence and
 * published_us. The caller owns one reference. NULL: out of memory, or size is 0 or above IMAGE_BYTES_MAX. */
struct sent_image *image_create(const struct protocol_picture *header, const uint8_t *bytes, size_t size);

/* Before publication, of H.264: its track (server.h). Default 0. */
void image_set_track(struct sent_image *p, unsigned track);
unsigned image_track(const struct sent_image *p);

/* Before publication: marks it as a rendition (server.h), which is not for viewers; its header's format is ignored. */
void image_set_rendition(struct sent_image *p, unsigned slot, uint64_t serial);

struct sent_image *image_ref(struct sent_image *p); /* returns p */
void image_unref(struct sent_image *p);             /* frees it with the last reference; NULL is allowed */

/* Owned by p; complete once it is published. */
const struct protocol_picture *image_header(const struct sent_image *p);

/* The bytes on the wire: encoded header, then payload. Owned by p. */
const uint8_t *image_message(const struct sent_image *p, size_t *size);
