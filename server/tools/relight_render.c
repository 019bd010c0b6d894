/* server/tools/relight_render.c */
/* Renders the frames of a source to files: the rooms of relightd without a network, for scripts and for tests. */
#include "buyer.h"
#include "clock.h"
#include "components.h"
#include "environment.h"
#include "exr_write.h"
#include "file_pattern.h"
#include "file_store.h"
#include "film.h"
#include "jpeg.h"
#include "light_options.h"
#include "log.h"
#include "mem.h"
#include "options.h"
#include "pilot.h"
#include "probe_options.h"
#include "progress.h"
#include "relight.h"
#include "sky.h"
#include "source.h"

#include <errno.h>
#include <inttypes.h>
#include <jansson.h>
#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

struct render {
    struct relight_desc light;
    struct environment_desc environment_desc;
    struct file_pattern out;
    struct components_desc components; /* out.text NULL: they are not asked for */
    const char *stats_path;
    struct probe_question question; /* about a pixel, where one is asked */
    bool probing, reseed, half;
    enum tone_curve tone;
    int quality;

    const struct kernels *kernels;
    struct source *source;
    struct set *set;
    struct relighter *relighter; /* or, where a time or an error is wished for and until the cache takes its place, */
    struct pilot *pilot;
    struct pilot_wish wish;
    struct buyer buyer; /* of the cache that auto may take */
    double cache_ms;    /* of computing or loading what --method cached needs, once */
    double beside_s;    /* of a frame, what is not light: reading and writing it, smoothed */
    struct environment *environment;
    struct jpeg_encoder *jpeg;
    struct prober *prober;
    struct exposure exposure;
    float *rgb;
    uint8_t *display;
    FILE *stats;
    struct frame frame;
    uint64_t rendered, refused;
    bool warned_clipped;
};

static const char source_default[] = "sky:", scale_default[] = "0";

static struct option_row rows[] = {
    { "", NULL, "what is lit, and by what", NULL },
    { "scene", "FILE", "scene to light: .json, .gltf or .glb; left out: the built-in one", NULL },
    { "camera", "NAME", "camera of the scene; left out: the first", NULL },
    { "source", "S", "a file, a directory, a printf or glob pattern, or sky:key=value,...", source_default },
    { "frames", "A-B", "only the frames with these numbers (one number: that frame)", NULL },
    { "layout", "L", "of the environment: auto, latlong, latlong-bottom, cube, hcross, vcross, ball, fisheye", "auto" },
    { "rotate", "DEGREES", "turns the environment about the vertical axis", "0" },
    { "scale", "STOPS", "makes the environment 2^STOPS times as bright", scale_default },
    { "", NULL, "how", NULL },
    { "size", "WxH", "of the pictures, in pixels", "640x360" },
    { "fps", "N", "with --method auto: the least error at N frames a second, files and all; for --samples", NULL },
    { "error", "E", "with --method auto: the least time for this error (relMSE); with --fps: within its time", NULL },
    { "reseed", NULL, "other random numbers in each frame, so that the noise moves", NULL },
    { "edge-rays", "K", "K x K camera rays where geometry has edges, 1 to 16", "4" },
    { "every-pixel", NULL, "K x K camera rays in all pixels", NULL },
    { "cpu", "LEVEL", "v3, v4 or baseline; left out: the best this CPU has", NULL },
    { "threads", "N", "at most; 0: as many as there are processors", "0" },
    { "", NULL, "what comes out", NULL },
    { "out", "PATTERN",
      "a name with %d or %04d for the frame's number, else one frame; .exr (linear) or .jpg (tone-mapped)", NULL },
    { "half", NULL, "EXR of 16-bit floats instead of 32", NULL },
    { "tone", "CURVE", "of .jpg: filmic, reinhard or linear", "filmic" },
    { "quality", "Q", "of .jpg, 1 to 100", "92" },
    { "components", "PATTERN",
      "instead of pictures under a source: one .hdr for each patch of Radiance's sky, for dctimestep; DIR/%03d.hdr",
      NULL },
    { "reinhart", "MF", "of --components: patches of Reinhart's subdivision; 1 (146), 2 (578) or 4 (2306)", "1" },
    { "probe", "X,Y",
      "where that pixel's light comes from, as JSON, one object a line and frame; --out may be left out then", NULL },
    { "probe-samples", "N", "of --probe: samples, 1 to 256; left out: --samples, held to that", NULL },
    { "probe-preset", "P", "of --probe: fig1, as that figure of Lu, Pacanowski and Granier 2013 was made", NULL },
    { "stats", "FILE", "statistics as JSON, one object a frame ('-': standard output)", NULL },
    { NULL, NULL, NULL, NULL },
};
static struct option_row light_rows[LIGHT_OPTIONS];

static bool ends_with(const char *text, const char *end)
{
    const size_t a = strlen(text), b = strlen(end);
    return a >= b && strcmp(text + a - b, end) == 0;
}

static const char samples_default[] = "64";

/* Whoever wishes for a time or an error does not count samples. */
static enum err read_wish(const struct options *o, struct render *r, struct reason *why)
{
    double fps = 0.0;
    enum err e = ERR_OK;

    if (options_get(o, "fps"))
        e = options_double(o, "fps", 1e-4, 1000.0, &fps, why);
    if (!e && options_get(o, "error"))
        e = options_double(o, "error", 1e-9, 10.0, &r->wish.error, why);
    if (e || (fps <= 0.0 && r->wish.error <= 0.0))
        return e;
    if (fps > 0.0)
        r->wish.seconds = 1.0 / fps;
    if (r->light.direct.method != METHOD_AUTO)
        return err_say(why, ERR_USAGE, "--fps and --error are for --method auto, not for %s",
                       method_name(r->light.direct.method));
    if (options_get(o, "samples") != samples_default)
        return err_say(why, ERR_USAGE, "--samples says how many samples are taken; --fps and --error leave that open");
    return ERR_OK;
}

/* Where pictures go, or components in their stead, which know no source, no frames and no wish. */
static enum err read_out(const struct options *o, struct render *r, struct reason *why)
{
    static const char *const others[] = { "out", "frames", "stats", "fps", "error", "reseed", "half" };
    const char *out = options_get(o, "out");

    if (options_get(o, "components")) {
        for (size_t k = 0; k < sizeof(others) / sizeof(others[0]); k++)
            if (options_get(o, others[k]))
                return err_say(why, ERR_USAGE, "--%s has no meaning with --components", others[k]);
        if (options_get(o, "source") != source_default)
            return err_say(why, ERR_USAGE, "--source has no meaning with --components, which are for all skies");
        if (options_get(o, "scale") != scale_default)
            return err_say(why, ERR_USAGE, "--scale has no meaning with --components: a patch has a radiance of 1");
        return components_read(o, &r->components, why);
    }
    if (!out && r->probing)
        return ERR_OK;
    if (!out)
        return err_say(why, ERR_USAGE, "--out is missing: where the pictures go, as --out DIR/picture.%%04d.exr");
    const enum err e = file_pattern_parse(out, "--out", &r->out, why);
    if (!e && !ends_with(out, ".exr") && !ends_with(out, ".jpg"))
        return err_say(why, ERR_USAGE, "--out '%s' must end in .exr or .jpg", out);
    return e;
}

static enum err read_options(const struct options *o, struct render *r, struct source_desc *source,
                             struct set_desc *set, struct reason *why)
{
    uint64_t edge = 0, quality = 0, threads = 0;
    enum err e = light_options_read(o, &r->light, set, &r->environment_desc, why);

    if (!e)
        e = options_size(o, "size", &set->width, &set->height, why);
    if (!e)
        e = probe_options_read(o, set->width, set->height, &r->probing, &r->question, why);
    if (!e)
        e = read_out(o, r, why);
    if (!e)
        e = options_range(o, "frames", &source->has_range, &source->first, &source->last, why);
    if (!e)
        e = options_u64(o, "edge-rays", 1, 16, &edge, why);
    if (!e)
        e = options_u64(o, "quality", 1, 100, &quality, why);
    if (!e)
        e = options_u64(o, "threads", 0, 1024, &threads, why);
    if (!e)
        e = options_double(o, "rotate", -3600.0, 3600.0, &r->environment_desc.rotation_degrees, why);
    if (!e)
        e = options_double(o, "scale", -60.0, 60.0, &r->environment_desc.scale_stops, why);
    if (!e)
        e = layout_parse(options_get(o, "layout"), &r->environment_desc.layout, why);
    if (!e)
        e = tone_parse(options_get(o, "tone"), &r->tone, why);
    if (!e)
        e = kernels_select(options_get(o, "cpu"), &r->kernels, why);
    if (!e)
        e = read_wish(o, r, why);
    r->reseed = options_on(o, "reseed");
    r->half = options_on(o, "half");
    r->quality = (int)quality;
    r->stats_path = options_get(o, "stats");
    set->scene = options_get(o, "scene");
    set->camera = options_get(o, "camera");
    set->edge_rays = (uint32_t)edge;
    set->every_pixel = options_on(o, "every-pixel");
    set->progress = true;
    source->spec = options_get(o, "source");
    if (threads)
        omp_set_num_threads((int)threads);
    return e;
}

/* What would fail after the work is found out before it. */
static enum err check_outputs(struct render *r, struct reason *why)
{
    const char *out = r->out.text, *slash = out ? strrchr(out, '/') : NULL;
    char folder[4096];

    snprintf(folder, sizeof(folder), "%.*s", slash ? (int)(slash - out) + 1 : 1, slash ? out : ".");
    if (out && access(folder, W_OK) != 0)
        return err_say(why, ERR_IO, "--out '%s': %s", out, strerror(errno));
    if (r->stats_path) {
        r->stats = strcmp(r->stats_path, "-") == 0 ? stdout : fopen(r->stats_path, "w");
        if (!r->stats)
            return err_say(why, ERR_IO, "%s: %s", r->stats_path, strerror(errno));
        fputs("[", r->stats);
    }
    return ERR_OK;
}

static enum err set_up(struct render *r, const struct source_desc *source, const struct set_desc *set,
                       struct reason *why)
{
    struct source_desc one = *source;
    enum err e = source_open(&one, &r->source, why);

    if (!e && source_count(r->source) == 0 && !source->has_range) { /* a sky has no last frame: take its first */
        source_close(r->source);
        one.has_range = true;
        e = source_open(&one, &r->source, why);
    }
    if (!e && r->out.text && !r->out.length && source_count(r->source) > 1)
        e = err_say(why, ERR_USAGE,
                    "--out '%s' names one file, but the source has %" PRIu64
                    " frames: put %%04d into it, or choose one by --frames",
                    r->out.text, source_count(r->source));
    if (!e)
        e = check_outputs(r, why);
    if (!e)
        e = set_create(set, &r->set, why);
    if (e)
        return e;
    const size_t pixels = (size_t)set->width * set->height;
    const bool piloted = r->wish.seconds > 0.0 || r->wish.error > 0.0;
    if (piloted)
        r->pilot = pilot_create(r->set, r->kernels, NULL);
    else
        r->relighter = relighter_create(r->set, r->kernels);
    r->environment_desc.lean = r->light.direct.method == METHOD_CACHED;
    r->environment = environment_create(&r->environment_desc);
    r->jpeg = jpeg_encoder_create();
    r->prober = r->probing ? prober_create(r->set, r->kernels) : NULL;
    r->rgb = mem_alloc(pixels, 3 * sizeof(float));
    r->display = mem_alloc(pixels, 3);
    exposure_init(&r->exposure);
    if (!(piloted ? (void *)r->pilot : (void *)r->relighter) || !r->environment || !r->jpeg || !r->rgb || !r->display ||
        (r->probing && !r->prober))
        return err_say(why, ERR_NOMEM, "no memory for pictures of %ux%u", set->width, set->height);
    r->light.direct.why = why;
    if (piloted)
        return ERR_OK;
    return buyer_prepare(&r->buyer, r->relighter, r->set, source_count(r->source), set->progress, &r->light,
                         &r->cache_ms);
}

static enum err write_picture(struct render *r, struct reason *why)
{
    const uint32_t width = r->set->gbuffer->width, height = r->set->gbuffer->height;
    const double gain = exposure_step(&r->exposure, r->rgb, width, height, 1);
    char name[4096];
    enum err e = file_pattern_name(&r->out, r->frame.number, name, sizeof(name), why);

    if (e)
        return e;
    if (ends_with(name, ".exr")) {
        const struct exr_desc d = { r->rgb, width, height, r->half ? EXR_HALF : EXR_FLOAT, NULL, 0 };
        return exr_write(&d, name, why);
    }
    const uint8_t *bytes;
    size_t size;
    tone_map(r->rgb, width, height, &(struct tone_desc){ gain, r->tone, r->kernels->level }, r->display);
    e = jpeg_encode(r->jpeg, r->display, width, height, r->quality, &bytes, &size);
    return e ? err_say(why, e, "%s: cannot be encoded", name) : file_store(name, bytes, size, why);
}

/* Which estimator took which class, with what, and what was left out and why. */
static json_t *plan_stats(const struct relight_stats *s)
{
    const struct plan *p = &s->plan;
    json_t *left_out = json_array();

    for (uint32_t k = 0; k < p->left_out_count; k++)
        json_array_append_new(left_out, json_string(p->left_out[k]));
    return json_pack("{s:{s:i, s:b, s:b}, s:s, s:s, s:s, s:I, s:i, s:o}", "direct", "strata", (int)s->direct.strata,
                     "sun_apart", s->direct.sun, "compensated", s->direct.compensated, "caustics",
                     plan_estimator_name(p->caustics), "interreflection", plan_estimator_name(p->indirect),
                     "interreflection_of_caustics", plan_estimator_name(p->indirect_caustics), "particles",
                     (json_int_t)p->particles, "eye_paths", (int)p->eye_paths, "left_out", left_out);
}

static json_t *picture_stats(const struct render *r, const struct relight_stats *s, const double ms[3])
{
    const struct gbuffer *g = r->set->gbuffer;
    const struct image_faults *f = &r->environment->image.faults;

    return json_pack(
        "{s:{s:f, s:f, s:f, s:f, s:f, s:f, s:f}, s:{s:I, s:I, s:I, s:I}, s:{s:I, s:I, s:I, s:I}, s:{s:I, s:I, s:I}, "
        "s:{s:I, s:I, s:I, s:I}, s:{s:I, s:I, s:f, s:I}}",
        "ms", "decode", ms[0], "rebuild", ms[1], "shade", s->shade_ms, "eye_paths", s->eye_ms, "light_tracer",
        s->light_ms, "resolve", s->resolve_ms, "write", ms[2], "rays", "direct", (json_int_t)s->direct.rays,
        "eye_paths", (json_int_t)s->eye.rays, "light_tracer", (json_int_t)s->light.rays, "reference",
        (json_int_t)s->reference_rays, "light_samples", "generated", (json_int_t)s->direct.generated, "chosen",
        (json_int_t)s->direct.chosen, "effective", (json_int_t)s->direct.effective, "lobes",
        (json_int_t)s->direct.lobes, "light_paths", "particles", (json_int_t)s->light.particles, "starts_hit",
        (json_int_t)s->light.starts_hit, "splats", (json_int_t)s->light.splats, "repaired", "nan", (json_int_t)f->nan,
        "infinite", (json_int_t)f->infinite, "negative", (json_int_t)f->negative, "clipped", (json_int_t)f->clipped,
        "gbuffer", "shade_points", (json_int_t)g->point_count, "edge_pixels", (json_int_t)g->edge_pixels, "cut_rays",
        g->cut_weight, "bytes", (json_int_t)g->bytes);
}

/* What was wished for, what was chosen, and the error that is expected of it. */
static json_t *estimate_stats(const struct render *r, const struct pilot_stats *s)
{
    json_t *parts = json_array();

    for (int k = 0; k < PILOT_PARTS; k++) {
        const struct pilot_part_stats *part = &s->part[k];
        if (part->there)
            json_array_append_new(parts, json_pack("{s:s, s:s, s:f, s:f, s:f, s:f}", "part",
                                                   pilot_part_name((enum pilot_part)k), "by", part->name, "count",
                                                   part->n, "ms", 1e3 * part->seconds, "expected_ms",
                                                   1e3 * part->expected_seconds, "error", part->error));
    }
    return json_pack("{s:f, s:f, s:f, s:b, s:I, s:f, s:f, s:f, s:{s:f, s:f, s:b}, s:o}", "error", s->error,
                     "wished_error", r->wish.error, "wished_ms", 1e3 * r->wish.seconds, "met", s->met, "readings",
                     (json_int_t)s->readings, "light_ms", 1e3 * s->seconds, "pilot_ms", 1e3 * s->pilot_seconds,
                     "error_in_twice_the_time", s->more, "edges", "points", s->edge_points, "error_without",
                     s->edge_error, "left_out", s->jagged, "parts", parts);
}

/* What was computed beforehand, and what this frame did with it. */
static json_t *cache_stats(const struct render *r, const struct relight_stats *s)
{
    const struct transport_stats *c = &s->cache;
    const struct transport_frame_stats *f = &s->cache_frame;

    return json_pack(
        "{s:b, s:f, s:f, s:I, s:I, s:I, s:i, s:i, s:i, s:i, s:i, s:f, s:{s:i, s:f, s:I, s:i, s:s, s:i, s:i}}", "loaded",
        s->cache_loaded, "load_ms", s->cache_loaded ? r->cache_ms : 0.0, "precomputation_ms",
        s->cache_loaded ? 0.0 : r->cache_ms, "bytes", (json_int_t)c->bytes, "dense_bytes", (json_int_t)c->dense, "rays",
        (json_int_t)c->rays, "packets", (int)c->packets, "packets_narrow", (int)c->narrow, "pieces", (int)c->pieces,
        "raw", (int)c->raw, "halves", (int)c->halves, "mean_rank", c->rank, "bright", "texels", (int)f->bright, "share",
        f->share, "rays", (json_int_t)f->rays, "penumbra_packets", (int)f->penumbra, "changed",
        transport_what_name(f->what), "blocks_kept", (int)f->kept, "blocks_computed", (int)(c->blocks - f->kept));
}

/* The light paths that are kept, and what was drawn anew for this picture. */
static json_t *stored_stats(const struct relight_stats *s)
{
    const struct caustic_store_stats *c = &s->stored;

    return json_pack("{s:I, s:I, s:I, s:I, s:i, s:i, s:I}", "paths", (json_int_t)c->paths, "wished_paths",
                     (json_int_t)c->wished, "splats", (json_int_t)c->splats, "bytes", (json_int_t)c->bytes, "parts",
                     (int)c->parts, "renewed_parts", (int)c->renewed, "rays", (json_int_t)c->rays);
}

static json_t *bounce_stats_of(const struct relight_stats *s)
{
    const struct bounce_stats *b = &s->bounce;

    return json_pack("{s:b, s:I, s:I, s:i, s:i, s:f, s:i, s:f}", "loaded", s->bounce_loaded, "bytes",
                     (json_int_t)b->bytes, "rays", (json_int_t)b->rays, "records", (int)b->records, "basis",
                     (int)b->basis, "basis_leaves_out", b->basis_rest, "bounces", (int)b->bounces, "mean_rank",
                     b->rank);
}

/* Whether auto took the cache, and why. */
static json_t *auto_stats(const struct buy *b)
{
    return json_pack("{s:b, s:o, s:s}", "cache", b->yes, "break_even_frames",
                     b->break_even > 0.0 ? json_real(b->break_even) : json_null(), "why", b->why);
}

static void write_stats(struct render *r, const struct relight_stats *s, const struct pilot_stats *pilot,
                        const double ms[3])
{
    json_t *name = json_string(r->environment->name); /* NULL where a file's name is not UTF-8 */
    json_t *j =
        json_pack("{s:I, s:o, s:s, s:i}", "frame", (json_int_t)r->frame.number, "environment",
                  name ? name : json_null(), "method", r->pilot ? "auto" : method_recipe(r->light.direct.method)->name,
                  "samples", (int)(r->pilot ? pilot->samples : r->light.direct.samples));
    json_t *more = picture_stats(r, s, ms);

    if (j && more) {
        json_object_update(j, more);
        if (!method_is_reference(r->light.direct.method))
            json_object_set_new(j, "plan", plan_stats(s));
        if (s->bias)
            json_object_set_new(j, "bias", json_string(s->bias));
        if (r->light.direct.method == METHOD_CACHED)
            json_object_set_new(j, "cache", cache_stats(r, s));
        if (s->plan.caustics == PLAN_STORED)
            json_object_set_new(j, "stored_caustics", stored_stats(s));
        if (s->bounce.basis > 0)
            json_object_set_new(j, "interreflection", bounce_stats_of(s));
        if (r->buyer.last.why)
            json_object_set_new(j, "auto", auto_stats(&r->buyer.last));
        if (r->pilot)
            json_object_set_new(j, "estimate", estimate_stats(r, pilot));
        fputs(r->rendered ? ",\n" : "\n", r->stats);
        json_dumpf(j, r->stats, JSON_REAL_PRECISION(6));
    }
    json_decref(more);
    json_decref(j);
}

/* The time for light is what reading and writing leave of the frame's. */
static enum err relight(struct render *r, struct relight_stats *stats, struct pilot_stats *pilot)
{
    struct pilot_wish wish = r->wish;

    if (!r->pilot)
        return relighter_run(r->relighter, r->environment, &r->light, r->rgb, stats);
    if (wish.seconds > 0.0)
        wish.seconds = fmax(0.2 * wish.seconds, wish.seconds - r->beside_s);
    return pilot_run(r->pilot, r->environment, &r->light, &wish, r->rgb, stats, pilot);
}

/* With a wish for a time or an error a clock decides already: also whether the frames that are left are worth it. */
static void ask(struct render *r, const struct relight_stats *stats, const struct pilot_stats *pilot)
{
    const uint64_t done = r->rendered + r->refused + 1, all = source_count(r->source);
    const struct buyer_wish wish = { .left = all > done ? all - done : 0, .error = r->wish.error };

    if (!buyer_may(&r->light) || wish.left == 0)
        return;
    if (!r->relighter)
        r->relighter = relighter_create(r->set, r->kernels);
    if (!r->relighter) /* no memory for more than there is */
        return;
    buyer_step(&r->buyer, r->relighter, r->set, &r->light, stats, pilot, &wish);
    if (!r->buyer.ready)
        return;
    r->light = buyer_light(&r->light);
    pilot_destroy(r->pilot);
    r->pilot = NULL;
}

/* One frame that was read: refused frames are reported and passed over, the sequence goes on. */
static enum err render_frame(struct render *r, struct reason *why)
{
    struct relight_stats stats;
    struct pilot_stats pilot = { 0 };
    double ms[3];

    double start = clock_seconds();
    enum err e = environment_decode(r->environment, &r->frame, why);
    ms[0] = 1e3 * (clock_seconds() - start);
    start = clock_seconds();
    if (!e)
        e = environment_rebuild(r->environment, why);
    ms[1] = 1e3 * (clock_seconds() - start);
    if (e) {
        log_error("%s", why->text);
        r->refused++;
        return e == ERR_NOMEM ? e : ERR_OK;
    }
    environment_warn_clipped(r->environment, &r->warned_clipped);
    r->light.direct.why = why;
    r->light.direct.pass = r->reseed ? r->frame.number : 0;
    r->light.turn = r->frame.number;
    r->light.cache_keep = true;
    e = relight(r, &stats, &pilot);
    if (e)
        return e == ERR_NOMEM ? err_say(why, e, "%s: no memory for the light samples", r->frame.name) : e;
    start = clock_seconds();
    if (r->out.text)
        e = write_picture(r, why);
    ms[2] = 1e3 * (clock_seconds() - start);
    const double beside_s = 1e-3 * (ms[0] + ms[1] + ms[2]);
    if (r->rendered > 0) /* the first makes tables that stay */
        r->beside_s += (r->rendered > 1 ? 0.3 : 1.0) * (beside_s - r->beside_s);
    if (!e && r->probing)
        e = prober_print(r->prober, r->environment, &r->light, &r->question, r->rgb, why);
    if (!e && r->stats)
        write_stats(r, &stats, &pilot, ms);
    if (!e && r->pilot)
        ask(r, &stats, &pilot);
    r->rendered += !e;
    return e;
}

static enum err render_all(struct render *r, struct reason *why)
{
    struct progress line;
    enum err e = ERR_OK;

    progress_begin(&line, "rendering", source_count(r->source), stderr);
    while (!e) {
        e = source_next(r->source, &r->frame, why);
        if (e == ERR_END)
            break;
        if (e) {
            log_error("%s", why->text);
            r->refused++;
            e = ERR_OK;
        } else if (r->frame.kind == FRAME_NONE) {
            continue; /* a watched folder that is quiet */
        } else {
            e = render_frame(r, why);
        }
        progress_step(&line, 1);
    }
    progress_end(&line);
    return e == ERR_END ? ERR_OK : e;
}

/* Daylight coefficients in place of pictures. */
static enum err export(struct render *r, const struct set_desc *set, struct reason *why) {
    const enum err e = set_create(set, &r->set, why);

    if (e) return e;
    r->components.set = r->set;
    r->components.kernels = r->kernels;
    r->components.light = &r->light;
    r->components.environment = &r->environment_desc;
    r->components.progress = set->progress;
    return components_write(&r->components, why);
}

static enum err finish(struct render *r, enum err e, struct reason *why)
{
    if (r->stats) {
        fputs("\n]\n", r->stats);
        const bool failed = fflush(r->stats) != 0 || ferror(r->stats);
        if (r->stats != stdout)
            fclose(r->stats);
        if (failed && !e)
            e = err_say(why, ERR_IO, "%s: cannot be written", r->stats_path);
    }
    if (!e && r->refused) {
        e = err_say(why, ERR_FORMAT, "%" PRIu64 " of %" PRIu64 " frames could not be used (named above)", r->refused,
                    r->refused + r->rendered);
    }
    frame_finish(&r->frame);
    mem_free(r->rgb);
    mem_free(r->display);
    jpeg_encoder_destroy(r->jpeg);
    environment_destroy(r->environment);
    prober_destroy(r->prober);
    relighter_destroy(r->relighter);
    pilot_destroy(r->pilot);
    set_destroy(r->set);
    source_close(r->source);
    return e;
}

int main(int argc, char **argv)
{
    struct options options = {
        .program = "relight-render",
        .synopsis = "--out PATTERN [--scene FILE] [--source S] [flags]",
        .about = "Lights a scene by each frame of an environment sequence and writes the pictures to files.\n"
                 "Exit code: 0 all frames rendered, 1 some could not be (each is named), 2 wrong usage.",
        .epilogue_title = "keys of sky:, with their defaults",
        .epilogue = sky_help,
        .rows = rows,
        .shared = light_rows,
    };
    struct source_desc source = { 0 };
    struct set_desc set = { 0 };
    struct render r = { 0 };
    struct reason why = { "" };
    bool done;

    log_init("relight-render", LOG_INFO);
    light_options_init(light_rows, samples_default, "all");
    enum err e = options_parse(&options, argc, argv, &done, &why);
    if (!e && done)
        return 0;
    if (!e)
        e = read_options(&options, &r, &source, &set, &why);
    if (!e && r.components.out.text) {
        e = export(&r, &set, &why);
    } else {
        if (!e)
            e = set_up(&r, &source, &set, &why);
        if (!e)
            e = render_all(&r, &why);
    }
    e = finish(&r, e, &why);
    if (e)
        log_error("%s", why.text[0] ? why.text : err_text(e));
    return err_exit_code(e);
}
