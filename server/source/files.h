/* server/source/files.h */
/* Which files a spec means and in which order, and reading one of them whole. Inside this room only; source.h is the
 * door. One thread per list. */
#ifndef SOURCE_FILES_H
#define SOURCE_FILES_H

#include "err.h"
#include "frame.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define FILES_SIZE_MAX ((uint64_t)1 << 30) /* bytes of one file: 1 GiB */

struct file_item {
    char *path; /* owned */
    uint64_t number;
    /* Of six files, one a face of a cube, path is the first; the others have another name of face_length characters
     * (px, nx, py, ny, pz, nz: 2; posx ..: 4) at path + face_at. 0: one file. */
    size_t face_at, face_length;
};

/* A queue of files: items[next] is the one to read next, what lies before it was read. Zeroed memory is an empty one.
 */
struct file_list {
    struct file_item *items;
    size_t count, capacity, next;
};

/* Appends dir/name, or name alone where dir is NULL. ERR_NOMEM leaves the list as it was. */
MUST_CHECK enum err files_add(struct file_list *l, const char *dir, const char *name, uint64_t number);
void files_finish(struct file_list *l); /* zeroed memory is allowed */

/* True when a folder's entry is a frame by its name: .exr or .hdr in any case, and not hidden (writers give a file a
 * name with a dot in front until it is whole). */
bool files_is_frame_name(const char *name);

/* Everything that `spec` names, in the order in which it is walked and numbered as source.h says. What exists under
 * that very name comes first, so that a file called `a%d.exr` or `[a].exr` can still be opened.
 * ERR_IO: there is nothing. ERR_USAGE: the pattern makes no sense. *why names the spec. */
MUST_CHECK enum err files_from_spec(const char *spec, struct file_list *out, struct reason *why);

/* All frames of a folder in byte order of their names, numbered from 0. There may be none. ERR_IO, ERR_NOMEM. */
MUST_CHECK enum err files_from_folder(const char *dir, struct file_list *out, struct reason *why);

/* The whole file, or six in the order px, nx, py, ny, pz, nz (f->faces), into f->bytes, with number, name and the
 * file's last modification as capture time. ERR_IO: cannot be read, is empty or no plain file. ERR_RANGE: above
 * FILES_SIZE_MAX. ERR_NOMEM. */
MUST_CHECK enum err files_read(const struct file_item *item, struct frame *f, struct reason *why);

/* "dir: cannot be opened: No such file or directory", from errno. */
enum err files_say_errno(struct reason *why, const char *path, const char *what, int number);

#endif
