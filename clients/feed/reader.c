#include "clients/feed/reader.h"

#include "base/log.h"
#include "base/mem.h"

#include <assert.h>
#include <pthread.h>

struct reader {
    struct reader_desc desc;
    struct source *source; /* belongs to the reader's thread while it runs */
    uint64_t total;
    pthread_t thread;
    bool running;
    bool noticed;  /* reader's thread: the log has mentioned decoding, */
    unsigned said; /* and these kinds of image_report */

    pthread_mutex_t lock;
    pthread_cond_t changed;
    struct parcel slots[READER_SLOTS]; /* slots `held` from `first` on belong to the consumer, the others to the
                                          reader's thread */
    size_t first, held;                /* {lock} */
    uint64_t run;                      /* {lock} incremented by reader_begin; invalidates what was read before */
    bool has_after, ended, stop;       /* {lock} */
    uint64_t after;                    /* {lock} */
    struct reader_counts counts;       /* {lock} */
};

enum err reader_create(const struct reader_desc *d, struct reader **out, struct reason *why)
{
    struct reader *r = mem_alloc(1, sizeof(*r));

    *out = NULL;
    if (!r)
        return err_say(why, ERR_NOMEM, "out of memory to read %s", d->source.spec);
    r->desc = *d;
    const enum err e = source_open(&d->source, &r->source, why);
    if (e) {
        mem_free(r);
        return e;
    }
    r->total = d->source.loop ? 0 : source_count(r->source);
    pthread_mutex_init(&r->lock, NULL);
    pthread_cond_init(&r->changed, NULL);
    *out = r;
    return ERR_OK;
}

/* ---- The reader's thread ---- */

/* {lock} Files the result of reading a frame. */
static void keep(struct reader *r, uint64_t run, enum err e, const struct frame *f)
{
    if (r->run != run)
        return;
    if (e == ERR_END)
        r->ended = true;
    else if (e)
        r->counts.faulty++;
    else if (f->kind == FRAME_NONE)
        return;
    else if (r->has_after && f->number <= r->after)
        r->counts.passed++;
    else
        r->held++;
}

static bool is_wanted(struct reader *r, const struct frame *f)
{
    pthread_mutex_lock(&r->lock);
    const bool wanted = !r->has_after || f->number > r->after;
    pthread_mutex_unlock(&r->lock);
    return wanted;
}

static enum err read_one(struct reader *r, struct parcel *p)
{
    struct reason why = { "" };
    enum err e = source_next(r->source, &p->frame, &why);

    const bool wanted = !e && p->frame.kind != FRAME_NONE && is_wanted(r, &p->frame);
    if (wanted)
        e = parcel_pack(p, &r->desc.parcel, &why);
    if (e && e != ERR_END)
        log_error("%s", why.text[0] ? why.text : err_text(e));
    if (!e && wanted && p->barred.text[0] && !r->noticed) {
        log_info("%s; such files are decoded here and sent as texels", p->barred.text);
        r->noticed = true;
    }
    if (!e && wanted && p->decoded)
        image_report(&p->image, p->frame.name, &r->said);
    return e;
}

static enum err open_again(struct reader *r)
{
    struct reason why = { "" };

    source_close(r->source);
    const enum err e = source_open(&r->desc.source, &r->source, &why);
    if (e)
        log_error("%s", why.text);
    return e;
}

static void *reader_main(void *arg)
{
    struct reader *r = arg;
    uint64_t opened = 1;

    pthread_mutex_lock(&r->lock);
    while (!r->stop) {
        if (r->ended || r->held == READER_SLOTS) {
            pthread_cond_wait(&r->changed, &r->lock);
            continue;
        }
        const uint64_t run = r->run;
        struct parcel *p = &r->slots[(r->first + r->held) % READER_SLOTS];
        pthread_mutex_unlock(&r->lock);
        const bool shut = run != opened && open_again(r) != ERR_OK;
        opened = run;
        const enum err e = shut ? ERR_END : read_one(r, p);
        pthread_mutex_lock(&r->lock);
        r->counts.faulty += shut;
        keep(r, run, e, &p->frame);
        const bool news = r->held > 0 || r->ended;
        pthread_mutex_unlock(&r->lock);
        if (news)
            r->desc.wake(r->desc.user);
        pthread_mutex_lock(&r->lock);
    }
    pthread_mutex_unlock(&r->lock);
    return NULL;
}

/* ---- The consumer ---- */

enum err reader_begin(struct reader *r, bool has_after, uint64_t after, struct reason *why)
{
    pthread_mutex_lock(&r->lock);
    r->run++;
    r->has_after = has_after;
    r->after = after;
    r->held = 0;
    r->ended = false;
    pthread_cond_signal(&r->changed);
    pthread_mutex_unlock(&r->lock);
    if (!r->running && pthread_create(&r->thread, NULL, reader_main, r) != 0)
        return err_say(why, ERR_NOMEM, "cannot start a thread");
    r->running = true;
    return ERR_OK;
}

struct parcel *reader_take(struct reader *r)
{
    pthread_mutex_lock(&r->lock);
    struct parcel *p = r->held > 0 ? &r->slots[r->first] : NULL;
    pthread_mutex_unlock(&r->lock);
    return p;
}

void reader_drop(struct reader *r)
{
    pthread_mutex_lock(&r->lock);
    assert(r->held > 0);
    r->first = (r->first + 1) % READER_SLOTS;
    r->held--;
    pthread_cond_signal(&r->changed);
    pthread_mutex_unlock(&r->lock);
}

bool reader_is_done(struct reader *r)
{
    pthread_mutex_lock(&r->lock);
    const bool done = r->ended && r->held == 0;
    pthread_mutex_unlock(&r->lock);
    return done;
}

uint64_t reader_total(const struct reader *r)
{
    return r->total;
}

void reader_counts(struct reader *r, struct reader_counts *out)
{
    pthread_mutex_lock(&r->lock);
    *out = r->counts;
    pthread_mutex_unlock(&r->lock);
}

void reader_destroy(struct reader *r)
{
    if (!r)
        return;
    pthread_mutex_lock(&r->lock);
    r->stop = true;
    pthread_cond_signal(&r->changed);
    pthread_mutex_unlock(&r->lock);
    if (r->running)
        pthread_join(r->thread, NULL);
    for (int i = 0; i < READER_SLOTS; i++)
        parcel_finish(&r->slots[i]);
    source_close(r->source);
    pthread_cond_destroy(&r->changed);
    pthread_mutex_destroy(&r->lock);
    mem_free(r);
}
