/* The viewer page's files, read once at start and served from memory, so that no path of a request reaches the file
 * system. Constant after site_load: any thread may read. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define SITE_FILES_MAX 128                    /* bounds a table; the page has 49 */
#define SITE_FILE_BYTES_MAX ((size_t)8 << 20) /* bounds memory, where files are kept */

struct site_file {
    char path[128];   /* "/app.js", "/js/relight.js"; index.html is "/", embed.html "/embed" */
    const char *type; /* "text/javascript; charset=utf-8" */
    char etag[24];    /* a hash of the bytes, in quotes */
    uint8_t *bytes;
    size_t size;
};

struct site {
    struct site_file *files;
    size_t count;
};

/* Writes the folder `requested` to path[size]; if NULL, ../share/relightd/web relative to the running program's
 * folder: next to bin where installed, and in a build tree by a link. ERR_IO: the program's folder is unknown. */
MUST_CHECK enum err site_folder(const char *requested, char *path, size_t size, struct reason *why);

/* Reads the files with a known extension of `dir` and of the folders in it; skips hidden ones and folders of folders.
 * ERR_IO: dir cannot be read or has no index.html. ERR_RANGE: a file or their number is too large. ERR_NOMEM. */
MUST_CHECK enum err site_load(struct site *site, const char *dir, struct reason *why);
void site_finish(struct site *site); /* zeroed memory is allowed */

/* The file at path, which has no query; owned by site. NULL: none. "/index.html" is "/". */
const struct site_file *site_find(const struct site *site, const char *path);

/* ---- Addresses ---- */

/* Whether a name or numeric address is always this machine's: localhost, ::1, 127.x.x.x, but no name that merely begins
 * so. Thread: any. */
bool address_is_loopback(const char *text);

/* This machine's own network addresses. Thread: any. */

#define ADDRESSES_MAX 32 /* bounds a table */
#define ADDRESS_TEXT 46  /* INET6_ADDRSTRLEN */

/* Numeric, without loopback and link-local ones, IPv4 first, in the system's order. Returns their number. */
size_t addresses_of_machine(char out[ADDRESSES_MAX][ADDRESS_TEXT]);
