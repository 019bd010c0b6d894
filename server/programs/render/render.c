#include "programs/render/render.h"

#include "base/clock.h"
#include "base/file_store.h"
#include "base/log.h"
#include "base/mem.h"
#include "light/frame/part.h"
#include "sky/daylight/sky.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <string.h>

#define PAID_BACK_IN 8.0 /* frames: what a frame of --fps took beyond its share */
#define RATE 30.0        /* frames per second of a video file if neither flag nor source sets it */

/* What would fail after the work is found out before it. */
static enum err open_outputs(struct render *r, struct reason *why)
{
    const struct render_desc *d = &r->desc;
    enum err e = ERR_OK;

    struct output_desc output = d->output;
    if (output.rate <= 0.0)
        output.rate = source_rate(r->source) > 0.0 ? source_rate(r->source) : RATE;
    if (output.pattern && !(render_collects(r) && ranks_index(d->ranks) > 0)) /* these may not see its folder */
        e = output_create(&output, d->setup.set_desc.width, d->setup.set_desc.height, &r->output, why);
    if (!e && r->output && !output_is_numbered(r->output) && source_count(r->source) > 1)
        e = err_say(why, ERR_USAGE,
                    "--out '%s' takes one file, but the source has %" PRIu64
                    " frames: add %%04d for the frame number, or select one with --frames",
                    d->output.pattern, source_count(r->source));
    if (!e && output.pattern && source_count(r->source) == 1 && source_kind(r->source) == SOURCE_FILES &&
        output_is_movie(r->output))
        log_warning("--out %s: a video of one image: %s is one frame", d->output.pattern, d->setup.source_desc.spec);
    if (!e)
        e = render_changes_create(r, why);
    if (!e)
        e = render_check_shared(r, why);
    if (e || !d->stats_path || ranks_index(d->ranks) > 0)
        return e;
    r->stats = strcmp(d->stats_path, "-") == 0 ? stdout : file_rewrite(d->stats_path);
    if (!r->stats)
        return err_say(why, ERR_IO, "%s: %s", d->stats_path, strerror(errno));
    fputs("[", r->stats);
    return ERR_OK;
}

static enum err open_source(struct render *r, struct reason *why)
{
    struct source_desc one = r->desc.setup.source_desc;
    enum err e = source_open(&one, &r->source, why);

    if (!e && source_count(r->source) == 0 && !one.frames.given &&
        source_kind(r->source) != SOURCE_VIDEO) { /* a sky has no last frame: take its first */
        source_close(r->source);
        one.frames.given = true;
        e = source_open(&one, &r->source, why);
    }
    const enum source_kind kind = e ? SOURCE_FILES : source_kind(r->source);
    if ((kind == SOURCE_WATCH || kind == SOURCE_LIVE) && between_is_used(&one.between))
        return err_say(why, ERR_USAGE,
                       "%s: --hold, --deflicker, --sun and --align are for files, videos and computed skies here, and "
                       "for relightd",
                       one.spec);
    return e;
}

/* The part of the scene's own lamps, which all frames share. */
static enum err light_lamps(struct render *r, struct reason *why)
{
    const struct setup *s = &r->desc.setup;
    const struct relight_lamps_desc desc = { r->set, s->lamp_samples, s->light.direct.seed, s->light.denoise,
                                             s->kernels };

    if (!(s->initial.lamps > 0.0))
        return ERR_OK;
    const enum err e = relight_lamps_create(&desc, &r->lamps, why);
    return e || !r->lamps ? e : relight_lamps_complete(r->lamps, s->set_desc.progress, why);
}

/* Images without the background. */
static enum err keep_alpha(struct render *r, struct reason *why)
{
    const struct prepared_scene_desc *d = &r->desc.setup.set_desc;

    if (!(r->set->scene->ground.radius > 0.0f))
        return err_say(why, ERR_USAGE, "--alpha is for scenes with a ground: add --ground");
    r->rgba = mem_alloc((size_t)d->width * d->height, 4 * sizeof(float));
    if (!r->rgba || relighter_keep_backplate(r->relighter))
        return err_say(why, ERR_NOMEM, "no memory for images of %ux%u with alpha", d->width, d->height);
    return ERR_OK;
}

static enum err set_up(struct render *r, struct reason *why)
{
    struct render_desc *d = &r->desc;
    enum err e = open_source(r, why);

    if (!e)
        e = open_outputs(r, why);
    if (!e)
        e = set_create(&d->setup.set_desc, &r->set, why);
    if (e)
        return e;
    setup_report_unused(&d->setup, r->set);
    if (!d->ranks && (d->split || d->collect))
        log_warning("--%s has no effect in one process: mpirun starts several", d->split ? "split-frames" : "collect");
    r->relighter = relighter_create(r->set, d->setup.kernels);
    d->setup.environment.lean = d->setup.light.direct.method == METHOD_CACHED;
    r->environment = environment_create(&d->setup.environment);
    r->inspector = d->inspection ? inspector_create(r->set, d->setup.kernels) : NULL;
    r->rgb = mem_alloc((size_t)d->setup.set_desc.width * d->setup.set_desc.height, 3 * sizeof(float));
    if (!r->relighter || !r->environment || !r->rgb || (d->inspection && !r->inspector))
        return err_say(why, ERR_NOMEM, "no memory for images of %ux%u", d->setup.set_desc.width,
                       d->setup.set_desc.height);
    e = light_lamps(r, why);
    if (!e)
        e = render_calibrate(r, why);
    if (!e && d->output.alpha)
        e = keep_alpha(r, why);
    if (!e && d->layers)
        e = render_layers_create(r, why);
    if (!e)
        e = render_expose(r, why);
    if (e)
        return e;
    d->setup.light.direct.why = why;
    return ERR_OK;
}

static enum err prepare_light(struct render *r, struct reason *why)
{
    struct render_desc *d = &r->desc;

    d->setup.light.direct.why = why;
    if (d->target.seconds > 0.0 || d->target.error > 0.0)
        return ERR_OK;
    return decider_prepare(&r->decider, r->relighter, d->setup.allow_bias, d->setup.set_desc.progress, &d->setup.light,
                           &r->cache_ms);
}

/* Ranks compute a cache together: at the same time, or when rank 0 tells those that serve it. */
static enum err prepare(struct render *r, struct reason *why)
{
    enum err e = ranks_agree(r->desc.ranks, set_up(r, why), why);

    if (e)
        return e;
    if (r->desc.ranks && r->desc.split)
        return render_split_begin(r, why);
    if (r->desc.ranks) {
        r->share = team_share(r->desc.ranks);
        relighter_share(r->relighter, &r->share);
    }
    e = ranks_agree(r->desc.ranks, prepare_light(r, why), why);
    return e ? e : render_collect_begin(r, why);
}

struct frame_request render_request(const struct render *r, const struct frame *frame, struct relight_desc *light)
{
    const uint64_t done = r->rendered + r->refused + 1, all = source_count(r->source);
    struct frame_request q = {
        .asked = light,
        .target = r->desc.target,
        .frames_left = all > done ? all - done : 0,
        .allow_bias = r->desc.setup.allow_bias,
        .no_cache = all <= done,
    };

    light->direct.pass = r->desc.setup.reseed ? frame->number : 0;
    light->turn = frame->number;
    if (q.target.seconds > 0.0) {
        const double left = all ? (double)q.frames_left + 1.0 : PAID_BACK_IN;
        const double owed_s = r->owed_s / fmin(left, PAID_BACK_IN) + r->beside_s; /* by reading and writing, too */
        q.target.seconds *= fmin(2.0, fmax(0.2, 1.0 - owed_s / q.target.seconds));
    }
    return q;
}

void render_decode(struct environment *e, const struct frame *frame, struct decoding *out)
{
    double start = clock_seconds();

    out->result = environment_decode(e, frame, &out->why);
    out->ms[0] = 1e3 * (clock_seconds() - start);
    start = clock_seconds();
    if (!out->result)
        out->result = environment_rebuild(e, &out->why);
    out->ms[1] = 1e3 * (clock_seconds() - start);
}

static enum err print_inspection(struct render *r, struct reason *why)
{
    struct inspect_request q = *r->desc.inspection;
    struct probe_lamps lamps = { .scale = r->desc.setup.initial.lamps };
    const struct sky_desc *sky = source_sky(r->source);
    struct source_place place = { .day = 0 };
    const bool placed = source_place(r->source, &place);
    struct sun_day day = sky ? sky_day(sky, r->environment->number) : place.sun_day;

    day.turn += r->environment->rotation;
    q.day = sky || placed ? &day : NULL;
    relight_lamps_pixel(r->lamps, q.x, q.y, lamps.rgb);
    return inspector_print(r->inspector, r->environment, &r->request.light, &q, r->rgb, r->lamps ? &lamps : NULL, why);
}

/* What a frame of --fps took beyond its share is owed by the next ones. Warns where the time is too short. */
static void keep_to_rate(struct render *r, const struct pilot_stats *pilot, double spent_s)
{
    const double frame_s = r->desc.target.seconds;

    if (!(frame_s > 0.0))
        return;
    const bool late = pilot->seconds > frame_s && !pilot->in_time;
    r->owed_s += spent_s - frame_s;
    if (pilot->denoised && !r->warned_denoised)
        log_warning("--fps: %.3g s a frame pay for few samples, so the light is denoised, which is biased", frame_s);
    if (late && !r->warned_late)
        log_warning("--fps: the fewest samples take %.3g s, which is more than %.3g s a frame: frames take longer",
                    pilot->seconds, frame_s);
    r->warned_denoised |= pilot->denoised;
    r->warned_late |= late;
}

/* Renders one frame that was read: refused frames are reported and skipped, and the sequence continues. */
static enum err render_frame(struct render *r, struct reason *why)
{
    struct relight_stats stats;
    struct pilot_stats pilot = { 0 };

    if (!r->decoded)
        render_decode(r->environment, &r->frame, &r->decoding);
    enum err e = r->decoding.result;
    if (e) {
        *why = r->decoding.why;
        log_error("%s", why->text);
        r->refused++;
        return e == ERR_NOMEM ? e : ERR_OK;
    }
    environment_report(r->environment, &r->said);
    if (r->unmetered)
        e = render_meter(r, why);
    if (e)
        return e;
    r->unmetered = false;
    r->desc.setup.light.direct.why = why;
    r->request = render_request(r, &r->frame, &r->desc.setup.light);
    decide(&r->decider, &r->request);
    const double begun_s = clock_seconds();
    e = r->layers ? render_layers_run(r, &stats)
                  : decider_run(&r->decider, r->relighter, r->environment, &r->request, r->rgb, &stats, &pilot);
    if (e)
        return e == ERR_NOMEM ? err_say(why, e, "%s: no memory for the light samples", r->frame.name) : e;
    relight_lamps_add(r->lamps, r->desc.setup.initial.lamps, r->rgb);
    const double start = clock_seconds();
    if (render_deals(r)) /* the number arrives meanwhile */
        ranks_ask(r->desc.ranks);
    e = render_changes(r, &stats, why);
    if (e)
        return e;
    if (r->rgba)
        relighter_split(r->relighter, r->environment, r->rgb, r->rgba);
    if (r->output)
        e = output_write(r->output, r->rgb, r->rgba, r->frame.number, why);
    if (!e && render_collects(r))
        e = ranks_index(r->desc.ranks) > 0 ? render_collect_post(r, why) : render_collect_take(r, false, why);
    const double ms[3] = { r->decoding.ms[0], r->decoding.ms[1], 1e3 * (clock_seconds() - start) };
    const double beside_s = 1e-3 * (ms[0] + ms[1] + ms[2]);
    keep_to_rate(r, &pilot, beside_s + start - begun_s);
    if (r->rendered > 0) /* the first makes tables that stay */
        r->beside_s += (r->rendered > 1 ? 0.3 : 1.0) * (beside_s - r->beside_s);
    if (!e && r->inspector)
        e = print_inspection(r, why);
    if (!e && r->desc.stats_path)
        e = render_note(r, render_stats_text(r, &stats, &pilot, ms)) ? err_say(why, ERR_NOMEM, "out of memory")
                                                                     : ERR_OK;
    if (!e)
        decider_learn(&r->decider, r->relighter, &r->request, &stats, &pilot);
    r->rendered += !e;
    return e;
}

static enum err render_all(struct render *r, struct reason *why)
{
    enum err e = ERR_OK;

    r->desc.setup.light.progress = &r->line;
    progress_begin(&r->line, "rendering", source_count(r->source), ranks_index(r->desc.ranks) == 0 ? stderr : NULL);
    while (!e) {
        e = render_take(r, why);
        if (e == ERR_END)
            break;
        if (e && source_gave_up(r->source)) {
            break;
        } else if (e) {
            log_error("%s", why->text);
            r->refused++;
            e = ERR_OK;
        } else if (r->frame.kind == FRAME_NONE) {
            continue; /* a quiet watched folder, or a live stream that does not come yet */
        } else if (render_is_kept(r, &r->frame)) {
            r->kept++;
        } else {
            e = render_frame(r, why);
        }
        progress_step(&r->line, render_deals(r) ? r->position + 1 - r->line.done : 1); /* of all ranks */
    }
    progress_end(&r->line);
    e = e == ERR_END ? ERR_OK : e;
    if (e && render_deals(r))
        ranks_stop(r->desc.ranks);
    e = render_collect_end(r, e, why);
    if (e)
        return e;
    return r->output ? output_finish(r->output, why) : ERR_OK;
}

/* "wrote day.%03d.png: 10 images of 640x360 in 12.3 s, exposure -0.3 EV". */
static void tell_written(const struct render *r, uint64_t rendered)
{
    const struct output_desc *d = &r->desc.output;
    char exposure[40] = "", count[40];

    if (output_is_exposed(r->output))
        snprintf(exposure, sizeof(exposure), ", exposure %+.1f EV", output_exposure(r->output) + 0.0);
    snprintf(count, sizeof(count), "%" PRIu64 " image%s", rendered, rendered == 1 ? "" : "s");
    log_info("wrote %s: %s of %ux%u in %.3g s%s", strcmp(d->pattern, "-") == 0 ? "standard output" : d->pattern, count,
             r->desc.setup.set_desc.width, r->desc.setup.set_desc.height, clock_seconds() - r->begun_s, exposure);
}

/* Says what all ranks did. Frames that were refused are an error, after all others are done. */
static enum err sum_up(struct render *r, enum err e, struct reason *why)
{
    struct ranks *ranks = r->desc.ranks;

    e = ranks_agree(ranks, e, why);
    const uint64_t rendered = ranks_sum(ranks, r->rendered), refused = ranks_sum(ranks, r->refused),
                   kept = ranks_sum(ranks, r->kept);
    if (r->desc.resume && kept > 0 && ranks_index(ranks) == 0)
        log_info("%" PRIu64 " existing images are kept, %" PRIu64 " are new", kept, rendered);
    if (!e && rendered > 0 && r->output && ranks_index(ranks) == 0)
        tell_written(r, rendered);
    if (!e && refused)
        return err_say(why, ERR_FORMAT, "%" PRIu64 " of %" PRIu64 " frames could not be used (named above)", refused,
                       refused + rendered + kept);
    return e;
}

static enum err finish(struct render *r, enum err e, struct reason *why)
{
    const enum err joined = render_join(r, why);

    e = e ? e : joined;
    if (r->stats) {
        fputs("\n]\n", r->stats);
        const bool failed = fflush(r->stats) != 0 || ferror(r->stats);
        if (r->stats != stdout)
            fclose(r->stats);
        if (failed && !e)
            e = err_say(why, ERR_IO, "%s: cannot be written", r->desc.stats_path);
    }
    frame_finish(&r->frame);
    frame_finish(&r->ahead.frame);
    mem_free(r->rgb);
    mem_free(r->rgba);
    mem_free(r->texts.at);
    mem_free(r->existing);
    output_destroy(r->output);
    output_destroy(r->maps);
    changes_finish(&r->changes);
    render_layers_destroy(r->layers);
    environment_destroy(r->environment);
    environment_destroy(r->ahead.environment);
    inspector_destroy(r->inspector);
    decider_finish(&r->decider);
    relight_lamps_destroy(r->lamps);
    team_destroy(r->team);
    relighter_destroy(r->relighter);
    set_destroy(r->set);
    source_close(r->source);
    return e;
}

enum err render_sequence(const struct render_desc *desc, struct reason *why)
{
    struct render r = { .desc = *desc, .begun_s = clock_seconds() };
    enum err e = prepare(&r, why);

    if (e)
        return finish(&r, e, why);
    if (r.team && ranks_index(desc->ranks) > 0) {
        e = team_serve(r.team, why);
    } else {
        e = r.team ? prepare_light(&r, why) : ERR_OK;
        if (!e)
            e = render_all(&r, why);
    }
    team_destroy(r.team);
    r.team = NULL;
    e = sum_up(&r, e, why);
    return finish(&r, e, why);
}
