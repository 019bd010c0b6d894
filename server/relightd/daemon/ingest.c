#include "relightd/daemon/ingest.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"

#include <omp.h>
#include <time.h>

void ingest_sleep_ms(int64_t ms)
{
    nanosleep(&(struct timespec){ .tv_nsec = (long)ms * 1000000 }, NULL);
}

bool ingest_is_watched(const struct ingest_thread *t)
{
    struct server_demand demand;

    shared_demand(t->shared, &demand);
    return demand.viewers > 0 || demand.recorder;
}

/* ---- Decoding ---- */

static enum err start_decoder(struct ingest_thread *t, struct reason *why)
{
    const struct daemon_config *c = &t->shared->config;
    struct decoder_desc desc = c->decoder_desc;

    if (c->no_sandbox) {
        log_warning("--no-sandbox: files from producers are decoded in this process; a malicious file can crash the "
                    "server or take it over");
        return ERR_OK;
    }
    desc.stop = t->shared->stop;
    const enum err e = decoder_create(&desc, &t->decoder, why);
    if (!e && !decoder_is_confined(t->decoder))
        log_warning("this kernel has no seccomp: the process that decodes producers' files has limited memory and "
                    "files, but unlimited system calls");
    return e;
}

static void report_decoder_stats(struct ingest_thread *t)
{
    struct decoder_counts c;

    if (!t->decoder)
        return;
    decoder_counts(t->decoder, &c);
    status_decoder(&t->shared->status, &c, decoder_is_confined(t->decoder));
}

/* Notes where in the source the frame is. */
static void note_position(const struct ingest_thread *t, struct ingested *in)
{
    in->position = t->source ? source_position(t->source) : 0;
    in->has_sky = t->source && source_sky(t->source);
    if (in->has_sky)
        in->sky = *source_sky(t->source);
    in->has_place = t->source && source_place(t->source, &in->place);
}

/* Of a map that says nothing of its sun. At most once a second: it takes a pass over the map. */
static void note_sun(struct ingest_thread *t, struct ingested *in)
{
    if (in->has_sky || in->has_place)
        return;
    if (t->sun_ms == 0 || clock_ms() - t->sun_ms >= 1000) {
        t->has_sun = sky_find_sun(in->environment, &t->sun);
        t->sun_ms = clock_ms();
    }
    in->has_sun = t->has_sun;
    in->sun = t->sun;
}

/* Frees the memory of idle slots that once held a far larger frame than recent ones. */
static void shrink_idle_slots(struct frame_slots *frames, int slot)
{
    const struct recent *recent = &frames->slot[slot].environment->image.recent;

    for (int i = 0; i < frames->count; i++) {
        struct environment *e = frames->slot[i].environment;
        if (i != slot && handoff_is_idle(&frames->handoff, i) &&
            recent_is_outgrown(recent, e->image.capacity * sizeof(*e->image.rgb)))
            environment_release_memory(e);
    }
}

/* Decodes f and builds its tables with the current settings; for a lockstep frame, with the initial settings. */
static enum err decode(struct ingest_thread *t, struct environment *out, const struct frame *f, bool lockstep,
                       struct reason *why)
{
    struct shared *shared = t->shared;
    const struct daemon_config *c = &shared->config;
    const struct settings now = lockstep ? c->setup.initial : settings_now(&shared->settings);
    const struct image_decoder decoder = { decoder_decode, t->decoder };

    atomic_store(&shared->reading, true);
    atomic_store(shared->new_work, true); /* refinement gives its processors to the new frame */
    environment_configure(out, &(struct environment_desc){ .layout = c->setup.environment.layout,
                                                           .layer = c->setup.environment.layer,
                                                           .sun_azimuth = c->setup.environment.sun_azimuth,
                                                           .decoder = t->decoder ? &decoder : NULL,
                                                           .rotation_degrees = now.rotation_degrees,
                                                           .scale_stops = now.scale_stops,
                                                           .max_side = c->max_side,
                                                           .lean = now.method == METHOD_CACHED });
    const enum err e = environment_update(out, f, why);
    out->decoder = NULL; /* it lives on this stack */
    atomic_store(&shared->reading, false);
    report_decoder_stats(t);
    return e;
}

enum err ingest_frame(struct ingest_thread *t, const struct frame *f, const struct server_ticket *ticket,
                      struct reason *why)
{
    struct shared *shared = t->shared;
    struct frame_slots *frames = &shared->frames;
    const int slot = handoff_begin(&frames->handoff);
    struct ingested *in = &frames->slot[slot];
    const double start = clock_seconds();
    const enum err e = decode(t, in->environment, f, ticket->lockstep, why);

    if (e)
        return e;
    environment_report(in->environment, &t->said);
    in->ticket = *ticket;
    in->decode_ms = 1e3 * (clock_seconds() - start);
    note_position(t, in);
    note_sun(t, in);
    shrink_idle_slots(frames, slot);
    in->ready_ms = clock_ms();
    const struct image_faults faults = in->environment->image.faults; /* once published, the slot is the reader's */
    const int dropped = handoff_publish(&frames->handoff, slot);
    atomic_store(shared->new_work, true);
    if (dropped != HANDOFF_NONE)
        server_frame_fate(shared->server, &frames->slot[dropped].ticket, SERVER_SUPERSEDED, NULL);
    status_frame_received(&shared->status, &faults, dropped != HANDOFF_NONE);
    return ERR_OK;
}

void ingest_relight(struct ingest_thread *t, const struct frame *f, uint64_t version, uint64_t *seen,
                    struct reason *why)
{
    static const struct server_ticket none = { 0 };

    if (version != *seen && f->kind != FRAME_NONE && ingest_frame(t, f, &none, why))
        status_frame_unreadable(&t->shared->status, why->text, true);
    *seen = version;
}

/* ---- The thread ---- */

#define PREPARED_POLL_MS 2 /* until the first frame is noticed */

void ingest_wait_prepared(struct ingest_thread *t)
{
    while (!atomic_load(&t->prepared) && !shared_is_stopping(t->shared))
        ingest_sleep_ms(PREPARED_POLL_MS);
}

void ingest_thread_go_on(struct ingest_thread *t)
{
    atomic_store(&t->prepared, true);
}

static void *run(void *arg)
{
    struct ingest_thread *t = arg;
    struct reason why = { "" };

    omp_set_num_threads(1); /* the other processors are shading */
    if (t->source)
        ingest_from_source(t, &why);
    else
        ingest_from_producers(t, &why);
    return NULL;
}

enum err ingest_thread_create(struct shared *shared, struct ingest_thread **out, struct reason *why)
{
    struct ingest_thread *t = mem_alloc(1, sizeof(*t));

    *out = NULL;
    if (!t)
        return err_say(why, ERR_NOMEM, "out of memory");
    t->shared = shared;
    struct source_desc source = shared->config.setup.source_desc;
    source.wait = true;
    enum err e = shared->config.push ? start_decoder(t, why) : source_open(&source, &t->source, why);
    const bool comes = !t->source || source_kind(t->source) == SOURCE_WATCH || source_kind(t->source) == SOURCE_LIVE;
    if (!e && comes && glide_create(&shared->config, &t->glide))
        e = err_say(why, ERR_NOMEM, "out of memory");
    if (e) {
        decoder_destroy(t->decoder);
        source_close(t->source);
        mem_free(t);
        return e;
    }
    if (t->source) {
        shared->settings.source_kind = source_kind(t->source);
        shared->settings.source_length = source_count(t->source);
    }
    *out = t;
    return ERR_OK;
}

enum err ingest_thread_start(struct ingest_thread *t, struct reason *why)
{
    t->running = pthread_create(&t->thread, NULL, run, t) == 0;
    return t->running ? ERR_OK : err_say(why, ERR_NOMEM, "a thread could not be started");
}

void ingest_thread_destroy(struct ingest_thread *t)
{
    if (!t)
        return;
    if (t->running)
        pthread_join(t->thread, NULL);
    decoder_destroy(t->decoder);
    source_close(t->source);
    glide_destroy(t->glide);
    mem_free(t);
}
