#include "net/stream/ingest.h"

#include "base/log.h"
#include "net/stream/internal.h"

#include <string.h>

#define ABANDONED_US ((int64_t)600 * 1000000) /* an unfetched image older than this may be dropped */

/* {lock} A sequence may be forgotten when nobody is connected and no image waits, or it was abandoned long ago. */
static bool may_forget(const struct sequence *q, int64_t now_us)
{
    if (q->producer || q->recorder || q->stage == SEQUENCE_WAITING || q->stage == SEQUENCE_WORKING)
        return false;
    return q->stage == SEQUENCE_IDLE || now_us - q->touched_us > ABANDONED_US;
}

static unsigned names_of(const struct ingest *g, const uint8_t address[16])
{
    unsigned count = 0;

    for (int i = 0; i < INGEST_SEQUENCES; i++)
        count += g->sequences[i].name[0] && memcmp(g->sequences[i].owner, address, 16) == 0;
    return count;
}

/* {lock} Whether to forget a before b: first those without a kept image, then those of the address that has most, then
 * the oldest. */
static bool rather(const struct ingest *g, const struct sequence *a, const struct sequence *b)
{
    if (!b || (a->stage == SEQUENCE_IDLE) != (b->stage == SEQUENCE_IDLE))
        return !b || a->stage == SEQUENCE_IDLE;
    const unsigned of_a = names_of(g, a->owner), of_b = names_of(g, b->owner);
    return of_a != of_b ? of_a > of_b : a->touched_us < b->touched_us;
}

/* {lock} The one of that name, or a free one, or the one to forget; NULL: none. */
static struct sequence *choose(struct ingest *g, const char *name, int64_t now_us)
{
    struct sequence *oldest = NULL;

    for (int i = 0; i < INGEST_SEQUENCES; i++)
        if (strcmp(g->sequences[i].name, name) == 0)
            return &g->sequences[i];
    for (int i = 0; i < INGEST_SEQUENCES; i++)
        if (!g->sequences[i].name[0])
            return &g->sequences[i];
    for (int i = 0; i < INGEST_SEQUENCES; i++) {
        struct sequence *q = &g->sequences[i];
        if (may_forget(q, now_us) && rather(g, q, oldest))
            oldest = q;
    }
    return oldest;
}

/* Takes the name of a recorder that waits for a first frame, whose address has most names and at least two more than
 * `by`. */
static void take_back(struct server *s, const struct client *by)
{
    struct ingest *g = &s->ingest;
    unsigned most = names_of(g, by->address) + 1;
    struct websocket *out = NULL;

    for (int i = 0; i < INGEST_SEQUENCES; i++) {
        const struct sequence *q = &g->sequences[i];
        if (q->recorder && !q->producer && !q->has_accepted && names_of(g, q->owner) > most) {
            most = names_of(g, q->owner);
            out = q->recorder;
        }
    }
    limit_reached(&s->limits, LIMIT_NAMES, out ? out->connection->client : by);
    if (out)
        recorder_displace(out);
}

struct sequence *ingest_sequence(struct server *s, const char *name, const struct client *by, int64_t now_us)
{
    struct sent_image *lost = NULL;

    pthread_mutex_lock(&s->lock);
    struct sequence *q = choose(&s->ingest, name, now_us);
    if (!q) {
        pthread_mutex_unlock(&s->lock);
        take_back(s, by);
        pthread_mutex_lock(&s->lock);
        q = choose(&s->ingest, name, now_us);
    }
    if (q && strcmp(q->name, name) != 0) {
        lost = q->kept;
        if (lost)
            log_warning("sequence %s: dropped with the image of frame %llu, which no recorder fetched", q->name,
                        (unsigned long long)q->accepted);
        *q = (struct sequence){ .stage = SEQUENCE_IDLE };
        memcpy(q->name, name, strlen(name) + 1);
        memcpy(q->owner, by->address, sizeof(q->owner));
    }
    if (q)
        q->touched_us = now_us;
    pthread_mutex_unlock(&s->lock);
    image_unref(lost);
    return q;
}

bool ingest_record(struct server *s, struct sequence *q, enum protocol_format format)
{
    pthread_mutex_lock(&s->lock);
    /* A frame under way becomes an image of the format requested when it was accepted. */
    const bool may = q->stage == SEQUENCE_IDLE || q->format == format;
    if (may) {
        q->format = format;
        q->recording = true;
    }
    pthread_mutex_unlock(&s->lock);
    return may;
}

bool ingest_stored(struct server *s, struct sequence *q, uint64_t picture)
{
    struct sent_image *done = NULL;

    pthread_mutex_lock(&s->lock);
    if (q->stage == SEQUENCE_KEPT && image_header(q->kept)->sequence == picture) {
        done = q->kept;
        q->kept = NULL;
        q->stage = SEQUENCE_IDLE;
        q->has_stored = true;
        q->stored = q->accepted;
        q->stored_count++;
    }
    pthread_mutex_unlock(&s->lock);
    image_unref(done);
    return done != NULL;
}

void ingest_demand(const struct ingest *g, struct server_demand *out)
{
    const struct sequence *q = g->current;

    for (int i = 0; i < INGEST_SEQUENCES; i++)
        if (g->sequences[i].stage == SEQUENCE_WORKING)
            q = &g->sequences[i];
    out->producer = g->producer != 0;
    out->ended = g->ended;
    out->recorder = q && q->recording;
    out->recorder_format = q ? q->format : (enum protocol_format)0;
}

void ingest_end(struct server *s, struct sequence *sequence)
{
    pthread_mutex_lock(&s->lock);
    s->ingest.ended = true;
    if (sequence)
        sequence->ended = true;
    pthread_mutex_unlock(&s->lock);
}

bool ingest_is_over(struct server *s, const struct sequence *q, uint64_t *stored)
{
    pthread_mutex_lock(&s->lock);
    const bool over = q->ended && q->recording && q->stage == SEQUENCE_IDLE;
    *stored = q->stored_count;
    pthread_mutex_unlock(&s->lock);
    return over;
}

struct sent_image *ingest_kept(struct server *s, const struct sequence *q)
{
    pthread_mutex_lock(&s->lock);
    struct sent_image *p = q->stage == SEQUENCE_KEPT ? image_ref(q->kept) : NULL;
    pthread_mutex_unlock(&s->lock);
    return p;
}
