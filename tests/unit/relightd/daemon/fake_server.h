/* A server without sockets: it notes what the daemon reports and gives it what a test has prepared. Its functions stand
 * in for those of net/stream/server.h at link time, so one test program includes this once. */
#pragma once

#include "support/unit.h"

#include "base/log.h"
#include "relightd/daemon/encode.h"
#include "relightd/daemon/ingest.h"
#include "relightd/daemon/shade.h"
#include "relightd/daemon/shared.h"

#include <pthread.h>
#include <time.h>

static struct {
    pthread_mutex_t lock;
    struct server_demand demand; /* given to the daemon */
    struct server_control ask;   /* likewise, once, where has_ask */
    bool has_ask;
    struct server_inspection inspection; /* likewise, where has_inspection */
    bool has_inspection;

    struct server_figures figures; /* reported by the daemon, as what follows */
    struct settings control;
    unsigned controls;
    char refusal[sizeof(struct reason)];
    unsigned fates[SERVER_REFUSED + 1];
    struct protocol_picture published; /* the last */
    unsigned images;
    struct protocol_picture rendition; /* likewise */
    unsigned renditions;
    unsigned answers; /* to probes, */
    bool answered;    /* the last with a result */
} fake = { .lock = PTHREAD_MUTEX_INITIALIZER };

void server_demand(struct server *s, struct server_demand *out)
{
    (void)s;
    pthread_mutex_lock(&fake.lock);
    *out = fake.demand;
    pthread_mutex_unlock(&fake.lock);
}

bool server_take_control(struct server *s, struct server_control *out)
{
    const bool any = fake.has_ask;

    (void)s;
    *out = fake.ask;
    fake.has_ask = false;
    return any;
}

bool server_control_waits(struct server *s)
{
    (void)s;
    return fake.has_ask;
}

void server_set_control(struct server *s, const void *values, const struct server_control *answered, const char *error)
{
    (void)s;
    (void)answered;
    memcpy(&fake.control, values, sizeof(fake.control));
    fake.controls++;
    snprintf(fake.refusal, sizeof(fake.refusal), "%s", error ? error : "");
}

void server_set_figures(struct server *s, const struct server_figures *figures)
{
    (void)s;
    pthread_mutex_lock(&fake.lock);
    fake.figures = *figures;
    pthread_mutex_unlock(&fake.lock);
}

static struct server_figures fake_figures(void)
{
    pthread_mutex_lock(&fake.lock);
    const struct server_figures f = fake.figures;
    pthread_mutex_unlock(&fake.lock);
    return f;
}

void server_frame_fate(struct server *s, const struct server_ticket *ticket, enum server_fate fate, const char *why)
{
    (void)s;
    (void)ticket;
    (void)why;
    fake.fates[fate]++;
}

void server_publish_for(struct server *s, struct sent_image *image, const struct server_ticket *ticket)
{
    (void)s;
    (void)ticket;
    fake.published = *image_header(image);
    fake.images++;
    image_unref(image);
}

void server_begin_image(struct server *s)
{
    (void)s;
}

void server_publish(struct server *s, struct sent_image *image)
{
    (void)s;
    fake.rendition = *image_header(image);
    fake.renditions++;
    image_unref(image);
}

bool server_take_frame(struct server *s, struct frame *f, struct server_ticket *ticket, bool live, int timeout_ms)
{
    (void)s;
    (void)f;
    (void)ticket;
    (void)live;
    nanosleep(&(struct timespec){ .tv_nsec = timeout_ms * 1000000L }, NULL);
    return false;
}

bool server_take_inspection(struct server *s, struct server_inspection *out)
{
    const bool any = fake.has_inspection;

    (void)s;
    *out = fake.inspection;
    fake.has_inspection = false;
    return any;
}

void server_answer_inspection(struct server *s, const struct server_inspection *asked, const char *text,
                              const char *error)
{
    (void)s;
    (void)asked;
    (void)error;
    fake.answers++;
    fake.answered = text != NULL;
}

uint32_t server_followed(struct server *s, struct server_follow out[SERVER_FOLLOWED_MAX])
{
    (void)s;
    (void)out;
    return 0;
}

void server_send_radiance(struct server *s, const struct server_follow *f, const struct server_radiance *r)
{
    (void)s;
    (void)f;
    (void)r;
}

void server_beat(struct server *s)
{
    (void)s;
}

void server_health(struct server *s, struct server_health *out)
{
    (void)s;
    *out = (struct server_health){ .alive = true, .ready = true, .reason = "ok" };
}

void server_observe(struct server *s, enum server_timing timing, double seconds)
{
    (void)s;
    (void)timing;
    (void)seconds;
}

enum err server_check(const struct server_desc *desc, struct reason *why)
{
    (void)desc;
    (void)why;
    return ERR_OK;
}

enum err server_change(struct server *s, const struct server_desc *desc, struct reason *why)
{
    (void)s;
    return server_check(desc, why);
}

double server_track_rate(unsigned track)
{
    (void)track;
    return 0.0;
}

/* ---- A daemon with it ---- */

#define WIDTH 64
#define HEIGHT 36
#define ARGUMENTS_MAX 16

struct rig {
    struct shared shared;
    atomic_bool stop, new_work, reload;
    struct shade_thread *shade;
    float *light; /* texels of the frames that are handed in */
};

/* What the command line says: 64 x 36 pixels of the built-in scene, 100 images a second, and the test's own flags,
 * ended by NULL. */
static void rig_begin(struct rig *r, const char *const *flags)
{
    char *argv[ARGUMENTS_MAX + 5] = { "relightd", "--size", "64x36", "--fps", "100" };
    int argc = 5;
    struct reason why;
    bool done = false;

    *r = (struct rig){ 0 };
    for (; *flags; flags++) {
        assert_true(argc < ARGUMENTS_MAX + 5);
        argv[argc++] = (char *)(uintptr_t)*flags;
    }
    r->shared.stop = &r->stop;
    r->shared.new_work = &r->new_work;
    r->shared.reload = &r->reload;
    assert_int_equal(daemon_config_read(&r->shared.config, &r->shared.readings, argc, argv, &done, &why), ERR_OK);
    r->shared.config.setup.set_desc.progress = false;
    assert_int_equal(shared_init(&r->shared, &why), ERR_OK);
    status_begin(&r->shared.status, &r->shared);
    fake.demand = (struct server_demand){ .viewers = 1 };
}

static void rig_load(struct rig *r)
{
    struct shared *s = &r->shared;
    struct reason why;

    assert_int_equal(shade_thread_create(s, &r->shade, &why), ERR_OK);
    s->settings.scene = r->shade->set->scene;
    settings_set_camera(&s->settings, r->shade->set->camera);
    status_set_cameras(&s->status, &s->settings, r->shade->set->camera);
}

static void rig_end(struct rig *r)
{
    atomic_store(&r->stop, true);
    shared_close(&r->shared);
    shade_thread_destroy(r->shade);
    shared_finish(&r->shared);
    config_readings_finish(&r->shared.readings);
    free(r->light);
}

/* A sky of even light, as the ingest thread would hand it on. */
static void rig_hand_in(struct rig *r, uint64_t number, bool lockstep)
{
    static const struct image_faults none;
    struct frame_slots *frames = &r->shared.frames;
    const int slot = handoff_begin(&frames->handoff);
    struct ingested *in = &frames->slot[slot];
    struct frame f = { .kind = FRAME_NONE };
    struct reason why;

    assert_int_equal(frame_reserve_texels(&f, 32, 16), ERR_OK);
    for (size_t i = 0; i < (size_t)3 * 32 * 16; i++)
        f.rgb[i] = 1.0f + (float)(i % 7);
    f.number = number;
    assert_int_equal(environment_update(in->environment, &f, &why), ERR_OK);
    frame_finish(&f);
    in->ticket = (struct server_ticket){ .id = lockstep ? number + 1 : 0, .lockstep = lockstep };
    status_frame_received(&r->shared.status, &none, handoff_publish(&frames->handoff, slot) != HANDOFF_NONE);
}

static void rig_turn(struct rig *r)
{
    struct reason why = { "" };

    if (shade_thread_turn(r->shade, &why))
        fail_msg("%s", why.text);
}

/* Turns until an image waits, at most so often; NULL: none came. It is the test's until rig_release. */
static struct shaded *rig_image(struct rig *r, int turns)
{
    struct image_slots *images = &r->shared.images;

    for (int i = 0; i < turns; i++) {
        rig_turn(r);
        const int slot = handoff_wait_newer(&images->handoff, 0) ? handoff_take(&images->handoff, 0) : HANDOFF_NONE;
        if (slot != HANDOFF_NONE)
            return &images->slot[slot];
    }
    return NULL;
}

static void rig_release(struct rig *r, struct shaded *image)
{
    handoff_release(&r->shared.images.handoff, (int)(image - r->shared.images.slot));
}
