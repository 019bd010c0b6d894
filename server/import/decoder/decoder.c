#define _GNU_SOURCE /* fallocate */
#include "import/decoder/internal.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "image/codec/calendar.h"
#include "import/decoder/decoder.h"

#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <sys/wait.h>

#define PROGRAM "relight-decoder"
#define VIDEO_PROGRAM "relight-video"
#define FILE_BYTES ((size_t)256 << 20)       /* default of --max-frame-mib */
#define MEMORY_BYTES ((size_t)512 << 20)     /* default, of the process */
#define VIDEO_MEMORY_BYTES ((size_t)3 << 30) /* decoders of 8K video keep 16 reference images of up to 100 MB */
#define IMAGE_BYTES                                                                                                    \
    (3 * sizeof(float) * IMAGE_MAX_TEXELS) /* address space; pages that no image has used take no memory */
#define KEPT_BYTES ((size_t)64 << 20)      /* shared memory that is kept although the current contents are smaller */
#define SPARED 2                           /* consecutive crashes after which the process is still restarted at once */
#define LIFE_S 3600 /* processor time after which the process is replaced, before its limit ends it */

enum { PATIENCE_MS = 10000, WAIT_MIN_MS = 250, WAIT_MAX_MS = 5000 };

/* ---- The process ---- */

/* Returns memory to the system that only much larger contents needed; keeps KEPT_BYTES. */
void decoder_trim(struct child_memory *m, size_t bytes)
{
    const size_t kept = bytes > KEPT_BYTES ? bytes : KEPT_BYTES;

    if (m->used / 4 > kept &&
        fallocate(m->fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, (off_t)kept, (off_t)(m->bytes - kept)) == 0)
        m->used = kept;
    m->used = m->used > bytes ? m->used : bytes;
}

static enum err start(struct decoder *d, struct reason *why)
{
    char file[24], picture[24], memory[24];
    char *const arguments[] = { d->video ? (char[]){ VIDEO_PROGRAM } : (char[]){ PROGRAM }, file, picture, memory,
                                NULL };
    const int descriptors[] = { d->file.fd, d->picture.fd }; /* in the order of internal.h */

    snprintf(file, sizeof(file), "%zu", d->file_bytes);
    snprintf(picture, sizeof(picture), "%zu", IMAGE_BYTES);
    snprintf(memory, sizeof(memory), "%zu", d->memory_bytes);
    atomic_fetch_add(&d->starts, 1);
    d->streaming = false;
    return child_start(&d->child, d->program, arguments, descriptors, 2, clock_ms() + d->timeout_ms, d->stop, why);
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

/* The process has ended with `status`. */
static enum err report_crash(struct decoder *d, enum child_receipt receipt, int status, const char *name,
                             struct reason *why)
{
    char death[64];

    if (receipt == CHILD_STOPPED)
        return err_say(why, ERR_END, "%s: not decoded, the program is stopping", name);
    count_crash(d);
    if (receipt == CHILD_SILENT) {
        atomic_fetch_add(&d->timed_out, 1);
        return err_say(why, ERR_FORMAT, "%s: decoding timed out after %g s", name, d->timeout_ms / 1e3);
    }
    atomic_fetch_add(&d->crashed, 1);
    return err_say(why, ERR_FORMAT, "%s: the decoder %s", name, child_death(status, death, sizeof(death)));
}

enum err decoder_report_invalid(struct decoder *d, const char *name, struct reason *why)
{
    child_end(&d->child);
    count_crash(d);
    atomic_fetch_add(&d->invalid, 1);
    return err_say(why, ERR_FORMAT, "%s: the decoder sent an invalid answer", name);
}

/* Copies row by row and sanitises each row while it is in the cache; an uncompromised process sends only valid texels.
 */
void decoder_take_texels(const struct decoder *d, struct image *im)
{
    const size_t row = 3 * (size_t)im->width;
    const float *rgb = d->picture.at;

    im->faults = (struct image_faults){ .nan = 0 };
    for (size_t at = 0; at < row * im->height; at += row) {
        memcpy(im->rgb + at, rgb + at, row * sizeof(float));
        image_sanitise_texels(im->rgb + at, im->width, NULL, &im->faults);
    }
    image_mend(im);
}

/* Returns a running process, starting one if necessary. */
static enum err make_ready(struct decoder *d, const char *name, struct reason *why)
{
    struct reason cause;
    clockid_t its;
    struct timespec spent;

    if (d->child.pid != 0 && clock_getcpuclockid(d->child.pid, &its) == 0 && clock_gettime(its, &spent) == 0 &&
        spent.tv_sec > LIFE_S)
        child_end(&d->child);
    if (d->child.pid != 0)
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

/* Sends the request and waits for the answer. *idle: the process had ended before it had the request, or was killed
 * from outside: neither is the request's fault. Without an answer the process has ended, and *status is waitpid's. */
static enum child_receipt ask(struct decoder *d, const struct wire_request *q, struct wire_answer *a, int *status,
                              bool *idle)
{
    const bool sent = child_send(&d->child, q, sizeof(*q));
    const enum child_receipt receipt =
        sent ? child_receive(&d->child, a, sizeof(*a), clock_ms() + d->timeout_ms, d->stop) : CHILD_GONE;

    *status = receipt == CHILD_RECEIVED ? 0 : child_end(&d->child);
    *idle = receipt == CHILD_GONE && (!sent || (WIFSIGNALED(*status) && WTERMSIG(*status) == SIGKILL));
    return receipt;
}

/* A process that can take the request, which lies beside it. */
static enum err prepare(struct decoder *d, const struct wire_request *q, const uint8_t *bytes, struct reason *why)
{
    const bool begins = q->kind == WIRE_IMAGE || q->kind == WIRE_STREAM; /* else it goes on with what the process has */
    const enum err e = begins || video_is_open(d) ? make_ready(d, q->name, why) : ERR_OK;

    if (e)
        return e;
    if (!begins && !video_is_open(d)) /* perhaps only since make_ready has replaced the process */
        return err_say(why, ERR_FORMAT, "%s: the decoder was restarted", q->name);
    if (bytes && q->size > 0)
        memcpy(d->file.at, bytes, q->size);
    decoder_trim(&d->file, q->size);
    return ERR_OK;
}

enum err decoder_exchange(struct decoder *d, const struct wire_request *q, const uint8_t *bytes, struct wire_answer *a,
                          struct reason *why)
{
    char text[sizeof(a->why.text)];
    int status;
    bool idle;

    if (q->size > d->file_bytes)
        return err_say(why, ERR_RANGE, "%s: larger than %zu bytes", q->name, d->file_bytes);
    enum err e = prepare(d, q, bytes, why);
    if (e)
        return e;
    enum child_receipt receipt = ask(d, q, a, &status, &idle);
    if (idle && q->kind == WIRE_IMAGE) { /* once more, with a new process */
        atomic_fetch_add(&d->crashed, 1);
        e = prepare(d, q, bytes, why);
        if (e)
            return e;
        receipt = ask(d, q, a, &status, &idle);
    }
    if (receipt == CHILD_GARBLED || (receipt == CHILD_RECEIVED && (a->result < ERR_OK || a->result >= ERR_END)))
        return decoder_report_invalid(d, q->name, why);
    if (receipt != CHILD_RECEIVED)
        return report_crash(d, receipt, status, q->name, why);
    d->crashes_in_row = 0;
    if (a->result == ERR_OK)
        return ERR_OK;
    return err_say(why, (enum err)a->result, "%s",
                   decode_printable(a->why.text, sizeof(a->why.text), text, sizeof(text)));
}

enum err decoder_decode(void *context, const uint8_t *bytes, size_t size, const char *name, struct image *im,
                        struct reason *why)
{
    struct decoder *d = context;
    struct wire_request q = { .magic = WIRE_MAGIC, .max_side = im->max_side, .size = size };
    struct wire_answer a;

    atomic_fetch_add(&d->files, 1);
    snprintf(q.name, sizeof(q.name), "%s", name);
    snprintf(q.layer, sizeof(q.layer), "%s", im->layer ? im->layer : "");
    enum err e = decoder_exchange(d, &q, bytes, &a, why);
    if (e)
        return e;
    e = a.layout > LAYOUT_LAST ? ERR_RANGE : image_resize(im, a.width, a.height);
    if (e == ERR_RANGE)
        return decoder_report_invalid(d, name, why);
    if (e)
        return err_say(why, e, "%s: out of memory for %ux%u texels", name, a.width, a.height);
    decoder_take_texels(d, im);
    im->layout = (enum layout)a.layout;
    im->faults = (struct image_faults){ a.nan, a.infinite, a.negative, a.clipped };
    im->low_range = a.low_range == 1;
    im->taken_us = a.taken_us > 0 && a.taken_us < CALENDAR_MAX_US ? a.taken_us : 0;
    im->exposure_s = a.exposure_s >= 0.0 && a.exposure_s <= IMAGE_EXPOSURE_MAX_S ? a.exposure_s : 0.0; /* NaN: 0 */
    decode_printable(a.note, sizeof(a.note), im->note, sizeof(im->note));
    decoder_trim(&d->picture, 3 * sizeof(float) * (size_t)im->width * im->height);
    return ERR_OK;
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
    d->video = desc->video;
    d->memory_bytes = desc->memory_bytes ? desc->memory_bytes : desc->video ? VIDEO_MEMORY_BYTES : MEMORY_BYTES;
    d->timeout_ms = desc->timeout_ms ? desc->timeout_ms : PATIENCE_MS;
    d->stop = desc->stop;
    enum err e = child_find(desc->video ? VIDEO_PROGRAM : PROGRAM, desc->program, d->program, sizeof(d->program), why);
    if (!e)
        e = child_share(&d->file, "relight-file", PROGRAM, d->file_bytes, PROT_READ | PROT_WRITE, why);
    if (!e)
        e = child_share(&d->picture, "relight-picture", PROGRAM, IMAGE_BYTES, PROT_READ, why);
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
    child_end(&d->child);
    child_unshare(&d->file);
    child_unshare(&d->picture);
    mem_free(d);
}

bool decoder_is_confined(const struct decoder *d)
{
    return d->child.unconfined == 0;
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
