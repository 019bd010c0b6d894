/* Several images from one frame of a source to the next: reads the frames around a moment and asks for the sky between
 * them. Which frames these are depends on the moment alone, so that images are the same in any order. */
#include "sky/source/source_internal.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "image/codec/decode.h"
#include "sky/between/taken.h"

#include <assert.h>
#include <math.h>

#define NONE UINT64_MAX
#define GAP 4.0   /* a longer interval than so many means is told */
#define LOOKS 10  /* frames by whose suns a sequence is aligned */
#define SAME 2e-6 /* s: an image so close to a frame's time is that frame's */

enum { MISSING = 1, TOLD = 2 }; /* it could not be read in this pass; that was said */

struct held {
    struct between *between;
    uint32_t hold;
    uint64_t image;             /* the next */
    uint64_t shown;             /* the last one returned */
    uint64_t loaded[SUN_MARKS]; /* positions of the frames in the window, as its skies, */
    double turns[SUN_MARKS];    /* and their turns, degrees, of any number of rounds */
    uint64_t stands;            /* the position that the source reads next; NONE: unknown */
    struct frame frame;         /* buffer */
    double *seconds;            /* [count]: when each frame was taken, since the first; NULL: evenly */
    uint64_t count;
    uint8_t *faults;     /* [count]: MISSING and TOLD; NULL where there is no count */
    bool broken;         /* without a count: nothing can be read any more */
    struct sky_desc sky; /* as source_sky */
};

/* When a file was taken, microseconds; 0: nothing tells, below 0: it cannot be read. Names are asked first: they need
 * no decoding. */
static int64_t taken_us(const struct file_item *item, bool by_name)
{
    struct image im = { .width = 0 };
    struct reason why;

    if (by_name)
        return taken_from_name(item->path);
    const int64_t us = decode_file(item->path, &im, &why) ? -1 : im.taken_us;
    image_finish(&im);
    return us;
}

/* The times of files that cannot be read lie evenly between those of their neighbours. */
static void fill_times(struct held *h)
{
    uint64_t last = NONE, first = NONE;

    for (uint64_t k = 0; k < h->count; k++) {
        if (isnan(h->seconds[k]))
            continue;
        const double step = last == NONE ? 0.0 : (h->seconds[k] - h->seconds[last]) / (double)(k - last);
        for (uint64_t i = last == NONE ? k : last + 1; i < k; i++)
            h->seconds[i] = h->seconds[last] + step * (double)(i - last);
        first = first == NONE ? k : first;
        last = k;
    }
    const double mean = last > first ? (h->seconds[last] - h->seconds[first]) / (double)(last - first) : 1.0;
    for (uint64_t k = 0; k < h->count && first != NONE; k++)
        if (k < first || k > last)
            h->seconds[k] = k < first ? h->seconds[first] - mean * (double)(first - k)
                                      : h->seconds[last] + mean * (double)(k - last);
}

/* Whether all files that can be read tell when they were taken, one after another. */
static bool read_times(struct source *s, bool by_name)
{
    struct held *h = s->held;
    int64_t first = 0, last = 0;

    for (uint64_t k = 0; k < h->count; k++) {
        const int64_t us = taken_us(&s->files.items[k], by_name);
        h->seconds[k] = us > 0 ? 1e-6 * (double)(us - (first ? first : us)) : NAN;
        if (us == 0)
            return false;
        if (us > 0 && last && us <= last) {
            log_warning("%s was taken %.3g s %s the file before it: images between are even in number, not in time",
                        s->files.items[k].path, 1e-6 * (double)(last - us), us < last ? "before" : "after");
            return false;
        }
        first = first || us < 0 ? first : us;
        last = us > 0 ? us : last;
    }
    fill_times(h);
    return first != 0;
}

/* The longest gap, if it is one, in words. */
static void tell_gap(const struct source *s)
{
    const struct held *h = s->held;
    const double mean = (h->seconds[h->count - 1] - h->seconds[0]) / (double)(h->count - 1);
    uint64_t longest = 1;

    for (uint64_t k = 2; k < h->count; k++)
        if (h->seconds[k] - h->seconds[k - 1] > h->seconds[longest] - h->seconds[longest - 1])
            longest = k;
    const double gap = h->seconds[longest] - h->seconds[longest - 1];
    log_info("%s: files were taken every %.3g s on average; images between them are even in time", s->desc.spec, mean);
    if (gap > GAP * mean)
        log_warning("%s: nothing was taken for %.3g s before it: images go from one sky to the other all that time",
                    s->files.items[longest].path, gap);
}

/* Capture times of files make images even in time. Without them, or where they do not go on, frames count as even. */
static enum err take_times(struct source *s)
{
    struct held *h = s->held;

    if (s->kind != SOURCE_FILES || s->repeats || h->count < 2 || h->hold == 1)
        return ERR_OK;
    h->seconds = mem_alloc((size_t)h->count, sizeof(*h->seconds));
    if (!h->seconds)
        return ERR_NOMEM;
    const bool by_name = taken_from_name(s->files.items[0].path) > 0;
    if (read_times(s, by_name)) {
        tell_gap(s);
        return ERR_OK;
    }
    mem_free(h->seconds);
    h->seconds = NULL;
    return ERR_OK;
}

/* Looks at the suns of frames all over the sequence. A frame that cannot be used is named when its turn comes. */
static enum err learn(struct source *s, struct reason *why)
{
    struct held *h = s->held;
    const uint64_t looks = h->count < LOOKS ? h->count : LOOKS;
    enum err e = ERR_OK;

    for (uint64_t k = 0; k < looks && e != ERR_NOMEM; k++) {
        h->stands = NONE;
        e = source_seek_sky(s, looks > 1 ? k * (h->count - 1) / (looks - 1) : 0) ? ERR_OK : ERR_END;
        if (!e)
            e = source_next_sky(s, &h->frame, why);
        if (!e && h->frame.kind != FRAME_NONE)
            e = between_learn(h->between, &h->frame, why);
    }
    between_settle(h->between);
    s->position = 0;
    (void)source_seek_sky(s, 0);
    return e == ERR_NOMEM ? e : ERR_OK;
}

static bool is_computed(const struct source *s)
{
    return s->kind == SOURCE_SKY || s->kind == SOURCE_DAYLIGHT;
}

static enum err check(const struct source *s, const struct between_desc *desc, struct reason *why)
{
    const uint64_t hold = desc->hold > 1 ? desc->hold : 1;

    if (desc->align && is_computed(s))
        return err_say(why, ERR_USAGE, "%s: a computed sky has its place and time: --align is for captured ones",
                       s->desc.spec);
    if (source_first_number(s) + source_count_skies(s) > FRAME_NUMBER_MAX / hold)
        return err_say(why, ERR_USAGE, "%s: with --hold %u, numbers of images would exceed 2^53 - 1", s->desc.spec,
                       (unsigned)hold);
    return ERR_OK;
}

enum err held_create(struct source *s, const struct between_desc *desc, struct reason *why)
{
    enum err e = check(s, desc, why);

    if (e)
        return e;
    struct held *h = s->held = mem_alloc(1, sizeof(*h));
    e = h ? between_create(desc, &h->between) : ERR_NOMEM;
    if (!e) {
        h->hold = desc->hold > 1 ? desc->hold : 1;
        h->count = source_count_skies(s);
        h->faults = h->count ? mem_alloc((size_t)h->count, sizeof(*h->faults)) : NULL;
        e = h->count && !h->faults ? ERR_NOMEM : take_times(s);
    }
    if (!e && desc->align)
        e = learn(s, why);
    return e ? err_say(why, e, "%s: out of memory", s->desc.spec) : ERR_OK;
}

void held_destroy(struct held *h)
{
    if (!h)
        return;
    between_destroy(h->between);
    frame_finish(&h->frame);
    mem_free(h->seconds);
    mem_free(h->faults);
    mem_free(h);
}

uint64_t held_count(const struct source *s)
{
    const uint64_t skies = s->held->faults ? s->held->count : source_count_skies(s);

    return skies > 0 ? (skies - 1) * s->held->hold + 1 : 0;
}

uint64_t held_position(const struct source *s)
{
    return s->held->shown;
}

/* What could not be read may have been mended. */
static void begin_pass(struct held *h)
{
    for (uint64_t k = 0; h->faults && k < h->count; k++)
        h->faults[k] &= TOLD;
    h->broken = false;
}

bool held_seek(struct source *s, uint64_t position)
{
    const uint64_t count = held_count(s);

    if ((count > 0 && position >= count) || position > FRAME_NUMBER_MAX)
        return false;
    s->held->image = position;
    begin_pass(s->held);
    return true;
}

void held_restart(struct source *s)
{
    struct held *h = s->held;

    if (!h)
        return;
    between_forget(h->between);
    h->stands = NONE;
    h->image = s->position * h->hold;
}

const struct sky_desc *held_sky(const struct source *s)
{
    s->held->sky = s->sky;
    s->held->sky.speed_hours /= s->held->hold;
    return &s->held->sky;
}

static double seconds_of(const struct held *h, uint64_t sky)
{
    return h->seconds ? h->seconds[sky] : (double)sky;
}

/* When an image is: they are even in time, also where the frames are not. */
static double moment_of(const struct held *h, uint64_t image)
{
    if (!h->seconds)
        return (double)(image / h->hold) + (double)(image % h->hold) / h->hold;
    const double whole = h->seconds[h->count - 1] - h->seconds[0];
    const double moment = h->seconds[0] + whole * (double)image / ((double)(h->count - 1) * h->hold);
    for (uint64_t k = 0; k < h->count; k++)
        if (fabs(h->seconds[k] - moment) < SAME)
            return h->seconds[k];
    return moment;
}

static bool is_missing(const struct held *h, uint64_t sky)
{
    return h->faults && h->faults[sky] & MISSING;
}

/* The nearest readable frame below, or above, a position; NONE: there is none. */
static uint64_t neighbour(const struct held *h, uint64_t sky, int step)
{
    for (uint64_t k = sky + (uint64_t)(int64_t)step; k != NONE && (!h->faults || k < h->count);
         k += (uint64_t)(int64_t)step)
        if (!is_missing(h, k))
            return k;
    return NONE;
}

/* The readable frames around a moment: one before the interval, its ends, one after it. Returns how many. */
static uint32_t choose(const struct held *h, double moment, uint64_t *wanted)
{
    uint64_t at = h->seconds ? 0 : (uint64_t)moment;
    uint32_t count = 0;

    while (h->seconds && at + 1 < h->count && h->seconds[at + 1] <= moment)
        at++;
    if (is_missing(h, at)) {
        const uint64_t below = neighbour(h, at, -1);
        at = below != NONE ? below : neighbour(h, at, 1);
    }
    if (at == NONE)
        return 0;
    const uint64_t before = neighbour(h, at, -1), next = neighbour(h, at, 1);
    if (before != NONE)
        wanted[count++] = before;
    wanted[count++] = at;
    if (next != NONE && moment > seconds_of(h, at)) /* an image at a frame's own time needs no other */
        wanted[count++] = next;
    const uint64_t after = next != NONE ? neighbour(h, next, 1) : NONE;
    if (after != NONE && count > 1 && wanted[count - 1] == next)
        wanted[count++] = after;
    return count;
}

/* Reads and adds frame `sky`. One that cannot be used is missing for the rest of the pass. */
static enum err load(struct source *s, uint64_t sky, struct reason *why)
{
    struct held *h = s->held;
    const uint32_t before = between_count(h->between);
    enum err e = h->stands == sky || source_seek_sky(s, sky) ? ERR_OK : ERR_END;

    if (!e)
        e = source_next_sky(s, &h->frame, why);
    h->stands = e ? NONE : sky + 1;
    if (e == ERR_END || e == ERR_NOMEM)
        return e;
    const double turn = s->desc.turn * (double)h->frame.number;
    h->frame.turn = 0.0;     /* added to what is shown, since between two frames it may be several rounds */
    h->frame.capture_us = 0; /* computed skies were taken when they are shown */
    if (!e)
        e = between_take(h->between, &h->frame, seconds_of(h, sky), NULL, why);
    const uint32_t count = between_count(h->between);
    for (uint32_t k = 0; k + 1 < before && count < before + !e; k++) { /* the oldest has left */
        h->loaded[k] = h->loaded[k + 1];
        h->turns[k] = h->turns[k + 1];
    }
    if (!e) {
        h->loaded[count - 1] = sky;
        h->turns[count - 1] = turn;
    } else if (h->faults) {
        if (!(h->faults[sky] & TOLD))
            log_warning("%s; images go from the sky before it to the one after it", why->text);
        h->faults[sky] = MISSING | TOLD;
    } else {
        h->broken = true;
    }
    return e;
}

/* Whether the window ends with the first `have` of the wanted frames. */
static uint32_t match(const struct held *h, const uint64_t *wanted, uint32_t count)
{
    const uint32_t window = between_count(h->between);

    for (uint32_t have = count < window ? count : window; have > 0; have--) {
        bool same = true;
        for (uint32_t k = 0; k < have; k++)
            same &= h->loaded[window - have + k] == wanted[k];
        if (same)
            return have;
    }
    return 0;
}

/* Whether all wanted frames are in the window already, in whatever place. */
static bool has_all(const struct held *h, const uint64_t *wanted, uint32_t count)
{
    uint32_t found = 0;

    for (uint32_t k = 0; k < between_count(h->between) && found < count; k++)
        found += h->loaded[k] == wanted[found];
    return found == count;
}

/* The frames around a moment, in the window. ERR_END: there is none, or a video has ended. */
static enum err load_around(struct source *s, double moment, struct reason *why)
{
    struct held *h = s->held;
    uint64_t wanted[SUN_MARKS];
    const uint32_t count = choose(h, moment, wanted);
    uint32_t have = has_all(h, wanted, count) ? count : match(h, wanted, count);

    if (count == 0)
        return ERR_END;
    if (have == 0)
        between_forget(h->between);
    for (; have < count; have++) {
        const enum err e = load(s, wanted[have], why);
        if (e == ERR_END && have > 0 && seconds_of(h, wanted[have]) > moment)
            break; /* a video of unknown length: its last frame stays */
        if (e)
            return e;
    }
    s->position = wanted[count > 1 && seconds_of(h, wanted[1]) <= moment ? 1 : 0];
    return ERR_OK;
}

/* Between the turns of the frames around a moment. */
static double turn_at(const struct held *h, double moment)
{
    const uint32_t count = between_count(h->between);
    uint32_t k = 0;

    while (k + 2 < count && between_seconds(h->between, k + 1) <= moment)
        k++;
    const double first = between_seconds(h->between, k);
    if (k + 1 >= count || moment <= first)
        return h->turns[k];
    const double t = fmin(1.0, (moment - first) / (between_seconds(h->between, k + 1) - first));
    return h->turns[k] + t * (h->turns[k + 1] - h->turns[k]);
}

/* A frame that cannot be used is named, and images go across it; if none is left, its error is returned. */
enum err held_next(struct source *s, struct frame *f, struct reason *why)
{
    struct held *h = s->held;
    const uint64_t images = held_count(s);
    enum err e, fault = ERR_OK;

    if ((images > 0 && h->image >= images) || h->broken) {
        if (!s->loop || h->broken)
            return ERR_END;
        h->image = 0;
        begin_pass(h);
    }
    const double moment = moment_of(h, h->image);
    for (e = load_around(s, moment, why); e && e != ERR_END && e != ERR_NOMEM && h->faults;
         e = load_around(s, moment, why))
        fault = e;
    if (e == ERR_END && h->faults && is_missing(h, 0) && neighbour(h, 0, 1) == NONE) {
        h->image++;
        return fault ? fault : err_say(why, ERR_FORMAT, "%s: none of its frames can be read", s->desc.spec);
    }
    if (e)
        return e;
    if (between_show(h->between, moment, f))
        return err_say(why, ERR_NOMEM, "%s: out of memory", s->desc.spec);
    f->turn = fmod(f->turn + turn_at(h, moment), 360.0);
    f->capture_us = is_computed(s) ? clock_wall_us() : 0; /* computed light is as old as its computation */
    f->number = source_first_number(s) * h->hold + h->image;
    h->shown = h->image++;
    return ERR_OK;
}
