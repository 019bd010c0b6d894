#include "relightd/settings/settings.h"

#include "base/log.h"
#include "base/setting_table.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

_Static_assert(offsetof(struct setup, initial) == 0, "rows with a key are rows of struct settings, too");

static const struct setting_choice path_choices[] = {
    { "direct", PATH_BACKGROUND | PATH_DIRECT, "direct light only", 0 },
    { "caustics", PATH_CAUSTICS, "caustics only", FOR_RELIGHTD | FOR_RENDER },
    { "indirect", PATH_INDIRECT, "indirect light only", FOR_RELIGHTD | FOR_RENDER },
    { "all", PATH_ALL, "all light", 0 },
    { NULL, 0, NULL, 0 },
};

static const struct setting_choice start_choices[] = {
    { "faces", START_FACES, "the visible faces of the boxes around their targets", 0 },
    { "quad", START_QUAD, "a rectangle around the projected boxes", 0 },
    { "disc", START_DISC, "a disc around the projected bounding spheres", 0 },
    { NULL, 0, NULL, 0 },
};

static const struct setting_choice compensate_choices[] = {
    { "off", COMPENSATE_OFF, "plain multiple importance sampling", 0 },
    { "on", COMPENSATE_ON, "light samples skip what BRDF samples cover well", 0 },
    { "auto", COMPENSATE_AUTO, "on if the environment has no sun, or if the sun is a separate stratum", 0 },
    { NULL, 0, NULL, 0 },
};

static const struct setting_choice azimuth_choices[] = {
    { "own", -1, NULL, 0 },
    { NULL, 0, NULL, 0 },
};

static const struct setting_choice time_choices[] = {
    { "rest", TIME_REST, NULL, 0 },
    { NULL, 0, NULL, 0 },
};

#define SCENE .section = "Scene and environment"
#define LIGHTING .section = "Lighting and sampling"
#define RENDERING .section = "Rendering"
#define OUTPUT .section = "Output"
#define LIGHT_PROGRAMS .programs = FOR_RELIGHTD | FOR_RENDER
#define VIDEO_SOURCES "; or a video: a file, rtsp://, rtmp://, srt://, http(s):// or v4l2:/dev/video0"
#define NO_FLAG .name = NULL
#define CONTROL(name, paragraph) .key = name, .clause = paragraph
#define AT(field) SETTING_AT(setup, field)

enum { GROUP_EFFORT = 1, GROUP_PLACE };

const struct setting settings_table[] = {
    /* What controllers may change, in the order of PROTOCOL.md 4.13. */
    { "rotate", "DEGREES", "rotate the environment about the vertical axis", "0", SCENE, LIGHT_PROGRAMS,
      REAL(-3600.0, 3600.0), AT(initial.rotation_degrees), .reload = RELOAD_SETTINGS,
      CONTROL("rotate_degrees", "4.13.2"), .use = SETTING_STATE },
    { "scale", "STOPS", "make the environment 2^STOPS times as bright", "0", SCENE, LIGHT_PROGRAMS, REAL(-60.0, 60.0),
      AT(initial.scale_stops), .reload = RELOAD_SETTINGS, CONTROL("scale_stops", "4.13.3"), .use = SETTING_STATE },
    { "method", "M", "estimator (--method help explains them)", "auto", LIGHTING, LIGHT_PROGRAMS,
      CHOICE(method_choices), AT(initial.method), .reload = RELOAD_SETTINGS, CONTROL("method", "4.13.4"),
      .offers = "methods", .use = SETTING_STATE },
    { "samples", "N", "samples per shading point (per pixel for reference methods)", "64", LIGHTING, LIGHT_PROGRAMS,
      WHOLE(1, 1 << 20), AT(initial.samples), .reload = RELOAD_SETTINGS, CONTROL("samples", "4.13.5"),
      .use = SETTING_STATE, .has_null = true, .group = GROUP_EFFORT },
    { NO_FLAG, .key = "counted", SWITCH, AT(initial.counted), .use = SETTING_TOLD },
    { "tone", "CURVE", "tone curve", "filmic", OUTPUT, LIGHT_PROGRAMS, CHOICE(tone_choices), AT(initial.tone),
      .reload = RELOAD_SETTINGS, CONTROL("tone", "4.13.6"), .offers = "tones", .use = SETTING_STATE },
    { "exposure", "E",
      "stops (EV) for all images; auto: one value for all, from the first frame; follow: adapt from image to image",
      "follow", OUTPUT, LIGHT_PROGRAMS, REAL(-60.0, 60.0), OR_WORD(exposure_choices), AT(initial.exposure_stops),
      .reload = RELOAD_SETTINGS, CONTROL("exposure_stops", "4.13.10"), .offers = "exposures", .use = SETTING_STATE,
      .has_null = true, .null = EXPOSURE_FOLLOW },
    { NO_FLAG, CONTROL("bias_stops", "4.13.11"), REAL(-20.0, 20.0), AT(initial.bias_stops), .use = SETTING_STATE },
    { "error", "E", "with --method auto: stop at this error (relMSE) when it takes less time", NULL, RENDERING,
      LIGHT_PROGRAMS, REAL(1e-9, 10.0), AT(initial.error), .reload = RELOAD_SETTINGS, CONTROL("error", "4.13.12"),
      .use = SETTING_STATE, .has_null = true, .group = GROUP_EFFORT },
    { "fps", "N", "maximum frames per second; --method auto without --samples uses all of a frame's time", "30",
      RENDERING, FOR_RELIGHTD, REAL(0.01, 1000.0), AT(initial.fps), .reload = RELOAD_SETTINGS,
      CONTROL("fps", "4.13.13"), .use = SETTING_STATE },
    { "paths", "P", "kinds of light in the image", "all", LIGHTING, LIGHT_PROGRAMS, CHOICE(path_choices),
      AT(initial.classes), .reload = RELOAD_SETTINGS, CONTROL("paths", "4.13.14"), .offers = "paths",
      .use = SETTING_STATE },
    { "camera", "NAME", "camera of the scene, or a view as @X,Y,Z;X,Y,Z;DEGREES; default: the first", NULL, SCENE,
      LIGHT_PROGRAMS, .type = SETTING_NAME, AT(initial.camera), CONTROL("camera", "4.13.15"), .use = SETTING_STATE },
    { "lamps", "SCALE", "multiply the light of the scene's lamps: emissive surfaces and lights", "1", LIGHTING,
      LIGHT_PROGRAMS, REAL(0.0, 1e6), AT(initial.lamps), .reload = RELOAD_SETTINGS, CONTROL("lamps", "4.13.21"),
      .use = SETTING_STATE },
    { NO_FLAG, CONTROL("save_view", "4.13.22"), .type = SETTING_NAME, AT(initial.save_view), .use = SETTING_ASKED },
    { NO_FLAG, CONTROL("forget_view", "4.13.22"), .type = SETTING_NAME, AT(initial.forget_view), .use = SETTING_ASKED },
    { NO_FLAG, CONTROL("paused", "4.13.7"), SWITCH, AT(initial.paused), .use = SETTING_ASKED | SETTING_TOLD },
    { NO_FLAG, CONTROL("step", "4.13.16"), WHOLE(-1000, 1000), AT(initial.step), .use = SETTING_ASKED | SETTING_ADDS,
      .group = GROUP_PLACE },
    { NO_FLAG, CONTROL("seek", "4.13.17"), WHOLE(0, 0x1.fffffffffffffp52), AT(initial.seek), .use = SETTING_ASKED,
      .group = GROUP_PLACE },
    { NO_FLAG, CONTROL("hour", "4.13.18"), REAL(0.0, 24.0), AT(initial.hour), .use = SETTING_ASKED,
      .group = GROUP_PLACE },
    { NO_FLAG, CONTROL("day", "4.13.23"), WHOLE(1, 365), AT(initial.day), .use = SETTING_ASKED },

    /* Flags and configuration alone. */
    { "scene", "FILE",
      "scene to light: .json, .gltf, .glb, .obj, .ply, .stl, .fbx, .dae or .3ds; default: the built-in one", NULL,
      SCENE, .programs = FOR_RELIGHTD | FOR_RENDER | FOR_BENCH, TEXT, AT(set_desc.scene) },
    { "position", "X,Y,Z", "place the camera here, in metres", NULL, EXPERT, SCENE, LIGHT_PROGRAMS, TEXT,
      AT(position) },
    { "look-at", "X,Y,Z", "point that the camera looks at", NULL, EXPERT, SCENE, LIGHT_PROGRAMS, TEXT, AT(look_at) },
    { "fov", "DEGREES", "vertical field of view of the camera", NULL, EXPERT, SCENE, LIGHT_PROGRAMS, REAL(1.0, 360.0),
      AT(fov) },
    { "projection", "P", "projection of the camera; a fisheye spans 180 degrees unless --fov is given", NULL, EXPERT,
      SCENE, LIGHT_PROGRAMS, CHOICE(projection_choices), AT(projection) },
    { "ground", NULL, "add a ground below the model: it shows the environment, with the model's shadows and caustics",
      NULL, SCENE, LIGHT_PROGRAMS, SWITCH, AT(set_desc.ground) },
    { "time", "SECONDS", "pose animated glTF models at this time of their first animation", "rest", EXPERT, SCENE,
      REAL(0.0, ANIMATION_TIME_MAX), OR_WORD(time_choices), AT(time) },
    { "max-scene-memory", "MB", "maximum memory for reading a scene", "4000", EXPERT, SCENE, WHOLE(1, 1 << 30),
      .scale = 1e6, AT(set_desc.reading.memory_bytes) },
    { "max-texture-memory", "MB", "maximum memory of textures; above it the largest lose resolution", "450", EXPERT,
      SCENE, WHOLE(1, 1 << 30), .scale = 1e6, AT(set_desc.reading.texture_bytes) },
    { "source", "S",
      "environment: file, directory, printf or glob pattern, watch:DIR, push:, epw:FILE or sky:key=value,...",
      "sky:", SCENE, FOR_RELIGHTD, NEEDS_VIDEO, VIDEO_SOURCES, TEXT, AT(source_desc.spec) },
    { "source", "S", "environment: file, directory, printf or glob pattern, epw:FILE or sky:key=value,...",
      "sky:", SCENE, FOR_RENDER, NEEDS_VIDEO, VIDEO_SOURCES, TEXT, AT(source_desc.spec) },
    { "source", "S", "environment (first frame only), converted to OpenEXR in memory", "sky:", SCENE, FOR_BENCH, TEXT,
      AT(source_desc.spec) },
    { "frames", "A-B", "only the frames with these numbers (one number: that frame)", NULL, SCENE, LIGHT_PROGRAMS,
      .type = SETTING_FRAMES, AT(source_desc.frames) },
    { "source-transfer", "T", "transfer function of a video, instead of the one that it declares", "auto", EXPERT,
      SCENE, LIGHT_PROGRAMS, .needs = NEEDS_VIDEO, CHOICE(signal_transfer_choices), AT(source_desc.colour.transfer) },
    { "source-peak", "CDM2",
      "cd/m^2 of a video's white (HLG: of its peak; PQ: clipping level); 0: 203, HLG 1000, PQ as coded", "0", EXPERT,
      SCENE, LIGHT_PROGRAMS, .needs = NEEDS_VIDEO, REAL(0.0, 1e6), AT(source_desc.colour.peak_cdm2) },
    { "source-ca", "FILE",
      "PEM file of the certificate authorities to trust for https://, rtsps:// and rtmps:// sources, instead of the "
      "system's; none: accept any certificate",
      NULL, EXPERT, SCENE, LIGHT_PROGRAMS, .needs = NEEDS_VIDEO, TEXT, AT(source_desc.ca) },
    { "once", NULL, "stop after the last frame and keep its image; default: start again", NULL, EXPERT, SCENE,
      FOR_RELIGHTD, SWITCH_OFF, AT(source_desc.loop) },
    { "layout", "L", "layout of the environment map", "auto", EXPERT, SCENE, LIGHT_PROGRAMS, CHOICE(layout_choices),
      AT(environment.layout) },
    { "sun-azimuth", "DEGREES",
      "turn each map so that its sun stands there, from north (+Z) over east (-X), in place of --rotate", "own", EXPERT,
      SCENE, LIGHT_PROGRAMS, REAL(0.0, 360.0), OR_WORD(azimuth_choices), AT(sun_azimuth) },
    { "rotate-speed", "DEGREES",
      "rotate the environment by so much from frame to frame; one file is then as many frames as --frames says", "0",
      EXPERT, SCENE, LIGHT_PROGRAMS, REAL(-360.0, 360.0), AT(source_desc.turn) },
    { "between", "HOW", "images between two skies", "fade", SCENE, LIGHT_PROGRAMS, CHOICE(between_choices),
      AT(source_desc.between.mode) },
    { "hold", "N", "with --between: images from one sky of a sequence to the next", "1", SCENE, LIGHT_PROGRAMS,
      WHOLE(1, BETWEEN_HOLD_MAX), AT(source_desc.between.hold) },
    { "deflicker", NULL, "undo a camera's scatter of exposure and white balance from sky to sky", NULL, EXPERT, SCENE,
      LIGHT_PROGRAMS, SWITCH, AT(source_desc.between.deflicker) },
    { "sun", "LUX", "restore a sun that the camera clipped, so that the sky has this horizontal illuminance", "keep",
      EXPERT, SCENE, LIGHT_PROGRAMS, REAL(1.0, 200000.0), OR_WORD(between_sun_choices), AT(source_desc.between.sun) },
    { "align", "BY", "where north is", "off", EXPERT, SCENE, LIGHT_PROGRAMS, CHOICE(between_align_choices),
      AT(source_desc.between.align) },
    { "place", "LAT,LON", "with --align: where skies are captured, in degrees north and east", NULL, EXPERT, SCENE,
      LIGHT_PROGRAMS, TEXT, AT(place) },
    { "layer", "NAME", "layer or part of OpenEXR maps; default: the one named like an image", NULL, EXPERT, SCENE,
      LIGHT_PROGRAMS, TEXT, AT(environment.layer) },

    { "size", "WxH", "image size in pixels", "640x360", RENDERING, .type = SETTING_SIZE, AT(size) },
    { "reseed", NULL, "new random numbers in each frame, so that noise moves", NULL, EXPERT, RENDERING, LIGHT_PROGRAMS,
      SWITCH, AT(reseed) },
    { "edge-rays", "K", "K x K camera rays at geometry edges, 1 to 16", "4", EXPERT, RENDERING,
      FOR_RELIGHTD | FOR_RENDER | FOR_CHART, WHOLE(1, 16), AT(set_desc.edge_rays) },
    { "every-pixel", NULL, "K x K camera rays in all pixels", NULL, EXPERT, RENDERING, FOR_RENDER | FOR_CHART, SWITCH,
      AT(set_desc.every_pixel) },
    { "cpu", "LEVEL", "instruction set: v3, v4 or baseline; default: the best that this CPU supports", NULL, EXPERT,
      RENDERING, TEXT, AT(cpu) },
    { "threads", "N", "maximum number of threads; 0: one per processor", "0", RENDERING, WHOLE(0, 1024), AT(threads) },
    { "quality", "Q", "JPEG quality, 1 to 100", "85", EXPERT, OUTPUT, LIGHT_PROGRAMS, WHOLE(1, 100), AT(quality),
      .reload = RELOAD_QUALITY },

    { "parts", "PATTERN",
      "with --method components: an image for each patch of Radiance's sky, DIR/%03d.hdr from 000 on, or a view "
      "matrix of rcontrib",
      NULL, EXPERT, LIGHTING, LIGHT_PROGRAMS, TEXT, AT(parts) },
    { "caustics", "BY", "technique for caustics", "auto", EXPERT, LIGHTING, LIGHT_PROGRAMS, CHOICE(caustics_choices),
      AT(light.caustics) },
    { "indirect", "BY", "technique for indirect light", "auto", EXPERT, LIGHTING, LIGHT_PROGRAMS,
      CHOICE(indirect_choices), AT(light.indirect) },
    { "particles", "N", "particles of the light tracer; 0: chosen for scene and environment", "0", EXPERT, LIGHTING,
      LIGHT_PROGRAMS, WHOLE(0, 0x1p40), AT(light.particles) },
    { "eye-paths", "N", "eye paths per shading point; 0: chosen for scene and environment", "0", EXPERT, LIGHTING,
      LIGHT_PROGRAMS, WHOLE(0, 1 << 20), AT(light.eye_paths) },
    { "start", "WHERE", "where light paths start", "faces", TUNE, LIGHT_PROGRAMS, CHOICE(start_choices),
      AT(light.start) },
    { "cells", "K", "strata of faces and mis: K x K on each cube face; 1, 2, 4 or 8", "1", TUNE, LIGHT_PROGRAMS,
      POWER(8), AT(light.direct.cells) },
    { "sun", NULL, "sample the sun, if there is one, as a separate stratum", NULL, TUNE, LIGHT_PROGRAMS, SWITCH,
      AT(light.direct.sun) },
    { "compensate", "C", "MIS compensation of the light samples of mis", "off", TUNE, LIGHT_PROGRAMS,
      CHOICE(compensate_choices), AT(light.direct.compensate) },
    { "no-visibility", NULL, "trace no shadow rays, as in the paper", NULL, TUNE, LIGHT_PROGRAMS, SWITCH,
      AT(light.direct.no_visibility) },
    { "allow-bias", "E",
      "--method auto may use the biased cache of light transport where its relMSE is at most E: 4.5e-4 for direct "
      "light, "
      "1e-2 with indirect light; 0: unbiased",
      "0", EXPERT, LIGHTING, LIGHT_PROGRAMS, REAL(0.0, 10.0), AT(allow_bias) },
    { "cache-memory", "MB", "maximum memory of the cache of --method cached", "1024", EXPERT, LIGHTING, LIGHT_PROGRAMS,
      WHOLE(1, 1 << 30), .scale = 1e6, AT(light.cache_bytes) },
    { "cache-dir", "DIR",
      "folder that keeps this cache for the next run (at most 2 GB, least recently used deleted first), or off; "
      "default: $CACHE_DIRECTORY, $XDG_CACHE_HOME/relightd or ~/.cache/relightd",
      NULL, LIGHTING, LIGHT_PROGRAMS, TEXT, AT(light.cache_dir) },
    { "cache-file", "FILE", "one file for this cache instead, or off", NULL, EXPERT, LIGHTING, LIGHT_PROGRAMS, TEXT,
      AT(light.cache_file) },
    { "cache-wait", NULL, "with --method cached: compute the whole cache before the first image", NULL, EXPERT,
      LIGHTING, FOR_RELIGHTD, SWITCH_OFF, AT(light.cache_background) },
    { "stored-paths", "N", "light paths kept for --caustics stored; 0: 64 per pixel", "0", TUNE, LIGHT_PROGRAMS,
      WHOLE(0, 0x1p40), AT(light.stored_paths) },
    { "renew", "K", "each frame renews one of K parts of these paths; 0: none", "512", TUNE, LIGHT_PROGRAMS,
      WHOLE(0, CAUSTIC_PARTS_MAX), AT(light.renew) },
    { "lamp-samples", "N", "samples per shading point for the lamps' light, computed before the first image", "64",
      TUNE, FOR_RENDER, WHOLE(1, 1 << 20), AT(lamp_samples) },
    { "lamp-samples", "N", "samples per shading point for the lamps' light, refined while images are shown", "256",
      TUNE, FOR_RELIGHTD, WHOLE(1, 1 << 20), AT(lamp_samples) },
    { "tune", "KEY=VALUE,...", "details of the estimators, by keys (--tune help explains them)", NULL, LIGHTING,
      LIGHT_PROGRAMS, .type = SETTING_KEYS },
    { "seed", "K", "seed of all random numbers", "0", EXPERT, LIGHTING, LIGHT_PROGRAMS, WHOLE(0, 0x1p64),
      AT(light.direct.seed) },
    { .name = NULL },
};

static bool begins_with_any(const char *text, const char *const *words)
{
    for (; *words; words++)
        if (strncmp(text, *words, strlen(*words)) == 0)
            return true;
    return false;
}

bool setup_computes_sky(const struct setup *s)
{
    static const char *const computed[] = { "sky:", "epw:", "cie:", "mtx:", NULL };

    return begins_with_any(s->source_desc.spec, computed);
}

bool setup_waits_for_skies(const struct setup *s)
{
    static const char *const live[] = { "push:", "watch:", "v4l2:", "rtsp", "rtmp", "srt:", NULL };

    return begins_with_any(s->source_desc.spec, live);
}

/* --place, which --align needs. */
static enum err take_place(struct setup *s, struct reason *why)
{
    struct between_desc *b = &s->source_desc.between;
    char end;

    if (b->align && !s->place)
        return err_say(why, ERR_USAGE, "--align sun needs --place LATITUDE,LONGITUDE, such as --place 48.14,11.58");
    if (s->place && (sscanf(s->place, "%lf,%lf%c", &b->place[0], &b->place[1], &end) != 2 ||
                     !(fabs(b->place[0]) <= 90.0) || !(fabs(b->place[1]) <= 180.0)))
        return err_say(why, ERR_USAGE,
                       "--place: '%.40s' is not LATITUDE,LONGITUDE in degrees, -90 to 90 and -180 to 180", s->place);
    if (s->place && !b->align)
        log_warning("--place has no effect without --align sun");
    return ERR_OK;
}

enum err setup_complete(struct setup *s, struct reason *why)
{
    struct settings *initial = &s->initial;

    s->set_desc.camera = initial->camera[0] ? initial->camera : NULL;
    s->set_desc.width = s->size[0];
    s->set_desc.height = s->size[1];
    s->set_desc.reading.animate = s->time != TIME_REST;
    s->set_desc.reading.time = s->time;
    s->light.direct.method = initial->method;
    s->light.direct.samples = initial->samples;
    s->light.classes = initial->classes;
    s->environment.rotation_degrees = initial->rotation_degrees;
    s->environment.scale_stops = initial->scale_stops;
    s->source_desc.between.layout = s->environment.layout;
    s->source_desc.between.layer = s->environment.layer;
    s->environment.sun_azimuth = s->sun_azimuth < 0.0 ? 0.0 : s->sun_azimuth == 0.0 ? 360.0 : s->sun_azimuth;
    if (!s->light.cache_file)
        s->light.cache_file = s->light.cache_dir && strcmp(s->light.cache_dir, "off") == 0 ? NULL : "";
    else if (strcmp(s->light.cache_file, "off") == 0)
        s->light.cache_file = NULL;
    if (initial->method == METHOD_COMPONENTS && !s->parts)
        return err_say(why, ERR_USAGE, "--method components needs --parts, such as --parts 'parts/%%03d.hdr'");
    if (setup_computes_sky(s) && s->environment.layout != LAYOUT_AUTO && s->environment.layout != LAYOUT_LATLONG)
        return err_say(why, ERR_USAGE, "--layout is for maps from files; the source %.40s is a lat-long map",
                       s->source_desc.spec);
    enum err e = take_place(s, why);
    if (!e)
        e = view_change_read(s->position, s->look_at, s->fov, &s->set_desc.change, why);
    s->set_desc.change.has_projection = s->projection != PROJECTION_PERSPECTIVE;
    s->set_desc.change.projection = (enum camera_projection)s->projection;
    if (!e)
        e = kernels_select(s->cpu, &s->kernels, why);
    s->set_desc.kernels = s->kernels;
    return e;
}
