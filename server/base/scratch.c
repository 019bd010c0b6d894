#include "base/mem.h"

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#define PIECES_MAX 256 /* pieces allocated at once; further ones come from mem_alloc */
/* Bytes; larger sizes are rounded up to powers of two, so that similar files request the same sizes. */
#define LARGE 4096

/* Pieces lie one after another in the block. Their list is stored outside the block, where a write past a piece's end
 * cannot reach it. */
struct piece {
    void *at; /* NULL: freed, but a later piece is still allocated */
    size_t offset;
};

struct scratch {
    uint8_t *block;
    size_t size;
    size_t used, most; /* bytes allocated, as if all had come from the block */
    struct piece piece[PIECES_MAX];
    size_t count;
};

struct scratch *scratch_create(void)
{
    return mem_alloc(1, sizeof(struct scratch));
}

void scratch_destroy(struct scratch *s)
{
    if (!s)
        return;
    mem_free(s->block);
    mem_free(s);
}

static size_t round_up(size_t bytes)
{
    size_t room = LARGE;

    if (bytes <= LARGE)
        return (bytes + MEM_ALIGN) / MEM_ALIGN * MEM_ALIGN; /* never 0, so that no two pieces share an address */
    while (room < bytes)
        room *= 2;
    return room;
}

void *scratch_alloc(struct scratch *s, size_t bytes)
{
    if (!s || s->count == PIECES_MAX)
        return mem_alloc(bytes, 1);
    const size_t room =
        bytes > SCRATCH_MAX ? 0 : round_up(bytes); /* a piece that is too large takes no space of the block */
    const bool fits = room > 0 && s->used <= s->size && room <= s->size - s->used;
    void *p = fits ? s->block + s->used : mem_alloc(bytes, 1);
    if (!p)
        return NULL;
    if (fits)
        memset(p, 0, bytes);
    s->piece[s->count++] = (struct piece){ p, s->used };
    s->used += room;
    s->most = s->used > s->most ? s->used : s->most;
    return p;
}

void scratch_free(struct scratch *s, void *p)
{
    if (!p)
        return;
    size_t k = s ? s->count : 0;
    while (k > 0 && s->piece[k - 1].at != p)
        k--;
    if (k > 0)
        s->piece[k - 1].at = NULL;
    const bool kept = s && (uintptr_t)p - (uintptr_t)s->block < s->size;
    if (!kept)
        mem_free(p);
    while (k > 0 && s->count > 0 && !s->piece[s->count - 1].at)
        s->used = s->piece[--s->count].offset;
}

void scratch_begin(struct scratch *s)
{
    if (!s)
        return;
    while (s->count > 0)
        scratch_free(s, s->piece[s->count - 1].at);
    if (s->most <= s->size || s->size == SCRATCH_MAX)
        return;
    /* doubled, because the files of a stream differ in size */
    const size_t wanted = s->most < SCRATCH_MAX / 2 ? 2 * s->most : SCRATCH_MAX;
    mem_free(s->block);
    s->block = mem_alloc_raw(wanted, 1);
    s->size = s->block ? wanted : 0;
}
