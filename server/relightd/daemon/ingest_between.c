/* Images between the skies of a producer, a watched folder or a live stream. They come when the sender has them, so
 * what is shown is one interval behind: when a sky arrives, images glide to it in the time after which the next is
 * expected. With --between-delay 0 the newest sky is shown at once, and its sun moves on until the next. */
#include "relightd/daemon/ingest.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"

#include <math.h>
#include <string.h>

/* SLOW: skies at least so far apart (s) are worth images between them, and so many images' time. LONGEST: after a
 * longer pause (s) the next sky is shown at once. BEFORE: skies that must have come slowly first, so that the interval
 * is known. AGAIN: seconds until it is asked again whether an image is wanted. */
#define SLOW 0.5
#define SLOW_IMAGES 2.0
#define LONGEST 300.0
#define BEFORE 3
#define INTERVALS 3
#define AGAIN 4e-3

struct glide {
    struct between *between;
    struct frame shown;          /* the last image's sky */
    double intervals[INTERVALS]; /* s, between the arrivals of the last skies */
    uint32_t count;              /* skies that came slowly, one after another; with this one */
    double arrived_s;            /* clock_seconds of the last sky; 0: none yet */
    int64_t capture_us;          /* of the last sky */
    double moment;               /* what is shown, in the window's seconds, */
    double from, to;             /* on the way from here to there */
    double begun_s, lasts_s;     /* by the clock: from when on, for how long */
    double due_s;                /* the next image */
    bool active;
    bool ended;      /* the next sky follows nothing */
    bool said_times; /* that capture times do not go on */
};

enum err glide_create(const struct daemon_config *c, struct glide **out)
{
    struct between_desc desc = c->setup.source_desc.between;
    struct glide *g = NULL;

    *out = NULL;
    desc.max_side = c->max_side;
    if (desc.mode == BETWEEN_OFF && !between_corrects(&desc))
        return ERR_OK;
    g = mem_alloc(1, sizeof(*g));
    if (!g || between_create(&desc, &g->between)) {
        mem_free(g);
        return ERR_NOMEM;
    }
    *out = g;
    return ERR_OK;
}

void glide_destroy(struct glide *g)
{
    if (!g)
        return;
    between_destroy(g->between);
    frame_finish(&g->shown);
    mem_free(g);
}

void glide_forget(struct ingest_thread *t)
{
    struct glide *g = t->glide;

    if (!g || (g->count == 0 && between_count(g->between) == 0))
        return;
    between_forget(g->between);
    g->count = 0;
    g->active = g->ended = false;
    g->arrived_s = 0.0;
    g->capture_us = 0;
    status_between(&t->shared->status, "", 0.0);
}

void glide_end(struct ingest_thread *t)
{
    if (t->glide)
        t->glide->ended = true;
}

/* The middle one of the last intervals: one late sky does not change the pace. */
static double usual_interval(const struct glide *g)
{
    const double a = g->intervals[0], b = g->intervals[1], c = g->intervals[2];

    return fmax(fmin(a, b), fmin(fmax(a, b), c));
}

/* Skies at least so far apart (s) are slow. */
static double slow_s(double fps)
{
    return fmax(SLOW, SLOW_IMAGES / fps);
}

/* Notes that a sky arrived. Returns whether skies come so slowly that images belong between them. */
static bool is_slow(struct glide *g, double fps)
{
    const double now = clock_seconds(), interval = now - g->arrived_s;
    const bool slow = g->arrived_s > 0.0 && interval >= slow_s(fps) && interval <= LONGEST;

    memmove(g->intervals + 1, g->intervals, (INTERVALS - 1) * sizeof(*g->intervals));
    g->intervals[0] = interval;
    g->count = g->arrived_s > 0.0 && !slow ? 1 : g->count + 1;
    g->arrived_s = now;
    return g->count >= BEFORE;
}

/* When the sky was taken, on the window's clock: by its capture time if that goes on, else when it came. */
static double seconds_of(struct glide *g, const struct frame *f)
{
    const uint32_t count = between_count(g->between);
    const double last = count > 0 ? between_seconds(g->between, count - 1) : 0.0;
    const double later = 1e-6 * (double)(f->capture_us - g->capture_us);

    if (count == 0)
        return 0.0;
    const bool known = f->capture_us != 0 && g->capture_us != 0;
    if (known && later > 0.0 && later < 10.0 * LONGEST)
        return last + later;
    if (known && !g->said_times)
        log_warning("%s: its capture time is %.3g s after the last sky's: such skies are spaced by their arrival",
                    f->name, later);
    g->said_times |= known;
    return last + g->intervals[0];
}

static double delay_of(const struct ingest_thread *t)
{
    const double asked = t->shared->config.between_delay;

    /* The window has no more skies to be between. */
    return asked >= 0.0 ? fmin(asked, (SUN_MARKS - 2) * usual_interval(t->glide)) : usual_interval(t->glide);
}

/* Images begin to glide, or stop doing so. */
static void set_active(struct ingest_thread *t, bool active, double fps)
{
    struct glide *g = t->glide;
    const bool moves = t->shared->config.setup.source_desc.between.mode == BETWEEN_MOTION;

    if (active && !g->active)
        log_info(
            "skies come every %.3g s: images between them %s, %.3g s behind (--between off shows each as it comes)",
            usual_interval(g), moves ? "move" : "fade", delay_of(t));
    else if (!active && g->active)
        log_info("skies come more often than every %.2g s, or after a long pause: each is shown as it comes",
                 slow_s(fps));
    g->active = active;
}

static void tell_state(struct ingest_thread *t)
{
    char text[sizeof(((struct server_figures *)0)->between)];
    const struct glide *g = t->glide;
    const bool told = between_count(g->between) > 1 || between_corrects(&t->shared->config.setup.source_desc.between);

    status_between(&t->shared->status, told ? between_state(g->between, g->active, text, sizeof(text)) : "",
                   g->active ? g->lasts_s : 0.0);
}

enum err glide_take(struct ingest_thread *t, const struct frame *f, const struct frame **shown, struct reason *why)
{
    const struct between_desc *desc = &t->shared->config.setup.source_desc.between;
    const struct image_decoder decoder = { decoder_decode, t->decoder };
    struct glide *g = t->glide;

    *shown = f;
    if (!g)
        return ERR_OK;
    const double fps = settings_now(&t->shared->settings).fps, arrived_s = g->arrived_s;
    if (g->ended || (arrived_s > 0.0 && clock_seconds() - arrived_s > LONGEST))
        glide_forget(t);
    g->ended = false;
    const bool slow = is_slow(g, fps) && desc->mode != BETWEEN_OFF, was_active = g->active;
    set_active(t, slow, fps);
    const double seconds = seconds_of(g, f);
    if (!slow && !between_corrects(desc)) {
        g->capture_us = f->capture_us;
        if (was_active)
            between_forget(g->between);
        if (was_active)
            tell_state(t);
        return ERR_OK;
    }
    const enum err e = between_take(g->between, f, seconds, t->decoder ? &decoder : NULL, why);
    if (e) { /* as if it had not come */
        g->arrived_s = arrived_s;
        return e;
    }
    g->capture_us = f->capture_us;
    const uint32_t count = between_count(g->between);
    g->lasts_s = slow && count > 1 ? delay_of(t) : 0.0;
    g->begun_s = clock_seconds();
    g->due_s = g->begun_s + 1.0 / fps;
    g->to = seconds;
    g->from = g->lasts_s <= 0.0 ? seconds : was_active ? g->moment : between_seconds(g->between, count - 2);
    g->moment = g->from;
    tell_state(t);
    *shown = &g->shown;
    return between_show(g->between, g->moment, &g->shown) ? err_say(why, ERR_NOMEM, "%s: out of memory", f->name)
                                                          : ERR_OK;
}

/* What is to be shown now. */
static double moment_now(const struct glide *g)
{
    const double passed = clock_seconds() - g->begun_s;

    if (g->lasts_s > 0.0)
        return g->from + (g->to - g->from) * fmin(1.0, passed / g->lasts_s);
    return g->to + passed; /* ahead; the window ends it after an interval */
}

bool glide_is_moving(const struct ingest_thread *t)
{
    const struct glide *g = t->glide;

    if (!g || !g->active || between_count(g->between) < 2)
        return false;
    return g->lasts_s > 0.0 ? g->moment < g->to : clock_seconds() - g->begun_s < usual_interval(g);
}

int glide_wait_ms(const struct ingest_thread *t, int most_ms)
{
    if (!glide_is_moving(t))
        return most_ms;
    const double left = 1e3 * (t->glide->due_s - clock_seconds());
    return left < 1.0 ? 1 : left < most_ms ? (int)left : most_ms;
}

/* The next image, if it is due, the last one is being lit, and somebody looks. */
const struct frame *glide_step(struct ingest_thread *t)
{
    struct glide *g = t->glide;
    const double now = clock_seconds(), fps = settings_now(&t->shared->settings).fps;

    if (!glide_is_moving(t) || now < g->due_s)
        return NULL;
    if (!ingest_is_watched(t) || !handoff_wait_taken(&t->shared->frames.handoff, 0)) {
        g->due_s = now + AGAIN;
        return NULL;
    }
    g->moment = moment_now(g);
    g->due_s = fmax(g->due_s + 1.0 / fps, now);
    return between_show(g->between, g->moment, &g->shown) ? NULL : &g->shown;
}
