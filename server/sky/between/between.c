#include "sky/between/between.h"

#include "base/log.h"
#include "base/mem.h"
#include "base/vec.h"
#include "sky/between/align.h"
#include "sky/between/deflicker.h"
#include "sky/between/drift.h"
#include "sky/between/latlong.h"
#include "sky/between/restore.h"
#include "sky/between/taken.h"
#include "sky/tables/environment.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

/* FAR: suns further apart than this from one sky to the next are different ones: at 15 degrees an hour, 80 minutes.
 * SECOND: a second sun with this share of the first's light is named. */
#define FAR (20.0 * PI / 180.0)
#define SECOND 0.25
#define CLOSE 0.25 /* of the interval: a mark so close to one of its ends would turn its error into a wide curve */
#define PAIRS 32   /* suns by which skies are aligned, */
#define APART (0.5 * PI / 180.0) /* so far from each other at least */

const struct setting_choice between_choices[] = {
    { "off", BETWEEN_OFF, "each sky is shown until the next one", 0 },
    { "fade", BETWEEN_FADE, "the sun moves along its arc, the rest of the sky fades", 0 },
    { "motion", BETWEEN_MOTION, "clouds move, too, where that explains the next sky better than fading", 0 },
    { NULL, 0, NULL, 0 },
};

const struct setting_choice between_sun_choices[] = {
    { "keep", (int)BETWEEN_SUN_KEEP, "the sun as it was captured", 0 },
    { "auto", (int)BETWEEN_SUN_AUTO, "a clipped sun gets the energy that the rest of the sky calls for", 0 },
    { NULL, 0, NULL, 0 },
};

const struct setting_choice between_align_choices[] = {
    { "off", BETWEEN_ALIGN_OFF, "the map's centre is north", 0 },
    { "sun", BETWEEN_ALIGN_SUN, "turned so that the sun stands where it must, at --place and at the time of capture",
      0 },
    { NULL, 0, NULL, 0 },
};

struct sky {
    double seconds;
    uint32_t width, height;
    float *rest;          /* owned; [height][width][3]: without its sun */
    size_t capacity;      /* floats */
    struct sun_patch sun; /* owned */
    struct frame about;   /* number, time, units, turn, corrections, name; no texels */
    uint64_t serial;      /* counts the skies that were taken */
    enum align_kind kind; /* of the alignment by which it was turned */
    bool turned;          /* by the alignment: its sun's texels are no longer where they were */
};

struct between {
    struct between_desc desc;
    struct sky skies[SUN_MARKS]; /* the oldest first */
    uint32_t count;
    uint64_t serial;
    struct environment *reader; /* decodes, and turns other layouts into lat-long */
    struct drift drift;
    uint64_t drift_of; /* serial of the later of its two skies; 0: none */

    struct deflicker deflicker;
    int64_t steadied_us; /* when the last sky was taken; 0: nobody says */
    struct sun_pair pairs[PAIRS];
    size_t pair_count;
    bool learning, learnt; /* the alignment, by between_learn; it is settled */
    struct alignment alignment;
    float *turning; /* owned; buffer of as many floats as */
    size_t turning_capacity;
    unsigned said, said_decoding;
};

enum {
    SAID_SIZE = 1,
    SAID_SECOND = 2,
    SAID_JUMP = 4,
    SAID_STILL = 8,
    SAID_TIME = 16,
    SAID_UNITS = 32,
    SAID_SUN = 64 /* and a bit for each kind of result */
};

static void say(struct between *b, unsigned what, const struct sky *s, const char *text)
{
    if (!(b->said & what))
        log_warning("%s: %s", s->about.name, text);
    b->said |= what;
}

bool between_corrects(const struct between_desc *d)
{
    return d->deflicker || d->align || d->sun != BETWEEN_SUN_KEEP;
}

bool between_is_used(const struct between_desc *d)
{
    return d->hold > 1 || between_corrects(d);
}

enum err between_create(const struct between_desc *desc, struct between **out)
{
    struct between *b = mem_alloc(1, sizeof(*b));

    *out = NULL;
    if (!b)
        return ERR_NOMEM;
    b->desc = *desc;
    b->reader = environment_create(&(struct environment_desc){
        .n = 1, .layout = desc->layout, .layer = desc->layer, .max_side = desc->max_side, .lean = true });
    if (!b->reader) {
        mem_free(b);
        return ERR_NOMEM;
    }
    *out = b;
    return ERR_OK;
}

void between_destroy(struct between *b)
{
    if (!b)
        return;
    for (uint32_t k = 0; k < SUN_MARKS; k++) {
        mem_free(b->skies[k].rest);
        sun_patch_finish(&b->skies[k].sun);
    }
    environment_destroy(b->reader);
    mem_free(b->turning);
    drift_finish(&b->drift);
    mem_free(b);
}

void between_forget(struct between *b)
{
    b->count = 0;
    b->drift_of = 0;
    b->deflicker = (struct deflicker){ .count = 0 };
    if (!b->learnt) {
        b->pair_count = 0;
        b->alignment = (struct alignment){ .kind = ALIGN_NONE };
    }
}

uint32_t between_count(const struct between *b)
{
    return b->count;
}

double between_seconds(const struct between *b, uint32_t k)
{
    assert(k < b->count);
    return b->skies[k].seconds;
}

static bool has_others(const struct sky *s)
{
    return s->sun.found && s->sun.others > SECOND;
}

/* ---- Taking skies ---- */

static enum err reserve(struct sky *s)
{
    const size_t floats = 3 * (size_t)s->width * s->height;

    if (floats <= s->capacity)
        return ERR_OK;
    mem_free(s->rest);
    s->rest = mem_alloc(floats, sizeof(float));
    s->capacity = s->rest ? floats : 0;
    return s->rest ? ERR_OK : ERR_NOMEM;
}

/* Room for one more sky: the place after the last, which moves the oldest out of a full window. */
static struct sky *next_place(struct between *b)
{
    if (b->count == SUN_MARKS) {
        const struct sky oldest = b->skies[0];
        memmove(b->skies, b->skies + 1, (SUN_MARKS - 1) * sizeof(oldest));
        b->skies[SUN_MARKS - 1] = oldest;
        b->count--;
    }
    return &b->skies[b->count];
}

static void describe(struct sky *s, const struct frame *f)
{
    s->about = (struct frame){ .number = f->number,
                               .capture_us = f->capture_us,
                               .units = f->units,
                               .turn = f->turn,
                               .gain = { 1.0f, 1.0f, 1.0f } };
    memcpy(s->about.name, f->name, sizeof(s->about.name));
}

/* When it was taken: by its name, by the file, which counts from the start of the exposure, or by its sender;
 * microseconds, 0: nobody says. */
static int64_t taken_us(const struct between *b, const struct frame *f)
{
    const struct image *im = &b->reader->image;
    const int64_t own = im->taken_us ? im->taken_us + llround(0.5e6 * im->exposure_s) : 0,
                  name = taken_from_name(f->name);

    return name ? name : own ? own : f->capture_us;
}

/* Multiplies by what makes the exposure steady. The window's seconds may only count the frames of a sequence. */
static void steady(struct between *b, const struct frame *f, struct sky *s)
{
    const struct sky *before = b->count > 0 ? s - 1 : NULL;
    const int64_t us = taken_us(b, f), last_us = b->steadied_us;
    struct deflicker_result r;
    double later = before ? s->seconds - before->seconds : 0.0;

    if (before && us != 0 && last_us != 0)
        later = 1e-6 * (double)(us - last_us);
    b->steadied_us = us;
    deflicker_take(&b->deflicker, s->rest, s->width, s->height, later, &r);
    memcpy(s->about.gain, r.gain, sizeof(r.gain));
    if (r.jumped)
        log_info("%s: the exposure jumped; it is undone, %+.2f stops from here on", s->about.name, (double)r.stops);
    for (size_t k = 0; k < 3 * (size_t)s->width * s->height; k++)
        s->rest[k] *= r.gain[k % 3];
}

static enum err give_sun(struct between *b, struct sky *s, struct reason *why)
{
    const bool measured = b->desc.sun > 0.0;
    const struct restore_desc desc = { .lux = fmax(b->desc.sun, 0.0),
                                       .units = s->about.units > 0.0 ? s->about.units
                                                : measured           ? 1.0
                                                                     : 0.0 };
    struct restored r;
    const enum err e = restore_sun(s->rest, s->width, s->height, &desc, &r, why);

    if (measured && !(s->about.units > 0.0))
        say(b, SAID_UNITS, s, "it is taken to be in W sr^-1 m^-2, so that --sun LUX can be compared with it");
    s->about.sun_restored = !e && r.kind == RESTORE_ADDED;
    if (!e && r.note[0])
        say(b, SAID_SUN << r.kind, s, r.note);
    return e;
}

/* Notes where the sun was seen, and fits the alignment. */
static void note_sun(struct between *b, const double seen[3], int64_t us)
{
    struct sun_pair *p = &b->pairs[b->pair_count % PAIRS];
    const struct sun_pair *last = b->pair_count ? &b->pairs[(b->pair_count - 1) % PAIRS] : NULL;
    double known[3];

    align_sun(b->desc.place[0], b->desc.place[1], us, known);
    if (last && angle_between(known, last->known) < APART) /* the last ones are to span a good part of its arc */
        return;
    memcpy(p->seen, seen, sizeof(p->seen));
    memcpy(p->known, known, sizeof(known));
    b->pair_count++;
    const enum align_kind before = b->alignment.kind;
    align_fit(b->pairs, b->pair_count < PAIRS ? b->pair_count : PAIRS, &b->alignment);
    if (b->alignment.kind != before && !b->learning)
        log_info("%s", b->alignment.note);
}

/* Looks for the sun, clipped or whole, by which north is found. */
static enum err look_for_sun(struct between *b, const struct frame *f, const struct sky *s)
{
    const int64_t us = taken_us(b, f);
    bool found = false;
    double seen[3];

    if (us == 0)
        say(b, SAID_TIME, s, "nothing says when it was taken, so that --align sun has no sun to go by");
    if (us == 0 || b->learnt)
        return ERR_OK;
    if (align_find_sun(s->rest, s->width, s->height, seen, &found))
        return ERR_NOMEM;
    if (found)
        note_sun(b, seen, us);
    return ERR_OK;
}

/* Turns the sky without its sun, and the sun. About the vertical alone the map is turned where it is looked up,
 * exactly; otherwise it is resampled. */
static enum err align(struct between *b, struct sky *s)
{
    const struct alignment *a = &b->alignment;
    const size_t floats = 3 * (size_t)s->width * s->height;
    double w[3];

    s->turned = false;
    s->kind = a->kind;
    if (a->kind == ALIGN_AZIMUTH)
        s->about.turn += atan2(a->r[0][2], a->r[0][0]) * 180.0 / PI;
    if (a->kind != ALIGN_ROTATION)
        return ERR_OK;
    if (b->turning_capacity < floats) {
        mem_free(b->turning);
        b->turning = mem_alloc(floats, sizeof(float));
        b->turning_capacity = b->turning ? floats : 0;
    }
    if (!b->turning)
        return ERR_NOMEM;
    align_apply((const double(*)[3])a->r, s->rest, b->turning, s->width, s->height);
    float *rest = s->rest;
    const size_t capacity = s->capacity;
    s->rest = b->turning;
    s->capacity = b->turning_capacity;
    b->turning = rest;
    b->turning_capacity = capacity;
    for (int i = 0; i < 3; i++)
        w[i] = dot3(a->r[i], s->sun.direction);
    memcpy(s->sun.direction, w, sizeof(w));
    s->turned = true;
    return ERR_OK;
}

/* Decodes f into s->rest; sets its size, but checks nothing against the window. */
static enum err read_sky(struct between *b, const struct frame *f, const struct image_decoder *decoder, struct sky *s,
                         enum layout *layout, struct reason *why)
{
    struct environment *e = b->reader;

    e->decoder = decoder;
    const enum err result = environment_decode(e, f, why);
    e->decoder = NULL;
    e->rotation = 0.0; /* what turns the map turns the result */
    return result ? result : latlong_size(e, layout, &s->width, &s->height, why);
}

/* What the camera did is undone, and the sun is taken out. */
static enum err prepare(struct between *b, const struct frame *f, struct sky *s, struct reason *why)
{
    enum err e = ERR_OK;

    if (b->desc.deflicker)
        steady(b, f, s);
    if (b->desc.sun != BETWEEN_SUN_KEEP)
        e = give_sun(b, s, why);
    if (e)
        return e;
    e = b->desc.align ? look_for_sun(b, f, s) : ERR_OK;
    if (!e)
        e = sun_patch_take(s->rest, s->width, s->height, &s->sun);
    if (!e && b->desc.align)
        e = align(b, s);
    return e ? err_say(why, e, "%s: out of memory", f->name) : ERR_OK;
}

/* Skies that were turned otherwise than the one after them have no images between them and it. */
static struct sky *begin_anew(struct between *b)
{
    const struct sky last = b->skies[b->count];

    b->skies[b->count] = b->skies[0];
    b->skies[0] = last;
    b->count = 0;
    return &b->skies[0];
}

enum err between_take(struct between *b, const struct frame *f, double seconds, const struct image_decoder *decoder,
                      struct reason *why)
{
    struct sky size = { .width = 0 };
    enum layout layout = LAYOUT_AUTO;

    enum err result = read_sky(b, f, decoder, &size, &layout, why);
    if (result)
        return result;
    environment_report(b->reader, &b->said_decoding);
    struct sky *s = next_place(b);
    s->width = size.width;
    s->height = size.height;
    if (reserve(s))
        return err_say(why, ERR_NOMEM, "%s: out of memory", f->name);
    latlong_copy(b->reader, layout, s->width, s->height, s->rest);
    s->seconds = seconds;
    describe(s, f);
    result = prepare(b, f, s, why);
    if (result)
        return result;
    if (b->desc.align && b->count > 0 && b->skies[b->count - 1].kind != s->kind)
        s = begin_anew(b);
    if (has_others(s) && b->desc.mode != BETWEEN_OFF)
        say(b, SAID_SECOND, s, "there is more than one sun: the brightest moves, the others fade");
    s->serial = ++b->serial;
    b->count++;
    return ERR_OK;
}

enum err between_learn(struct between *b, const struct frame *f, struct reason *why)
{
    struct sky s = { .width = 0 };
    enum layout layout = LAYOUT_AUTO;

    enum err e = read_sky(b, f, NULL, &s, &layout, why);
    if (e)
        return e;
    describe(&s, f);
    e = reserve(&s);
    if (!e)
        latlong_copy(b->reader, layout, s.width, s.height, s.rest);
    b->learning = true;
    if (!e)
        e = look_for_sun(b, f, &s);
    b->learning = false;
    mem_free(s.rest);
    return e ? err_say(why, e, "%s: out of memory", f->name) : ERR_OK;
}

void between_settle(struct between *b)
{
    b->learnt = true;
    log_info("%s", b->pair_count > 0 ? b->alignment.note : "north: no sun was found by which skies could be turned");
}

/* ---- Showing skies ---- */

/* Whether two skies in a row have one sun, as far as is seen. */
static bool same_sun(const struct sky *a, const struct sky *b)
{
    return !a->sun.found || !b->sun.found || angle_between(a->sun.direction, b->sun.direction) < FAR;
}

/* The marks of the sun that is in the window's skies from..to, of the sky before and of the one after, if it is the
 * same there: no more, so that an image is the same whatever else the window has. */
static uint32_t collect_marks(const struct between *b, uint32_t from, uint32_t to, struct sun_mark *marks)
{
    const double least = CLOSE * (b->skies[to].seconds - b->skies[from].seconds);
    const bool before = from > 0 && same_sun(&b->skies[from - 1], &b->skies[from]) &&
                        b->skies[from].seconds - b->skies[from - 1].seconds >= least;
    const bool after = to + 1 < b->count && same_sun(&b->skies[to], &b->skies[to + 1]) &&
                       b->skies[to + 1].seconds - b->skies[to].seconds >= least;
    uint32_t count = 0;

    from -= before;
    to += after;
    for (uint32_t k = from; k <= to; k++) {
        const struct sky *s = &b->skies[k];
        if (s->sun.found)
            marks[count++] =
                (struct sun_mark){ s->seconds, { s->sun.direction[0], s->sun.direction[1], s->sun.direction[2] } };
    }
    return count;
}

static void put(const struct sky *s, const struct sun_patch *sun, const double direction[3], double share, float *rgb)
{
    const double energy[3] = { share * sun->energy[0], share * sun->energy[1], share * sun->energy[2] };

    if (sun->found && share > 0.0)
        sun_put(rgb, s->width, s->height, direction, sun->radius, energy);
}

/* The suns of skies k and k + 1 at t of the way. */
static void put_suns(struct between *b, uint32_t k, double t, float *rgb)
{
    const struct sky *first = &b->skies[k], *second = first + 1;
    struct sun_mark marks[SUN_MARKS];
    double w[3];

    if (!same_sun(first, second)) {
        say(b, SAID_JUMP, second, "the sun is far from where it was: the two fade");
        put(first, &first->sun, first->sun.direction, 1.0 - t, rgb);
        put(second, &second->sun, second->sun.direction, t, rgb);
        return;
    }
    const uint32_t count = collect_marks(b, k, k + 1, marks);
    if (count == 0)
        return;
    sun_way(marks, count, first->seconds + t * (second->seconds - first->seconds), w);
    struct sun_patch sun = { .found = true };
    for (int c = 0; c < 3; c++)
        sun.energy[c] = (1.0 - t) * (first->sun.found ? first->sun.energy[c] : 0.0) +
                        t * (second->sun.found ? second->sun.energy[c] : 0.0);
    const double r0 = first->sun.found ? first->sun.radius : second->sun.radius;
    sun.radius = first->sun.found && second->sun.found ? (1.0 - t) * r0 + t * second->sun.radius : r0;
    if (first->sun.found || second->sun.found)
        put(first, &sun, w, 1.0, rgb);
}

/* The motion from sky k to k + 1, if clouds move; found once. */
static enum err find_drift(struct between *b, uint32_t k, const struct drift **out)
{
    const struct sky *first = &b->skies[k], *second = first + 1;

    *out = NULL;
    if (b->desc.mode != BETWEEN_MOTION || has_others(first) || has_others(second)) /* no cloud carries a lamp along */
        return ERR_OK;
    if (b->drift_of != second->serial) {
        if (drift_find(&b->drift, first->rest, second->rest, first->width, first->height))
            return ERR_NOMEM;
        b->drift_of = second->serial;
        if (!b->drift.moves)
            say(b, SAID_STILL, second, "no motion of clouds explains this sky better than fading does: it fades");
    }
    *out = &b->drift;
    return ERR_OK;
}

/* A sky as it came, or, after the last one, with its sun moved on. */
static void show_one(const struct between *b, uint32_t k, double seconds, float *rgb)
{
    const struct sky *s = &b->skies[k];
    struct sun_mark marks[SUN_MARKS];
    double w[3];

    memcpy(rgb, s->rest, 3 * (size_t)s->width * s->height * sizeof(float));
    const uint32_t count = collect_marks(b, k, k, marks);
    if (seconds <= s->seconds || k + 1 < b->count || count < 2 || !s->sun.found || b->desc.mode == BETWEEN_OFF) {
        if (s->turned)
            put(s, &s->sun, s->sun.direction, 1.0, rgb);
        else
            sun_patch_restore(&s->sun, rgb);
        return;
    }
    sun_way(marks, count, fmin(seconds, 2.0 * s->seconds - marks[count - 2].seconds), w);
    put(s, &s->sun, w, 1.0, rgb);
}

static void set_about(const struct between *b, uint32_t k, double t, struct frame *out)
{
    const struct frame *f = &b->skies[k].about, *next = t > 0.0 ? &b->skies[k + 1].about : f;
    const double turn = t * remainder(next->turn - f->turn, 360.0); /* the shorter way round */
    const double later = f->capture_us && next->capture_us ? t * (double)(next->capture_us - f->capture_us) : 0.0;

    out->number = f->number;
    out->capture_us = next->capture_us ? f->capture_us + llround(later) : 0;
    out->units = f->units;
    out->turn = f->turn + turn;
    for (int c = 0; c < 3; c++)
        out->gain[c] = f->gain[c] + (float)t * (next->gain[c] - f->gain[c]);
    out->sun_restored = f->sun_restored || next->sun_restored;
    snprintf(out->layout, sizeof(out->layout), "latlong");
    out->placed = true;
    memcpy(out->name, f->name, sizeof(out->name));
}

/* Of skies of different sizes the first stays until the second. */
static bool same_size(struct between *b, const struct sky *first, const struct sky *second)
{
    const bool same = first->width == second->width && first->height == second->height;

    if (!same)
        say(b, SAID_SIZE, second, "it has another size than the sky before: there are no images between the two");
    return same;
}

enum err between_show(struct between *b, double seconds, struct frame *out)
{
    const struct drift *drift;
    uint32_t k = 0;

    assert(b->count > 0);
    while (k + 1 < b->count && b->skies[k + 1].seconds <= seconds)
        k++;
    const struct sky *s = &b->skies[k];
    if (frame_reserve_texels(out, s->width, s->height))
        return ERR_NOMEM;
    const bool between = k + 1 < b->count && seconds > s->seconds && b->desc.mode != BETWEEN_OFF;
    if (!between || !same_size(b, s, s + 1)) {
        show_one(b, k, seconds, out->rgb);
        set_about(b, k, 0.0, out);
        return ERR_OK;
    }
    const struct sky *second = s + 1;
    const double t = (seconds - s->seconds) / (second->seconds - s->seconds);
    if (find_drift(b, k, &drift))
        return ERR_NOMEM;
    drift_blend(drift, s->rest, second->rest, s->width, s->height, t, out->rgb);
    put_suns(b, k, t, out->rgb);
    set_about(b, k, t, out);
    return ERR_OK;
}

const char *between_state(const struct between *b, bool moving, char *out, size_t size)
{
    const struct alignment *a = &b->alignment;
    const struct frame *last =
        b->count > 0 ? &b->skies[b->count - 1].about : &(struct frame){ .gain = { 1.0f, 1.0f, 1.0f } };
    const bool moves = b->desc.mode == BETWEEN_MOTION && b->drift_of && b->drift.moves;
    size_t used = (size_t)snprintf(out, size, "%s",
                                   !moving ? "each sky is shown until the next"
                                   : moves ? "the sun and the clouds move"
                                           : "the sun moves, the rest fades");

    if (b->desc.deflicker && used < size)
        used += (size_t)snprintf(out + used, size - used, "; exposure %+.2f stops", log2((double)last->gain[1]));
    if (last->sun_restored && used < size)
        used += (size_t)snprintf(out + used, size - used, "; a clipped sun was restored");
    if (a->kind != ALIGN_NONE && used < size)
        (void)snprintf(out + used, size - used, "; turned by %.1f degrees to north", a->azimuth);
    return out;
}
