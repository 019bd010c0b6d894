/* Files of tables that take long to compute and that later runs need again. A file consists of sections, each with a
 * name, a key (the digest of everything that determines its contents), a length and a checksum. Numbers have the
 * machine's own byte order. A file is untrusted: checksums detect damage (every error of up to 32 bits), the lengths
 * detect truncation. What the bytes of a section mean, its reader must check.
 *
 * A room that saves a table writes a section with cache_writer_section and any number of cache_writer_put, and reads it
 * with cache_reader_find, cache_reader_get and cache_reader_end. Thread: one per writer and reader.
 *
 * Below: where such files lie, in a folder of limited size, and the digest of the code that made them. */
#pragma once

#include "base/digest.h"
#include "base/err.h"

#include <stdbool.h>
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

/* ---- The place of a file ---- */

/* The path of a scene's cache file: either a given path, or a file in the cache folder whose name contains a digest of
 * everything that the cache depends on. Thread: any. */

#define CACHE_PATH 4096 /* PATH_MAX of Linux */

struct cache_place {
    char path[CACHE_PATH];   /* empty: the cache is not stored */
    char folder[CACHE_PATH]; /* the cache folder; empty: the path was given */
};

/* The view that a cache belongs to. */
struct cache_view {
    const char *scene, *camera; /* the scene's file and the camera's name; "": the built-in scene, no name */
    uint32_t width, height;
};

/* file: the argument of --cache-file; "": use the cache folder; NULL: do not store the cache. folder: the argument of
 * --cache-dir; NULL: the default (below). A file in the folder is SCENE.CAMERA-WxH-KEY.transport.
 * ERR_USAGE, ERR_IO: the place does not exist, and out->path is empty. */
MUST_CHECK enum err cache_place_find(const struct cache_view *view, const char *file, const char *folder,
                                     const struct digest *key, struct cache_place *out, struct reason *why);

/* Call it before storing a file of `bytes`: creates the folder and frees room in it. ERR_IO: the folder does not exist
 * or cannot be written; ERR_RANGE: the file is too large for the cache folder. */
MUST_CHECK enum err cache_place_prepare(const struct cache_place *p, uint64_t bytes, struct reason *why);

/* ---- The digest of the code ---- */

/* A digest of the code that computes the caches of light transport, made at build time (cache_code.cmake): sources of
 * the rooms that a cache's bits depend on, and compiler and flags. It is part of a stored cache's key, so that no
 * build loads a cache that it would compute differently. */

extern const char cache_code[]; /* 64 hexadecimal digits */

/* ---- The folder ---- */

/* The folder of --cache-dir, which several programs and users' services share: files of tables (cache_file.h) whose
 * names contain a digest of everything they depend on. Its size is limited; the least recently used files are deleted
 * first. Thread: any. */

#define CACHE_FOLDER_BYTES (UINT64_C(2) * 1000000000) /* limit of all files together */
#define CACHE_FOLDER_SUFFIX ".transport"              /* of the files that count and that may be deleted */

/* Writes the folder's path into path[size]: `requested`, or, if NULL, the first folder of $CACHE_DIRECTORY (systemd),
 * else that of base/file_store.h. Creates nothing. ERR_USAGE: no variable names a folder; ERR_IO: the path is too long.
 */
MUST_CHECK enum err cache_folder_find(const char *requested, char *path, size_t size, struct reason *why);

/* Creates the folder if it is missing. ERR_IO: it cannot be created, is not a folder, belongs to another user than
 * this process's or root, or its file system is read-only; the reason names it. */
MUST_CHECK enum err cache_folder_prepare(const char *path, struct reason *why);

/* As cache_folder_prepare, but a missing folder is no error and is not created. To be called before reading. */
MUST_CHECK enum err cache_folder_check(const char *path, struct reason *why);

/* Marks a file as used now. Failure only makes it look older. */
void cache_folder_touch(const char *file);

/* Deletes files, least recently used first, until the others and `more` bytes fit into `limit`, and what killed writers
 * left. `keep`: a file that is not deleted and not counted; NULL: none. Two programs may do this at the same time.
 * ERR_RANGE: `more` exceeds the limit by itself; nothing was deleted. */
MUST_CHECK enum err cache_folder_trim(const char *path, const char *keep, uint64_t more, uint64_t limit,
                                      struct reason *why);
