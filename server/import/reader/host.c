#include "import/reader/host.h"

#include "base/mem.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>

static enum err read_all(int fd, const char *path, struct bytes *out, struct reason *why)
{
    size_t at = 0;

    while (at < out->size) {
        const ssize_t got = read(fd, out->at + at, out->size - at);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return err_say(why, ERR_IO, "%s: %s", path, strerror(errno));
        if (got == 0)
            return err_say(why, ERR_IO, "%s: has become shorter while it was read", path);
        at += (size_t)got;
    }
    return ERR_OK;
}

enum err host_read(const struct host *h, const char *path, struct bytes *out, struct reason *why)
{
    int fd;

    *out = (struct bytes){ 0 };
    enum err e = h->open(h->context, path, &fd, &out->size, why);
    if (e)
        return e;
    out->at = mem_alloc_raw(out->size, 1);
    e = out->at ? read_all(fd, path, out, why) : ERR_NOMEM;
    close(fd);
    if (e)
        bytes_finish(out);
    return e;
}

void bytes_finish(struct bytes *b)
{
    mem_free(b->at);
    *b = (struct bytes){ 0 };
}
