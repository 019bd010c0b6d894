#include "net/stream/ingest.h"

#include "base/clock.h"
#include "base/mem.h"
#include "net/stream/internal.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

void ingest_finish(struct ingest *g)
{
    block_finish(&g->live.payload);
    block_finish(&g->lockstep.payload);
    block_finish(&g->spare);
    for (int i = 0; i < INGEST_SEQUENCES; i++)
        image_unref(g->sequences[i].kept);
    pthread_cond_destroy(&g->arrived);
}

/* {lock} Keeps the larger of two spare blocks, unless it is far too large by now or no producer is connected. */
static void keep_spare(struct ingest *g, struct block *b)
{
    if (g->producer && b->capacity > g->spare.capacity && !recent_is_outgrown(&g->recent, b->capacity)) {
        const struct block old = g->spare;
        g->spare = *b;
        *b = old;
    }
    block_finish(b);
}

void ingest_spare(struct server *s, struct block *out)
{
    pthread_mutex_lock(&s->lock);
    *out = s->ingest.spare;
    s->ingest.spare = (struct block){ 0 };
    pthread_mutex_unlock(&s->lock);
}

void ingest_attach(struct server *s, uint64_t producer, struct sequence *sequence)
{
    struct ingest *g = &s->ingest;

    pthread_mutex_lock(&s->lock);
    g->producer = producer;
    g->current = sequence;
    g->returned = 0;
    pthread_mutex_unlock(&s->lock);
}

void ingest_detach(struct server *s, uint64_t producer)
{
    struct ingest *g = &s->ingest;

    pthread_mutex_lock(&s->lock);
    if (g->producer == producer) {
        g->producer = 0;
        g->current = NULL;
        block_finish(&g->spare);
    }
    pthread_mutex_unlock(&s->lock);
}

/* {lock} */
static struct note *note(struct ingest *g, uint64_t producer, struct sequence *sequence, uint64_t number,
                         enum server_fate fate)
{
    assert(g->note_count < INGEST_NOTES);
    struct note *n = &g->notes[g->note_count++];
    *n = (struct note){ .producer = producer, .sequence = sequence, .number = number, .fate = fate };
    n->fault.clause = "";
    return n;
}

unsigned ingest_notes(struct server *s, struct note out[INGEST_NOTES])
{
    struct ingest *g = &s->ingest;

    pthread_mutex_lock(&s->lock);
    const unsigned count = g->note_count;
    memcpy(out, g->notes, count * sizeof(out[0]));
    g->note_count = 0;
    pthread_mutex_unlock(&s->lock);
    return count;
}

/* {lock} image: 0: the frame was refused. */
static void remember(struct sequence *q, uint64_t number, uint64_t picture)
{
    const unsigned i = q->fate_count++ % INGEST_FATES;

    q->fates[i].number = number;
    q->fates[i].picture = picture;
}

/* {lock} A frame that is not above the last one received: its fate is decided already, or it comes too late. */
static void deliver_again(struct ingest *g, const struct pushed *p)
{
    const struct sequence *q = p->sequence;
    const unsigned count = q->fate_count < INGEST_FATES ? q->fate_count : INGEST_FATES;
    unsigned i = 0;

    g->repeated++;
    while (i < count && q->fates[i].number != p->header.frame)
        i++;
    const uint64_t picture = i < count ? q->fates[i].picture : 0;
    struct note *n = note(g, p->producer, p->sequence, p->header.frame, picture ? SERVER_USED : SERVER_REFUSED);
    n->picture = picture;
    if (i == count)
        fault_say(&n->fault, FAULT_BAD_FRAME, "5.8", "its number is not above %llu, and no fate of it is remembered",
                  (unsigned long long)q->accepted);
    else if (!picture)
        fault_say(&n->fault, FAULT_BAD_FRAME, "7.10", "it was refused before");
}

/* {lock} */
static void deliver_refused(struct ingest *g, const struct pushed *p, const struct fault *refusal)
{
    g->refused++;
    note(g, p->producer, p->sequence, p->header.frame, SERVER_REFUSED)->fault = *refusal;
    if (p->sequence) {
        p->sequence->has_accepted = true;
        p->sequence->accepted = p->header.frame;
        remember(p->sequence, p->header.frame, 0);
        p->sequence->ended = false;
    } else {
        g->returned++;
    }
    g->ended = false;
}

/* {lock} */
static void deliver_live(struct ingest *g, const struct pushed *p)
{
    if (g->live.full) {
        g->superseded++;
        note(g, g->live.producer, NULL, g->live.header.frame, SERVER_SUPERSEDED);
        if (g->live.producer == g->producer)
            g->returned++;
        keep_spare(g, &g->live.payload);
    }
    g->live = *p;
    g->ended = false;
}

/* {lock} */
static void deliver_lockstep(struct ingest *g, const struct pushed *p)
{
    struct sequence *q = p->sequence;

    assert(q->stage == SEQUENCE_IDLE && !g->lockstep.full); /* or no credit would have been given */
    q->stage = SEQUENCE_WAITING;
    q->has_accepted = true;
    q->accepted = p->header.frame;
    q->ended = false;
    g->lockstep = *p;
    g->ended = false;
}

void ingest_deliver(struct server *s, struct assembly *a, uint64_t producer, const char *peer,
                    struct sequence *sequence, const struct fault *refusal)
{
    struct ingest *g = &s->ingest;
    struct pushed p = {
        .full = true, .header = a->header, .payload = a->payload, .producer = producer, .sequence = sequence
    };

    snprintf(p.peer, sizeof(p.peer), "%s", peer);
    pthread_mutex_lock(&s->lock);
    g->received++;
    recent_add(&g->recent, p.header.payload);
    if (sequence && sequence->has_accepted && p.header.frame <= sequence->accepted) {
        deliver_again(g, &p);
    } else if (refusal) {
        deliver_refused(g, &p, refusal);
    } else {
        if (sequence)
            deliver_lockstep(g, &p);
        else
            deliver_live(g, &p);
        a->payload = (struct block){ 0 };
        pthread_cond_signal(&g->arrived);
    }
    pthread_mutex_unlock(&s->lock);
}

/* {lock} At most one lockstep frame is under way, of any producer, and no live frame meanwhile: it could overtake. */
static bool is_working(const struct ingest *g)
{
    for (int i = 0; i < INGEST_SEQUENCES; i++)
        if (g->sequences[i].stage == SEQUENCE_WORKING)
            return true;
    return false;
}

/* ---- Credit ---- */

bool ingest_may_grant(struct server *s, const struct sequence *sequence)
{
    const struct ingest *g = &s->ingest;

    pthread_mutex_lock(&s->lock);
    const bool may = sequence->stage == SEQUENCE_IDLE && sequence->format != 0 && !g->lockstep.full && !is_working(g);
    pthread_mutex_unlock(&s->lock);
    return may;
}

uint32_t ingest_returned(struct server *s)
{
    pthread_mutex_lock(&s->lock);
    const uint32_t n = s->ingest.returned;
    s->ingest.returned = 0;
    pthread_mutex_unlock(&s->lock);
    return n;
}

/* ---- Taking frames, and their fate: any thread ---- */

/* {lock} */
static struct ticket *open_ticket(struct ingest *g, const struct pushed *p)
{
    struct ticket *t = NULL;

    for (int i = 0; i < INGEST_TICKETS; i++) {
        struct ticket *c = &g->tickets[i];
        if (c->id && c->sequence) /* never forgotten; there is at most one, see ingest_may_grant */
            continue;
        if (!t || c->id < t->id)
            t = c;
    }
    *t = (struct ticket){ ++g->last_ticket, p->producer, p->header.frame, p->sequence };
    return t;
}

/* {lock} */
static struct ticket *find_ticket(struct ingest *g, const struct server_ticket *ticket)
{
    for (int i = 0; ticket->id && i < INGEST_TICKETS; i++)
        if (g->tickets[i].id == ticket->id)
            return &g->tickets[i];
    return NULL;
}

static void set_layout(struct frame *f, const struct protocol_environment *h)
{
    static const char *const names[] = { "",     "latlong", "cube",     "hcross",  "vcross",
                                         "ball", "fisheye", "cube-3x2", "cube-6x1" };
    const bool raw = f->kind == FRAME_TEXELS;
    const char *name = names[h->layout];

    if (h->layout == PROTOCOL_LAYOUT_AUTO && raw)
        name = "auto";
    if (!raw && h->flags & PROTOCOL_BOTTOM_FIRST)
        name = "latlong-bottom"; /* of files, only this layout may be bottom first */
    snprintf(f->layout, sizeof(f->layout), "%s", name);
}

/* Moves the payload into the frame, and the frame's old memory back. */
static enum err fill_frame(struct frame *f, struct pushed *p)
{
    const struct protocol_environment *h = &p->header;
    enum err e = ERR_OK;

    if (h->encoding == PROTOCOL_FILE_EXR || h->encoding == PROTOCOL_FILE_HDR) {
        const struct block old = { f->bytes, f->bytes_capacity };
        f->bytes = p->payload.bytes;
        f->bytes_capacity = p->payload.capacity;
        p->payload = old;
        f->kind = FRAME_FILE;
        f->size = h->payload;
    } else {
        e = texels_take(f, h, &p->payload);
    }
    f->number = h->frame;
    f->capture_us = h->capture_us;
    snprintf(f->name, sizeof(f->name), "frame %llu of producer %s", (unsigned long long)h->frame, p->peer);
    set_layout(f, h);
    return e;
}

/* {lock} Frees what the frame keeps from payloads of the other kind. */
static void drop_unused(const struct ingest *g, struct frame *f)
{
    if (f->kind == FRAME_FILE && recent_is_outgrown(&g->recent, f->rgb_capacity * sizeof(float))) {
        mem_free(f->rgb);
        f->rgb = NULL;
        f->rgb_capacity = 0;
    } else if (f->kind == FRAME_TEXELS && recent_is_outgrown(&g->recent, f->bytes_capacity)) {
        mem_free(f->bytes);
        f->bytes = NULL;
        f->bytes_capacity = 0;
    }
}

/* {lock} */
static struct pushed *to_take(struct ingest *g, bool live)
{
    if (is_working(g))
        return NULL;
    return g->lockstep.full ? &g->lockstep : live && g->live.full ? &g->live : NULL;
}

/* {lock} Waits for a frame and moves it into *out. */
static bool wait_frame(struct server *s, struct pushed *out, bool live, int timeout_ms)
{
    struct ingest *g = &s->ingest;
    const int64_t until_ms = clock_ms() + timeout_ms;
    struct pushed *from = to_take(g, live);

    while (!from && clock_wait(&g->arrived, &s->lock, until_ms))
        from = to_take(g, live);
    if (!from)
        return false;
    *out = *from;
    *from = (struct pushed){ 0 };
    return true;
}

bool server_take_frame(struct server *s, struct frame *f, struct server_ticket *ticket, bool live, int timeout_ms)
{
    struct ingest *g = &s->ingest;
    struct pushed p;

    *ticket = (struct server_ticket){ 0 };
    pthread_mutex_lock(&s->lock);
    if (!wait_frame(s, &p, live, timeout_ms)) {
        pthread_mutex_unlock(&s->lock);
        return false;
    }
    *ticket = (struct server_ticket){ open_ticket(g, &p)->id, p.sequence != NULL };
    if (p.sequence)
        p.sequence->stage = SEQUENCE_WORKING;
    else if (p.producer == g->producer)
        g->returned++; /* the next may come while this one is decoded */
    pthread_mutex_unlock(&s->lock);

    const enum err e = fill_frame(f, &p);
    pthread_mutex_lock(&s->lock);
    keep_spare(g, &p.payload);
    drop_unused(g, f);
    pthread_mutex_unlock(&s->lock);
    lws_cancel_service(s->context);
    if (e)
        server_frame_fate(s, ticket, SERVER_REFUSED, "there is no memory for its texels");
    return e == ERR_OK;
}

void server_frame_fate(struct server *s, const struct server_ticket *ticket, enum server_fate fate, const char *why)
{
    struct ingest *g = &s->ingest;

    pthread_mutex_lock(&s->lock);
    struct ticket *t = find_ticket(g, ticket);
    if (!t) {
        pthread_mutex_unlock(&s->lock);
        return;
    }
    if (t->sequence) {
        if (fate != SERVER_REFUSED) {
            fate = SERVER_REFUSED;
            why = "no image was made of it";
        }
        t->sequence->stage = SEQUENCE_IDLE;
        remember(t->sequence, t->number, 0);
        pthread_cond_signal(&g->arrived);
    }
    g->refused += fate == SERVER_REFUSED;
    g->superseded += fate == SERVER_SUPERSEDED;
    struct note *n = note(g, t->producer, t->sequence, t->number, fate);
    if (fate == SERVER_REFUSED)
        fault_say(&n->fault, FAULT_BAD_FRAME, "7.10", "%s", why ? why : "it could not be used");
    *t = (struct ticket){ 0 };
    pthread_mutex_unlock(&s->lock);
    lws_cancel_service(s->context);
}

void server_publish_for(struct server *s, struct sent_image *image, const struct server_ticket *ticket)
{
    struct ingest *g = &s->ingest;

    pthread_mutex_lock(&s->lock);
    struct sent_image *old = server_place(s, image, ticket->lockstep ? PROTOCOL_PICTURE_LOCKSTEP : 0);
    const struct protocol_picture *header = image_header(image);
    struct ticket *t = find_ticket(g, ticket);
    if (t && (!t->sequence || (unsigned)t->sequence->format == image_kind(image))) {
        note(g, t->producer, t->sequence, t->number, SERVER_USED)->picture = header->sequence;
        if (t->sequence) {
            remember(t->sequence, t->number, header->sequence);
            t->sequence->kept = image_ref(image);
            t->sequence->stage = SEQUENCE_KEPT;
            pthread_cond_signal(&g->arrived);
        }
        *t = (struct ticket){ 0 };
    }
    pthread_mutex_unlock(&s->lock);
    image_unref(old);
    lws_cancel_service(s->context);
}
