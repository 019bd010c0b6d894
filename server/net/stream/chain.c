#include "net/stream/internal.h"

/* H.264 images encode only changes since the image before. A viewer that misses one can continue only at a key
 * image, which is ten times as large. So the last few images are kept for viewers that are slightly behind, and
 * more of them may be under way at once, because the round trip of a long line exceeds two images. A viewer that is
 * far behind first waits until its line is clear, then starts at a keyframe. */

static struct sent_image *kept(const struct server *s, unsigned track, uint64_t sequence)
{
    struct sent_image *p = s->chain[track][sequence % STREAM_CHAIN];

    return p && image_header(p)->sequence == sequence ? p : NULL;
}

/* Whether an image placed at that time is too old to send, compared with the newest. The last two never are: those of
 * a slow stream are old when they are published. */
static bool too_late(const struct server *s, unsigned track, uint64_t sequence, int64_t placed_us)
{
    const uint64_t newest = s->issued[STREAM_TRACKS + track];
    const struct sent_image *last = kept(s, track, newest);

    return last && newest - sequence >= PROTOCOL_CREDIT && image_placed_us(last) - placed_us > STREAM_LAG_US;
}

void chain_place(struct server *s, struct sent_image *p)
{
    const struct protocol_picture *header = image_header(p);
    const unsigned track = image_track(p);
    struct sent_image **place = &s->chain[track][header->sequence % STREAM_CHAIN];

    image_unref(*place);
    *place = NULL;
    if (!(s->demand.h264 >> track & 1)) /* nobody watches; the next viewer starts at a keyframe */
        return;
    *place = image_ref(p);
    if (header->flags & PROTOCOL_PICTURE_KEY)
        s->keys_wanted &= ~(1u << track);
}

void chains_clear(struct server *s, uint32_t watched)
{
    for (unsigned track = 0; track < SERVER_TRACKS; track++)
        for (int i = 0; i < STREAM_CHAIN && !(watched >> track & 1); i++) {
            image_unref(s->chain[track][i]);
            s->chain[track][i] = NULL;
        }
    s->keys_wanted &= watched;
}

uint64_t chain_newest(struct server *s, unsigned track)
{
    pthread_mutex_lock(&s->lock);
    const uint64_t newest = s->issued[STREAM_TRACKS + track];
    pthread_mutex_unlock(&s->lock);
    return newest;
}

struct sent_image *chain_next(const struct server *s, const struct websocket *ws)
{
    const unsigned track = ws->kind - STREAM_TRACKS;
    const uint64_t newest = s->issued[ws->kind];
    struct sent_image *p = ws->chained ? kept(s, track, ws->begun + 1) : NULL;

    if (p && !too_late(s, track, ws->begun + 1, image_placed_us(p)))
        return p;
    for (uint64_t n = newest; n > ws->begun && newest - n < STREAM_CHAIN; n--) {
        p = kept(s, track, n);
        if (p && image_header(p)->flags & PROTOCOL_PICTURE_KEY)
            return p;
    }
    return NULL;
}

bool chain_may_begin(const struct server *s, const struct websocket *ws, const struct sent_image *p)
{
    if (ws->unacked_count < PROTOCOL_CREDIT)
        return true;
    return ws->chained && image_header(p)->sequence == ws->begun + 1 && ws->unacked_count < PROTOCOL_CREDIT_H264 &&
           !too_late(s, ws->kind - STREAM_TRACKS, ws->unacked[0].sequence, ws->unacked[0].placed_us);
}

void chain_ask(struct server *s, const struct websocket *ws)
{
    const bool up_to_date = ws->chained && ws->begun == s->issued[ws->kind];

    if (!up_to_date && ws->unacked_count < PROTOCOL_CREDIT)
        s->keys_wanted |= 1u << (ws->kind - STREAM_TRACKS);
}
