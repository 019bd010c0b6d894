/* Files of tables that take long to compute and are the same in the next run: sections, each with a name, a key of all
 * that decides what is in it, its length and its checksum. Numbers are those of the machine that wrote them.
 * Nothing of a file is believed: a byte that is not as it was written is found out by a checksum (all single errors of
 * up to 32 bits), a file that is cut or longer by its length. What a section's bytes mean, its reader has to check.
 *
 * A table that is saved here has two functions of its own, one that puts its section (cache_writer_section, then
 * cache_writer_put as often as it likes) and one that reads it (cache_reader_find, cache_reader_get, cache_reader_end).
 * One thread for each writer and reader. */
#ifndef CACHE_CACHE_FILE_H
#define CACHE_CACHE_FILE_H

#include "base/digest.h"
#include "base/err.h"

#include <stddef.h>
#include <stdint.h>

#define CACHE_SECTIONS 16  /* of a file, at most */
#define CACHE_NAME_ROOM 24 /* of a section's name, its end included */

/* ---- Writing ---- */

struct cache_writer;

struct cache_writer *cache_writer_create(void);    /* NULL when out of memory */
void cache_writer_destroy(struct cache_writer *w); /* NULL is allowed */

/* What is put from now on belongs to a section of that name. Lack of memory is told by cache_writer_store. */
void cache_writer_section(struct cache_writer *w, const char *name, const struct digest *key);
void cache_writer_put(struct cache_writer *w, const void *bytes, size_t size); /* borrowed until the writer is gone */
void cache_writer_give(struct cache_writer *w, void *bytes, size_t size);      /* the writer's now: mem_free */

/* Sections to disk, as file_store.h does it. ERR_IO, ERR_NOMEM. */
MUST_CHECK enum err cache_writer_store(struct cache_writer *w, const char *path, struct reason *why);

/* ---- Reading ---- */

struct cache_reader;

/* *out is NULL and no error where there is no such file. ERR_FORMAT: it is not one of these, or damaged; ERR_IO;
 * ERR_NOMEM. The reason names the file. */
MUST_CHECK enum err cache_reader_open(const char *path, struct cache_reader **out, struct reason *why);
void cache_reader_close(struct cache_reader *r); /* NULL is allowed */

/* Goes to the beginning of that section. ERR_END: there is none; ERR_UNSUPPORTED: it has another key. */
MUST_CHECK enum err cache_reader_find(struct cache_reader *r, const char *name, const struct digest *key,
                                      struct reason *why);

/* Bytes of the section that have not been read. */
uint64_t cache_reader_left(const struct cache_reader *r);

/* ERR_FORMAT where fewer are left; ERR_IO. What was read is not known to be right before cache_reader_end. */
MUST_CHECK enum err cache_reader_get(struct cache_reader *r, void *out, size_t size, struct reason *why);

/* ERR_FORMAT unless the section was read to its end and is as it was written. */
MUST_CHECK enum err cache_reader_end(struct cache_reader *r, struct reason *why);

/* The path, for those who find a fault in what they have read. */
const char *cache_reader_path(const struct cache_reader *r);

#endif
