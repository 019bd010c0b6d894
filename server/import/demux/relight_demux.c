/* relight-demux: the process that the programs start to demultiplex a video file or a network stream. */
#define _GNU_SOURCE
#include "import/demux/demux.h"
#include "import/demux/internal.h"
#include "import/sandbox/confine.h"
#include "import/sandbox/helper_process.h"

#include <errno.h>
#include <fcntl.h>
#include <libavformat/avformat.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#define PROGRAM_BYTES ((size_t)1 << 30) /* libraries, buffers of containers and network, a video's index */
#define CA_COPY (WIRE_SOCKET + 1)
#define LIFE_S (365u * 24 * 3600) /* processor time: a live stream may run for long */

/* Only a device is opened with the privileges of the program, which lose them then. */
static enum err work(struct reading *r, bool device, struct demux_request *q, struct demux_answer *a)
{
    q->url[sizeof(q->url) - 1] = 0;
    if (q->ask == DEMUX_ASK_NEXT)
        return reading_next(r, a);
    if (q->ask == DEMUX_ASK_SEEK)
        return reading_seek(r, q->time_us, a);
    const enum err e = reading_open(r, q->url, a);
    return !e && device && confine_user() ? err_say(&a->why, ERR_IO, "privileges could not be dropped") : e;
}

static int serve(struct reading *r, bool device)
{
    struct demux_request q;

    while (helper_receive(&q, sizeof(q))) {
        struct demux_answer a = { .magic = WIRE_MAGIC };
        a.result = (int32_t)work(r, device, &q, &a);
        if (!helper_send(&a, sizeof(a)))
            return 1;
    }
    return 0;
}

/* Maps the file, so that reading it needs no system call. */
static bool map_file(struct reading_desc *d)
{
    struct stat st;

    if (fstat(DEMUX_INPUT, &st) != 0)
        return false;
    void *at = mmap(NULL, (size_t)st.st_size, PROT_READ, MAP_PRIVATE, DEMUX_INPUT, 0);
    d->file = at;
    d->file_bytes = (size_t)st.st_size;
    return at != MAP_FAILED;
}

/* Copies the authorities into memory, since a process of another user might not be allowed to read their file. Returns
 * a path of the copy; the file's where that fails; NULL: none. */
static const char *copy_authorities(const char *path)
{
    static char copy[32];
    char piece[4096];
    ssize_t n = -1;

    if (!path[0] || strcmp(path, DEMUX_ANY_CA) == 0)
        return path[0] ? path : NULL;
    const int from = open(path, O_RDONLY | O_CLOEXEC), to = memfd_create("relight-ca", 0);
    while (from >= 0 && to >= 0 && (n = read(from, piece, sizeof(piece))) > 0 && write(to, piece, (size_t)n) == n)
        continue;
    if (n != 0 || dup2(to, CA_COPY) < 0) /* closed with all above CA_COPY by confine_limits */
        return path;
    snprintf(copy, sizeof(copy), "/proc/self/fd/%d", CA_COPY);
    return access(copy, R_OK) == 0 ? copy : path;
}

/* A file needs neither network nor files; a network source needs the network. Devices are opened before. */
static bool confine(const struct reading_desc *d)
{
    const struct confine_limits limits = {
        .address_bytes = d->file_bytes + d->packet_bytes + PROGRAM_BYTES,
        .seconds = LIFE_S,
        .descriptors = CA_COPY + 1,
        .received = d->file ? 0 : 64,
        .threads = !d->file,
    };

    if (confine_limits(&limits) != 0)
        return false;
    const int error = d->file ? confine_calls_softly() : confine_network(d->ca);
    return error == 0 || error == ENOSYS || error == EINVAL; /* a kernel without seccomp */
}

int main(int argc, char **argv)
{
    struct reading_desc d = { .file = NULL };
    unsigned long long bytes;

    if (argc != 4 || sscanf(argv[1], "%llu", &bytes) != 1)
        return helper_refuse(argc, argv, "read video");
    d.packet_bytes = (size_t)bytes;
    d.device = strcmp(argv[2], "device") == 0 ? "v4l2" : NULL;
    d.packet = mmap(NULL, d.packet_bytes, PROT_READ | PROT_WRITE, MAP_SHARED, DEMUX_MEMORY, 0);
    if (d.packet == MAP_FAILED || (strcmp(argv[2], "file") == 0 && !map_file(&d)))
        return 1;
    close(DEMUX_MEMORY);
    close(DEMUX_INPUT);
    d.ca = copy_authorities(argv[3]);
    struct reading *r = reading_create(&d);
    if (!r)
        return 1;
    if (!d.file)
        avformat_network_init();
    if ((!d.device && !confine(&d)) || !helper_hello(0))
        return 1;
    _exit(serve(r, d.device != NULL)); /* libraries clean up by system calls that are gone */
}
