/* A section of a cache's file in memory, for tests that read it again, also with wrong numbers and right checksums. */
#pragma once

#include "support/unit.h"

#include "base/mem.h"
#include "base/rng.h"
#include "light/cache/cache_file.h"

#include <string.h>

struct section {
    uint8_t *bytes, *file;
    size_t size, file_size;
    size_t spoiled; /* where a byte is wrong, */
    uint8_t was;    /* and what it was */
};

static const struct digest section_key = { { 1, 2 } };

/* A file with a section of these bytes; free with mem_free. */
static uint8_t *section_file(const void *bytes, size_t size, void (*save)(const void *, struct cache_writer *),
                             size_t *file_size)
{
    struct cache_writer *w = cache_writer_create();
    uint8_t *out;

    assert_non_null(w);
    cache_writer_section(w, "section", &section_key);
    if (save)
        save(bytes, w);
    else
        cache_writer_put(w, bytes, size);
    assert_int_equal(cache_writer_bytes(w, &out, file_size), ERR_OK);
    cache_writer_destroy(w);
    return out;
}

static struct cache_reader *section_open(const uint8_t *file, size_t size)
{
    struct cache_reader *r;
    struct reason why;

    assert_int_equal(cache_reader_take("a test", file, size, &r, &why), ERR_OK);
    assert_int_equal(cache_reader_find(r, "section", &section_key, &why), ERR_OK);
    return r;
}

/* What `save` writes of an object. */
static inline struct section section_of(const void *object, void (*save)(const void *, struct cache_writer *))
{
    struct section s = { NULL, NULL, 0, 0, 0, 0 };
    struct reason why;
    size_t size;
    uint8_t *file = section_file(object, 0, save, &size), byte;
    struct cache_reader *r = section_open(file, size);

    while (cache_reader_get(r, &byte, 1, &why) == ERR_OK)
        s.size++;
    cache_reader_close(r);
    r = section_open(file, size);
    s.bytes = mem_alloc_raw(s.size, 1);
    assert_int_equal(cache_reader_get(r, s.bytes, s.size, &why), ERR_OK);
    cache_reader_close(r);
    mem_free(file);
    return s;
}

/* A reader at the section's start; valid until the next one. */
static inline struct cache_reader *section_read(struct section *s)
{
    mem_free(s->file);
    s->file = section_file(s->bytes, s->size, NULL, &s->file_size);
    return section_open(s->file, s->file_size);
}

/* Changes one byte, in half of the cases near the start, where numbers of things are. */
static inline void section_spoil(struct section *s, struct rng *r)
{
    const size_t most = rng_next(r) < 0.5 && s->size > 200 ? 200 : s->size;

    s->spoiled = (size_t)(rng_next(r) * (double)most);
    s->was = s->bytes[s->spoiled];
    s->bytes[s->spoiled] ^= (uint8_t)(1.0 + rng_next(r) * 255.0);
}

static inline void section_mend(struct section *s)
{
    s->bytes[s->spoiled] = s->was;
}

static inline void section_free(struct section *s)
{
    mem_free(s->bytes);
    mem_free(s->file);
}
