#define _GNU_SOURCE /* memfd_create, fallocate */
#include "decoder/decoder.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "decoder/wire.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define PROGRAM "relight-decoder"
#define FILE_BYTES ((size_t)256 << 20)
#define MEMORY_BYTES ((size_t)512 << 20)
#define PICTURE_BYTES                                                                                                  \
    (3 * sizeof(float) * IMAGE_MAX_TEXELS) /* address space; pages that no image has used take no memory */
#define KEPT_BYTES ((size_t)64 << 20)      /* shared memory that is kept although the current contents are smaller */
#define ABOVE 10    /* descriptors passed to the process are first moved above its fixed numbers */
#define SPARED 2    /* consecutive crashes after which the process is still restarted at once */
#define LIFE_S 3600 /* processor time after which the process is replaced, before its limit ends it */

enum { PATIENCE_MS = 10000, LOOK_MS = 100, WAIT_MIN_MS = 250, WAIT_MAX_MS = 5000 };

/* Memory mapped by both processes. */
struct shared {
    int fd; /* -1: none */
    void *at;
    size_t bytes;
    size_t used; /* bytes that may be backed by pages */
};

struct decoder {
    char program[4096];
    size_t file_bytes, memory_bytes;
    uint32_t timeout_ms;
    const atomic_bool *stop;
    struct shared file, picture;

    pid_t pid; /* 0: not running */
    int socket;
    bool confined;
    unsigned crashes_in_row; /* consecutive crashes */
    int64_t restart_ms;      /* earliest restart */
    atomic_uint_fast64_t files, crashed, timed_out, invalid, refused, starts;
};

/* ---- The process ---- */

/* Looks beside this program and in the package's lib folder. */
static enum err find_program(struct decoder *d, const char *asked, struct reason *why)
{
    static const char *const places[] = { "/" PROGRAM, "/../lib/relightd/" PROGRAM };
    char self[2048];

    if (asked) {
        snprintf(d->program, sizeof(d->program), "%s", asked);
        return access(asked, X_OK) == 0 ? ERR_OK
                                        : err_say(why, ERR_IO, "%s: cannot execute: %s", asked, strerror(errno));
    }
    const ssize_t n = readlink("/proc/self/exe", self, sizeof(self) - 1);
    self[n > 0 ? n : 0] = 0;
    char *slash = strrchr(self, '/');
    if (slash)
        *slash = 0;
    for (size_t i = 0; i < sizeof(places) / sizeof(places[0]); i++) {
        snprintf(d->program, sizeof(d->program), "%s%s", self, places[i]);
        if (access(d->program, X_OK) == 0)
            return ERR_OK;
    }
    return err_say(why, ERR_IO, PROGRAM " not found in %.200s or in ../lib/relightd from there", self);
}

/* Creates shared memory as a descriptor and maps it. */
static enum err share(struct shared *s, const char *name, size_t bytes, int protection, struct reason *why)
{
    const int low = memfd_create(name, MFD_CLOEXEC);

    s->fd = low < 0 ? -1 : fcntl(low, F_DUPFD_CLOEXEC, ABOVE);
    if (low >= 0)
        close(low);
    if (s->fd < 0 || ftruncate(s->fd, (off_t)bytes) != 0)
        return err_say(why, ERR_IO, "cannot share memory with " PROGRAM ": %s", strerror(errno));
    void *at = mmap(NULL, bytes, protection, MAP_SHARED, s->fd, 0);
    if (at == MAP_FAILED)
        return err_say(why, ERR_NOMEM, "out of memory for %zu bytes shared with " PROGRAM, bytes);
    s->at = at;
    s->bytes = bytes;
    return ERR_OK;
}

static void shared_finish(struct shared *s)
{
    if (s->at)
        munmap(s->at, s->bytes);
    if (s->fd >= 0)
        close(s->fd);
}

/* Returns memory to the system that only much larger contents needed; keeps KEPT_BYTES. */
static void trim(struct shared *s, size_t bytes)
{
    const size_t kept = bytes > KEPT_BYTES ? bytes : KEPT_BYTES;

    if (s->used / 4 > kept &&
        fallocate(s->fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, (off_t)kept, (off_t)(s->bytes - kept)) == 0)
        s->used = kept;
    s->used = s->used > bytes ? s->used : bytes;
}

/* Passes these three descriptors, an empty environment and default signal handling. */
static int spawn(struct decoder *d, int socket)
{
    char file[24], picture[24], memory[24];
    char *const arguments[] = { (char[]){ PROGRAM }, file, picture, memory, NULL }, *const environment[] = { NULL };
    posix_spawn_file_actions_t files;
    posix_spawnattr_t how;
    sigset_t none, all;

    snprintf(file, sizeof(file), "%zu", d->file_bytes);
    snprintf(picture, sizeof(picture), "%zu", PICTURE_BYTES);
    snprintf(memory, sizeof(memory), "%zu", d->memory_bytes);
    posix_spawn_file_actions_init(&files);
    for (int fd = 0; fd < 3; fd++)
#ifdef __SANITIZE_ADDRESS__
        if (fd != STDERR_FILENO) /* for error reports */
#endif
            posix_spawn_file_actions_addopen(&files, fd, "/dev/null", O_RDWR, 0);
    posix_spawn_file_actions_adddup2(&files, socket, WIRE_SOCKET);
    posix_spawn_file_actions_adddup2(&files, d->file.fd, WIRE_FILE);
    posix_spawn_file_actions_adddup2(&files, d->picture.fd, WIRE_PICTURE);
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_init(&how);
    posix_spawnattr_setsigmask(&how, &none);
    posix_spawnattr_setsigdefault(&how, &all);
    posix_spawnattr_setflags(&how, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
    const int failed = posix_spawn(&d->pid, d->program, &files, &how, arguments, environment);
    posix_spawnattr_destroy(&how);
    posix_spawn_file_actions_destroy(&files);
    if (failed)
        d->pid = 0;
    return failed;
}

/* Ends the process if it has not ended yet, and returns its exit status as waitpid does. */
static int end(struct decoder *d)
{
    int status = 0;

    if (d->pid == 0)
        return 0;
    close(d->socket);
    kill(d->pid, SIGKILL);
    while (waitpid(d->pid, &status, 0) < 0 && errno == EINTR)
        continue;
    d->pid = 0;
    return status;
}

enum receipt { RECEIVED, RECEIVED_END, RECEIVED_NOTHING, RECEIVED_STOP };

/* Waits for one message of exactly `size` bytes. RECEIVED_END: the process is gone or sent something else. */
static enum receipt receive(struct decoder *d, void *message, size_t size)
{
    const int64_t until = clock_ms() + d->timeout_ms;

    for (;;) {
        struct pollfd p = { .fd = d->socket, .events = POLLIN };
        const int64_t left = until - clock_ms();
        if (left <= 0)
            return RECEIVED_NOTHING;
        if (d->stop && atomic_load(d->stop))
            return RECEIVED_STOP;
        if (poll(&p, 1, left < LOOK_MS ? (int)left : LOOK_MS) <= 0)
            continue;
        const ssize_t got = recv(d->socket, message, size, MSG_TRUNC | MSG_DONTWAIT);
        return got == (ssize_t)size ? RECEIVED : RECEIVED_END;
    }
}

static enum err start(struct decoder *d, struct reason *why)
{
    struct wire_hello hello = { 0 };
    int pair[2];

    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) != 0)
        return err_say(why, ERR_IO, "cannot create a socket for " PROGRAM ": %s", strerror(errno));
    const int theirs = fcntl(pair[1], F_DUPFD_CLOEXEC, ABOVE);
    const int failed = theirs < 0 ? errno : spawn(d, theirs);
    close(pair[1]);
    if (theirs >= 0)
        close(theirs);
    d->socket = pair[0];
    if (failed) {
        close(pair[0]);
        return err_say(why, ERR_IO, "%.200s: cannot start: %s", d->program, strerror(failed));
    }
    atomic_fetch_add(&d->starts, 1);
    const enum receipt receipt = receive(d, &hello, sizeof(hello));
    if (receipt != RECEIVED || hello.magic != WIRE_MAGIC) {
        end(d);
        return err_say(why, ERR_IO, "%.200s: is not the " PROGRAM " of this version", d->program);
    }
    d->confined = hello.confined == 1;
    return ERR_OK;
}

/* ---- One file ---- */

/* The first crashes cost only a restart; then the delay doubles, so that a stream of bad files does not keep a
 * processor busy with restarts. */
static void count_crash(struct decoder *d)
{
    int64_t wait = WAIT_MIN_MS;

    if (++d->crashes_in_row <= SPARED)
        return;
    for (unsigned i = SPARED + 1; i < d->crashes_in_row && wait < WAIT_MAX_MS; i++)
        wait *= 2;
    d->restart_ms = clock_ms() + (wait < WAIT_MAX_MS ? wait : WAIT_MAX_MS);
}

static enum err report_crash(struct decoder *d, enum receipt receipt, const char *name, struct reason *why)
{
    const int status = end(d);

    if (receipt == RECEIVED_STOP)
        return err_say(why, ERR_END, "%s: not decoded, the program is stopping", name);
    count_crash(d);
    if (receipt == RECEIVED_NOTHING) {
        atomic_fetch_add(&d->timed_out, 1);
        return err_say(why, ERR_FORMAT, "%s: decoding timed out after %g s", name, d->timeout_ms / 1e3);
    }
    atomic_fetch_add(&d->crashed, 1);
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGSYS)
        return err_say(why, ERR_FORMAT, "%s: the decoder made a forbidden system call", name);
    if (WIFSIGNALED(status))
        return err_say(why, ERR_FORMAT, "%s: the decoder crashed (signal %d)", name, WTERMSIG(status));
    return err_say(why, ERR_FORMAT, "%s: the decoder crashed (exit code %d)", name, WEXITSTATUS(status));
}

static enum err report_invalid_answer(struct decoder *d, const char *name, struct reason *why)
{
    end(d);
    count_crash(d);
    atomic_fetch_add(&d->invalid, 1);
    return err_say(why, ERR_FORMAT, "%s: the decoder sent an invalid answer", name);
}

/* Copies row by row and sanitises each row while it is in the cache; an uncompromised process sends only valid texels.
 */
static void take_texels(const struct decoder *d, struct image *im)
{
    const size_t row = 3 * (size_t)im->width;
    const float *rgb = d->picture.at;
    struct image_faults ignored = { 0 };

    for (size_t at = 0; at < row * im->height; at += row) {
        memcpy(im->rgb + at, rgb + at, row * sizeof(float));
        image_sanitise_texels(im->rgb + at, im->width, NULL, &ignored);
    }
}

static enum err take_answer(struct decoder *d, struct wire_answer *a, const char *name, struct image *im,
                            struct reason *why)
{
    if (a->magic != WIRE_MAGIC || a->result < ERR_OK || a->result >= ERR_END || a->layout > LAYOUT_FISHEYE)
        return report_invalid_answer(d, name, why);
    d->crashes_in_row = 0;
    if (a->result != ERR_OK) {
        char text[sizeof(a->why.text)];
        return err_say(why, (enum err)a->result, "%s",
                       decode_printable(a->why.text, sizeof(a->why.text), text, sizeof(text)));
    }
    const enum err e = image_resize(im, a->width, a->height);
    if (e == ERR_RANGE)
        return report_invalid_answer(d, name, why);
    if (e)
        return err_say(why, e, "%s: out of memory for %ux%u texels", name, a->width, a->height);
    im->layout = (enum layout)a->layout;
    im->faults = (struct image_faults){ a->nan, a->infinite, a->negative, a->clipped };
    take_texels(d, im);
    trim(&d->picture, 3 * sizeof(float) * (size_t)im->width * im->height);
    return ERR_OK;
}

/* Returns a running process, starting one if necessary. */
static enum err ready(struct decoder *d, const char *name, struct reason *why)
{
    struct reason cause;
    clockid_t its;
    struct timespec spent;

    if (d->pid != 0 && clock_getcpuclockid(d->pid, &its) == 0 && clock_gettime(its, &spent) == 0 &&
        spent.tv_sec > LIFE_S)
        end(d);
    if (d->pid != 0)
        return ERR_OK;
    if (clock_ms() < d->restart_ms) {
        atomic_fetch_add(&d->refused, 1);
        return err_say(why, ERR_IO, "%s: not decoded: the decoder crashed on %u frames in a row", name,
                       d->crashes_in_row);
    }
    const enum err e = start(d, &cause);
    if (e) {
        count_crash(d);
        log_error("%s", cause.text);
        return err_say(why, e, "%s: no decoder is running", name);
    }
    return ERR_OK;
}

enum err decoder_decode(void *context, const uint8_t *bytes, size_t size, const char *name, struct image *im,
                        struct reason *why)
{
    struct decoder *d = context;
    struct wire_request q = { .magic = WIRE_MAGIC, .max_side = im->max_side, .size = size };
    struct wire_answer a;

    atomic_fetch_add(&d->files, 1);
    if (size > d->file_bytes)
        return err_say(why, ERR_RANGE, "%s: larger than %zu bytes", name, d->file_bytes);
    enum err e = ready(d, name, why);
    if (e)
        return e;
    snprintf(q.name, sizeof(q.name), "%s", name);
    memcpy(d->file.at, bytes, size);
    trim(&d->file, size);
    enum receipt receipt = RECEIVED_END;
    if (send(d->socket, &q, sizeof(q), MSG_NOSIGNAL) == (ssize_t)sizeof(q))
        receipt = receive(d, &a, sizeof(a));
    return receipt == RECEIVED ? take_answer(d, &a, name, im, why) : report_crash(d, receipt, name, why);
}

/* ---- Creation and statistics ---- */

enum err decoder_create(const struct decoder_desc *desc, struct decoder **out, struct reason *why)
{
    *out = NULL;
    struct decoder *d = mem_alloc(1, sizeof(*d));
    if (!d)
        return err_say(why, ERR_NOMEM, "out of memory");
    d->file.fd = d->picture.fd = -1;
    d->file_bytes = desc->file_bytes ? desc->file_bytes : FILE_BYTES;
    d->memory_bytes = desc->memory_bytes ? desc->memory_bytes : MEMORY_BYTES;
    d->timeout_ms = desc->timeout_ms ? desc->timeout_ms : PATIENCE_MS;
    d->stop = desc->stop;
    enum err e = find_program(d, desc->program, why);
    if (!e)
        e = share(&d->file, "relight-file", d->file_bytes, PROT_READ | PROT_WRITE, why);
    if (!e)
        e = share(&d->picture, "relight-picture", PICTURE_BYTES, PROT_READ, why);
    if (!e)
        e = start(d, why);
    if (e) {
        decoder_destroy(d);
        return e;
    }
    *out = d;
    return ERR_OK;
}

void decoder_destroy(struct decoder *d)
{
    if (!d)
        return;
    end(d);
    shared_finish(&d->file);
    shared_finish(&d->picture);
    mem_free(d);
}

bool decoder_is_confined(const struct decoder *d)
{
    return d->confined;
}

void decoder_counts(const struct decoder *d, struct decoder_counts *out)
{
    *out = (struct decoder_counts){
        .files = atomic_load(&d->files),
        .crashed = atomic_load(&d->crashed),
        .timed_out = atomic_load(&d->timed_out),
        .invalid = atomic_load(&d->invalid),
        .refused = atomic_load(&d->refused),
        .starts = atomic_load(&d->starts),
    };
}
