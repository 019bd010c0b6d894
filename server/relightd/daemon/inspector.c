/* Answers queries about a pixel: where its light comes from (PROTOCOL.md 4.15). The shade thread answers between two
 * images, because it holds the frame; so queries cannot change an image. An answer takes about a tenth of a
 * second, and the server passes on only a few queries per second. */
#include "relightd/daemon/shade.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"

#define SKY_LEAST_S 1.0 /* between two images of the sky alone */

void inspect_report_image(struct shade_thread *t, const struct shaded *image)
{
    struct server *server = t->shared->server;
    struct server_follow followed[SERVER_FOLLOWED_MAX];
    const uint32_t count = server_followed(server, followed);
    const struct protocol_picture *h = &image->header;

    t->last = image;
    for (uint32_t i = 0; i < count; i++) {
        const struct server_follow *f = &followed[i];
        if (f->x >= h->width || f->y >= h->height)
            continue;
        const float *rgb = image->rgb + 3 * ((size_t)f->y * h->width + f->x);
        server_send_radiance(server, f,
                             &(struct server_radiance){ .frame = h->frame,
                                                        .capture_us = h->capture_us,
                                                        .finer = h->flags & PROTOCOL_PICTURE_FINER,
                                                        .rgb = { rgb[0], rgb[1], rgb[2] } });
    }
}

static struct inspector *get_inspector(struct shade_thread *t)
{
    if (!t->inspector)
        t->inspector = inspector_create(t->set, t->shared->config.setup.kernels);
    return t->inspector;
}

/* About the last image, whose frame the shade thread holds. */
static enum err report(struct shade_thread *t, const struct server_inspection *asked, char **text)
{
    const struct shown_image *shown = &t->refine.shown;
    struct relight_desc light = shown->light;
    const struct inspect_request q = { .x = asked->x,
                                       .y = asked->y,
                                       .samples = asked->samples,
                                       .figure = asked->figure,
                                       .sky = asked->sky,
                                       .day = light.has_sun_day ? &light.sun_day : NULL };
    struct probe_lamps lamps;

    *text = NULL;
    if (!get_inspector(t))
        return ERR_NOMEM;
    light.direct.cancel = NULL;
    light.direct.why = NULL;
    light.direct.samples = shown->header.samples > 0 ? shown->header.samples : light.direct.samples;
    lamps_pixel(t, q.x, q.y, &lamps);
    return inspector_report(t->inspector, shown->in->environment, &light, &q, t->last->rgb,
                            lamps_sky(t) ? &lamps : NULL, text);
}

/* The same answer for everyone: a new one at most once a frame and once a second. NULL: out of memory. */
static const char *answer_sky(struct shade_thread *t)
{
    struct sky_answer *a = &t->sky;
    const struct environment *e = t->refine.shown.in->environment;
    const double now = clock_seconds();
    char *text;

    const bool same = a->text && e->number == a->frame && e->rotation == a->rotation;
    if (same || (a->text && now - a->made_s < SKY_LEAST_S))
        return a->text;
    if (!get_inspector(t) || inspector_sky(t->inspector, e, &text))
        return NULL;
    mem_free(a->text);
    *a = (struct sky_answer){ text, e->number, now, e->rotation };
    return text;
}

void inspect_result(struct shade_thread *t)
{
    struct server *server = t->shared->server;
    struct server_inspection asked;
    char *text = NULL;

    if (!t->last && t->cut_s > 0.0) /* a cancelled image is made again, as the viewer still sees the one before */
        return;
    do {
        if (!server_take_inspection(server, &asked))
            return;
        if (asked.sky_alone && t->last)
            server_answer_inspection(server, &asked, answer_sky(t), "out of memory");
    } while (asked.sky_alone && t->last);
    const bool other_view = t->set != t->first_set && !t->refine.known; /* a lockstep image, by the first camera */
    if (!t->last || other_view || asked.x >= t->last->header.width || asked.y >= t->last->header.height) {
        server_answer_inspection(server, &asked, NULL, "there is no image with such a pixel");
        return;
    }
    const enum err e = report(t, &asked, &text);
    if (e)
        log_warning("pixel %u, %u could not be analysed: %s", asked.x, asked.y, err_text(e));
    server_answer_inspection(server, &asked, text, err_text(e));
    mem_free(text);
}

void inspect_finish(struct shade_thread *t)
{
    inspector_destroy(t->inspector);
    mem_free(t->sky.text);
}
