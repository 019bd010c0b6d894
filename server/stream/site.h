/* server/stream/site.h */
/* The viewer page's files, read once at start and served from memory: what was not there then cannot be asked for, so
 * that no path of a request ever reaches the file system. Never changes after site_load: any thread may read. */
#ifndef STREAM_SITE_H
#define STREAM_SITE_H

#include "err.h"

#include <stddef.h>
#include <stdint.h>

#define SITE_FILES_MAX 128
#define SITE_FILE_BYTES_MAX ((size_t)8 << 20)

struct site_file {
    char path[128];   /* "/app.js"; index.html is "/" */
    const char *type; /* "text/javascript; charset=utf-8" */
    char etag[24];    /* a hash of the bytes, in quotes */
    uint8_t *bytes;
    size_t size;
};

struct site {
    struct site_file *files;
    size_t count;
};

/* The folder that was asked for, or, where that is NULL, ../share/relightd/web as seen from the folder of the program
 * that runs: beside /usr/bin where it is installed, and beside bin in a build tree, which has a link there. ERR_IO: the
 * program cannot be found. */
MUST_CHECK enum err site_folder(const char *asked, char *path, size_t size, struct reason *why);

/* Reads the files of `dir` whose extension has a known type; folders and hidden files are passed over.
 * ERR_IO: dir cannot be read or has no index.html. ERR_RANGE: a file or their number is too large. ERR_NOMEM. */
MUST_CHECK enum err site_load(struct site *site, const char *dir, struct reason *why);
void site_finish(struct site *site); /* zeroed memory is allowed */

/* The file at this path, without query; NULL when there is none. "/index.html" is "/". */
const struct site_file *site_find(const struct site *site, const char *path);

#endif
