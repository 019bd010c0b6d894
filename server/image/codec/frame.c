#include "image/codec/frame.h"

#include "base/mem.h"

#include <string.h>

/* Frees the old block first, since its contents are not needed, so that both never exist at once. */
static enum err reserve(struct recent *recent, void **block, size_t *capacity, size_t count, size_t size)
{
    recent_add(recent, count <= SIZE_MAX / size ? count * size : SIZE_MAX);
    if (*block && *capacity >= count && !recent_is_outgrown(recent, *capacity * size))
        return ERR_OK;
    mem_free(*block);
    *capacity = 0;
    *block = mem_alloc_raw(count, size);
    if (!*block)
        return ERR_NOMEM;
    *capacity = count;
    return ERR_OK;
}

enum err frame_reserve_bytes(struct frame *f, size_t size)
{
    void *block = f->bytes;

    f->kind = FRAME_NONE;
    f->size = 0;
    memset(f->faces, 0, sizeof(f->faces));
    const enum err e = reserve(&f->recent_bytes, &block, &f->bytes_capacity, size, 1);
    f->bytes = block;
    if (e)
        return e;
    f->kind = FRAME_FILE;
    f->units = 0.0;
    f->size = size;
    return ERR_OK;
}

enum err frame_reserve_texels(struct frame *f, uint32_t width, uint32_t height)
{
    const uint64_t texels = (uint64_t)width * height; /* cannot overflow: less than 2^64 */
    void *block = f->rgb;

    f->kind = FRAME_NONE;
    f->width = f->height = 0;
    if (texels > SIZE_MAX / 3)
        return ERR_NOMEM;
    const enum err e = reserve(&f->recent_rgb, &block, &f->rgb_capacity, 3 * (size_t)texels, sizeof(float));
    f->rgb = block;
    if (e)
        return e;
    f->kind = FRAME_TEXELS;
    f->units = 0.0;
    f->width = width;
    f->height = height;
    return ERR_OK;
}

void frame_finish(struct frame *f)
{
    if (!f)
        return;
    mem_free(f->bytes);
    mem_free(f->rgb);
    *f = (struct frame){ .kind = FRAME_NONE };
}
