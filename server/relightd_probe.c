/* Where a pixel's light comes from, for whoever asks (PROTOCOL.md 4.15). It is found out between two pictures, on the
 * thread that makes them: that has the frame whose tables are asked about, needs no copy of it and shares nothing with
 * anybody, so that no picture can be changed by it. It takes some hundredths of a second, and only a few are answered
 * in a second. */
#include "relightd.h"

#include "clock.h"
#include "log.h"
#include "mem.h"

#define SKY_LEAST_S 1.0 /* between two pictures of the sky for who asks for it alone */

void daemon_probe_picture(struct daemon *d, const struct shaded *picture)
{
    struct server_follow followed[SERVER_FOLLOWED_MAX];
    const uint32_t count = server_followed(d->server, followed);
    const struct protocol_picture *h = &picture->header;

    d->latest = picture;
    for (uint32_t i = 0; i < count; i++) {
        const struct server_follow *f = &followed[i];
        if (f->x >= h->width || f->y >= h->height)
            continue;
        const float *rgb = picture->rgb + 3 * ((size_t)f->y * h->width + f->x);
        server_tell_radiance(d->server, f,
                             &(struct server_radiance){ .frame = h->frame,
                                                        .capture_us = h->capture_us,
                                                        .finer = h->flags & PROTOCOL_PICTURE_FINER,
                                                        .rgb = { rgb[0], rgb[1], rgb[2] } });
    }
}

/* The picture that was made last was made of the frame of d->still_frame, which is the shade thread's still. */
static enum err report(struct daemon *d, const struct server_probe *asked, char **text)
{
    const struct still_frame *f = &d->still_frame;
    struct relight_desc light = f->light;
    const struct probe_question q = {
        .x = asked->x, .y = asked->y, .samples = asked->samples, .figure = asked->figure, .sky = asked->sky
    };

    *text = NULL;
    if (!d->prober)
        d->prober = prober_create(d->set, d->kernels);
    if (!d->prober)
        return ERR_NOMEM;
    light.direct.cancel = NULL;
    light.direct.why = NULL;
    light.direct.samples = f->header.samples > 0 ? f->header.samples : light.direct.samples;
    return prober_report(d->prober, f->in->environment, &light, &q, d->latest->rgb, text);
}

/* Made once a second at most, and once a frame, for all who ask. */
static const char *sky_alone(struct daemon *d)
{
    const struct environment *e = d->still_frame.in->environment;
    const double now = clock_seconds();
    char *text;

    if (!d->prober)
        d->prober = prober_create(d->set, d->kernels);
    const bool same = d->sky_text && e->number == d->sky_frame && e->rotation == d->sky_rotation;
    if (same || (d->sky_text && now - d->sky_s < SKY_LEAST_S))
        return d->sky_text;
    if (!d->prober || prober_sky(d->prober, e, &text))
        return NULL;
    mem_free(d->sky_text);
    d->sky_text = text;
    d->sky_frame = e->number;
    d->sky_rotation = e->rotation;
    d->sky_s = now;
    return text;
}

/* One pixel's question; the sky is given to all who have asked. */
void daemon_probe_answer(struct daemon *d)
{
    struct server_probe asked;
    char *text = NULL;

    do {
        if (!server_take_probe(d->server, &asked))
            return;
        if (asked.sky_alone && d->latest)
            server_answer_probe(d->server, &asked, sky_alone(d), "out of memory");
    } while (asked.sky_alone && d->latest);
    const bool elsewhere = d->set != d->first_set && !d->still_known; /* a lockstep sequence's, of its own camera */
    if (!d->latest || elsewhere || asked.x >= d->latest->header.width || asked.y >= d->latest->header.height) {
        server_answer_probe(d->server, &asked, NULL, "there is no picture with such a pixel");
        return;
    }
    const enum err e = report(d, &asked, &text);
    if (e)
        log_warning("pixel %u, %u could not be looked into: %s", asked.x, asked.y, err_text(e));
    server_answer_probe(d->server, &asked, text, err_text(e));
    mem_free(text);
}
