/* --exposure auto: measures one value for the whole sequence, before the first image.
 *
 * The measured image is a rough one of the metering frame, whose settings are fixed here: few pixels, few samples,
 * denoised, a seed of its own. So it costs the same for all sizes and sample counts, and the value depends on scene,
 * camera, sky and --paths alone: not on the frames that are rendered, nor on method, samples or seed. */
#include "programs/render/render.h"

#include "base/luminance.h"
#include "base/mem.h"
#include "sky/tables/irradiance.h"

#include <math.h>
#include <string.h>

#define SIDE 160 /* pixels of the longer side, at most */
#define SAMPLES 8
#define PARTICLES 50000 /* where there are mirrors or glass */

static enum err light_image(const struct render *r, const struct prepared_scene *set, float *rgb, struct reason *why)
{
    const struct setup *s = &r->desc.setup;
    const struct relight_desc light = {
        .direct = { .method = METHOD_AUTO,
                    .samples = SAMPLES,
                    .no_visibility = s->light.direct.no_visibility,
                    .why = why },
        .classes = s->light.classes,
        .particles = PARTICLES,
        .eye_paths = 2,
        .denoise = true,
    };
    const struct relight_lamps_desc lamps_desc = { .set = set, .samples = SAMPLES };
    struct relighter *relighter = relighter_create(set, s->kernels);
    struct relight_lamps *lamps = NULL;
    struct relight_stats stats;
    enum err e = relighter ? relighter_run(relighter, r->environment, &light, rgb, &stats) : ERR_NOMEM;

    if (!e && s->initial.lamps > 0.0)
        e = relight_lamps_create(&lamps_desc, &lamps, why);
    if (!e && lamps)
        e = relight_lamps_complete(lamps, false, why);
    relight_lamps_add(lamps, s->initial.lamps, rgb);
    relight_lamps_destroy(lamps);
    relighter_destroy(relighter);
    return e == ERR_NOMEM ? err_say(why, e, "out of memory for the exposure") : e;
}

/* By the frame that r->environment holds. */
enum err render_meter(struct render *r, struct reason *why)
{
    struct prepared_scene_desc desc = r->desc.setup.set_desc;
    const double side = fmax(desc.width, desc.height), scale = fmin(SIDE / side, 1.0);
    struct exposure exposure;
    struct prepared_scene *set = NULL;

    desc.width = (uint32_t)fmax(1.0, round(scale * desc.width));
    desc.height = (uint32_t)fmax(1.0, round(scale * desc.height));
    desc.every_pixel = false;
    desc.edge_rays = 0;
    enum err e = set_create_view(r->set, &desc, NULL, &set, why);
    float *rgb = e ? NULL : mem_alloc((size_t)desc.width * desc.height, 3 * sizeof(float));
    if (!e)
        e = rgb ? light_image(r, set, rgb, why) : err_say(why, ERR_NOMEM, "out of memory for the exposure");
    if (!e) {
        exposure_init(&exposure);
        output_fix_exposure(r->output, log2(exposure_step(&exposure, rgb, desc.width, desc.height, 1)));
    }
    mem_free(rgb);
    set_destroy(set);
    return e;
}

/* Reads and decodes one frame of the source. ERR_END: there is no further one. */
static enum err load_next(struct render *r, struct source *source, struct reason *why)
{
    enum err e = source_next(source, &r->frame, why);

    if (!e && r->frame.kind == FRAME_NONE)
        return ERR_END;
    if (!e)
        e = environment_decode(r->environment, &r->frame, why);
    return e ? e : environment_rebuild(r->environment, why);
}

static enum err meter_first(struct render *r, struct reason *why)
{
    struct source_desc desc = r->desc.setup.source_desc;
    struct source *source = NULL;
    struct reason cause = { "" }; /* of the frame that was passed over last */
    enum err e;

    desc.frames =
        (struct setting_frames){ r->desc.exposure_frame_given, r->desc.exposure_frame, r->desc.exposure_frame };
    e = source_open(&desc, &source, why);
    if (!e) {
        /* An unreadable first frame is passed over, as in the sequence, where it is reported. */
        do
            e = load_next(r, source, &cause);
        while (e && e != ERR_END && e != ERR_NOMEM && !desc.frames.given);
        /* The fault of a single file says it all. */
        if (e == ERR_END && strncmp(cause.text, desc.spec, strlen(desc.spec)) == 0)
            e = err_say(why, ERR_IO, "%s", cause.text);
        else if (e == ERR_END)
            e = err_say(why, ERR_IO, "%s: no frame to take the exposure from%s%s", desc.spec, cause.text[0] ? ": " : "",
                        cause.text);
        else if (e)
            *why = cause;
    }
    source_close(source);
    return e ? e : render_meter(r, why);
}

/* --exposure auto uses the source's first frame, whichever frames --frames selects; of a source that cannot be read
 * twice, from the first frame that comes. */
enum err render_expose(struct render *r, struct reason *why)
{
    const double stops = r->desc.setup.initial.exposure_stops;

    if (!r->output || !output_is_exposed(r->output))
        return ERR_OK;
    if (stops < EXPOSURE_FOLLOW)
        output_fix_exposure(r->output, stops);
    r->unmetered = stops == EXPOSURE_AUTO;
    if (!r->unmetered || !source_seek(r->source, 0))
        return r->desc.exposure_frame_given
                   ? err_say(why, ERR_USAGE, "--exposure-frame does not work with --source %s: its frames come once",
                             r->desc.setup.source_desc.spec)
                   : ERR_OK;
    r->unmetered = false;
    return meter_first(r, why);
}

/* ---- --calibrate ---- */

enum err render_calibrate(struct render *r, struct reason *why)
{
    struct environment_desc *d = &r->desc.setup.environment;
    const uint32_t n = r->environment->n;
    struct frame frame = { .kind = FRAME_NONE };
    double rgb[3];

    if (!(r->desc.calibrate_lux > 0.0))
        return ERR_OK;
    double *weights = mem_alloc((size_t)2 * n * n, sizeof(*weights));
    enum err e =
        weights ? source_first(&r->desc.setup.source_desc, &frame, why) : err_say(why, ERR_NOMEM, "out of memory");
    if (!e)
        e = environment_update(r->environment, &frame, why);
    if (!e) {
        irradiance_weights(n, weights);
        irradiance_upward(r->environment, weights, rgb);
        const double lux = LUMINOUS_EFFICACY * luminance_of(r->desc.weights, rgb);
        if (!(lux > 0.0 && isfinite(lux)))
            e = err_say(why, ERR_RANGE, "--calibrate: %s has no light from above", frame.name);
        else
            d->scale_stops += log2(r->desc.calibrate_lux / lux);
        d->calibrated = !e;
    }
    environment_configure(r->environment, d);
    mem_free(weights);
    frame_finish(&frame);
    return e;
}
