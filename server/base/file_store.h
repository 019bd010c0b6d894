/* Atomic file writes: no reader ever sees a partial file. Writes to NAME.part in the same folder, syncs it, renames it
 * to NAME and syncs the folder. In a folder that others may write to, nothing is written through what they put there.
 * After ERR_OK the file survives a power failure. After an error or a kill the old file is intact; at most a .part file
 * remains, which the next writer of that name reuses. Thread: any, but one at a time within a process. Several
 * processes may write to one name; the last one wins. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

/* Longest path, with its NUL. */
#define FILE_STORE_PATH 4096

/* The path that means standard output, which gets the bytes as they are written. */
#define FILE_STORE_STDOUT "-"
/* Whether the path is that one. */
bool file_is_stdout(const char *path);

/* A file that a library writes by its name. Zeroed memory is one that is not begun. */
struct file_draft {
    char path[FILE_STORE_PATH];      /* the finished file */
    char temporary[FILE_STORE_PATH]; /* the same as path for a pipe, device or symbolic link */
    char name[40];                   /* a library writes here: the open file, whatever becomes of its name; "-" for
                                        standard output */
    int fd;                          /* locked while the file is written */
    bool begun, replace;             /* replace: temporary is renamed to path */
};

/* Creates the temporary file, empty. On an error nothing is begun. ERR_IO: as file_store. */
MUST_CHECK enum err file_draft_begin(struct file_draft *d, const char *path, struct reason *why);
/* Syncs what was written and puts it in place. On an error the temporary file is removed. */
MUST_CHECK enum err file_draft_commit(struct file_draft *d, struct reason *why);
/* Removes the temporary file. Does nothing after file_draft_commit or when nothing is begun. */
void file_draft_discard(struct file_draft *d);

/* Creates the file, or opens it with these flags of open(2) if it is there; its own links are followed. -1 and errno:
 * not; EPERM: it is another user's, or has another name too. */
int file_open(const char *path, int flags);
/* Likewise, to write it anew; NULL and errno: not. */
FILE *file_rewrite(const char *path);

/* Writes `size` bytes to `path`. A pipe, device or symbolic link is written in place. ERR_IO names path and cause, such
 * as a full disk or a missing folder. */
MUST_CHECK enum err file_store(const char *path, const void *bytes, size_t size, struct reason *why);

/* As file_store, for data in several buffers, written one after the other. */
struct file_part {
    const void *bytes;
    size_t size;
};
/* Errors of file_store. */
MUST_CHECK enum err file_store_parts(const char *path, const struct file_part *parts, size_t count, struct reason *why);

/* ---- Folder ---- */

/* Output folders. Thread: any. */

/* Creates a folder and its missing parents. ERR_IO names the folder and the cause. */
MUST_CHECK enum err folder_make(const char *path, struct reason *why);

/* Creates a folder for secrets, as `flag` names it, for this user alone. ERR_USAGE: it cannot be created, is a link or
 * no folder, or users other than this one and root may write to it, who could choose what it holds. */
MUST_CHECK enum err folder_make_own(const char *flag, const char *path, struct reason *why);

/* Writes the cache folder of `program` into path[size]: $XDG_CACHE_HOME/program, else $HOME/.cache/program. Does not
 * create it. ERR_USAGE: neither variable is set. ERR_IO: the path is too long. */
MUST_CHECK enum err folder_cache(const char *program, char *path, size_t size, struct reason *why);

/* ---- Numbered files ---- */

/* Names of numbered files: "image.%04d.exr". A pattern has at most one %d or %0Nd and no other '%'. Thread: any. */

struct file_pattern {
    const char *text; /* borrowed */
    size_t at;        /* offset of the conversion */
    size_t length;    /* of the conversion; 0: none, so every file has the same name */
    unsigned digits;  /* minimum number of digits, zero-padded */
};

/* Parses a pattern; *out borrows `text`. `flag`, such as "--out", begins the message. ERR_USAGE: not a valid pattern.
 */
MUST_CHECK enum err file_pattern_parse(const char *text, const char *flag, struct file_pattern *out,
                                       struct reason *why);

/* Writes the name of file `number` into name[size]. ERR_USAGE: the name does not fit. */
MUST_CHECK enum err file_pattern_name(const struct file_pattern *p, uint64_t number, char *name, size_t size,
                                      struct reason *why);
