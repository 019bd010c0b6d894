#include "import/reader/host.h"

#include "base/log.h"
#include "import/reader/wire.h"
#include "import/sandbox/confine.h"
#include "import/sandbox/helper_process.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>

#define SPARE_BYTES ((size_t)16 << 20) /* the stack, and buffers of libraries */

/* The parent is gone or sent an invalid message: there is nobody to report to. */
static _Noreturn void give_up(void)
{
    _exit(1);
}

static void say(enum wire_kind kind, int code, const char *text)
{
    struct wire_message m = { .magic = WIRE_MAGIC, .kind = (uint32_t)kind, .code = code };

    snprintf(m.text, sizeof(m.text), "%s", text);
    if (!helper_send(&m, sizeof(m)))
        give_up();
}

static void forward_line(enum log_level level, const char *text)
{
    say(WIRE_LOG, (int)level, text);
}

/* Returns the descriptor that came with the answer, or -1. */
static int hear(struct wire_answer *a)
{
    union {
        struct cmsghdr head;
        char room[CMSG_SPACE(sizeof(int))];
    } control;
    struct iovec part = { a, sizeof(*a) };
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = control.room, .msg_controllen = sizeof(control.room)
    };
    ssize_t got;
    int fd = -1;

    do
        got = recvmsg(WIRE_SOCKET, &message, 0);
    while (got < 0 && errno == EINTR);
    if (got != (ssize_t)sizeof(*a) || a->magic != WIRE_MAGIC)
        give_up();
    const struct cmsghdr *c = CMSG_FIRSTHDR(&message);
    if (c && c->cmsg_level == SOL_SOCKET && c->cmsg_type == SCM_RIGHTS)
        memcpy(&fd, CMSG_DATA(c), sizeof(fd));
    return fd;
}

static enum err ask(enum wire_kind kind, const char *path, int *fd, size_t *size, struct reason *why)
{
    struct wire_answer a;

    if (strlen(path) >= HOST_PATH_MAX)
        return err_say(why, ERR_RANGE, "%.100s...: the path is too long", path);
    say(kind, 0, path);
    *fd = hear(&a);
    *size = (size_t)a.size;
    if (a.code)
        return err_say(why, (enum err)a.code, "%s", a.why.text);
    return kind == WIRE_OPEN && *fd < 0 ? err_say(why, ERR_IO, "%s: cannot be handed over", path) : ERR_OK;
}

static enum err ask_to_open(void *context, const char *path, int *fd, size_t *size, struct reason *why)
{
    (void)context;
    return ask(WIRE_OPEN, path, fd, size, why);
}

static enum err ask_to_allow(void *context, const char *path, struct reason *why)
{
    size_t size;
    int fd;

    (void)context;
    return ask(WIRE_ALLOW, path, &fd, &size, why);
}

static void tell_step(void *context)
{
    (void)context;
    say(WIRE_STEP, 0, "");
}

/* The system ends this process first when it runs out of memory. */
static void stand_back(void)
{
    const int fd = open("/proc/self/oom_score_adj", O_WRONLY | O_CLOEXEC);

    if (fd >= 0 && write(fd, "1000", 4) < 0)
        errno = 0; /* nothing else depends on it */
    if (fd >= 0)
        close(fd);
}

/* Address space of the program and its libraries. */
static size_t own_bytes(void)
{
    unsigned long pages = 0;
    FILE *f = fopen("/proc/self/statm", "r");

    if (f && fscanf(f, "%lu", &pages) != 1)
        pages = 0;
    if (f)
        fclose(f);
    return pages * (size_t)sysconf(_SC_PAGESIZE) + SPARE_BYTES;
}

/* Returns 0 or errno of seccomp. */
static int confine(uint64_t memory_bytes, unsigned seconds)
{
    const struct confine_limits limits = {
        .address_bytes = own_bytes() + (size_t)memory_bytes,
        .file_bytes = memory_bytes, /* the parcel */
        .seconds = seconds,
        .descriptors = WIRE_COUNT,
        .received = 1, /* the file that is being read */
    };

    if (confine_limits(&limits) != 0)
        give_up();
    return confine_calls(true);
}

int reader_serve(int argc, char **argv,
                 enum err (*import)(const char *path, const struct host *host, struct scene **out, struct reason *why))
{
    struct host host = { ask_to_open, ask_to_allow, tell_step, NULL, NAN, 0 };
    struct scene *scene = NULL;
    struct reason why = { "" };
    uint64_t memory_bytes;
    unsigned seconds;

    if (argc != 6 || sscanf(argv[1], "%" SCNu64, &memory_bytes) != 1 || sscanf(argv[2], "%u", &seconds) != 1 ||
        sscanf(argv[3], "%lf", &host.time) != 1 || sscanf(argv[4], "%" SCNu64, &host.texture_bytes) != 1)
        return helper_refuse(argc, argv, "read scenes");
    /* A terminal or service manager sends these to the parent too, which decides. */
    signal(SIGINT, SIG_IGN);
    signal(SIGTERM, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN); /* write fails instead */
    prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0);
    stand_back();
    if (!helper_hello(confine(memory_bytes, seconds)))
        give_up();
    log_divert(forward_line);
    enum err e = import(argv[5], &host, &scene, &why);
    if (!e)
        e = parcel_write(WIRE_PARCEL, scene, &why);
    say(WIRE_DONE, (int)e, why.text);
    _exit(0);
}
