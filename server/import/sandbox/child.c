#define _GNU_SOURCE /* F_DUPFD_CLOEXEC, memfd_create */
#include "import/sandbox/helper_process.h"

#include "base/clock.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#define ABOVE 10 /* descriptors passed to the process are first moved above its fixed numbers */
#define GIVEN_MAX 4

enum { LOOK_MS = 100 };

enum err child_find(const char *name, const char *requested, char *out, size_t size, struct reason *why)
{
    static const char *const places[] = { "", "/../lib/relightd" };
    char self[2048];

    if (requested) {
        snprintf(out, size, "%s", requested);
        return access(requested, X_OK) == 0
                   ? ERR_OK
                   : err_say(why, ERR_IO, "%s: cannot execute: %s", requested, strerror(errno));
    }
    const ssize_t n = readlink("/proc/self/exe", self, sizeof(self) - 1);
    self[n > 0 ? n : 0] = 0;
    char *slash = strrchr(self, '/');
    if (slash)
        *slash = 0;
    for (size_t i = 0; i < sizeof(places) / sizeof(places[0]); i++) {
        snprintf(out, size, "%s%s/%s", self, places[i], name);
        if (access(out, X_OK) == 0)
            return ERR_OK;
    }
    return err_say(why, ERR_IO, "%s not found in %.200s or in ../lib/relightd from there", name, self);
}

/* Returns errno or 0. given: GIVEN_MAX + 1 descriptors at most, none of which has a number that the child uses. */
static int spawn(struct child *c, const char *program, char *const arguments[], const int *given, size_t count)
{
    char *const environment[] = { NULL };
    posix_spawn_file_actions_t files;
    posix_spawnattr_t how;
    sigset_t none, all;

    posix_spawn_file_actions_init(&files);
    for (int fd = 0; fd < 3; fd++)
#ifdef __SANITIZE_ADDRESS__
        if (fd != STDERR_FILENO) /* for error reports */
#endif
            posix_spawn_file_actions_addopen(&files, fd, "/dev/null", O_RDWR, 0);
    for (size_t i = 0; i < count; i++)
        posix_spawn_file_actions_adddup2(&files, given[i], WIRE_SOCKET + (int)i);
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_init(&how);
    posix_spawnattr_setsigmask(&how, &none);
    posix_spawnattr_setsigdefault(&how, &all);
    posix_spawnattr_setflags(&how, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
    const int failed = posix_spawn(&c->pid, program, &files, &how, arguments, environment);
    posix_spawnattr_destroy(&how);
    posix_spawn_file_actions_destroy(&files);
    if (failed)
        c->pid = 0;
    return failed;
}

enum err child_share(struct child_memory *m, const char *name, const char *program, size_t bytes, int protection,
                     struct reason *why)
{
    m->fd = memfd_create(name, MFD_CLOEXEC);
    if (m->fd < 0 || ftruncate(m->fd, (off_t)bytes) != 0)
        return err_say(why, ERR_IO, "cannot share memory with %s: %s", program, strerror(errno));
    void *at = mmap(NULL, bytes, protection, MAP_SHARED, m->fd, 0);
    if (at == MAP_FAILED)
        return err_say(why, ERR_NOMEM, "out of memory for %zu bytes shared with %s", bytes, program);
    m->at = at;
    m->bytes = bytes;
    return ERR_OK;
}

void child_unshare(struct child_memory *m)
{
    if (m->at)
        munmap(m->at, m->bytes);
    if (m->fd >= 0)
        close(m->fd);
}

enum err child_start(struct child *c, const char *program, char *const arguments[], const int *descriptors,
                     size_t count, int64_t until_ms, const atomic_bool *stop, struct reason *why)
{
    int pair[2], given[GIVEN_MAX + 1] = { 0 }, failed = 0;
    struct wire_hello hello;
    size_t moved = 0;

    assert(count <= GIVEN_MAX);
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) != 0)
        return err_say(why, ERR_IO, "cannot create a socket for %.100s: %s", arguments[0], strerror(errno));
    for (; moved < count + 1 && !failed; moved++) {
        given[moved] = fcntl(moved == 0 ? pair[1] : descriptors[moved - 1], F_DUPFD_CLOEXEC, ABOVE);
        failed = given[moved] < 0 ? errno : 0;
    }
    if (!failed)
        failed = spawn(c, program, arguments, given, moved);
    for (size_t i = 0; i < moved; i++)
        if (given[i] >= 0)
            close(given[i]);
    close(pair[1]);
    c->socket = pair[0];
    if (failed) {
        close(pair[0]);
        return err_say(why, ERR_IO, "%.200s: cannot start: %s", program, strerror(failed));
    }
    const enum child_receipt receipt = child_receive(c, &hello, sizeof(hello), until_ms, stop);
    if (receipt != CHILD_RECEIVED) {
        child_end(c);
        return err_say(why, receipt == CHILD_STOPPED ? ERR_END : ERR_IO, "%.200s: is not the %s of this version",
                       program, arguments[0]);
    }
    c->unconfined = hello.unconfined;
    return ERR_OK;
}

int child_end(struct child *c)
{
    int status = 0;

    if (c->pid == 0)
        return 0;
    close(c->socket);
    kill(c->pid, SIGKILL);
    while (waitpid(c->pid, &status, 0) < 0 && errno == EINTR)
        continue;
    c->pid = 0;
    return status;
}

const char *child_death(int status, char *out, size_t size)
{
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGSYS)
        snprintf(out, size, "made a forbidden system call");
    else if (WIFSIGNALED(status))
        snprintf(out, size, "crashed (signal %d)", WTERMSIG(status));
    else
        snprintf(out, size, "crashed (exit code %d)", WEXITSTATUS(status));
    return out;
}

bool child_send(struct child *c, const void *message, size_t size)
{
    return send(c->socket, message, size, MSG_NOSIGNAL) == (ssize_t)size;
}

enum child_receipt child_receive(struct child *c, void *message, size_t size, int64_t until_ms, const atomic_bool *stop)
{
    for (;;) {
        struct pollfd p = { .fd = c->socket, .events = POLLIN };
        const int64_t left = until_ms - clock_ms();
        if (left <= 0)
            return CHILD_SILENT;
        if (stop && atomic_load(stop))
            return CHILD_STOPPED;
        if (poll(&p, 1, left < LOOK_MS ? (int)left : LOOK_MS) <= 0)
            continue;
        const ssize_t got = recv(c->socket, message, size, MSG_TRUNC | MSG_DONTWAIT);
        uint32_t magic = 0;
        memcpy(&magic, message, sizeof(magic));
        return got <= 0 ? CHILD_GONE : got == (ssize_t)size && magic == WIRE_MAGIC ? CHILD_RECEIVED : CHILD_GARBLED;
    }
}
