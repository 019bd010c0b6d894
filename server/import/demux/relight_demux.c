/* relight-demux: the process that the programs start to demultiplex a video file or a network stream. */
#define _GNU_SOURCE
#include "import/demux/read.h"
#include "import/sandbox/confine.h"
#include "import/sandbox/helper.h"

#include <errno.h>
#include <libavformat/avformat.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#define PROGRAM_BYTES ((size_t)1 << 30) /* libraries, buffers of containers and network, a video's index */
#define LIFE_S (365u * 24 * 3600)       /* processor time: a live stream may run for long */

static enum err work(struct reading *r, struct demux_request *q, struct demux_answer *a)
{
    q->url[sizeof(q->url) - 1] = 0;
    if (q->ask == DEMUX_ASK_OPEN)
        return reading_open(r, q->url, a);
    return q->ask == DEMUX_ASK_NEXT ? reading_next(r, a) : reading_seek(r, q->time_us, a);
}

static int serve(struct reading *r)
{
    struct demux_request q;

    while (helper_receive(&q, sizeof(q))) {
        struct demux_answer a = { .magic = WIRE_MAGIC };
        a.result = (int32_t)work(r, &q, &a);
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

/* A file needs neither network nor files; a network source needs the network. Devices are opened before. */
static bool confine(const struct reading_desc *d)
{
    const struct confine_limits limits = {
        .address_bytes = d->file_bytes + d->packet_bytes + PROGRAM_BYTES,
        .seconds = LIFE_S,
        .descriptors = WIRE_SOCKET + 1,
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
    d.ca = argv[3][0] ? argv[3] : NULL;
    d.device = strcmp(argv[2], "device") == 0 ? "v4l2" : NULL;
    d.packet = mmap(NULL, d.packet_bytes, PROT_READ | PROT_WRITE, MAP_SHARED, DEMUX_MEMORY, 0);
    if (d.packet == MAP_FAILED || (strcmp(argv[2], "file") == 0 && !map_file(&d)))
        return 1;
    struct reading *r = reading_create(&d);
    if (!r)
        return 1;
    if (!d.file)
        avformat_network_init();
    if ((!d.device && !confine(&d)) || !helper_hello(0))
        return 1;
    _exit(serve(r)); /* libraries clean up by system calls that are gone */
}
