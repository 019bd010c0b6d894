#include "light/denoise/accumulation.h"

#include "base/mem.h"

#include <math.h>
#include <string.h>

#define GROUP 128 /* packets, side by side in the image for the most part, that share w */
#define FLOATS ((size_t)3 * PACKET)
#define SOFT 1e-2        /* of relMSE */
#define STEADY 0.25f     /* of the way to what is known under a still sky, in an image without a cache */
#define WEIGHT_MOST 0.98 /* of the cache's light, against the first samples */

struct group { /* sums of V and D */
    double own, off;
};

struct accumulation {
    struct denoiser *denoiser;
    uint32_t packets;
    uint64_t key, turn;  /* images since it began, */
    uint64_t first_turn; /* and before the first one with a cache */
    bool followed;       /* in this image */
    bool moved;          /* the cache's light did, in this image */
    bool has_cache;      /* `cache` is that of the last image */
    bool still;          /* the sky is that of the last image */
    bool slow;           /* this image may begin a glide */
    bool shows;          /* `shown` is light with this key */
    unsigned glide;      /* steps still to take */
    float *half[2];      /* B, [packets][3][16], as what follows */
    float *cache;        /* C of the last image */
    float *shown;        /* P, changed with C */
    float *target;       /* what it moves to: the filter's output, likewise */
    float *final;        /* [packets], as what follows */
    float *count;        /* n; 0: nothing is known, and B is C */
    bool *changed;
    struct group *groups;
    uint32_t *due_index, *beyond_index;
    struct packet_list due, beyond;
    const float *scale; /* what errors are relative to: `shown`, or what the caller gave */
    double soft;        /* 1e-2 mean(scale)^2 */
};

static uint32_t group_count(const struct accumulation *h)
{
    return (h->packets + GROUP - 1) / GROUP;
}

struct accumulation *accumulation_create(const struct gbuffer *g, struct denoiser *denoiser)
{
    struct accumulation *h = mem_alloc(1, sizeof(*h));
    const uint32_t packets = g->packet_count;

    if (!h)
        return NULL;
    h->denoiser = denoiser;
    h->packets = packets;
    for (int k = 0; k < 2; k++)
        h->half[k] = mem_alloc(packets, FLOATS * sizeof(float));
    h->cache = mem_alloc(packets, FLOATS * sizeof(float));
    h->shown = mem_alloc(packets, FLOATS * sizeof(float));
    h->target = mem_alloc(packets, FLOATS * sizeof(float));
    h->final = mem_alloc(packets, sizeof(*h->final));
    h->count = mem_alloc(packets, sizeof(*h->count));
    h->changed = mem_alloc(packets, sizeof(*h->changed));
    h->groups = mem_alloc(group_count(h), sizeof(*h->groups));
    h->due_index = mem_alloc(packets, sizeof(*h->due_index));
    h->beyond_index = mem_alloc(packets, sizeof(*h->beyond_index));
    if (!h->half[0] || !h->half[1] || !h->cache || !h->shown || !h->target || !h->final || !h->count || !h->changed ||
        !h->groups || !h->due_index || !h->beyond_index) {
        accumulation_destroy(h);
        return NULL;
    }
    return h;
}

void accumulation_destroy(struct accumulation *h)
{
    if (!h)
        return;
    mem_free(h->half[0]);
    mem_free(h->half[1]);
    mem_free(h->cache);
    mem_free(h->shown);
    mem_free(h->target);
    mem_free(h->final);
    mem_free(h->count);
    mem_free(h->changed);
    mem_free(h->groups);
    mem_free(h->due_index);
    mem_free(h->beyond_index);
    mem_free(h);
}

float *accumulation_final(struct accumulation *h)
{
    return h->final;
}

bool *accumulation_changed(struct accumulation *h)
{
    return h->changed;
}

const struct packet_list *accumulation_due(const struct accumulation *h)
{
    return &h->due;
}

uint64_t accumulation_turn(const struct accumulation *h)
{
    return h->turn;
}

const struct packet_list *accumulation_beyond(const struct accumulation *h)
{
    return &h->beyond;
}

static void list_packets(struct accumulation *h)
{
    h->due = (struct packet_list){ h->due_index, 0 };
    h->beyond = (struct packet_list){ h->beyond_index, 0 };
    for (uint32_t i = 0; i < h->packets; i++) {
        if (!h->followed || (i % ACCUMULATION_TURNS == h->turn % ACCUMULATION_TURNS && h->final[i] < 1.0f))
            h->due_index[h->due.count++] = i;
        if (h->followed && h->final[i] >= 0.5f)
            h->beyond_index[h->beyond.count++] = i;
    }
}

void accumulation_begin(struct accumulation *h, uint64_t key, bool glides)
{
    if (h->key != key) {
        memset(h->count, 0, h->packets * sizeof(*h->count));
        memset(h->groups, 0, group_count(h) * sizeof(*h->groups));
        h->has_cache = h->shows = false;
    }
    if (h->key != key || !glides)
        h->glide = 0;
    h->key = key;
    h->followed = h->still = h->moved = false;
    h->slow = glides;
    list_packets(h);
}

unsigned accumulation_glides(const struct accumulation *h)
{
    return h->glide;
}

void accumulation_hold(struct accumulation *h, bool still)
{
    h->still = still;
}

/* The cache's light becomes all that is known. */
static void start_anew(struct accumulation *h, size_t at, const float *lo)
{
    memcpy(h->half[0] + at, lo + at, FLOATS * sizeof(float));
    memcpy(h->half[1] + at, lo + at, FLOATS * sizeof(float));
    memcpy(h->shown + at, lo + at, FLOATS * sizeof(float));
    memcpy(h->target + at, lo + at, FLOATS * sizeof(float));
}

/* The mean change of the cache's light by the sky, as a factor. Summed in one order. */
static float mean_change(const struct accumulation *h, const float *lo)
{
    double before[PACKET] = { 0.0 }, now[PACKET] = { 0.0 }, all = 0.0, changed = 0.0;

    for (uint32_t i = 0; i < h->packets && h->has_cache; i++)
        for (size_t at = i * FLOATS; at < (i + 1) * FLOATS && !h->changed[i]; at += PACKET)
            for (size_t k = 0; k < PACKET; k++) {
                before[k] += (double)h->cache[at + k];
                now[k] += (double)lo[at + k];
            }
    for (int k = 0; k < PACKET; k++) {
        all += before[k];
        changed += now[k];
    }
    return all > 0.0 ? (float)(changed / all) : 1.0f;
}

/* b changes as the cache's light does from `was` to `is`, within the range of b, b with the mean change, and `is`. */
static float follow(float b, float was, float is, float mean)
{
    const float even = mean * b;

    return fminf(fmaxf(b + (is - was), fminf(fminf(b, even), is)), fmaxf(fmaxf(b, even), is));
}

void accumulation_follow(struct accumulation *h, const float *lo)
{
    const float mean = mean_change(h, lo);
    bool moved = false;

#pragma omp parallel for schedule(static) reduction(|| : moved)
    for (uint32_t i = 0; i < h->packets; i++) {
        const size_t at = i * FLOATS;
        if (h->final[i] >= 1.0f)
            h->count[i] = 0.0f;
        if (h->count[i] == 0.0f) {
            start_anew(h, at, lo);
        } else if (h->has_cache && !h->changed[i]) {
            for (size_t k = at; k < at + FLOATS; k++) {
                const float was = h->cache[k], b = 0.5f * (h->half[0][k] + h->half[1][k]);
                const float by = follow(b, was, lo[k], mean) - b;
                moved = moved || lo[k] != was;
                h->half[0][k] += by;
                h->half[1][k] += by;
                h->shown[k] = follow(h->shown[k], was, lo[k], mean);
                h->target[k] = follow(h->target[k], was, lo[k], mean);
            }
        }
        memcpy(h->cache + at, lo + at, FLOATS * sizeof(float));
    }
    if (!h->has_cache)
        h->first_turn = h->turn;
    h->followed = h->has_cache = true;
    h->moved = moved;
    list_packets(h);
}

/* Summed in one order. */
static double softness(const struct accumulation *h)
{
    double sum = 0.0;

    for (size_t k = 0; k < h->packets * FLOATS; k++)
        sum += (double)h->scale[k];
    const double mean = sum / (double)(h->packets * FLOATS);
    return SOFT * mean * mean + 1e-30;
}

/* Sums of V and D over a packet. */
static void compare(const struct accumulation *h, uint32_t packet, double *own, double *off)
{
    const float *a = denoiser_half(h->denoiser, 0), *b = denoiser_half(h->denoiser, 1);

    for (size_t k = packet * FLOATS; k < (packet + 1) * FLOATS; k++) {
        const double r = (double)h->scale[k], per = 1.0 / (r * r + h->soft);
        const double apart = (double)a[k] - (double)b[k];
        const double from = 0.5 * ((double)a[k] + (double)b[k] - (double)h->half[0][k] - (double)h->half[1][k]);
        *own += 0.25 * apart * apart * per;
        *off += from * from * per;
    }
}

/* share: V / D. Before the first samples, B is the cache's light, or 0. */
static double weight_of(const struct accumulation *h, uint32_t packet, double share)
{
    const double n = (double)h->count[packet];

    return n > 0.0 ? fmin(n / (n + 1.0), share) : h->followed ? fmin(share, WEIGHT_MOST) : 0.0;
}

static void add_packet(struct accumulation *h, uint32_t packet, double share)
{
    const double w = weight_of(h, packet, share);

    for (int half = 0; half < 2; half++) {
        const float *s = denoiser_half(h->denoiser, half);
        float *to = h->half[half];
        for (size_t k = packet * FLOATS; k < (packet + 1) * FLOATS; k++)
            to[k] = s[k] + (float)w * (to[k] - s[k]);
    }
    h->count[packet] = (float)(1.0 / (1.0 - w));
}

/* due[0 .. count - 1] belong to group g. The means cover all packets of the group, because those of one image are too
 * few. */
static void add_group(struct accumulation *h, uint32_t g, const uint32_t *due, uint32_t count)
{
    const uint32_t all = h->packets - g * GROUP < GROUP ? h->packets - g * GROUP : GROUP;
    const double keep = 1.0 - (double)count / all;
    struct group *sums = &h->groups[g];
    double own = 0.0, off = 0.0;

    for (uint32_t i = 0; i < count; i++)
        if (h->count[due[i]] > 0.0f || h->followed)
            compare(h, due[i], &own, &off);
    sums->own = keep * sums->own + own;
    sums->off = keep * sums->off + off;
    for (uint32_t i = 0; i < count; i++)
        add_packet(h, due[i], sums->own < sums->off && !h->still ? sums->own / sums->off : 1.0);
}

/* The mean light of a moving sky, by colour, before B's groups are compared with the samples: a group's noise hides
 * what all have lost. The correction has the weight of the change against the variance of the samples' sum: that of
 * independent samples or, if more, of the two halves' sums, which have what pixels share. */
static void follow_mean(struct accumulation *h)
{
    const float *a = denoiser_half(h->denoiser, 0), *b = denoiser_half(h->denoiser, 1);
    double now[3] = { 0.0 }, was[3] = { 0.0 }, noise[3] = { 0.0 }, all[3] = { 0.0 };
    float gain[3];

    for (size_t k = 0; k < h->packets * FLOATS; k++) {
        const size_t c = k / PACKET % 3;
        const double apart = (double)a[k] - (double)b[k];
        now[c] += 0.5 * ((double)a[k] + (double)b[k]);
        was[c] += 0.5 * ((double)h->half[0][k] + (double)h->half[1][k]);
        noise[c] += 0.25 * apart * apart;
        all[c] += 0.5 * apart;
    }
    for (int c = 0; c < 3; c++) {
        const double by = now[c] - was[c], variance = fmax(noise[c], all[c] * all[c]);
        const double share = by != 0.0 ? fmax(0.0, 1.0 - variance / (by * by)) : 0.0;
        gain[c] = was[c] > 0.0 ? (float)(1.0 + share * by / was[c]) : 1.0f;
    }
#pragma omp parallel for schedule(static)
    for (size_t k = 0; k < h->packets * FLOATS; k++)
        for (int half = 0; half < 2; half++)
            h->half[half][k] *= gain[k / PACKET % 3];
}

void accumulation_add(struct accumulation *h, const float *scale)
{
    const uint32_t *due = h->due_index;
    const uint32_t groups = group_count(h);
    uint32_t *first = mem_alloc(groups + 1, sizeof(*first));
    uint32_t next = 0;

    if (!first) /* the samples are lost */
        return;
    if (h->shows && !h->followed && !h->still)
        follow_mean(h);
    h->scale = scale ? scale : h->shown;
    h->soft = softness(h);
    for (uint32_t g = 0; g <= groups; g++) {
        while (next < h->due.count && due[next] / GROUP < g)
            next++;
        first[g] = next;
    }
#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t g = 0; g < groups; g++)
        add_group(h, g, due + first[g], first[g + 1] - first[g]);
    mem_free(first);
}

/* In the denoiser's own halves, whose samples are taken. */
static void add_more(struct accumulation *h, const float *const more[2])
{
    for (int k = 0; k < 2; k++) {
        float *to = denoiser_half(h->denoiser, k);
#pragma omp parallel for schedule(static)
        for (size_t i = 0; i < h->packets * FLOATS; i++)
            to[i] = h->half[k][i] + more[k][i];
    }
}

/* Of the way that is left, in a glide's step that begins; 1: all of it. */
static float glide_share(const struct accumulation *h)
{
    const float from = 1.0f - (float)h->glide / ACCUMULATION_GLIDE, to = from + 1.0f / ACCUMULATION_GLIDE;
    const float was = from * from * (3.0f - 2.0f * from), is = to * to * (3.0f - 2.0f * to);

    return h->glide > 1 ? (is - was) / (1.0f - was) : 1.0f;
}

void accumulation_glide(struct accumulation *h, float *lo)
{
    const float step = glide_share(h);

#pragma omp parallel for schedule(static)
    for (size_t k = 0; k < h->packets * FLOATS; k++) {
        h->shown[k] = step < 1.0f ? h->shown[k] + step * (h->target[k] - h->shown[k]) : h->target[k];
        lo[k] = fmaxf(h->shown[k], 0.0f);
    }
    h->glide -= h->glide > 0;
}

/* Likewise, in an image that takes samples and does not glide. shows: light with this key. since: images since the
 * filter ran. */
static float step_of(const struct accumulation *h, bool shows, unsigned since)
{
    if (!h->followed)
        return h->still && shows ? STEADY : 1.0f;
    return h->moved ? 1.0f : 1.0f / (float)(ACCUMULATION_TURNS - since);
}

void accumulation_show(struct accumulation *h, const float *const more[2], float *lo)
{
    const bool shows = h->shows;
    const float *filtered[2];

    for (int k = 0; k < 2; k++)
        filtered[k] = more ? denoiser_half(h->denoiser, k) : h->half[k];
    if (more)
        add_more(h, more);
    const unsigned since = h->followed ? (unsigned)((h->turn - h->first_turn + 1) % ACCUMULATION_TURNS) : 0;
    if (since == 0)
        denoiser_filter(h->denoiser, filtered, h->target);
    h->glide = h->slow && shows && !h->followed ? ACCUMULATION_GLIDE : 0;
    h->shows = true;
    if (h->glide > 0) {
        accumulation_glide(h, lo);
        h->turn++;
        return;
    }
    const float step = step_of(h, shows, since);
#pragma omp parallel for schedule(static)
    for (uint32_t i = 0; i < h->packets; i++) {
        const float f = h->followed ? h->final[i] : 0.0f;
        for (size_t k = i * FLOATS; k < (i + 1) * FLOATS; k++) {
            h->shown[k] = step < 1.0f ? h->shown[k] + step * (h->target[k] - h->shown[k]) : h->target[k];
            const float shown = fmaxf(h->shown[k], 0.0f);
            lo[k] = f > 0.0f ? shown + f * (h->cache[k] - shown) : shown;
        }
    }
    h->turn++;
}

const float *accumulation_half(const struct accumulation *h, int k)
{
    return h->half[k];
}
