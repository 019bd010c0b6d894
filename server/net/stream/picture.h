/* An encoded picture: header and bytes, reference-counted and constant once published, so that all viewers share one
 * copy. All functions: any thread. */
#pragma once

#include "protocol/relight_protocol.h"

#include <stddef.h>
#include <stdint.h>

struct picture;

#define PICTURE_BYTES_MAX ((size_t)512 << 20)

/* Copies `size` bytes of an encoded picture. This function or server_publish sets header->payload, sequence and
 * published_us. The caller owns one reference. NULL: out of memory, or size is 0 or above PICTURE_BYTES_MAX. */
struct picture *picture_create(const struct protocol_picture *header, const uint8_t *bytes, size_t size);

/* Before publication, of H.264: its track (server.h). Default 0. */
void picture_set_track(struct picture *p, unsigned track);
unsigned picture_track(const struct picture *p);

/* Before publication: marks it as a rendition (server.h), which is not for viewers; its header's format is ignored. */
void picture_set_rendition(struct picture *p, unsigned slot, uint64_t serial);

struct picture *picture_ref(struct picture *p); /* returns p */
void picture_unref(struct picture *p);          /* frees it with the last reference; NULL is allowed */

/* Owned by p; complete once it is published. */
const struct protocol_picture *picture_header(const struct picture *p);

/* The bytes on the wire: encoded header, then payload. Owned by p. */
const uint8_t *picture_message(const struct picture *p, size_t *size);
