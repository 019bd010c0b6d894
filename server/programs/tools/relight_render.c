/* Renders the frames of a source to files: the rooms of relightd without a network, for scripts and for tests. */
#include "base/log.h"
#include "base/setting_table.h"
#include "import/sandbox/helper_process.h"
#include "light/frame/part.h"
#include "light/radiance/components.h"
#include "programs/render/render.h"
#include "relightd/settings/settings.h"
#include "sky/daylight/sky.h"
#include "year/annual.h"
#include "year/sun_hours.h"

#include <errno.h>
#include <omp.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define LIVE_TRIES 4 /* connections to a live stream before its first image; 3.5 s between them */

struct request {
    struct render_desc desc;
    double fps;                        /* 0: no time is set */
    int bits;                          /* of PNG: 8 or 16 */
    int weights;                       /* enum luminance_weights */
    struct components_desc components; /* out.text NULL: not requested */
    struct annual_desc annual;         /* folder NULL: not requested */
    const char *sun_hours;             /* NULL: not requested */
    struct inspect_request inspection; /* about a pixel, */
    bool probing;                      /* where one is asked */
    struct relight_whole whole;        /* of METHOD_COMPONENTS */
    char name[200];                    /* of a rank, in the log */
};

#define RENDERING .section = "Rendering"
#define OUTPUT .section = "Output"
#define AT(field) SETTING_AT(request, field)

static const struct setting_choice reinhart_choices[] = {
    { "1", 1, "146 patches", 0 },
    { "2", 2, "578 patches", 0 },
    { "4", 4, "2306 patches", 0 },
    { NULL, 0, NULL, 0 },
};

static const struct setting_choice bits_choices[] = {
    { "8", 8, "as on displays", 0 },
    { "16", 16, "for further processing", 0 },
    { NULL, 0, NULL, 0 },
};

static const struct setting_choice luminance_choices[] = {
    { "rec709", LUMINANCE_REC709, "0.2126 R + 0.7152 G + 0.0722 B", 0 },
    { "radiance", LUMINANCE_RADIANCE, "0.265 R + 0.670 G + 0.065 B, as in Radiance's programs", 0 },
    { NULL, 0, NULL, 0 },
};

/* What this program alone has. */
static const struct setting rows[] = {
    { "fps", "N",
      "with --method auto: least error at N frames per second on average, files and measurements included; denoised if "
      "the time pays for few samples; replaces --samples",
      NULL, RENDERING, REAL(1e-4, 1000.0), AT(fps) },
    { "out", "PATTERN",
      "file name: .exr (linear), .jpg or .png (tone-mapped), with %d or %04d for the frame number; '-': standard "
      "output, with --format",
      NULL, OUTPUT, .needs = NEEDS_MOVIES, .also = "; for a video of all frames: .mp4, .mkv (H.264) or .webm (AV1)",
      TEXT },
    { "format", "F", "format of --out -: exr (one frame), jpg or png (one after the other)", NULL, EXPERT, OUTPUT,
      .needs = NEEDS_MOVIES, .also = ", mp4, mkv or webm", TEXT, AT(desc.output.format) },
    { "rate", "N", "frames per second of a video file; default: the source's, or 30", NULL, OUTPUT,
      .needs = NEEDS_MOVIES, REAL(0.01, 1000.0), AT(desc.output.rate) },
    { "denoise", NULL, "filter noise out of direct and indirect light", NULL, RENDERING, SWITCH,
      AT(desc.setup.light.denoise) },
    { "exposure-frame", "N", "with --exposure auto: measure this frame; default: the source's first", NULL, EXPERT,
      OUTPUT, WHOLE(0, 0x1.fffffffffffffp52), AT(desc.exposure_frame) },
    { "calibrate", "LUX",
      "scale the environment to real units: the first frame's horizontal illuminance in the open was LUX", NULL, EXPERT,
      RENDERING, REAL(1e-6, 1e9), AT(desc.calibrate_lux) },
    { "half", NULL, "write EXR with 16-bit instead of 32-bit floats", NULL, EXPERT, OUTPUT, SWITCH,
      AT(desc.output.half) },
    { "changes", "PATTERN",
      "also write which pixels changed since the last frame: .png; red: changed, green: light computed, blue: rays "
      "traced towards the sun (--method cached)",
      NULL, EXPERT, OUTPUT, TEXT, AT(desc.changes) },
    { "resume", NULL, "keep existing images, for instance after an interruption, and render the rest", NULL, OUTPUT,
      SWITCH, AT(desc.resume) },
    { "collect", NULL, "under mpirun: rank 0 writes the images of all ranks, for hosts without a shared file system",
      NULL, EXPERT, OUTPUT, .needs = NEEDS_MPI, SWITCH, AT(desc.collect) },
    { "split-frames", NULL, "under mpirun: all ranks light each frame together, instead of one rank per frame", NULL,
      EXPERT, RENDERING, .needs = NEEDS_MPI, SWITCH, AT(desc.split) },
    { "bits", "B", "bits per channel of PNG", "8", EXPERT, OUTPUT, CHOICE(bits_choices), AT(bits) },
    { "layers", NULL,
      "write EXR with layers: light by class, sun and sky, albedo, normal, position, depth, error, Cryptomatte", NULL,
      OUTPUT, SWITCH, AT(desc.layers) },
    { "alpha", NULL, "with --ground: leave out the background; .exr and .png get an alpha channel for compositing",
      NULL, OUTPUT, SWITCH, AT(desc.output.alpha) },
    { "components", "PATTERN",
      "instead of images: daylight coefficients for dctimestep, one .hdr per patch of Radiance's sky; DIR/%03d.hdr",
      NULL, OUTPUT, TEXT },
    { "reinhart", "MF", "subdivision of the sky for --components", "1", EXPERT, OUTPUT, CHOICE(reinhart_choices),
      AT(components.mf) },
    { "annual", "DIR",
      "instead of images: a year of light under --source epw:FILE; tables, daylight measures, heat maps, false colour",
      NULL, OUTPUT, TEXT, AT(annual.folder) },
    { "sensors", "S",
      "with --annual: measure illuminance there; a file with a line 'x y z nx ny nz' each (metres), or "
      "grid:SURFACE,spacing=0.5,height=0.8,margin=0",
      NULL, EXPERT, OUTPUT, TEXT, AT(annual.sensors) },
    { "pictures", "HOURS", "with --annual: images of these hours: MM-DDTHH:MM, separated by commas; seasons; or none",
      "seasons", EXPERT, OUTPUT, TEXT, AT(annual.images) },
    { "sun-hours", "FILE",
      "instead of images: how long each pixel's surface sees the sun, on the day of --source sky:... or in the year of "
      "epw:FILE; "
      ".png in colours, .exr in hours",
      NULL, OUTPUT, TEXT, AT(sun_hours) },
    { "luminance", "W", "with --annual and --calibrate: luminance and illuminance from red, green and blue", "rec709",
      EXPERT, OUTPUT, CHOICE(luminance_choices), AT(weights) },
    { "probe", "X,Y", "print a pixel's light by kind and by sample, one JSON object per frame; makes --out optional",
      NULL, OUTPUT, TEXT },
    { "probe-samples", "N", "samples of --probe, 1 to 256; default: --samples, at most 256", NULL, EXPERT, OUTPUT,
      WHOLE(1, INSPECT_SAMPLES_MAX), AT(inspection.samples) },
    { "probe-preset", "P", "preset of --probe, as in figure 1 of Lu, Pacanowski and Granier 2013", NULL, EXPERT, OUTPUT,
      CHOICE(inspect_presets), AT(inspection.figure) },
    { "audit", "SHARE",
      "with --stats: estimate each frame's error without aliasing, by this share of its rays + 500,000; 0: no estimate",
      "0", EXPERT, RENDERING, REAL(0.0, 1000.0), AT(desc.setup.light.audit) },
    { "stats", "FILE", "write statistics, one JSON object per frame ('-': standard output)", NULL, OUTPUT, TEXT,
      AT(desc.stats_path) },
    { .name = NULL },
};

/* A time or an error takes the place of a sample count. */
static enum err read_target(const struct command *c, struct request *r, struct reason *why)
{
    struct budget_target *t = &r->desc.target;

    t->seconds = r->fps > 0.0 ? 1.0 / r->fps : 0.0;
    t->error = r->desc.setup.initial.error;
    if (t->seconds <= 0.0 && t->error <= 0.0)
        return ERR_OK;
    if (r->desc.setup.light.direct.method != METHOD_AUTO)
        return err_say(why, ERR_USAGE, "--fps and --error are for --method auto, not for %s",
                       method_name(r->desc.setup.light.direct.method));
    if (command_given(c, "samples"))
        return err_say(why, ERR_USAGE,
                       "--samples fixes the sample count; --fps and --error choose it: give one or the other");
    return ERR_OK;
}

/* The filter takes images by counts, made of shade points. */
static enum err check_denoise(const struct request *r, struct reason *why)
{
    const enum method method = r->desc.setup.light.direct.method;

    if (!r->desc.setup.light.denoise)
        return ERR_OK;
    if (method_is_reference(method))
        return err_say(why, ERR_USAGE, "--denoise cannot be used with --method %s, which lights pixels, not surfaces",
                       method_name(method));
    if (r->desc.target.seconds > 0.0 || r->desc.target.error > 0.0)
        return err_say(why, ERR_USAGE,
                       "--denoise takes --samples and --eye-paths, not --fps or --error, which measure images "
                       "without a filter");
    return ERR_OK;
}

/* Layers are made by counts, of shade points. */
static enum err check_layers(const struct request *r, struct reason *why)
{
    const enum method method = r->desc.setup.light.direct.method;

    if (!r->desc.layers)
        return ERR_OK;
    if (!r->desc.output.pattern)
        return err_say(why, ERR_USAGE, "--layers needs --out FILE.exr");
    if (method_is_reference(method))
        return err_say(why, ERR_USAGE, "--layers does not work with the reference method %s: choose another --method",
                       method_name(method));
    if (r->desc.target.seconds > 0.0 || r->desc.target.error > 0.0)
        return err_say(why, ERR_USAGE, "--layers takes --samples and --eye-paths, not --fps or --error");
    if (r->desc.output.alpha)
        return err_say(why, ERR_USAGE, "--layers and --alpha exclude each other: layers are parts of the whole image");
    return ERR_OK;
}

/* Ranks light shade points of their own: what adds to pixels, filters, or follows the clock is not theirs. */
static enum err check_split(const struct request *r, struct reason *why)
{
    const struct render_desc *d = &r->desc;
    const enum method method = d->setup.light.direct.method;
    const char *what = d->setup.light.denoise                             ? "--denoise"
                       : d->layers                                        ? "--layers"
                       : d->output.alpha                                  ? "--alpha"
                       : d->target.seconds > 0.0 || d->target.error > 0.0 ? "--fps or --error"
                       : d->setup.light.direct.cells > 1                  ? "--tune cells"
                                                                          : NULL;

    if (d->collect && d->layers)
        return err_say(why, ERR_USAGE,
                       "--collect cannot be used with --layers: let all ranks write to a shared folder");
    if (!d->split)
        return ERR_OK;
    if (r->components.out.text)
        return err_say(why, ERR_USAGE, "--split-frames cannot be used with --components");
    if (!light_deals(method))
        return err_say(why, ERR_USAGE,
                       "--split-frames does not work with --method %s, which needs more than the faces of the sky and "
                       "the shade points of a rank: without it, each rank renders its own frames",
                       method_name(method));
    if (what)
        return err_say(why, ERR_USAGE,
                       "--split-frames cannot be used with %s: without it, each rank renders its own frames", what);
    return ERR_OK;
}

/* Where images go, or components in their stead, which know no source, no frames and no target. */
static enum err read_out(const struct command *c, struct request *r, struct reason *why)
{
    static const char *const others[] = { "out",    "frames",    "stats",  "fps",     "error",
                                          "reseed", "half",      "alpha",  "denoise", "exposure-frame",
                                          "layers", "calibrate", "format", "resume",  "changes" };

    r->desc.exposure_frame_given = command_given(c, "exposure-frame");
    if (r->desc.exposure_frame_given && r->desc.setup.initial.exposure_stops != EXPOSURE_AUTO)
        return err_say(why, ERR_USAGE, "--exposure-frame is for --exposure auto, not for --exposure %s",
                       command_get(c, "exposure"));
    if (command_get(c, "components")) {
        for (size_t k = 0; k < sizeof(others) / sizeof(others[0]); k++)
            if (command_get(c, others[k]))
                return err_say(why, ERR_USAGE, "--%s cannot be used with --components", others[k]);
        if (command_given(c, "source"))
            return err_say(why, ERR_USAGE, "--source cannot be used with --components, which are for all skies");
        if (command_given(c, "scale"))
            return err_say(why, ERR_USAGE, "--scale cannot be used with --components: a patch has a radiance of 1");
        if (r->desc.setup.initial.method == METHOD_COMPONENTS)
            return err_say(why, ERR_USAGE, "--components cannot be used with --method components, which adds them up");
        return components_read(command_get(c, "components"), &r->components, why);
    }
    if (r->desc.calibrate_lux > 0.0 && command_given(c, "scale"))
        return err_say(why, ERR_USAGE, "--calibrate cannot be used with --scale: give one or the other");
    if (r->sun_hours) {
        for (size_t k = 0; k < sizeof(others) / sizeof(others[0]); k++)
            if (command_get(c, others[k]))
                return err_say(why, ERR_USAGE, "--%s cannot be used with --sun-hours", others[k]);
        return r->annual.folder ? err_say(why, ERR_USAGE, "--annual cannot be used with --sun-hours")
               : r->probing     ? err_say(why, ERR_USAGE, "--probe cannot be used with --sun-hours")
                                : ERR_OK;
    }
    if (r->annual.folder) {
        for (size_t k = 0; k < sizeof(others) / sizeof(others[0]); k++)
            if (strcmp(others[k], "resume") != 0 && command_get(c, others[k]))
                return err_say(why, ERR_USAGE, "--%s cannot be used with --annual", others[k]);
        if (command_get(c, "split-frames") || command_get(c, "collect"))
            return err_say(why, ERR_USAGE,
                           "--split-frames and --collect are for sequences of images, not for --annual");
        return r->probing ? err_say(why, ERR_USAGE, "--probe cannot be used with --annual") : ERR_OK;
    }
    r->desc.output.pattern = command_get(c, "out");
    r->desc.output.deep = r->bits == 16;
    r->desc.output.layers = r->desc.layers;
    if (r->desc.output.pattern && strcmp(r->desc.output.pattern, "-") == 0 &&
        (r->probing || (r->desc.stats_path && strcmp(r->desc.stats_path, "-") == 0)))
        return err_say(why, ERR_USAGE, "--out - and %s both write to standard output: name a file for --out",
                       r->probing ? "--probe" : "--stats -");
    if (r->desc.output.alpha && method_is_reference(r->desc.setup.light.direct.method))
        return err_say(why, ERR_USAGE, "--alpha does not work with the reference method %s: choose another --method",
                       method_name(r->desc.setup.light.direct.method));
    if (r->desc.output.pattern)
        return output_check(&r->desc.output, why);
    return r->probing ? ERR_OK
                      : err_say(why, ERR_USAGE, "--out is missing: name the images, such as --out DIR/image.%%04d.exr");
}

/* Warns about flags that the file format does not support, or that belong to an output that was not requested. */
static void report_ignored(struct command *c, const struct request *r)
{
    struct setup setup = r->desc.setup;
    static const char *const display[] = { "tone", "exposure", "exposure-frame", "bits", "quality" };
    const char *dot = r->desc.output.pattern ? output_extension(&r->desc.output) : NULL;

    if (r->annual.folder) /* which always uses the cache */
        setup.light.direct.method = METHOD_CACHED;
    setup_report_ignored(c, &setup);
    for (size_t k = 0; dot && strcmp(dot, ".exr") == 0 && k < sizeof(display) / sizeof(display[0]); k++)
        if (command_given(c, display[k]))
            log_warning("--%s has no effect: .exr files are linear", display[k]);
    if (dot && strcmp(dot, ".png") == 0 && command_given(c, "quality"))
        log_warning("--quality has no effect: .png files are lossless");
    if (dot && strcmp(dot, ".exr") != 0 && r->desc.output.half)
        log_warning("--half has no effect: it is for .exr files");
    if (dot && r->desc.output.rate > 0.0 &&
        (strcmp(dot, ".exr") == 0 || strcmp(dot, ".jpg") == 0 || strcmp(dot, ".png") == 0))
        log_warning("--rate has no effect: it is for video files");
    if (!r->annual.folder && (command_given(c, "sensors") || command_given(c, "pictures")))
        log_warning("--sensors and --pictures have no effect without --annual");
    if (!r->annual.folder && r->desc.calibrate_lux <= 0.0 && command_given(c, "luminance"))
        log_warning("--luminance has no effect without --annual or --calibrate");
    if (!r->components.out.text && command_given(c, "reinhart"))
        log_warning("--reinhart has no effect without --components");
    if (!r->desc.stats_path && command_given(c, "audit"))
        log_warning("--audit has no effect without --stats");
}

static enum err read_options(struct command *c, struct request *r, struct reason *why)
{
    struct render_desc *d = &r->desc;
    struct setup *s = &d->setup;
    enum err e = command_read(c, why);

    if (!e)
        e = setup_complete(s, why);
    if (!e)
        e = inspect_options_read(c, s->size[0], s->size[1], &r->probing, &r->inspection, why);
    if (!e)
        e = read_out(c, r, why);
    s->set_desc.progress = true;
    d->weights = (enum luminance_weights)r->weights;
    s->source_desc.tries = LIVE_TRIES;
    d->inspection = r->probing ? &r->inspection : NULL;
    d->output.tone = s->initial.tone;
    d->output.quality = (int)s->quality;
    d->output.level = s->kernels ? s->kernels->level : NULL;
    if (!e)
        e = read_target(c, r, why);
    if (!e)
        e = check_denoise(r, why);
    if (!e)
        e = check_layers(r, why);
    if (!e)
        e = check_split(r, why);
    if (!e)
        report_ignored(c, r);
    if (!d->stats_path) /* nobody reads the error: of an image, a component or an hour of a year */
        s->light.audit = 0.0;
    if (s->threads)
        omp_set_num_threads((int)s->threads);
    return e;
}

/* Daylight coefficients in place of images. */
static enum err export_components(struct request *r, struct reason *why)
{
    const struct setup *setup = &r->desc.setup;
    struct prepared_scene *set = NULL;
    enum err e = set_create(&setup->set_desc, &set, why);

    if (!e && set->scene->ground.radius > 0.0f)
        e = err_say(why, ERR_USAGE, "a ground cannot be used with --components: it is not linear in the sky");
    if (e) {
        set_destroy(set);
        return e;
    }
    r->components.set = set;
    r->components.kernels = setup->kernels;
    r->components.light = &setup->light;
    r->components.environment = &setup->environment;
    r->components.progress = true;
    e = components_write(&r->components, why);
    set_destroy(set);
    return e;
}

/* What METHOD_COMPONENTS adds up. The caller frees *out, which may be NULL. */
static enum err read_parts(struct request *r, struct parts **out, struct reason *why)
{
    struct setup *s = &r->desc.setup;
    const struct parts_desc desc = { s->parts, s->set_desc.width, s->set_desc.height, s->light.cache_bytes };

    *out = NULL;
    if (s->light.direct.method != METHOD_COMPONENTS)
        return ERR_OK;
    const enum err e = parts_create(&desc, out, why);
    if (!e)
        r->whole = parts_whole(*out);
    s->light.whole = e ? NULL : &r->whole;
    return e;
}

/* Images. */
static enum err run_sequence(struct request *r, struct reason *why)
{
    struct parts *parts;
    enum err e = read_parts(r, &parts, why);

    if (!e)
        e = render_sequence(&r->desc, why);
    parts_destroy(parts);
    return e;
}

/* A year in place of images. */
static enum err run_annual(struct request *r, struct reason *why)
{
    r->annual.setup = r->desc.setup;
    r->annual.measures = measures_lm83;
    r->annual.resume = r->desc.resume;
    r->annual.ranks = r->desc.ranks;
    r->annual.weights = (enum luminance_weights)r->weights;
    return annual_run(&r->annual, why);
}

/* Maps and a page from the tables: replaces this process by the script. */
static enum err draw_year(const char *folder)
{
    char script[4096], *const arguments[] = { (char[]){ "python3" }, (char[]){ "-B" }, script, (char *)folder, NULL };
    struct reason why;

    if (child_find("relight-scripts/year.py", NULL, script, sizeof(script), &why) == ERR_OK) {
        log_info("%s/index.html shows the year", folder);
        execvp(arguments[0], arguments);
        (void)err_say(&why, ERR_IO, "python3 cannot be started: %s", strerror(errno));
    }
    log_warning("%s; there are tables, but no maps and no page", why.text);
    return ERR_OK;
}

/* All ranks of a job render one sequence; alone, this process does. */
static enum err render_together(struct request *r, int argc, char **argv, struct reason *why)
{
    const struct setup *s = &r->desc.setup;
    const struct ranks_desc desc = { "relight-render", s->kernels->level, argc, argv };
    struct ranks *ranks;
    enum err e = ranks_create(&desc, &ranks, why);
    const bool together = ranks || (e && !why->text[0]);

    if (ranks) {
        snprintf(r->name, sizeof(r->name), "relight-render, %s", ranks_name(ranks));
        log_init(r->name, LOG_INFO);
        if (!s->threads)
            omp_set_num_threads((int)ranks_threads(ranks));
    }
    r->desc.ranks = ranks;
    if (!e && r->components.out.text)
        e = ranks ? err_say(why, ERR_USAGE, "--components is for one process: start relight-render without mpirun")
                  : export_components(r, why);
    else if (!e && r->sun_hours)
        e = ranks ? err_say(why, ERR_USAGE, "--sun-hours is for one process: start relight-render without mpirun")
                  : sun_hours_write(&(struct sun_hours_desc){ r->desc.setup, r->sun_hours }, why);
    else if (!e && r->annual.folder)
        e = run_annual(r, why);
    else if (!e)
        e = run_sequence(r, why);
    /* Wrong usage is the same on all ranks, and an error that is another rank's is told there. */
    if (e && !(together && (!why->text[0] || (e == ERR_USAGE && ranks_index(ranks) > 0))))
        log_error("%s", why->text[0] ? why->text : err_text(e));
    const bool draws = !e && r->annual.folder && ranks_index(ranks) == 0;
    ranks_destroy(ranks);
    return draws ? draw_year(r->annual.folder) : e;
}

int main(int argc, char **argv)
{
    static struct request r;
    static struct command command = {
        .name = "relight-render",
        .synopsis = "--out PATTERN [--scene FILE] [--source S] [flags]",
        .about = "Lights a scene with each frame of an environment sequence and writes the images to files.\n"
                 "Exit code: 0 all frames rendered, 1 some could not be (each is named), 2 wrong usage.",
        .epilogue_title = "keys of sky:, with their defaults",
        .program = FOR_RENDER,
        .lists = { { settings_table, &r.desc.setup }, { rows, &r } },
    };
    struct reason why = { "" };
    bool done;

    log_init("relight-render", LOG_INFO);
    signal(SIGPIPE, SIG_IGN); /* a reader of standard output that ends is an error of writing */
    command.epilogue = sky_help;
    if (output_has_movies())
        command.program |= FOR_MOVIES;
    command.lacks = (source_has_video() ? 0 : NEEDS_VIDEO) | (output_has_movies() ? 0 : NEEDS_MOVIES) |
                    (ranks_available() ? 0 : NEEDS_MPI);
    command_begin(&command);
    command_default(&command, "quality", "92");
    command_default(&command, "exposure", "auto");
    enum err e = command_parse(&command, argc, argv, &done, &why);
    if (!e && done)
        return 0;
    if (!e)
        e = read_options(&command, &r, &why);
    if (!e)
        return err_exit_code(render_together(&r, argc, argv, &why));
    log_error("%s", why.text[0] ? why.text : err_text(e));
    return err_exit_code(e);
}
