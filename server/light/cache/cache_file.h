/* Files of tables that take long to compute and that later runs need again. A file consists of sections, each with a
 * name, a key (the digest of everything that determines its contents), a length and a checksum. Numbers have the
 * machine's own byte order. A file is untrusted: checksums detect damage (every error of up to 32 bits), the lengths
 * detect truncation. What the bytes of a section mean, its reader must check.
 *
 * A room that saves a table writes a section with cache_writer_section and any number of cache_writer_put, and reads it
 * with cache_reader_find, cache_reader_get and cache_reader_end. Thread: one per writer and reader. */
#pragma once

#include "base/digest.h"
#include "base/err.h"

#include <stddef.h>
#include <stdint.h>

#define CACHE_SECTIONS 16  /* in a file, at most */
#define CACHE_NAME_ROOM 24 /* bytes of a section's name, with its terminating zero */

/* ---- Writing ---- */

struct cache_writer;

struct cache_writer *cache_writer_create(void);    /* NULL when out of memory */
void cache_writer_destroy(struct cache_writer *w); /* NULL is allowed */

/* Starts a section. Lack of memory is reported by cache_writer_store. */
void cache_writer_section(struct cache_writer *w, const char *name, const struct digest *key);

/* Adds bytes to it, which must stay valid and unchanged until the writer is destroyed. */
void cache_writer_put(struct cache_writer *w, const void *bytes, size_t size);

/* Writes the sections to a file, atomically (base/file_store.h). ERR_IO, ERR_NOMEM; the reason names the file. */
MUST_CHECK enum err cache_writer_store(struct cache_writer *w, const char *path, struct reason *why);

/* The file's bytes, for another process; free *out with mem_free. ERR_NOMEM. */
MUST_CHECK enum err cache_writer_bytes(struct cache_writer *w, uint8_t **out, size_t *size);

/* ---- Reading ---- */

struct cache_reader;

/* If there is no such file, *out is NULL and the result ERR_OK. ERR_FORMAT: not such a file, or damaged; ERR_IO;
 * ERR_NOMEM. The reason names the file, as that of all functions below. */
MUST_CHECK enum err cache_reader_open(const char *path, struct cache_reader **out, struct reason *why);

/* Reads such bytes, which must outlive *out, instead of a file. `from` names their sender for reasons. ERR_FORMAT;
 * ERR_NOMEM. */
MUST_CHECK enum err cache_reader_take(const char *from, const uint8_t *bytes, size_t size, struct cache_reader **out,
                                      struct reason *why);
void cache_reader_close(struct cache_reader *r); /* NULL is allowed */

/* Goes to the start of a section. ERR_END: there is none of that name; ERR_UNSUPPORTED: it has another key. */
MUST_CHECK enum err cache_reader_find(struct cache_reader *r, const char *name, const struct digest *key,
                                      struct reason *why);

/* Reads the next `size` bytes, which cache_reader_end verifies. ERR_FORMAT: the section has fewer left; ERR_IO. */
MUST_CHECK enum err cache_reader_get(struct cache_reader *r, void *out, size_t size, struct reason *why);

/* ERR_FORMAT unless the section was read to its end and its checksum matches. */
MUST_CHECK enum err cache_reader_end(struct cache_reader *r, struct reason *why);

/* Returns ERR_FORMAT with the reason that a section contains impossible numbers, for readers that find some. */
enum err cache_reader_refuse(const struct cache_reader *r, struct reason *why);
