#include "net/stream/server.h"

#include "base/mem.h"

#include "net/stream/internal.h"

#include <assert.h>
#include <stdatomic.h>
#include <string.h>

struct sent_image {
    atomic_uint references;
    struct protocol_picture header;
    int64_t placed_us;
    unsigned track;
    unsigned rendition; /* slot + 1; 0: an image for viewers */
    uint64_t serial;    /* of that slot's use */
    uint64_t made;      /* server.begun when it was published */
    uint64_t counted;   /* the last round of holdings.c that counted it */
    size_t size;        /* of message */
    uint8_t message[];
};

struct sent_image *image_create(const struct protocol_picture *header, const uint8_t *bytes, size_t size)
{
    if (size == 0 || size > IMAGE_BYTES_MAX)
        return NULL;
    struct sent_image *p = mem_alloc_raw(1, sizeof(*p) + PROTOCOL_PICTURE_BYTES + size);
    if (!p)
        return NULL;
    atomic_init(&p->references, 1);
    p->header = *header;
    p->header.payload = (uint32_t)size;
    p->track = p->rendition = 0;
    p->serial = p->made = p->counted = 0;
    p->size = PROTOCOL_PICTURE_BYTES + size;
    protocol_picture_encode(&p->header, p->message);
    memcpy(p->message + PROTOCOL_PICTURE_BYTES, bytes, size);
    return p;
}

void image_set_track(struct sent_image *p, unsigned track)
{
    assert(p->header.sequence == 0 && track < SERVER_TRACKS);
    p->track = track;
}

unsigned image_track(const struct sent_image *p)
{
    return p->track;
}

void image_set_rendition(struct sent_image *p, unsigned slot, uint64_t serial)
{
    assert(p->header.sequence == 0 && slot < SERVER_RENDITIONS);
    p->rendition = slot + 1;
    p->serial = serial;
}

int image_rendition(const struct sent_image *p, uint64_t *serial)
{
    *serial = p->serial;
    return (int)p->rendition - 1;
}

struct sent_image *image_ref(struct sent_image *p)
{
    atomic_fetch_add_explicit(&p->references, 1, memory_order_relaxed);
    return p;
}

void image_unref(struct sent_image *p)
{
    /* Release: what this thread read must be done before; acquire: the one that frees sees all of that. */
    if (p && atomic_fetch_sub_explicit(&p->references, 1, memory_order_acq_rel) == 1)
        mem_free(p);
}

const struct protocol_picture *image_header(const struct sent_image *p)
{
    return &p->header;
}

const uint8_t *image_message(const struct sent_image *p, size_t *size)
{
    *size = p->size;
    return p->message;
}

void image_stamp(struct sent_image *p, uint64_t sequence, uint64_t made, int64_t published_us, uint8_t flags)
{
    assert(p->header.sequence == 0); /* published once */
    p->header.sequence = sequence;
    p->made = made;
    p->header.published_us = published_us;
    p->placed_us = stream_now_us();
    p->header.flags |= flags;
    protocol_picture_encode(&p->header, p->message);
}

uint64_t image_made(const struct sent_image *p)
{
    return p->made;
}

bool image_count(struct sent_image *p, uint64_t round)
{
    const bool first = p->counted != round;

    p->counted = round;
    return first;
}

int64_t image_placed_us(const struct sent_image *p)
{
    return p->placed_us;
}
