/* Recordings: relightd-YYYYMMDDThhmmssZ.mp4, each of the target's length. A file is fragmented MP4, complete up to its
 * last keyframe at any moment, and named .part until it is closed. */
#include "base/clock.h"
#include "base/file_store.h"
#include "base/log.h"
#include "base/mem.h"
#include "net/publish/sink.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define NAME_START "relightd-"
#define NAME_END ".mp4.part"

struct record {
    struct sink sink;
    struct sink_desc desc; /* its header is a copy, which follows */
    int folder;            /* locked */

    struct file_draft draft;
    struct sink_stream stream;
    int64_t begun_us;     /* of the file's first unit */
    uint64_t size, whole; /* bytes written, and of these all whole fragments */
    uint64_t beginning;   /* bytes before the first fragment */
    int failed;           /* errno of the first failed write; 0: none */
    uint8_t header[];
};

static bool to_file(void *user, const uint8_t *bytes, size_t size)
{
    struct record *r = user;

    if (!r->failed)
        r->failed = sink_write_all(r->draft.fd, bytes, size);
    r->size += size;
    return r->failed == 0;
}

/* The muxer knows only that a write failed. */
static enum err explain(const struct record *r, enum err e, struct reason *why)
{
    return e && r->failed ? err_say(why, ERR_IO, "%s", strerror(r->failed)) : e;
}

static enum err begin_file(struct record *r, struct reason *why)
{
    const struct mux_desc to = {
        .format = "mp4",
        .options = "movflags=frag_keyframe+empty_moov+default_base_moof+write_colr",
        .write = to_file,
        .user = r,
    };
    char path[PUBLISH_PATH + 64], time[SINK_TIME];
    struct stat st;

    sink_time(clock_wall_us(), time);
    snprintf(path, sizeof(path), "%s/" NAME_START "%s.mp4", r->desc.target->folder, time);
    for (int n = 2; stat(path, &st) == 0 && n < 100; n++) /* a second file of the same second */
        snprintf(path, sizeof(path), "%s/" NAME_START "%s-%d.mp4", r->desc.target->folder, time, n);
    enum err e = file_draft_begin(&r->draft, path, why);
    if (e)
        return e;
    r->size = r->whole = r->beginning = 0;
    r->failed = 0;
    e = explain(r, sink_stream_open(&r->desc, &to, true, &r->stream, why), why);
    if (e)
        file_draft_discard(&r->draft);
    r->beginning = r->whole = r->size;
    return e;
}

/* Keeps what is whole; a file without an image goes. */
static void end_file(struct record *r)
{
    struct reason why = { "" };

    if (!r->draft.begun)
        return;
    const enum err e = sink_stream_close(&r->stream, !r->failed, &why);
    if (!e && !r->failed)
        r->whole = r->size;
    if (r->whole <= r->beginning || (r->whole < r->size && ftruncate(r->draft.fd, (off_t)r->whole) != 0))
        file_draft_discard(&r->draft);
    else if (file_draft_commit(&r->draft, &why))
        log_warning("%s: %s", r->desc.target->name, why.text);
}

static enum err record_write(struct sink *s, const struct sink_unit *unit, struct reason *why)
{
    struct record *r = (struct record *)s;
    const bool full = unit->time_us - r->begun_us >= (int64_t)(1e6 * r->desc.target->file_s);

    if (unit->key && full && r->draft.begun)
        end_file(r);
    if (!r->draft.begun) {
        const enum err e = begin_file(r, why);
        if (e)
            return e;
        r->begun_us = unit->time_us;
    }
    const enum err e = sink_stream_write(&r->stream, unit, why);
    if (!e)
        r->whole = r->size; /* the muxer passes on whole fragments */
    return explain(r, e, why);
}

static void record_close(struct sink *s)
{
    struct record *r = (struct record *)s;

    end_file(r);
    close(r->folder);
    mem_free(r);
}

/* Recordings that a killed process left get their names. */
static void adopt(const char *folder)
{
    DIR *d = opendir(folder);
    const struct dirent *entry;

    while (d && (entry = readdir(d))) {
        const size_t length = strlen(entry->d_name), end = strlen(NAME_END);
        char from[PUBLISH_PATH + 256], to[PUBLISH_PATH + 256];
        struct stat st;
        if (length <= end || strncmp(entry->d_name, NAME_START, strlen(NAME_START)) != 0 ||
            strcmp(entry->d_name + length - end, NAME_END) != 0)
            continue;
        snprintf(from, sizeof(from), "%s/%s", folder, entry->d_name);
        snprintf(to, sizeof(to), "%s/%.*s", folder, (int)(length - strlen(".part")), entry->d_name);
        if (stat(from, &st) == 0 && st.st_size == 0)
            unlink(from);
        else if (stat(to, &st) != 0 && rename(from, to) == 0)
            log_info("%s is complete up to the end of the process that wrote it", to);
    }
    if (d)
        closedir(d);
}

enum err record_open(const struct sink_desc *desc, struct sink **out, struct reason *why)
{
    static const struct sink_ops ops = { record_write, record_close };
    struct record *r = mem_alloc(1, sizeof(*r) + desc->header_size);

    if (!r)
        return err_say(why, ERR_NOMEM, "out of memory");
    r->sink.ops = &ops;
    r->desc = *desc;
    memcpy(r->header, desc->header, desc->header_size);
    r->desc.header = r->header;
    enum err e = sink_folder_lock(desc->target->folder, false, &r->folder, why);
    if (!e && access(desc->target->folder, W_OK) != 0) {
        e = err_say(why, ERR_IO, "the folder cannot be written to: %s", strerror(errno));
        close(r->folder);
    }
    if (e) {
        mem_free(r);
        return e;
    }
    adopt(desc->target->folder);
    *out = &r->sink;
    return ERR_OK;
}
