/* server/stream/picture.h */
/* One encoded picture on its way to any number of viewers: bytes and header, counted references, never changed once
 * published, so that fifty viewers share one copy. All functions: any thread. */
#ifndef STREAM_PICTURE_H
#define STREAM_PICTURE_H

#include "relight_protocol.h"

#include <stddef.h>
#include <stdint.h>

struct picture;

/* Copies `size` bytes of an encoded picture. header->payload, sequence and published_us are set here or by
 * server_publish and need not be given. One reference, the caller's. NULL when out of memory or size is 0 or above
 * PICTURE_BYTES_MAX. */
#define PICTURE_BYTES_MAX ((size_t)512 << 20)
struct picture *picture_create(const struct protocol_picture *header, const uint8_t *bytes, size_t size);

/* Before it is published, of H.264: the track that it belongs to (server.h); else 0, the whole picture at every rate.
 */
void picture_set_track(struct picture *p, unsigned track);
unsigned picture_track(const struct picture *p);

struct picture *picture_ref(struct picture *p); /* returns p */
void picture_unref(struct picture *p);          /* frees it with the last reference; NULL is allowed */

const struct protocol_picture *picture_header(const struct picture *p);

/* The bytes as they go over the wire: the encoded header, then the payload. */
const uint8_t *picture_message(const struct picture *p, size_t *size);

#endif
