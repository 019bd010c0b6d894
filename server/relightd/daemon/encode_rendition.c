#include "relightd/daemon/encode.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "image/codec/encode.h"
#include "image/film/film.h"

#define RENDITIONS_SHARE 0.25 /* of this thread's time, at most, for all renditions: viewers need the rest */

/* The image at the rendition's size. */
struct sized {
    uint32_t width, height;
    const float *rgb;
    const uint8_t *srgb;
    float *scratch; /* to free */
};

static bool is_smaller(const struct server_rendition *r, const struct shaded *in)
{
    return r->width > 0 && r->width < in->header.width;
}

/* False: out of memory. */
static bool resize(struct encode_thread *t, const struct shaded *in, const struct server_rendition *r,
                   struct sized *out)
{
    const uint32_t width = in->header.width, height = in->header.height;

    *out = (struct sized){ width, height, in->rgb, t->display[0], NULL };
    if (!is_smaller(r, in))
        return true;
    out->width = r->width;
    out->height = scale_height(width, height, r->width);
    const size_t count = 3 * (size_t)out->width * out->height;
    out->scratch = mem_alloc_raw(count, sizeof(float) + 1); /* the linear pixels, and behind them those to be shown */
    if (!out->scratch)
        return false;
    uint8_t *shown = (uint8_t *)(out->scratch + count);
    scale_linear(in->rgb, width, height, out->scratch, out->width, out->height);
    encode_display(t, in, out->scratch, out->width, out->height, shown);
    out->rgb = out->scratch;
    out->srgb = shown;
    return true;
}

/* *owned: to free; NULL: *bytes are the encoder's. */
static enum err encode(struct encode_thread *t, const struct sized *s, enum server_image image, int quality,
                       const uint8_t **bytes, size_t *size, uint8_t **owned, struct reason *why)
{
    const struct png_desc png = { .samples = s->srgb, .width = s->width, .height = s->height };
    const struct exr_desc exr = { .rgb = s->rgb, .width = s->width, .height = s->height, .depth = EXR_HALF };

    *owned = NULL;
    if (image == SERVER_JPEG)
        return jpeg_encode(t->jpeg, s->srgb, s->width, s->height, quality, bytes, size);
    const enum err e = image == SERVER_PNG ? png_encode(&png, owned, size, why) : exr_encode(&exr, owned, size, why);
    *bytes = *owned;
    return e;
}

static void publish(struct encode_thread *t, const struct shaded *in, unsigned slot, const struct server_rendition *r,
                    int quality)
{
    const double start = clock_seconds();
    struct protocol_picture header = in->header;
    struct reason why = { "" };
    struct sent_image *p = NULL;
    const uint8_t *bytes;
    struct sized s;
    uint8_t *owned = NULL;
    size_t size;

    t->rendered[slot] = r->serial;
    if (resize(t, in, r, &s) && encode(t, &s, r->image, quality, &bytes, &size, &owned, &why) == ERR_OK) {
        header.format = PROTOCOL_JPEG; /* unused: a rendition goes to no viewer */
        header.width = s.width;
        header.height = s.height;
        header.encoded_us = (uint32_t)(1e6 * (clock_seconds() - start));
        p = image_create(&header, bytes, size);
    }
    if (p) {
        image_set_rendition(p, slot, r->serial);
        server_publish(t->shared->server, p);
    } else {
        log_error("an image for plain HTTP could not be encoded: %s", why.text[0] ? why.text : "out of memory");
    }
    mem_free(owned);
    mem_free(s.scratch);
    t->served[slot].owner = r->owner;
    t->served[slot].at_s = clock_seconds();
    t->renditions_due_s = t->served[slot].at_s + (1.0 / RENDITIONS_SHARE - 1.0) * (t->served[slot].at_s - start);
}

/* When a rendition of that client was made last. */
static double served_s(const struct encode_thread *t, uint32_t owner)
{
    double last = 0.0;

    for (unsigned k = 0; k < SERVER_RENDITIONS; k++)
        last = t->served[k].owner == owner ? fmax(last, t->served[k].at_s) : last;
    return last;
}

static bool is_missing(const struct encode_thread *t, unsigned k, const struct server_rendition *r)
{
    return r->image != SERVER_NO_IMAGE && t->rendered[k] != r->serial;
}

/* Of the missing renditions that can be made, the one whose client, and then which itself, had its turn longest ago;
 * -1: none. */
static int choose(const struct encode_thread *t, const struct shaded *in, const struct server_rendition *all)
{
    int best = -1;

    for (unsigned k = 0; k < SERVER_RENDITIONS; k++) {
        const bool linear = all[k].image == SERVER_EXR || is_smaller(&all[k], in);
        if (!is_missing(t, k, &all[k]) || (linear && !in->rgb) || !(t->display_valid & 1))
            continue;
        const double turn = served_s(t, all[k].owner), other = best < 0 ? INFINITY : served_s(t, all[best].owner);
        if (turn < other || (turn == other && t->served[k].at_s < t->served[best].at_s))
            best = (int)k;
    }
    return best;
}

bool renditions_encode(struct encode_thread *t, const struct shaded *in, const struct server_demand *demand,
                       int quality)
{
    const struct server_rendition *all = demand->renditions;
    bool left = false;

    if (clock_seconds() < t->renditions_due_s)
        return true;
    for (int k; clock_seconds() >= t->renditions_due_s && (k = choose(t, in, all)) >= 0;)
        publish(t, in, (unsigned)k, &all[k], quality);
    for (unsigned k = 0; k < SERVER_RENDITIONS; k++)
        left = left || (is_missing(t, k, &all[k]) && (all[k].image == SERVER_EXR || is_smaller(&all[k], in)));
    return in->rgb || !left;
}
