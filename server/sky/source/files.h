/* Lists the files that a source specification names, in order, and reads them. Private to this room, behind source.h.
 * Thread: one per list. */
#pragma once

#include "base/err.h"
#include "base/setting.h"
#include "image/codec/frame.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define FILES_SIZE_MAX ((uint64_t)1 << 30) /* maximum bytes of a file: 1 GiB */

struct file_item {
    char *path; /* owned */
    uint64_t number;
    /* For a cube map of six files, path is the first; the others replace face_length characters at path + face_at (px,
     * nx, py, ny, pz, nz: 2; posx ..: 4). 0: a single file. */
    size_t face_at, face_length;
};

/* A queue of files: items[next] is read next. Zeroed memory is an empty queue. */
struct file_list {
    struct file_item *items;
    size_t count, capacity, next;
};

/* Appends dir/name, or just name if dir is NULL. ERR_NOMEM: the list is unchanged. */
MUST_CHECK enum err files_add(struct file_list *l, const char *dir, const char *name, uint64_t number);
void files_finish(struct file_list *l); /* frees the list; zeroed memory is allowed */

/* Whether a folder entry is a frame by its name: .exr or .hdr in any case, and not hidden. (Writers use a name with a
 * leading dot until the file is complete.) */
bool files_is_frame_name(const char *name);

/* Whether it names another image, which only a pattern or its own name makes a frame. */
bool files_is_other_image(const char *name);

/* Lists everything that `spec` names, ordered and numbered as in source.h. The caller owns *out. A file of exactly that
 * name takes precedence, so that `a%d.exr` or `[a].exr` can be opened. ERR_IO: nothing found. ERR_USAGE: an invalid
 * pattern. ERR_NOMEM. *why names the spec. */
MUST_CHECK enum err files_from_spec(const char *spec, struct file_list *out, struct reason *why);

/* The order of names, as strcmp: digits in both at once are compared as one number, the rest by bytes; names that
 * differ in zeros alone (1, 01) by bytes. Any thread. */
int files_compare(const char *a, const char *b);

/* Keeps only files whose number is in the range, if one is given. ERR_USAGE: none is, or a number exceeds
 * FRAME_NUMBER_MAX. */
MUST_CHECK enum err files_select(struct file_list *l, const struct setting_frames *frames, const char *spec,
                                 struct reason *why);

/* Lists the frames of a folder in the order of files_compare, numbered from 0; may be empty. The caller owns *out.
 * ERR_IO, ERR_NOMEM.
 */
MUST_CHECK enum err files_from_folder(const char *dir, struct file_list *out, struct reason *why);

/* Reads a file, or six in the order px, nx, py, ny, pz, nz (f->faces), into f->bytes, with number, name and
 * modification time as capture time. ERR_IO: cannot be read, empty, or not a regular file. ERR_RANGE: larger than
 * FILES_SIZE_MAX. ERR_NOMEM. */
MUST_CHECK enum err files_read(const struct file_item *item, struct frame *f, struct reason *why);

/* Writes a message such as "dir: cannot open: No such file or directory" from errno; returns ERR_IO. */
enum err files_say_errno(struct reason *why, const char *path, const char *what, int number);

/* ---- Watched folders ---- */

/* Watches a folder with inotify: files closed after writing, moved or linked in, in order of arrival. What other
 * hosts write to a network share, or others through a link, raises no event: the folder is also listed every second or
 * so, and a file without events of its own that is new or different, and the same twice, counts as complete. Private to
 * this room. Thread: one per watch. */

struct watch_known;
struct watch_event;

struct watch {
    char *dir; /* owned */
    int fd;
    bool gone;              /* the folder was removed; no more files will come */
    bool told_other;        /* that another image was passed over */
    uint64_t number;        /* of the next file to appear */
    struct file_list queue; /* files not yet read, numbered in order of arrival */

    struct watch_known *known; /* owned; the last listing, by name */
    size_t known_count;
    struct watch_event *events; /* owned; names with events since then, and those being written */
    size_t event_count, event_room;
    int64_t list_ms; /* when to list again */
};

/* Starts watching. Files that already exist are queued first, in the order of files_compare, and assumed complete.
 * ERR_IO: no such folder, or no inotify watches left. ERR_NOMEM. On error *w is finished. */
MUST_CHECK enum err watch_init(struct watch *w, const char *dir, struct reason *why);
void watch_finish(struct watch *w); /* frees; zeroed memory is allowed */

/* The next file, borrowed until the next call; *out is NULL after timeout_ms or a signal. ERR_RANGE: the kernel's event
 * queue overflowed and files were missed; the next call continues. ERR_END: the folder was removed and every file was
 * delivered. ERR_NOMEM. */
MUST_CHECK enum err watch_next(struct watch *w, int timeout_ms, const struct file_item **out, struct reason *why);
