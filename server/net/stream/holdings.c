/* What clients make the server keep: images that are being sent although newer ones exist, and texts that wait. A
 * message under way can be neither finished nor withdrawn, so slow clients together could take any amount of memory,
 * each with another image. Above a limit for all of them, the client that holds most loses the connection that holds
 * most. Recorders are exempt: they must get every image, and hold one of a sequence each. */
#include "net/stream/internal.h"

#include "base/log.h"

#define HELD_BYTES ((size_t)128 << 20) /* of all clients together, */
#define HELD_IMAGES 4                  /* or as much as this many of the largest images */

/* Of one round over all connections. */
struct tally {
    uint64_t round;
    size_t all, largest; /* each image counts once in `all` */
};

static size_t image_size(const struct sent_image *p)
{
    size_t size;

    image_message(p, &size);
    return size;
}

/* The image that it keeps alive; NULL: none. {lock} */
static struct sent_image *image_of(const struct server *s, const struct connection *c)
{
    struct sent_image *p = c->websocket ? c->websocket->current : c->watcher ? c->watcher->current : NULL;

    return p && s->latest[image_kind(p)] != p ? p : NULL;
}

static bool counts(const struct connection *c)
{
    return (c->websocket && !c->websocket->cut && !c->websocket->recorder) || (c->watcher && !c->watcher->closing);
}

/* {lock} */
static size_t held_by(const struct server *s, const struct connection *c)
{
    const struct sent_image *p = image_of(s, c);

    return (p ? image_size(p) : 0) + (c->websocket ? c->websocket->outbox_bytes : 0);
}

/* {lock} */
static void count(const struct server *s, const struct connection *c, struct tally *t)
{
    struct sent_image *p = image_of(s, c);
    const size_t size = p ? image_size(p) : 0;

    t->all += (c->websocket ? c->websocket->outbox_bytes : 0) + (p && image_count(p, t->round) ? size : 0);
    t->largest = size > t->largest ? size : t->largest;
}

/* {lock} What a client holds. */
static size_t held_by_client(const struct server *s, const struct client *client)
{
    size_t sum = 0;

    for (const struct connection *c = s->limits.first; c; c = c->next)
        sum += c->client == client && counts(c) ? held_by(s, c) : 0;
    return sum;
}

/* {lock} Of the client that holds most, the connection that holds most; NULL: none holds anything. */
static struct connection *choose(const struct server *s)
{
    const struct client *client = NULL;
    struct connection *out = NULL;
    size_t most = 0;

    for (const struct connection *c = s->limits.first; c; c = c->next) {
        const size_t held = counts(c) && c->client != client ? held_by_client(s, c->client) : 0;
        if (held > most) {
            most = held;
            client = c->client;
        }
    }
    most = 0;
    for (struct connection *c = s->limits.first; c; c = c->next) {
        const size_t held = counts(c) && c->client == client ? held_by(s, c) : 0;
        if (held > most) {
            most = held;
            out = c;
        }
    }
    return out;
}

/* The connection to cut now; NULL: all is within the limit. */
static struct connection *next_to_cut(struct server *s)
{
    struct tally t = { .round = ++s->rounds };
    struct connection *out = NULL;

    pthread_mutex_lock(&s->lock);
    for (const struct connection *c = s->limits.first; c; c = c->next)
        if (counts(c))
            count(s, c, &t);
    if (t.all > HELD_BYTES && t.all > HELD_IMAGES * t.largest)
        out = choose(s);
    pthread_mutex_unlock(&s->lock);
    return out;
}

void holdings_limit(struct server *s)
{
    for (struct connection *c; (c = next_to_cut(s)) != NULL;) {
        limit_reached(&s->limits, LIMIT_MEMORY, c->client);
        if (c->websocket)
            c->websocket->cut = true;
        else
            c->watcher->closing = true;
        lws_set_timeout(c->wsi, PENDING_TIMEOUT_USER_REASON_BASE, LWS_TO_KILL_ASYNC);
    }
}
