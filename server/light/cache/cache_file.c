#include "light/cache/cache_file.h"

#include "base/file_store.h"
#include "base/mem.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#define VERSION 3         /* 1: keys were digests of another kind; 2: the matte part below highlights was another */
#define ORDER 0x01020304u /* which reads otherwise where bytes have another order */
#define BUFFER ((size_t)1 << 18)

static const char magic[8] = { 'r', 'e', 'l', 'i', 't', 0x1a, '\r', '\n' };

struct header {
    char magic[8];
    uint32_t order, version, sections;
    uint32_t check; /* of the header, this being 0, and of the sections' entries behind it */
};

struct entry {
    char name[CACHE_NAME_ROOM];
    struct digest key;
    uint64_t length;
    uint32_t check, zero;
};

_Static_assert(sizeof(struct header) == 24 && sizeof(struct entry) == 56, "a file's layout has no padding");

struct front { /* what a file begins with */
    struct header header;
    struct entry entries[CACHE_SECTIONS];
};

static size_t front_size(uint32_t sections)
{
    return sizeof(struct header) + sections * sizeof(struct entry);
}

static uint32_t front_check(const struct front *f)
{
    struct front copy = *f;

    copy.header.check = 0;
    return (uint32_t)crc32_z(0, (const Bytef *)&copy, front_size(f->header.sections));
}

/* ---- Writing ---- */

struct cache_writer {
    struct front front;
    struct file_part *parts; /* the first is the front */
    size_t count, capacity;
    bool no_memory;
};

struct cache_writer *cache_writer_create(void)
{
    struct cache_writer *w = mem_alloc(1, sizeof(*w));

    if (!w)
        return NULL;
    memcpy(w->front.header.magic, magic, sizeof(magic));
    w->front.header.order = ORDER;
    w->front.header.version = VERSION;
    if (!mem_reserve(&w->parts, 0, &w->capacity, sizeof(*w->parts))) {
        cache_writer_destroy(w);
        return NULL;
    }
    w->count = 1;
    return w;
}

void cache_writer_destroy(struct cache_writer *w)
{
    if (!w)
        return;
    mem_free(w->parts);
    mem_free(w);
}

void cache_writer_section(struct cache_writer *w, const char *name, const struct digest *key)
{
    assert(w->front.header.sections < CACHE_SECTIONS);
    struct entry *e = &w->front.entries[w->front.header.sections++];
    strncpy(e->name, name, sizeof(e->name) - 1);
    e->key = *key;
}

void cache_writer_put(struct cache_writer *w, const void *bytes, size_t size)
{
    struct entry *e = &w->front.entries[w->front.header.sections - 1];

    if (size == 0 || w->no_memory)
        return;
    if (!mem_reserve(&w->parts, w->count, &w->capacity, sizeof(*w->parts))) {
        w->no_memory = true;
        return;
    }
    w->parts[w->count++] = (struct file_part){ bytes, size };
    e->length += size;
    e->check = (uint32_t)crc32_z(e->check, bytes, size);
}

static void close_front(struct cache_writer *w)
{
    w->front.header.check = 0;
    w->front.header.check = front_check(&w->front);
    w->parts[0] = (struct file_part){ &w->front, front_size(w->front.header.sections) };
}

enum err cache_writer_bytes(struct cache_writer *w, uint8_t **out, size_t *size)
{
    *out = NULL;
    *size = 0;
    if (w->no_memory)
        return ERR_NOMEM;
    close_front(w);
    for (size_t k = 0; k < w->count; k++)
        *size += w->parts[k].size;
    *out = mem_alloc_raw(*size, 1);
    if (!*out)
        return ERR_NOMEM;
    uint8_t *to = *out;
    for (size_t k = 0; k < w->count; to += w->parts[k++].size)
        memcpy(to, w->parts[k].bytes, w->parts[k].size);
    return ERR_OK;
}

enum err cache_writer_store(struct cache_writer *w, const char *path, struct reason *why)
{
    if (w->no_memory)
        return err_say(why, ERR_NOMEM, "%s: no memory for writing it", path);
    close_front(w);
    return file_store_parts(path, w->parts, w->count, why);
}

/* ---- Reading ---- */

struct cache_reader {
    char path[4096];
    FILE *stream;
    struct front front;
    const struct entry *at; /* the section that is being read */
    uint64_t left;
    uint32_t check; /* of what was read of it */
};

static enum err refuse(const struct cache_reader *r, struct reason *why, const char *what)
{
    return err_say(why, ERR_FORMAT, "%.200s: %s", r->path, what);
}

static enum err say_errno(const struct cache_reader *r, struct reason *why, int number)
{
    char text[80];

    if (strerror_r(number, text, sizeof(text)) != 0)
        snprintf(text, sizeof(text), "error %d", number);
    return err_say(why, ERR_IO, "%.200s: cannot be read: %s", r->path, text);
}

/* Opens what is a plain file; without one that is, the stream stays NULL. O_NONBLOCK: a pipe must not hold us up. */
static enum err open_plain(struct cache_reader *r, uint64_t *size, struct reason *why)
{
    const int fd = open(r->path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    struct stat st;

    if (fd < 0)
        return errno == ENOENT || errno == ENOTDIR ? ERR_OK : say_errno(r, why, errno);
    if (fstat(fd, &st) != 0 || !S_ISREG(st.st_mode)) {
        close(fd);
        return refuse(r, why, "is not a regular file");
    }
    *size = (uint64_t)st.st_size;
    r->stream = fdopen(fd, "rb");
    if (!r->stream) {
        close(fd);
        return err_say(why, ERR_NOMEM, "%.200s: no memory for reading it", r->path);
    }
    setvbuf(r->stream, NULL, _IOFBF, BUFFER);
    return ERR_OK;
}

static enum err read_front(struct cache_reader *r, uint64_t size, struct reason *why)
{
    struct front *f = &r->front;
    uint64_t rest = size;

    if (fread(&f->header, sizeof(f->header), 1, r->stream) != 1 || memcmp(f->header.magic, magic, sizeof(magic)) != 0)
        return refuse(r, why, "is not a cache file");
    if (f->header.order != ORDER || f->header.version != VERSION)
        return refuse(r, why, "was written by another version of this program");
    if (f->header.sections > CACHE_SECTIONS ||
        fread(f->entries, sizeof(f->entries[0]), f->header.sections, r->stream) != f->header.sections ||
        f->header.check != front_check(f))
        return refuse(r, why, "its header is damaged");
    rest -= front_size(f->header.sections);
    for (uint32_t k = 0; k < f->header.sections; k++) {
        if (f->entries[k].length > rest || f->entries[k].name[CACHE_NAME_ROOM - 1])
            return refuse(r, why, "is cut off");
        rest -= f->entries[k].length;
    }
    return rest == 0 ? ERR_OK : refuse(r, why, "is longer than it should be");
}

enum err cache_reader_open(const char *path, struct cache_reader **out, struct reason *why)
{
    struct cache_reader *r = mem_alloc(1, sizeof(*r));
    uint64_t size = 0;

    *out = NULL;
    if (!r)
        return err_say(why, ERR_NOMEM, "%.200s: no memory for reading it", path);
    if (snprintf(r->path, sizeof(r->path), "%s", path) >= (int)sizeof(r->path)) {
        mem_free(r);
        return err_say(why, ERR_IO, "%.200s...: the path is too long", path);
    }
    enum err e = open_plain(r, &size, why);
    if (!e && r->stream) {
        e = read_front(r, size, why);
        if (!e) {
            *out = r;
            return ERR_OK;
        }
    }
    cache_reader_close(r);
    return e;
}

enum err cache_reader_take(const char *from, const uint8_t *bytes, size_t size, struct cache_reader **out,
                           struct reason *why)
{
    struct cache_reader *r = size > 0 ? mem_alloc(1, sizeof(*r)) : NULL;
    enum err e = size > 0 ? ERR_NOMEM : ERR_FORMAT;

    *out = NULL;
    if (r) {
        snprintf(r->path, sizeof(r->path), "%s", from);
        r->stream = fmemopen((void *)(uintptr_t)bytes, size, "rb");
        e = r->stream ? read_front(r, size, why) : ERR_NOMEM;
    }
    if (!e) {
        *out = r;
        return ERR_OK;
    }
    cache_reader_close(r);
    return err_say(why, e, "%.200s: its part of a cache %s", from, e == ERR_NOMEM ? "needs more memory" : "is damaged");
}

void cache_reader_close(struct cache_reader *r)
{
    if (!r)
        return;
    if (r->stream)
        fclose(r->stream);
    mem_free(r);
}

enum err cache_reader_find(struct cache_reader *r, const char *name, const struct digest *key, struct reason *why)
{
    uint64_t place = front_size(r->front.header.sections);

    r->at = NULL;
    r->left = 0;
    for (uint32_t k = 0; k < r->front.header.sections; k++) {
        const struct entry *e = &r->front.entries[k];
        if (strcmp(e->name, name) == 0) {
            if (memcmp(&e->key, key, sizeof(*key)) != 0)
                return err_say(why, ERR_UNSUPPORTED,
                               "%.200s: was made for another scene, view, size or seed, or with other settings",
                               r->path);
            if (fseeko(r->stream, (off_t)place, SEEK_SET) != 0)
                return say_errno(r, why, errno);
            r->at = e;
            r->left = e->length;
            r->check = 0;
            return ERR_OK;
        }
        place += e->length;
    }
    return err_say(why, ERR_END, "%.200s: has no '%s'", r->path, name);
}

enum err cache_reader_get(struct cache_reader *r, void *out, size_t size, struct reason *why)
{
    if (size == 0)
        return ERR_OK;
    if (size > r->left)
        return refuse(r, why, "a section is shorter than what it says is in it");
    if (fread(out, 1, size, r->stream) != size)
        return ferror(r->stream) ? say_errno(r, why, errno) : refuse(r, why, "is cut off");
    r->left -= size;
    r->check = (uint32_t)crc32_z(r->check, out, size);
    return ERR_OK;
}

enum err cache_reader_end(struct cache_reader *r, struct reason *why)
{
    if (!r->at || r->left > 0)
        return refuse(r, why, "a section is longer than what it says is in it");
    return r->check == r->at->check ? ERR_OK : refuse(r, why, "is damaged: a checksum does not match");
}

enum err cache_reader_refuse(const struct cache_reader *r, struct reason *why)
{
    return refuse(r, why, "contains impossible numbers");
}
