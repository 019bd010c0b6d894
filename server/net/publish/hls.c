/* HLS [RFC 8216] with CMAF segments of at least SEGMENT_US, cut at keyframes, in a folder that a web server serves:
 * live.m3u8, init-EPOCH.mp4 and live-EPOCH-N.m4s. EPOCH is the time when the sink was opened, so that names are never
 * reused. The playlist is never ended, even at exit: players thus continue after a restart. */
#include "base/clock.h"
#include "base/file_store.h"
#include "base/mem.h"
#include "base/text.h"
#include "net/publish/sink.h"

#include <dirent.h>
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define SEGMENT_US 1900000 /* keyframes come every two seconds, and more often when viewers come */
#define TARGET_S 4         /* bound on a segment that is stated to players; twice the usual length */
#define LISTED 6           /* segments */
#define KEEP_S 30          /* files that are not listed any more */
#define MODE 0644          /* a web server of another user reads them, whatever our umask is */

struct segment {
    uint64_t number; /* from 0 */
    int64_t length_us, wall_us;
};

struct hls {
    struct sink sink;
    const char *folder;
    int lock;
    struct sink_stream stream;

    int64_t epoch;     /* ms since 1970 */
    struct text bytes; /* of the segment */

    bool begun;
    int64_t begun_us, last_us, interval_us; /* of the segment; of the last unit, and its distance to the one before */
    int64_t wall_us;                        /* when the segment began */
    uint64_t count;                         /* segments so far */
    struct segment listed[LISTED];          /* segment n at n % LISTED */
};

static bool collect(void *user, const uint8_t *bytes, size_t size)
{
    struct hls *h = user;

    text_add_bytes(&h->bytes, (const char *)bytes, size);
    return !h->bytes.failed;
}

/* Writes a file that is there whole or not at all. */
static enum err store(const struct hls *h, const char *name, const struct text *bytes, struct reason *why)
{
    char path[PUBLISH_PATH + 128];
    struct file_draft d;

    snprintf(path, sizeof(path), "%s/%s", h->folder, name);
    const enum err e = bytes->failed ? err_say(why, ERR_NOMEM, "out of memory") : file_draft_begin(&d, path, why);
    if (e)
        return e;
    int failed = fchmod(d.fd, MODE) != 0 ? errno : 0;
    if (!failed)
        failed = sink_write_all(d.fd, (const uint8_t *)bytes->bytes, bytes->size);
    if (!failed)
        return file_draft_commit(&d, why);
    file_draft_discard(&d);
    return err_say(why, ERR_IO, "%s", strerror(failed));
}

/* ---- The list ---- */

static void append_segment(const struct hls *h, const struct segment *s, struct text *t)
{
    const time_t at = (time_t)(s->wall_us / 1000000);
    char date[32] = "1970-01-01T00:00:00";
    struct tm parts;

    if (gmtime_r(&at, &parts))
        strftime(date, sizeof(date), "%Y-%m-%dT%H:%M:%S", &parts);
    text_add(t, "#EXT-X-PROGRAM-DATE-TIME:%s.%03dZ\n#EXTINF:%.3f,\nlive-%" PRId64 "-%" PRIu64 ".m4s\n", date,
             (int)(s->wall_us / 1000 % 1000), 1e-6 * (double)s->length_us, h->epoch, s->number);
}

/* Sequence numbers begin at the epoch in seconds. A segment is longer than a second, so they always rise, also over
 * restarts; players would ignore smaller ones. */
static enum err store_playlist(const struct hls *h, struct reason *why)
{
    const uint64_t first = h->count > LISTED ? h->count - LISTED : 0;
    const int64_t base = h->epoch / 1000;
    struct text text = { .bytes = NULL };
    int longest_s = TARGET_S;

    for (uint64_t n = first; n < h->count; n++)
        longest_s = (int)fmax(longest_s, ceil(1e-6 * (double)h->listed[n % LISTED].length_us));
    text_add(&text,
             "#EXTM3U\n#EXT-X-VERSION:7\n#EXT-X-TARGETDURATION:%d\n#EXT-X-MEDIA-SEQUENCE:%" PRIu64
             "\n#EXT-X-DISCONTINUITY-SEQUENCE:%" PRId64 "\n#EXT-X-INDEPENDENT-SEGMENTS\n"
             "#EXT-X-MAP:URI=\"init-%" PRId64 ".mp4\"\n",
             longest_s, (uint64_t)base + first, base, h->epoch);
    for (uint64_t n = first; n < h->count; n++)
        append_segment(h, &h->listed[n % LISTED], &text);
    const enum err e = store(h, "live.m3u8", &text, why);
    text_finish(&text);
    return e;
}

/* ---- Old files ---- */

/* Whether a name is one of ours, and of the present list. */
static bool is_ours(const struct hls *h, const char *name, bool *listed)
{
    int64_t epoch = 0;
    uint64_t number = 0;
    int end = 0;

    *listed = false;
    if (sscanf(name, "init-%" SCNd64 ".mp4%n", &epoch, &end) == 1 && end > 0) {
        *listed = epoch == h->epoch;
    } else {
        end = 0;
        if (sscanf(name, "live-%" SCNd64 "-%" SCNu64 ".m4s%n", &epoch, &number, &end) != 2 || end == 0)
            return false;
        *listed = epoch == h->epoch && number + LISTED >= h->count;
    }
    return name[end] == '\0' || strcmp(name + end, ".part") == 0;
}

/* Segments that were listed are kept for a while, for players that loaded the list just before. */
static void remove_old(const struct hls *h)
{
    DIR *d = opendir(h->folder);
    const time_t now = time(NULL);
    const struct dirent *entry;
    struct stat st;
    bool listed;

    while (d && (entry = readdir(d)))
        if (is_ours(h, entry->d_name, &listed) && !listed && fstatat(h->lock, entry->d_name, &st, 0) == 0 &&
            now - st.st_mtime > KEEP_S)
            unlinkat(h->lock, entry->d_name, 0);
    if (d)
        closedir(d);
}

/* ---- Segments ---- */

static enum err store_segment(struct hls *h, int64_t end_us, struct reason *why)
{
    char name[64];

    snprintf(name, sizeof(name), "live-%" PRId64 "-%" PRIu64 ".m4s", h->epoch, h->count);
    enum err e = store(h, name, &h->bytes, why);
    if (e)
        return e;
    h->bytes.size = 0;
    h->listed[h->count % LISTED] = (struct segment){ h->count, end_us - h->begun_us, h->wall_us };
    h->count++;
    e = store_playlist(h, why);
    if (!e)
        remove_old(h);
    return e;
}

static void begin_segment(struct hls *h, int64_t time_us)
{
    h->begun = true;
    h->begun_us = time_us;
    h->wall_us = clock_wall_us() - ((int64_t)(1e6 * clock_seconds()) - time_us);
}

/* A keyframe makes the muxer pass on all that was before it. */
static enum err hls_write(struct sink *s, const struct sink_unit *unit, struct reason *why)
{
    struct hls *h = (struct hls *)s;
    enum err e = sink_stream_write(&h->stream, unit, why);

    if (h->bytes.failed)
        return err_say(why, ERR_NOMEM, "out of memory");
    if (!e && unit->key && h->begun && unit->time_us - h->begun_us >= SEGMENT_US) {
        e = store_segment(h, unit->time_us, why);
        begin_segment(h, unit->time_us);
    }
    if (!h->begun)
        begin_segment(h, unit->time_us);
    else
        h->interval_us = unit->time_us - h->last_us;
    h->last_us = unit->time_us;
    return e;
}

static void hls_close(struct sink *s)
{
    struct hls *h = (struct hls *)s;
    struct reason ignored;
    const enum err e = sink_stream_close(&h->stream, true, &ignored);

    if (!e && h->begun && h->bytes.size > 0)
        (void)!store_segment(h, h->last_us + h->interval_us, &ignored); /* nobody waits for it */
    if (h->lock >= 0)
        close(h->lock);
    text_finish(&h->bytes);
    mem_free(h);
}

/* A new epoch, and its file with the parameter sets. */
static enum err begin(struct hls *h, const struct sink_desc *desc, struct reason *why)
{
    const struct mux_desc to = {
        .format = "mp4",
        .options = "movflags=frag_keyframe+empty_moov+default_base_moof+cmaf+skip_trailer+write_colr",
        .write = collect,
        .user = h,
    };
    char name[64];
    struct stat st;

    h->epoch = clock_wall_us() / 1000;
    do
        snprintf(name, sizeof(name), "init-%" PRId64 ".mp4", ++h->epoch);
    while (fstatat(h->lock, name, &st, 0) == 0);
    enum err e = sink_stream_open(desc, &to, true, &h->stream, why);
    if (!e)
        e = store(h, name, &h->bytes, why);
    h->bytes.size = 0;
    return e;
}

enum err hls_open(const struct sink_desc *desc, struct sink **out, struct reason *why)
{
    static const struct sink_ops ops = { hls_write, hls_close };
    struct hls *h = mem_alloc(1, sizeof(*h));

    if (!h)
        return err_say(why, ERR_NOMEM, "out of memory");
    h->sink.ops = &ops;
    h->folder = desc->target->folder;
    enum err e = sink_folder_lock(h->folder, true, &h->lock, why);
    if (!e)
        e = begin(h, desc, why);
    if (e) {
        hls_close(&h->sink);
        return e;
    }
    *out = &h->sink;
    return ERR_OK;
}
