#include "clients/record/journal.h"

#include "base/file_store.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define TAIL 65536 /* bytes; exceeds any line */

static enum err say(const struct journal *j, const char *step, struct reason *why)
{
    return err_say(why, ERR_IO, "%s: cannot %s: %s", j->path, step, strerror(errno));
}

/* Finds the last complete line in the file's tail, and where it ends. */
static enum err read_tail(struct journal *j, off_t size, struct reason *why)
{
    static char tail[TAIL]; /* too large for the stack */
    const off_t from = size > TAIL ? size - TAIL : 0;
    size_t count = 0;

    while (from + (off_t)count < size) {
        const ssize_t n = pread(j->fd, tail + count, (size_t)(size - from) - count, from + (off_t)count);
        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0)
            return say(j, "read", why);
        count += (size_t)n;
    }
    size_t end = count;
    while (end > 0 && tail[end - 1] != '\n')
        end--;
    if (end == 0 && from > 0)
        return err_say(why, ERR_IO, "%s: is not an index of relight-record: its last line is too long", j->path);
    size_t begin = end > 0 ? end - 1 : 0;
    while (begin > 0 && tail[begin - 1] != '\n')
        begin--;
    j->last = json_loadb(tail + begin, end - begin, JSON_REJECT_DUPLICATES, NULL);
    if (end < count && ftruncate(j->fd, from + (off_t)end) != 0)
        return say(j, "truncate a partial line", why);
    return ERR_OK;
}

enum err journal_open(struct journal *j, const char *path, struct reason *why)
{
    *j = (struct journal){ .fd = -1, .path = path };
    if (!path)
        return ERR_OK;
    j->fd = file_open(path, O_RDWR | O_APPEND);
    const off_t size = j->fd < 0 ? -1 : lseek(j->fd, 0, SEEK_END);
    if (size < 0)
        return say(j, "open", why);
    return read_tail(j, size, why);
}

void journal_close(struct journal *j)
{
    if (j->fd >= 0)
        close(j->fd);
    json_decref(j->last);
    *j = (struct journal){ .fd = -1 };
}

static bool says_the_same(const json_t *a, const json_t *b, const char *const *key)
{
    for (; *key; key++)
        if (!json_equal(json_object_get(a, *key), json_object_get(b, *key)))
            return false;
    return true;
}

static enum err write_line(struct journal *j, const char *text, struct reason *why)
{
    size_t left = strlen(text);

    while (left > 0) {
        const ssize_t n = write(j->fd, text, left);
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return say(j, "write", why);
        text += n;
        left -= (size_t)n;
    }
    return ERR_OK;
}

enum err journal_add(struct journal *j, json_t *line, const char *const *key, struct reason *why)
{
    char *text = NULL;
    enum err e = ERR_OK;

    if (!line)
        return err_say(why, ERR_NOMEM, "out of memory for an index line");
    if (j->fd < 0 || (j->last && says_the_same(j->last, line, key)))
        goto done;
    text = json_dumps(line, JSON_COMPACT | JSON_REAL_PRECISION(9));
    e = text ? write_line(j, text, why) : err_say(why, ERR_NOMEM, "out of memory for an index line");
    if (!e)
        e = write_line(j, "\n", why); /* the newline makes the line valid */
    if (!e && fsync(j->fd) != 0 && errno != EINVAL)
        e = say(j, "sync", why);
    if (!e) {
        json_decref(j->last);
        j->last = json_incref(line);
    }
done:
    free(text);
    json_decref(line);
    return e;
}
