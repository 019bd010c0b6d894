#define _GNU_SOURCE /* memfd_create, fallocate */
#include "decoder.h"

#include "clock.h"
#include "log.h"
#include "mem.h"
#include "wire.h"

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
    (3 * sizeof(float) * IMAGE_MAX_TEXELS) /* address space: what no picture has used takes no memory */
#define KEPT_BYTES ((size_t)64 << 20)      /* of shared memory, though what is in it is smaller now */
#define ABOVE 10                           /* descriptors that are given on lie above those that they become */
#define SPARED 2                           /* deaths in a row after which the process is started again at once */
#define LIFE_S 3600                        /* processor time after which it is replaced, before its limit ends it */

enum { PATIENCE_MS = 10000, LOOK_MS = 100, WAIT_LEAST_MS = 250, WAIT_MOST_MS = 5000 };

/* Memory that both see. */
struct shared {
    int fd; /* -1: none yet */
    void *at;
    size_t bytes;
    size_t used; /* that the system may have given so far */
};

struct decoder {
    char program[4096];
    size_t file_bytes, memory_bytes;
    uint32_t patience_ms;
    const atomic_bool *stop;
    struct shared file, picture;

    pid_t pid; /* 0: there is no process */
    int socket;
    bool confined;
    unsigned deaths;  /* in a row */
    int64_t again_ms; /* no start before */
    atomic_uint_fast64_t files, died, hung, lied, waited, starts;
};

/* ---- The process ---- */

/* Beside this program, or where a package has it. */
static enum err find_program(struct decoder *d, const char *asked, struct reason *why)
{
    static const char *const places[] = { "/" PROGRAM, "/../lib/relightd/" PROGRAM };
    char self[2048];

    if (asked) {
        snprintf(d->program, sizeof(d->program), "%s", asked);
        return access(asked, X_OK) == 0 ? ERR_OK
                                        : err_say(why, ERR_IO, "%s: cannot be run: %s", asked, strerror(errno));
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
    return err_say(why, ERR_IO, PROGRAM " is neither in %.200s nor in ../lib/relightd from there", self);
}

/* Memory of that size, as a descriptor and mapped. */
static enum err share(struct shared *s, const char *name, size_t bytes, int protection, struct reason *why)
{
    const int low = memfd_create(name, MFD_CLOEXEC);

    s->fd = low < 0 ? -1 : fcntl(low, F_DUPFD_CLOEXEC, ABOVE);
    if (low >= 0)
        close(low);
    if (s->fd < 0 || ftruncate(s->fd, (off_t)bytes) != 0)
        return err_say(why, ERR_IO, "no memory can be shared with " PROGRAM ": %s", strerror(errno));
    void *at = mmap(NULL, bytes, protection, MAP_SHARED, s->fd, 0);
    if (at == MAP_FAILED)
        return err_say(why, ERR_NOMEM, "no room for %zu bytes that are shared with " PROGRAM, bytes);
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

/* Of what only much larger contents than these `bytes` have needed, the system gets all back but KEPT_BYTES. */
static void trim(struct shared *s, size_t bytes)
{
    const size_t kept = bytes > KEPT_BYTES ? bytes : KEPT_BYTES;

    if (s->used / 4 > kept &&
        fallocate(s->fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, (off_t)kept, (off_t)(s->bytes - kept)) == 0)
        s->used = kept;
    s->used = s->used > bytes ? s->used : bytes;
}

/* With these three descriptors, nothing in its environment, and no signal blocked or ignored. */
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
        if (fd != STDERR_FILENO) /* reports go there */
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

/* Ends the process, if it has not done so itself, and returns how it ended, as waitpid says. */
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

enum heard { HEARD, HEARD_END, HEARD_NOTHING, HEARD_STOP };

/* Waits for one message of exactly that size. HEARD_END: there is no other end any more, or it talks nonsense. */
static enum heard hear(struct decoder *d, void *message, size_t size)
{
    const int64_t until = clock_ms() + d->patience_ms;

    for (;;) {
        struct pollfd p = { .fd = d->socket, .events = POLLIN };
        const int64_t left = until - clock_ms();
        if (left <= 0)
            return HEARD_NOTHING;
        if (d->stop && atomic_load(d->stop))
            return HEARD_STOP;
        if (poll(&p, 1, left < LOOK_MS ? (int)left : LOOK_MS) <= 0)
            continue;
        const ssize_t got = recv(d->socket, message, size, MSG_TRUNC | MSG_DONTWAIT);
        return got == (ssize_t)size ? HEARD : HEARD_END;
    }
}

static enum err start(struct decoder *d, struct reason *why)
{
    struct wire_hello hello = { 0 };
    int pair[2];

    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) != 0)
        return err_say(why, ERR_IO, "no socket for " PROGRAM ": %s", strerror(errno));
    const int theirs = fcntl(pair[1], F_DUPFD_CLOEXEC, ABOVE);
    const int failed = theirs < 0 ? errno : spawn(d, theirs);
    close(pair[1]);
    if (theirs >= 0)
        close(theirs);
    d->socket = pair[0];
    if (failed) {
        close(pair[0]);
        return err_say(why, ERR_IO, "%.200s: cannot be started: %s", d->program, strerror(failed));
    }
    atomic_fetch_add(&d->starts, 1);
    const enum heard heard = hear(d, &hello, sizeof(hello));
    if (heard != HEARD || hello.magic != WIRE_MAGIC) {
        end(d);
        return err_say(why, ERR_IO, "%.200s: started, and is no " PROGRAM " of this version", d->program);
    }
    d->confined = hello.confined == 1;
    return ERR_OK;
}

/* ---- One file ---- */

/* The first deaths cost nothing but a start; then it waits longer and longer, so that a stream of bad files does not
 * keep a processor busy with starting processes. */
static void note_death(struct decoder *d)
{
    int64_t wait = WAIT_LEAST_MS;

    if (++d->deaths <= SPARED)
        return;
    for (unsigned i = SPARED + 1; i < d->deaths && wait < WAIT_MOST_MS; i++)
        wait *= 2;
    d->again_ms = clock_ms() + (wait < WAIT_MOST_MS ? wait : WAIT_MOST_MS);
}

static enum err say_death(struct decoder *d, enum heard heard, const char *name, struct reason *why)
{
    const int status = end(d);

    if (heard == HEARD_STOP)
        return err_say(why, ERR_END, "%s: the program ends", name);
    note_death(d);
    if (heard == HEARD_NOTHING) {
        atomic_fetch_add(&d->hung, 1);
        return err_say(why, ERR_FORMAT, "%s: not decoded within %g s", name, d->patience_ms / 1e3);
    }
    atomic_fetch_add(&d->died, 1);
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGSYS)
        return err_say(why, ERR_FORMAT, "%s: made its decoder ask the system for what decoding does not need", name);
    if (WIFSIGNALED(status))
        return err_say(why, ERR_FORMAT, "%s: its decoder did not survive it (signal %d)", name, WTERMSIG(status));
    return err_say(why, ERR_FORMAT, "%s: its decoder did not survive it (exit code %d)", name, WEXITSTATUS(status));
}

static enum err say_lie(struct decoder *d, const char *name, struct reason *why)
{
    end(d);
    note_death(d);
    atomic_fetch_add(&d->lied, 1);
    return err_say(why, ERR_FORMAT, "%s: its decoder answered with nonsense", name);
}

/* Row by row, each put right while it is in the cache; of an honest process there is nothing to put right. */
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
        return say_lie(d, name, why);
    d->deaths = 0;
    if (a->result != ERR_OK) {
        char text[sizeof(a->why.text)];
        return err_say(why, (enum err)a->result, "%s",
                       decode_plain(a->why.text, sizeof(a->why.text), text, sizeof(text)));
    }
    const enum err e = image_resize(im, a->width, a->height);
    if (e == ERR_RANGE)
        return say_lie(d, name, why);
    if (e)
        return err_say(why, e, "%s: no memory for %ux%u texels", name, a->width, a->height);
    im->layout = (enum layout)a->layout;
    im->faults = (struct image_faults){ a->nan, a->infinite, a->negative, a->clipped };
    take_texels(d, im);
    trim(&d->picture, 3 * sizeof(float) * (size_t)im->width * im->height);
    return ERR_OK;
}

/* A process that is ready: the one there is, or a new one. */
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
    if (clock_ms() < d->again_ms) {
        atomic_fetch_add(&d->waited, 1);
        return err_say(why, ERR_IO, "%s: not decoded, since %u frames in a row have each cost a decoder", name,
                       d->deaths);
    }
    const enum err e = start(d, &cause);
    if (e) {
        note_death(d);
        log_error("%s", cause.text);
        return err_say(why, e, "%s: there is no decoder for it", name);
    }
    return ERR_OK;
}

enum err decoder_decode(void *context, const uint8_t *bytes, size_t size, const char *name, struct image *im,
                        struct reason *why)
{
    struct decoder *d = context;
    struct wire_request q = { .magic = WIRE_MAGIC, .most_side = im->most_side, .size = size };
    struct wire_answer a;

    atomic_fetch_add(&d->files, 1);
    if (size > d->file_bytes)
        return err_say(why, ERR_RANGE, "%s: more than %zu bytes", name, d->file_bytes);
    enum err e = ready(d, name, why);
    if (e)
        return e;
    snprintf(q.name, sizeof(q.name), "%s", name);
    memcpy(d->file.at, bytes, size);
    trim(&d->file, size);
    enum heard heard = HEARD_END;
    if (send(d->socket, &q, sizeof(q), MSG_NOSIGNAL) == (ssize_t)sizeof(q))
        heard = hear(d, &a, sizeof(a));
    return heard == HEARD ? take_answer(d, &a, name, im, why) : say_death(d, heard, name, why);
}

/* ---- Life ---- */

enum err decoder_create(const struct decoder_desc *desc, struct decoder **out, struct reason *why)
{
    *out = NULL;
    struct decoder *d = mem_alloc(1, sizeof(*d));
    if (!d)
        return err_say(why, ERR_NOMEM, "out of memory");
    d->file.fd = d->picture.fd = -1;
    d->file_bytes = desc->file_bytes ? desc->file_bytes : FILE_BYTES;
    d->memory_bytes = desc->memory_bytes ? desc->memory_bytes : MEMORY_BYTES;
    d->patience_ms = desc->patience_ms ? desc->patience_ms : PATIENCE_MS;
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
        .died = atomic_load(&d->died),
        .hung = atomic_load(&d->hung),
        .lied = atomic_load(&d->lied),
        .waited = atomic_load(&d->waited),
        .starts = atomic_load(&d->starts),
    };
}
