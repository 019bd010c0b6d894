#include "sky/source/files.h"

#include "base/log.h"
#include "base/mem.h"
#include "image/codec/decode.h"

#include <assert.h>
#include <ctype.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <glob.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#define SMALL_BYTES (1 << 20) /* files up to this are read without a look at the header */
#define FACE "{face}"

enum err files_say_errno(struct reason *why, const char *path, const char *what, int number)
{
    char text[128] = "";

    if (strerror_r(number, text, sizeof(text)) != 0)
        snprintf(text, sizeof(text), "error %d", number);
    return err_say(why, ERR_IO, "%s: %s: %s", path, what, text);
}

/* ---- File lists ---- */

enum err files_add(struct file_list *l, const char *dir, const char *name, uint64_t number)
{
    if (l->count == l->capacity) {
        const size_t capacity = l->capacity ? 2 * l->capacity : 64;
        struct file_item *items = mem_grow(l->items, l->count, capacity, sizeof(*items));
        if (!items)
            return ERR_NOMEM;
        l->items = items;
        l->capacity = capacity;
    }
    const size_t size = (dir ? strlen(dir) + 1 : 0) + strlen(name) + 1;
    char *path = mem_alloc(size, 1);
    if (!path)
        return ERR_NOMEM;
    if (dir)
        snprintf(path, size, "%s%s%s", dir, dir[0] && dir[strlen(dir) - 1] == '/' ? "" : "/", name);
    else
        memcpy(path, name, size);
    l->items[l->count++] = (struct file_item){ .path = path, .number = number };
    return ERR_OK;
}

void files_finish(struct file_list *l)
{
    for (size_t i = 0; i < l->count; i++)
        mem_free(l->items[i].path);
    mem_free(l->items);
    *l = (struct file_list){ .items = NULL };
}

int files_compare(const char *a, const char *b)
{
    const char *s = a, *t = b;

    while (*s && *t) {
        if (!isdigit((unsigned char)*s) || !isdigit((unsigned char)*t)) {
            if (*s != *t)
                break;
            s++;
            t++;
            continue;
        }
        s += strspn(s, "0");
        t += strspn(t, "0");
        const size_t n = strspn(s, "0123456789"), m = strspn(t, "0123456789");
        const int order = n != m ? (n < m ? -1 : 1) : strncmp(s, t, n);
        if (order != 0)
            return order;
        s += n;
        t += m;
    }
    return *s != *t ? (unsigned char)*s - (unsigned char)*t : strcmp(a, b);
}

static int by_path(const void *a, const void *b)
{
    return files_compare(((const struct file_item *)a)->path, ((const struct file_item *)b)->path);
}

static int by_number(const void *a, const void *b)
{
    const uint64_t x = ((const struct file_item *)a)->number, y = ((const struct file_item *)b)->number;
    return (x > y) - (x < y);
}

static void sort_and_count(struct file_list *l)
{
    if (l->count > 1)
        qsort(l->items, l->count, sizeof(l->items[0]), by_path);
    for (size_t i = 0; i < l->count; i++)
        l->items[i].number = i;
}

/* ---- Folders ---- */

bool files_is_frame_name(const char *name)
{
    const size_t n = strlen(name);
    return n > 4 && name[0] != '.' && (strcasecmp(name + n - 4, ".exr") == 0 || strcasecmp(name + n - 4, ".hdr") == 0);
}

bool files_is_other_image(const char *name)
{
    static const char *const endings[] = { ".jpg",  ".jpeg", ".png",  ".tif", ".tiff",
                                           ".webp", ".avif", ".heic", ".pfm", ".dpx" };
    const char *dot = strrchr(name, '.');

    for (size_t i = 0; dot && name[0] != '.' && i < sizeof(endings) / sizeof(endings[0]); i++)
        if (strcasecmp(dot, endings[i]) == 0)
            return true;
    return false;
}

/* Skips entries that are not files; keeps those that cannot be examined, so that reading them reports why. */
static bool is_something_else(const char *path)
{
    struct stat st;
    return stat(path, &st) == 0 && !S_ISREG(st.st_mode);
}

/* Calls take(name, arg) for every entry of the folder. */
static enum err each_entry(const char *dir, enum err (*take)(const char *name, void *arg), void *arg,
                           struct reason *why)
{
    enum err e = ERR_OK;
    DIR *d = opendir(dir);

    if (!d)
        return files_say_errno(why, dir, "cannot open as a folder", errno);
    while (!e) {
        errno = 0; /* distinguishes the end of the folder from an error */
        const struct dirent *entry = readdir(d);
        if (!entry && errno)
            e = files_say_errno(why, dir, "cannot list", errno);
        if (!entry)
            break;
        e = take(entry->d_name, arg);
    }
    closedir(d);
    return e == ERR_NOMEM ? err_say(why, e, "%s: out of memory for its file names", dir) : e;
}

struct folder_scan {
    const char *dir;
    struct file_list *out;
    size_t others; /* images that are no frames */
    char other[64];
};

static enum err take_frame_name(const char *name, void *arg)
{
    struct folder_scan *scan = arg;
    struct file_list *l = scan->out;

    if (files_is_other_image(name) && scan->others++ == 0)
        snprintf(scan->other, sizeof(scan->other), "%.63s", name);
    if (!files_is_frame_name(name))
        return ERR_OK;
    const enum err e = files_add(l, scan->dir, name, 0);
    if (!e && is_something_else(l->items[l->count - 1].path))
        mem_free(l->items[--l->count].path);
    return e;
}

static enum err scan_folder(struct folder_scan *scan, struct reason *why)
{
    *scan->out = (struct file_list){ .items = NULL };
    const enum err e = each_entry(scan->dir, take_frame_name, scan, why);
    if (e)
        files_finish(scan->out);
    else
        sort_and_count(scan->out);
    return e;
}

enum err files_from_folder(const char *dir, struct file_list *out, struct reason *why)
{
    return scan_folder(&(struct folder_scan){ .dir = dir, .out = out }, why);
}

/* ---- printf patterns ---- */

/* `DIR/headNNNNtail`; NNNN is a number padded to at least `width` characters. */
struct pattern {
    char *dir;        /* owned */
    const char *head; /* in the spec; length head_length */
    size_t head_length;
    const char *tail; /* in the spec, to its end */
    int width;
    bool zeros; /* padded with zeros, else with blanks */
    struct file_list *out;
};

/* Length of the %d, %i or %u conversion at p, with an optional width, or 0. The text never reaches printf; other
 * conversions are literal characters. */
static size_t conversion_at(const char *p, int *width, bool *zeros)
{
    size_t n = 1;

    *zeros = p[1] == '0';
    *width = 0;
    while (isdigit((unsigned char)p[n]) && *width < 100)
        *width = 10 * *width + (p[n++] - '0');
    return (p[n] == 'd' || p[n] == 'i' || p[n] == 'u') && *width <= 20 ? n + 1 : 0;
}

/* Counts the conversions of the spec and stores the position of the first. */
static size_t count_conversions(const char *spec, const char **at, size_t *length, struct pattern *p)
{
    size_t count = 0;

    for (const char *c = strchr(spec, '%'); c; c = strchr(c, '%')) {
        int width;
        bool zeros;
        const size_t n = conversion_at(c, &width, &zeros);
        if (n && count++ == 0) {
            *at = c;
            *length = n;
            p->width = width;
            p->zeros = zeros;
        }
        c += n ? n : 1;
    }
    return count;
}

/* Accepts a name that is exactly what the pattern prints for some number. */
static enum err take_numbered(const char *name, void *arg)
{
    const struct pattern *p = arg;
    const size_t length = strlen(name), tail_length = strlen(p->tail);
    char digits[32] = "", printed[32];

    if (length <= p->head_length + tail_length || strncmp(name, p->head, p->head_length) != 0 ||
        strcmp(name + length - tail_length, p->tail) != 0)
        return ERR_OK;
    const size_t digits_length = length - p->head_length - tail_length;
    if (digits_length >= sizeof(digits))
        return ERR_OK;
    memcpy(digits, name + p->head_length, digits_length);
    errno = 0;
    const unsigned long long number = strtoull(digits, NULL, 10);
    if (errno)
        return ERR_OK; /* exceeds 64 bits */
    snprintf(printed, sizeof(printed), p->zeros ? "%0*llu" : "%*llu", p->width, number);
    if (strcmp(printed, digits) != 0)
        return ERR_OK;
    return files_add(p->out, p->dir[0] ? p->dir : NULL, name, number);
}

static enum err from_pattern(const char *spec, struct file_list *out, struct reason *why)
{
    struct pattern p = { .out = out };
    const char *at = NULL;
    size_t length = 0;
    enum err e = ERR_NOMEM;

    if (count_conversions(spec, &at, &length, &p) != 1)
        return err_say(why, ERR_USAGE, "%s: a pattern must contain exactly one number (%%d, %%04d)", spec);
    const char *slash = strrchr(spec, '/');
    p.head = slash ? slash + 1 : spec;
    p.tail = at + length;
    if (p.head > at)
        return err_say(why, ERR_USAGE, "%s: the number must be in the file name, not in a folder name", spec);
    p.head_length = (size_t)(at - p.head);
    const size_t dir_length = (size_t)(p.head - spec); /* includes the slash, so that "/" stays the root */
    p.dir = mem_alloc(dir_length + 1, 1);
    if (p.dir) {
        memcpy(p.dir, spec, dir_length);
        e = each_entry(dir_length ? p.dir : ".", take_numbered, &p, why);
    }
    if (!e && out->count == 0)
        e = err_say(why, ERR_IO, "%s: no file matches", spec);
    if (!e)
        qsort(out->items, out->count, sizeof(out->items[0]), by_number);
    mem_free(p.dir);
    return e;
}

/* ---- Glob patterns and single files ---- */

static enum err from_glob(const char *spec, struct file_list *out, struct reason *why)
{
    glob_t found = { 0 };
    enum err e = ERR_OK;
    const int code = glob(spec, GLOB_NOSORT, NULL, &found); /* sorted later; glob would sort by locale */

    if (code == GLOB_NOSPACE)
        e = ERR_NOMEM;
    else if (code != 0 && code != GLOB_NOMATCH)
        e = err_say(why, ERR_IO, "%s: cannot read a folder in it", spec);
    for (size_t i = 0; !e && i < found.gl_pathc; i++)
        if (!is_something_else(found.gl_pathv[i]))
            e = files_add(out, NULL, found.gl_pathv[i], 0);
    globfree(&found);
    if (!e && out->count == 0)
        e = err_say(why, ERR_IO, "%s: no file matches", spec);
    if (!e)
        sort_and_count(out);
    return e;
}

static enum err from_existing(const char *spec, const struct stat *st, struct file_list *out, struct reason *why)
{
    if (!S_ISDIR(st->st_mode))
        return files_add(out, NULL, spec, 0);
    struct folder_scan scan = { .dir = spec, .out = out };
    const enum err e = scan_folder(&scan, why);
    if (!e && scan.others > 0 && out->count > 0)
        log_info("%s: its .exr and .hdr files are read; %s%s passed over", spec, scan.other,
                 scan.others > 1 ? " and other images are" : " is");
    if (!e && out->count == 0)
        return err_say(why, ERR_IO,
                       "%s: the folder contains no .exr or .hdr file; for others give a pattern such as '%s/*.png'",
                       spec, spec);
    return e;
}

static enum err expand(const char *spec, struct file_list *out, struct reason *why)
{
    struct pattern p;
    struct stat st;
    const char *at;
    size_t length;

    if (stat(spec, &st) == 0)
        return from_existing(spec, &st, out, why);
    if (count_conversions(spec, &at, &length, &p) > 0)
        return from_pattern(spec, out, why);
    if (strpbrk(spec, "*?["))
        return from_glob(spec, out, why);
    if (spec[strspn(spec, "abcdefghijklmnopqrstuvwxyz0123456789")] == ':')
        return err_say(why, ERR_USAGE,
                       "%s: neither a file nor a kind of source; these are sky:, epw:, cie:, mtx:, watch:DIR, v4l2:, a "
                       "URL and, for relightd, push:",
                       spec);
    return files_say_errno(why, spec, "cannot open", errno);
}

/* File names of cube faces, in the order of frame.h. */
static const char *const face_names[2][6] = { { "px", "nx", "py", "ny", "pz", "nz" },
                                              { "posx", "negx", "posy", "negy", "posz", "negz" } };

/* Expands the spec with the first face's name in place of `{face}`, which `at` points to. */
static enum err from_faces(const char *spec, const char *at, struct file_list *out, struct reason *why)
{
    const size_t before = (size_t)(at - spec), size = strlen(spec) + 1;
    const char *after = at + strlen(FACE);
    char *first = mem_alloc(size, 1);
    enum err e = ERR_IO;

    if (!first)
        return ERR_NOMEM;
    if (strpbrk(after, "%*?[{")) {
        mem_free(first);
        return err_say(why, ERR_USAGE, "%s: after " FACE " no pattern is allowed", spec);
    }
    for (int k = 0; k < 2 && e == ERR_IO; k++) {
        snprintf(first, size, "%.*s%s%s", (int)before, spec, face_names[k][0], after);
        files_finish(out);
        e = expand(first, out, why);
        for (size_t i = 0; !e && i < out->count; i++) {
            out->items[i].face_length = strlen(face_names[k][0]);
            out->items[i].face_at = strlen(out->items[i].path) - strlen(after) - out->items[i].face_length;
        }
    }
    mem_free(first);
    return e == ERR_IO ? err_say(why, e, "%s: found no file for the first face, px or posx", spec) : e;
}

enum err files_from_spec(const char *spec, struct file_list *out, struct reason *why)
{
    struct stat st;
    const char *face = strstr(spec, FACE);
    enum err e;

    *out = (struct file_list){ .items = NULL };
    if (!spec[0])
        return err_say(why, ERR_USAGE,
                       "the source is empty; expected a file, folder, pattern, watch:DIR, sky: or a URL");
    if (face && stat(spec, &st) != 0)
        e = from_faces(spec, face, out, why);
    else
        e = expand(spec, out, why);
    if (e == ERR_NOMEM)
        err_say(why, e, "%s: out of memory for its file list", spec);
    if (e)
        files_finish(out);
    return e;
}

enum err files_select(struct file_list *l, const struct setting_frames *frames, const char *spec, struct reason *why)
{
    const uint64_t least = l->items[0].number, most = l->items[l->count - 1].number; /* in ascending order */
    size_t kept = 0;

    for (size_t i = 0; i < l->count; i++) {
        if (!frames->given || (l->items[i].number >= frames->first && l->items[i].number <= frames->last))
            l->items[kept++] = l->items[i];
        else
            mem_free(l->items[i].path);
    }
    l->count = kept;
    if (kept == 0)
        return err_say(why, ERR_USAGE,
                       "%s: no frame in the range from %" PRIu64 " to %" PRIu64 "; the numbers run from %" PRIu64
                       " to %" PRIu64,
                       spec, frames->first, frames->last, least, most);
    const struct file_item *last = &l->items[kept - 1];
    return last->number <= FRAME_NUMBER_MAX
               ? ERR_OK
               : err_say(why, ERR_USAGE, "%s: %s: the number is above %" PRIu64 ", the largest frame number", spec,
                         last->path, FRAME_NUMBER_MAX);
}

/* ---- Reading ---- */

/* Keeps the end of a long path, which is more specific than its beginning. */
static void set_name(struct frame *f, const char *path)
{
    const size_t n = strlen(path), room = sizeof(f->name) - 1;

    if (n <= room)
        memcpy(f->name, path, n + 1);
    else
        snprintf(f->name, sizeof(f->name), "...%s", path + n - (room - 3));
}

static enum err read_bytes(int fd, uint8_t *to, size_t size, const char *path, struct reason *why)
{
    for (size_t done = 0; done < size;) {
        const ssize_t n = read(fd, to + done, size - done);
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return files_say_errno(why, path, "cannot read", errno);
        if (n == 0)
            return err_say(why, ERR_IO, "%s: byte %zu: the file was truncated while it was read (it had %zu bytes)",
                           path, done, size);
        done += (size_t)n;
    }
    return ERR_OK;
}

/* Judges a large file by its header, before it takes memory: one with holes takes no disk. */
static enum err check_claimed(int fd, const char *path, uint64_t size, struct reason *why)
{
    uint8_t *head = mem_alloc_raw(DECODE_HEAD, 1);
    const ssize_t n = head ? pread(fd, head, DECODE_HEAD, 0) : -1;
    const uint64_t most = n > 0 ? decode_claimed(head, (size_t)n) : UINT64_MAX; /* reading will say what is wrong */
    struct image none = { .width = 0 };

    const bool foreign = most == 0 && decode_image(head, (size_t)n, path, &none, why) == ERR_UNSUPPORTED;
    image_finish(&none);
    mem_free(head);
    if (size <= most)
        return ERR_OK;
    if (foreign) /* such as a model, which *why names */
        return ERR_UNSUPPORTED;
    if (most == 0)
        return err_say(why, ERR_FORMAT, "%s: its first %d KiB are no header of an image; it was not read", path,
                       (int)(DECODE_HEAD >> 10));
    return err_say(why, ERR_FORMAT, "%s: is %" PRIu64 " bytes long, but by its header at most %" PRIu64, path, size,
                   most);
}

/* Opens a file and checks its size against the limits. Sets *fd and *st on ERR_OK. */
static enum err open_file(const char *path, int *fd, struct stat *st, struct reason *why)
{
    enum err e = ERR_OK;

    /* O_NONBLOCK: opening a FIFO must not wait for its writer before fstat shows what it is. */
    *fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (*fd < 0)
        return files_say_errno(why, path, "cannot open", errno);
    if (fstat(*fd, st) != 0)
        e = files_say_errno(why, path, "cannot stat", errno);
    else if (!S_ISREG(st->st_mode))
        e = err_say(why, ERR_IO, "%s: is not a regular file", path);
    else if (st->st_size <= 0)
        e = err_say(why, ERR_IO, "%s: is empty", path);
    else if ((uint64_t)st->st_size > FILES_SIZE_MAX)
        e = err_say(why, ERR_RANGE, "%s: is %lld bytes long, more than the limit of %" PRIu64, path,
                    (long long)st->st_size, FILES_SIZE_MAX);
    else if (st->st_size > SMALL_BYTES)
        e = check_claimed(*fd, path, (uint64_t)st->st_size, why);
    if (e) {
        close(*fd);
        *fd = -1;
    }
    return e;
}

/* The modification time; 0 if it is beyond what a capture time can be. */
static int64_t modified_us(const struct stat *st)
{
    const int64_t s = st->st_mtim.tv_sec, most_s = FRAME_CAPTURE_MAX_US / 1000000;

    return s < most_s && s > -most_s ? s * 1000000 + st->st_mtim.tv_nsec / 1000 : 0;
}

/* Reads `count` files one after another. For a cube, substitutes each face's name into the path. */
static enum err read_all(const struct file_item *item, char *path, size_t count, struct frame *f, struct reason *why)
{
    const char *const *names = face_names[item->face_length == 4];
    struct stat st[6];
    int fd[6];
    size_t total = 0, opened = 0;
    enum err e = ERR_OK;

    for (; opened < count && !e; opened += !e) {
        if (count > 1)
            memcpy(path + item->face_at, names[opened], item->face_length);
        e = open_file(path, &fd[opened], &st[opened], why);
        total += e ? 0 : (size_t)st[opened].st_size;
    }
    if (!e && total > FILES_SIZE_MAX)
        e = err_say(why, ERR_RANGE, "%s: the faces together exceed %" PRIu64 " bytes", path, FILES_SIZE_MAX);
    if (!e && frame_reserve_bytes(f, total))
        e = err_say(why, ERR_NOMEM, "%s: out of memory for %zu bytes", path, total);
    for (size_t k = 0, at = 0; k < count && !e; at += (size_t)st[k++].st_size) {
        if (count > 1) {
            memcpy(path + item->face_at, names[k], item->face_length);
            f->faces[k] = (size_t)st[k].st_size;
        }
        f->capture_us = modified_us(&st[k]);
        e = read_bytes(fd[k], f->bytes + at, (size_t)st[k].st_size, path, why);
    }
    while (opened)
        close(fd[--opened]);
    return e;
}

enum err files_read(const struct file_item *item, struct frame *f, struct reason *why)
{
    assert(item->path);
    f->kind = FRAME_NONE;
    f->number = item->number;
    set_name(f, item->path);
    char *path = mem_text(item->path);
    if (!path)
        return err_say(why, ERR_NOMEM, "%s: out of memory for its name", item->path);
    const enum err e = read_all(item, path, item->face_length ? 6 : 1, f, why);
    if (e)
        f->kind = FRAME_NONE;
    mem_free(path);
    return e;
}
