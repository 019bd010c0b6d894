#include "light/frame/relight_day.h"

#include "base/clock.h"
#include "base/log.h"

#include <math.h>
#include <string.h>

#define SEGMENTS 360     /* of a day, of four minutes: a degree of the sun's way */
#define PLACES 9         /* of the sun along a segment */
#define STEADY 8         /* frames of one day, before its way counts as known: not while the sky turns */
#define MORE_TILES 1.125 /* than in the file, which is then written again; so it is at the first day of a run */
#define TURN 512         /* packets that a turn asks for: a frame waits for some milliseconds at most */

static bool is_same_day(const struct sun_day *a, const struct sun_day *b)
{
    return a->day == b->day && a->latitude == b->latitude && a->solar == b->solar && a->ahead == b->ahead &&
           a->turn == b->turn;
}

static struct digest digest_of_day(const struct sun_day *d)
{
    const double numbers[] = { d->latitude, d->day, d->solar, d->ahead, d->turn };
    struct digest out = { { 0 } };

    digest_bytes(&out, numbers, sizeof(numbers));
    return out;
}

/* False: the end. */
static bool await_day(struct relight_day *d, const struct aim *last, struct aim *out)
{
    pthread_mutex_lock(&d->lock);
    while (!d->ended && (d->aim.frames < STEADY || (last->transport && is_same_day(&last->day, &d->aim.day))))
        pthread_cond_wait(&d->aimed, &d->lock);
    *out = d->aim;
    const bool ended = d->ended;
    pthread_mutex_unlock(&d->lock);
    return !ended;
}

/* Follows the last frame's sun. False: the day is over. */
static bool follow_aim(struct relight_day *d, struct aim *a)
{
    pthread_mutex_lock(&d->lock);
    const bool goes_on = !d->ended && is_same_day(&a->day, &d->aim.day);
    memcpy(a->axis, d->aim.axis, sizeof(a->axis));
    pthread_mutex_unlock(&d->lock);
    return goes_on;
}

/* The first one that is left from the sun's on. SEGMENTS: none. */
static uint32_t next_segment(const struct aim *a, const bool *over)
{
    double w[3], most = -2.0;
    uint32_t nearest = 0;

    for (uint32_t k = 0; k < SEGMENTS; k++) {
        sun_day_at(&a->day, 24.0 / SEGMENTS * (k + 0.5), w);
        const double c = w[0] * a->axis[0] + w[1] * a->axis[1] + w[2] * a->axis[2];
        nearest = c > most ? k : nearest;
        most = fmax(most, c);
    }
    for (uint32_t k = 0; k < SEGMENTS; k++)
        if (!over[(nearest + k) % SEGMENTS])
            return (nearest + k) % SEGMENTS;
    return SEGMENTS;
}

/* ERR_END: the day is over. Other errors: those of transport_look_at. */
static enum err look_along_segment(struct relight_day *d, struct aim *a, uint32_t segment)
{
    const uint32_t turns = 1 + d->set->gbuffer->packet_count / TURN;
    double w[PLACES][3];
    enum err e = ERR_OK;

    for (uint32_t k = 0; k < PLACES; k++)
        sun_day_at(&a->day, 24.0 / SEGMENTS * (segment + (double)k / (PLACES - 1)), w[k]);
    for (uint32_t turn = 0; !e && turn < turns && w[PLACES / 2][1] > -SUN_RADIUS; turn++) {
        precedence_give_way(d->urgent);
        e = follow_aim(d, a) ? transport_look_at(a->transport, w, PLACES, turn, turns, a->since) : ERR_END;
    }
    return e;
}

/* Asks for what the sun meets on this day, from its next moments on. */
static enum err look_along_day(struct relight_day *d, struct aim *a)
{
    bool over[SEGMENTS] = { false };
    enum err e = ERR_OK;

    for (uint32_t k; !e && (k = next_segment(a, over)) < SEGMENTS; over[k] = true)
        e = look_along_segment(d, a, k);
    return e;
}

void relight_day_follow(struct relight_day *d)
{
    struct aim last = { .transport = NULL }, now;
    enum err said = ERR_END; /* each outcome is told when it changes, not every day */
    uint32_t kept = 0;

    while (await_day(d, &last, &now)) {
        const double start = clock_seconds();
        const struct digest day = digest_of_day(&now.day);
        bool whole = false;
        if (!last.transport && relight_keep_load_sun(&d->keep, now.transport, &day, &whole))
            kept = transport_sun_tiles(now.transport);
        const enum err e = whole ? ERR_OK : look_along_day(d, &now);
        if (!e && !whole && (!last.transport || transport_sun_tiles(now.transport) > MORE_TILES * kept)) {
            relight_keep_save_sun(&d->keep, now.transport, &day);
            kept = transport_sun_tiles(now.transport);
        }
        if (e != said && !e)
            log_info("sun: what points see of it on this day is known after %.1f s in the background",
                     clock_seconds() - start);
        else if (e != said && e == ERR_RANGE)
            log_info("sun: --cache-memory has no room for what points see of it on a day; images ask for the rest");
        said = e == ERR_END ? said : e;
        last = now;
    }
}

void relight_day_aim(struct relight_day *d, struct transport *t, const struct sun_day *day)
{
    const float *axis = transport_sun_axis(t);

    if (!axis)
        return;
    pthread_mutex_lock(&d->lock);
    if (!d->aim.transport || !is_same_day(&d->aim.day, day))
        d->aim = (struct aim){ .transport = t, .day = *day, .since = transport_frames(t) };
    d->aim.frames++;
    memcpy(d->aim.axis, axis, sizeof(d->aim.axis));
    pthread_cond_signal(&d->aimed);
    pthread_mutex_unlock(&d->lock);
}

void relight_day_init(struct relight_day *d, const struct prepared_scene *set, const struct relight_desc *light,
                      const struct relight_keep *caches, const struct precedence *urgent)
{
    struct digest sun = { { 0 } };

    *d = (struct relight_day){ .set = set, .urgent = urgent };
    digest_bytes(&sun, "sun", sizeof("sun"));
    relight_keep_init_paths(&d->keep, caches, set, light, &sun);
    pthread_mutex_init(&d->lock, NULL);
    pthread_cond_init(&d->aimed, NULL);
}

void relight_day_end(struct relight_day *d)
{
    pthread_mutex_lock(&d->lock);
    d->ended = true;
    pthread_cond_signal(&d->aimed);
    pthread_mutex_unlock(&d->lock);
}

void relight_day_finish(struct relight_day *d)
{
    pthread_cond_destroy(&d->aimed);
    pthread_mutex_destroy(&d->lock);
}
