#include "scratch.h"

#include "mem.h"

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#define PIECES_MOST 256 /* in hand at once; more come from mem_alloc */
#define LARGE 4096      /* bytes: from there on sizes are powers of two, so that files of a kind ask for the same */

/* Pieces lie in the block one behind the other. The list of them stands outside, where who writes beyond a piece's end
 * does not reach it. */
struct piece {
    void *at; /* NULL: given back, but something behind it is still in hand */
    size_t offset;
};

struct scratch {
    uint8_t *block;
    size_t size;
    size_t used, most; /* bytes in hand, as if all had come from the block */
    struct piece piece[PIECES_MOST];
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
        return (bytes + MEM_ALIGN) / MEM_ALIGN * MEM_ALIGN; /* never 0, so that no two are at one place */
    while (room < bytes)
        room *= 2;
    return room;
}

void *scratch_take(struct scratch *s, size_t bytes)
{
    if (!s || s->count == PIECES_MOST)
        return mem_alloc(bytes, 1);
    const size_t room = bytes > SCRATCH_MOST ? 0 : round_up(bytes); /* what is too large takes no room of the block */
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

void scratch_give(struct scratch *s, void *p)
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
        scratch_give(s, s->piece[s->count - 1].at);
    if (s->most <= s->size || s->size == SCRATCH_MOST)
        return;
    /* twice that, since no two files of a stream are alike */
    const size_t wanted = s->most < SCRATCH_MOST / 2 ? 2 * s->most : SCRATCH_MOST;
    mem_free(s->block);
    s->block = mem_alloc_raw(wanted, 1);
    s->size = s->block ? wanted : 0;
}
