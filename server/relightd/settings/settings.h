/* The one table of settings for light, scene and image: flags of relightd, relight-render, relight-bench and
 * relight-chart, the configuration file, control messages and the state file all follow from it (base/setting.h).
 * Flags of a single program are in a table next to that program's main. */
#pragma once

#include "base/command.h"
#include "image/film/film.h"
#include "light/frame/relight.h"
#include "light/inspector/inspector.h"
#include "sky/source/source.h"

/* What controllers may change while relightd runs, and what it is at the start. */
struct settings {
    enum method method;
    uint32_t samples; /* per shading point; requested as 0: as many as time allows */
    bool counted;     /* someone fixed the sample count: no pilot */
    double error;     /* the pilot stops at this relMSE; 0: it uses all the time there is */
    uint32_t classes; /* PATH_* of paths.h */
    double fps;       /* maximum frames per second; also the pilot's time limit */
    double rotation_degrees, scale_stops;
    double lamps;    /* factor of the light of the scene's own emitters */
    char camera[64]; /* its name; "": the first of the scene */
    enum tone_curve tone;
    double exposure_stops; /* the gain is 2^this; or EXPOSURE_*: by the images, */
    double bias_stops;     /* with this added */
    bool paused;           /* the source is paused */

    /* Requests to move within the source: in control messages only. */
    int64_t step;
    uint64_t seek;
    double hour;
    uint32_t day;

    /* Requests to keep the present view under a name, or to forget one: likewise. */
    char save_view[64], forget_view[64];

    /* Not settings: how often they have changed. */
    uint64_t light_version;   /* the current frame must be lit again */
    uint64_t display_version; /* only exposure or tone curve changed */
};

#define TIME_REST (-1) /* of struct setup */

/* All values of the table. Zeroed memory, then settings_table's flags by command_read, then setup_complete. */
struct setup {
    struct settings initial;
    struct prepared_scene_desc set_desc;
    struct source_desc source_desc;
    struct relight_desc light;           /* method, samples and classes too */
    struct environment_desc environment; /* rotation and scale too */
    const struct kernels *kernels;
    double allow_bias;     /* relMSE: auto may use estimators of this bias; 0: unbiased ones alone */
    bool reseed;           /* new random numbers in each frame */
    uint32_t threads;      /* 0: one per processor */
    uint32_t quality;      /* of JPEG, 1..100 */
    uint32_t lamp_samples; /* per shading point, of the lamps' light */

    /* As flags have them; setup_complete puts them where they belong. */
    uint32_t size[2];
    const char *cpu;
    const char *parts;              /* of METHOD_COMPONENTS; the program reads them into light.whole */
    const char *place;              /* LATITUDE,LONGITUDE; NULL: not given */
    const char *position, *look_at; /* X,Y,Z; NULL: the camera's */
    double fov;                     /* degrees; 0: the camera's */
    int projection;                 /* enum camera_projection; perspective: the camera's */
    double sun_azimuth;             /* degrees; below 0: as it is */
    double time;                    /* s; TIME_REST: no pose of an animation */
};

/* Rows of struct setup. Those with a key come first; their fields are in `initial`, its first member, so that they are
 * rows of struct settings, too. */
extern const struct setting settings_table[];

/* Whether the source is a formula's, which are lat-long maps, and not one of images. */
bool setup_computes_sky(const struct setup *s);
bool setup_waits_for_skies(const struct setup *s); /* they come by themselves: no sequence, by its name */

/* Warns of each flag that was given and has no effect beside the others. Once, when the program starts. */
void setup_report_ignored(struct command *c, const struct setup *s);

/* Warns of settings that have no effect in this scene. Once, when it has been read. */
void setup_report_unused(const struct setup *s, const struct prepared_scene *set);

/* After command_read: what follows from several flags, or from what this machine is. ERR_USAGE names the flag. */
MUST_CHECK enum err setup_complete(struct setup *s, struct reason *why);

/* ---- Probed pixels ---- */

/* Reads --probe, --probe-samples and --probe-preset from a program's flags. Main thread. */

extern const struct setting_choice inspect_presets[]; /* values of the field `figure` */

/* After command_read, which reads samples and preset. *asked: --probe is given; its pixel, of an image of that size,
 * goes to *out. ERR_USAGE names the flag. */
MUST_CHECK enum err inspect_options_read(const struct command *c, uint32_t width, uint32_t height, bool *asked,
                                         struct inspect_request *out, struct reason *why);
