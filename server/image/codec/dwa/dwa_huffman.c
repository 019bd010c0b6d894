#include "image/codec/dwa/dwa.h"

#include "base/mem.h"

#include <stdbool.h>
#include <string.h>

#define SYMBOLS 65537 /* every 16-bit value, and one that repeats the previous value */
/* Maximum bits of a code. The format allows 58, but a tree as deep as 56 needs more values than fit into any file, and
 * a byte-wise refill always has 56 bits available. */
#define LENGTH_MAX 56
#define RUN_SHORT 59 /* 59..62 instead of a length: 2..5 symbols without a code */
#define RUN_LONG 63  /* followed by eight bits: 6 symbols or more */
#define RUN_LONG_MIN 6
#define QUICK_BITS 12
#define HEAD 20 /* bytes: first symbol, last symbol, size of the table, number of data bits, reserved */

/* A bit reader, most significant bit first. */
struct bits {
    const uint8_t *at, *end;
    uint64_t held;  /* the next bits, left-aligned; zeros after the last */
    unsigned count; /* number of valid bits */
};

/* Canonical Huffman codes. Codes of the same length ascend with their symbols; longer codes have smaller values when
 * left-aligned to 64 bits, so the length of the next code follows from comparing the bits with `first`. */
struct code {
    uint64_t first[LENGTH_MAX + 1]; /* for each length: its smallest code, left-aligned to 64 bits */
    uint32_t count[LENGTH_MAX + 1];
    uint32_t start[LENGTH_MAX + 1]; /* for each length: index of its first symbol */
    unsigned shortest, longest;
    uint32_t symbols[SYMBOLS];       /* longest codes first, then ascending */
    uint8_t length[SYMBOLS];         /* 0: no code */
    uint8_t quick[1u << QUICK_BITS]; /* length of the code that these bits start; 0: longer */
};

static void fill(struct bits *b)
{
    while (b->count <= 56 && b->at < b->end) {
        b->held |= (uint64_t)*b->at++ << (56 - b->count);
        b->count += 8;
    }
}

/* False if fewer than `count` bits are left. 1 <= count <= LENGTH_MAX. */
static bool take(struct bits *b, unsigned count, unsigned *value)
{
    fill(b);
    if (b->count < count)
        return false;
    *value = (unsigned)(b->held >> (64 - count));
    b->held <<= count;
    b->count -= count;
    return true;
}

static uint32_t read_u32(const uint8_t *p)
{
    return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

/* Reads the code lengths of symbols first..last, six bits each; runs of symbols without a code are abbreviated. */
static const char *read_lengths(struct bits *b, uint32_t first, uint32_t last, uint8_t *length)
{
    for (uint32_t s = first; s <= last;) {
        unsigned l, more = 0;
        if (!take(b, 6, &l) || (l == RUN_LONG && !take(b, 8, &more)))
            return "the code table is truncated";
        if (l > LENGTH_MAX && l < RUN_SHORT)
            return "a code is too long";
        if (l < RUN_SHORT) {
            length[s++] = (uint8_t)l;
            continue;
        }
        const uint32_t run = l == RUN_LONG ? more + RUN_LONG_MIN : l - RUN_SHORT + 2;
        if (run > last + 1 - s)
            return "the code table exceeds its range";
        s += run;
    }
    return NULL;
}

static const char *assign_codes(struct code *c)
{
    uint64_t next = 0;
    uint32_t place = 0, to[LENGTH_MAX + 1];

    for (uint32_t s = 0; s < SYMBOLS; s++)
        c->count[c->length[s]]++;
    for (unsigned l = LENGTH_MAX; l > 0; l--) {
        c->first[l] = next << (64 - l);
        c->start[l] = to[l] = place;
        place += c->count[l];
        next += c->count[l];
        if (c->count[l]) {
            c->shortest = l;
            c->longest = c->longest ? c->longest : l;
        }
        /* longer codes must fill whole shorter ones, and the total must not exceed the code space */
        if (next > (uint64_t)1 << l || (l > 1 && next % 2))
            return "the codes overlap";
        next /= 2;
    }
    if (!c->longest)
        return "there are no codes";
    for (uint32_t s = 0; s < SYMBOLS; s++)
        if (c->length[s])
            c->symbols[to[c->length[s]]++] = s;
    return NULL;
}

static void fill_quick(struct code *c)
{
    for (unsigned l = c->shortest; l <= QUICK_BITS && l <= c->longest; l++) {
        const size_t from = (size_t)(c->first[l] >> (64 - QUICK_BITS));
        memset(c->quick + from, (int)l, (size_t)c->count[l] << (QUICK_BITS - l));
    }
}

/* False at the end of the data or if no code matches. */
static bool take_symbol(struct bits *b, const struct code *c, uint32_t *symbol)
{
    fill(b);
    unsigned l = c->quick[b->held >> (64 - QUICK_BITS)];
    if (!l)
        for (l = c->shortest; l < c->longest && b->held < c->first[l];)
            l++;
    const uint64_t place = (b->held - c->first[l]) >> (64 - l);
    if (l > b->count || place >= c->count[l])
        return false;
    *symbol = c->symbols[c->start[l] + place];
    b->held <<= l;
    b->count -= l;
    return true;
}

static const char *read_values(struct bits *b, const struct code *c, uint32_t repeat, uint16_t *out, size_t count)
{
    for (size_t n = 0; n < count;) {
        uint32_t symbol;
        unsigned times;
        if (!take_symbol(b, c, &symbol))
            return "the coded values are truncated";
        if (symbol != repeat) {
            out[n++] = (uint16_t)symbol;
            continue;
        }
        if (!take(b, 8, &times))
            return "the coded values are truncated";
        if (n == 0 || times > count - n)
            return "a run exceeds the number of values";
        for (; times; times--, n++)
            out[n] = out[n - 1];
    }
    return NULL;
}

const char *dwa_huffman(const uint8_t *packed, size_t size, uint16_t *out, size_t count)
{
    if (count == 0)
        return NULL;
    if (size < HEAD)
        return "the Huffman header is truncated";
    const uint32_t first = read_u32(packed), last = read_u32(packed + 4);
    if (first > last || last >= SYMBOLS)
        return "the code table exceeds its range";
    struct code *c = mem_alloc(1, sizeof(*c));
    if (!c)
        return dwa_no_memory;
    struct bits b = { .at = packed + HEAD, .end = packed + size };
    const char *fault = read_lengths(&b, first, last, c->length);
    if (!fault)
        fault = assign_codes(c);
    if (!fault) {
        fill_quick(c);
        /* The values start at the next byte boundary after the table; bytes prefetched into `held` but not consumed
         * count as unread. */
        struct bits values = { .at = b.at - b.count / 8, .end = b.end };
        fault = read_values(&values, c, last, out, count);
    }
    mem_free(c);
    return fault;
}
