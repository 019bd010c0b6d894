#include "relightd/settings/settings.h"

#include "base/log.h"

#include <unistd.h>

/* Why a flag has no effect; NULL: it has one. */
typedef const char *ignored_by(const struct setup *s);

static const char *without_indirect(const struct setup *s)
{
    return s->light.classes & PATH_INDIRECT ? NULL : "there is no indirect light with this --paths";
}

static const char *without_caustics(const struct setup *s)
{
    return s->light.classes & PATH_CAUSTICS ? NULL : "there are no caustics with this --paths";
}

static const char *without_paths(const struct setup *s)
{
    if (method_is_reference(s->light.direct.method))
        return "a reference --method computes the whole image by itself";
    return s->light.classes & (PATH_INDIRECT | PATH_CAUSTICS)
               ? NULL
               : "there is neither indirect light nor a caustic with this --paths";
}

static const char *without_tracer(const struct setup *s)
{
    const bool caustics = s->light.caustics != PLAN_EYE && s->light.caustics != PLAN_NONE;

    if (without_paths(s) || s->light.indirect == PLAN_LIGHT || (caustics && s->light.classes & PATH_CAUSTICS))
        return without_paths(s);
    return "with this --paths, --caustics and --indirect there is no light tracer";
}

static const char *without_store(const struct setup *s)
{
    const bool may = s->light.caustics == PLAN_STORED || s->light.caustics == PLAN_AUTO;

    return may ? without_caustics(s) : "light paths are kept for --caustics stored alone";
}

static const char *without_cache(const struct setup *s)
{
    return s->light.direct.method == METHOD_CACHED || (s->light.direct.method == METHOD_AUTO && s->allow_bias > 0.0)
               ? NULL
               : "only --method cached, and auto with --allow-bias, have a cache";
}

static const char *without_memory(const struct setup *s)
{
    return s->light.caustics == PLAN_STORED ? NULL : without_cache(s);
}

static const char *without_auto(const struct setup *s)
{
    return s->light.direct.method == METHOD_AUTO ? NULL : "only --method auto chooses";
}

static const char *without_strata(const struct setup *s)
{
    const enum method m = s->light.direct.method;

    return m == METHOD_FACES || m == METHOD_FACES_UNIFORM || m == METHOD_MIS || m == METHOD_AUTO || m == METHOD_CACHED
               ? NULL
               : "only --method faces, faces-uniform, mis and auto have strata";
}

static const char *without_lobes(const struct setup *s)
{
    const enum method m = s->light.direct.method;

    return m == METHOD_FACES || m == METHOD_FACES_UNIFORM ? "--method faces samples no BRDF lobes" : without_strata(s);
}

static const char *without_shadow_rays(const struct setup *s)
{
    return method_is_reference(s->light.direct.method) ? "reference methods trace all rays" : NULL;
}

static const char *without_folder(const struct setup *s)
{
    return s->light.cache_file && s->light.cache_file[0] ? "--cache-file names one file" : without_cache(s);
}

static const char *without_video(const struct setup *s)
{
    return setup_computes_sky(s) ? "the source is computed, no video" : NULL;
}

static const char *without_file(const struct setup *s)
{
    return setup_computes_sky(s) ? "the source is computed, no map from a file" : NULL;
}

static const char *without_sequence(const struct setup *s)
{
    return setup_waits_for_skies(s) ? "it is for sequences; images between skies that come by themselves do so, too"
                                    : NULL;
}

static const char *without_turn(const struct setup *s)
{
    return s->environment.sun_azimuth > 0.0 ? "--sun-azimuth turns each map" : NULL;
}

static const char *without_components(const struct setup *s)
{
    return s->light.direct.method == METHOD_COMPONENTS ? NULL : "it is for --method components";
}

static const char *without_whole_light(const struct setup *s)
{
    return s->light.direct.method == METHOD_COMPONENTS ? "components have the light that they were made with" : NULL;
}

static const char *without_models(const struct setup *s)
{
    return s->set_desc.scene ? NULL : "the built-in scene does not move";
}

static const char *without_lamps(const struct setup *s)
{
    return s->initial.lamps > 0.0 ? NULL : "--lamps 0 turns the lamps off";
}

static const struct {
    const char *flag;
    ignored_by *why;
} rows[] = {
    { "indirect", without_indirect },   { "caustics", without_caustics },     { "eye-paths", without_paths },
    { "particles", without_tracer },    { "start", without_tracer },          { "stored-paths", without_store },
    { "renew", without_store },         { "cache-file", without_cache },      { "cache-dir", without_folder },
    { "cache-memory", without_memory }, { "cache-wait", without_cache },      { "allow-bias", without_auto },
    { "cells", without_strata },        { "compensate", without_lobes },      { "tune sun", without_strata },
    { "lamp-samples", without_lamps },  { "time", without_models },           { "parts", without_components },
    { "paths", without_whole_light },   { "samples", without_whole_light },   { "no-visibility", without_shadow_rays },
    { "layer", without_file },          { "hold", without_sequence },         { "rotate", without_turn },
    { "rotate-speed", without_turn },   { "source-transfer", without_video }, { "source-peak", without_video },
    { "source-ca", without_video },
};

void setup_report_ignored(struct command *c, const struct setup *s)
{
    for (size_t k = 0; k < sizeof(rows) / sizeof(rows[0]); k++) {
        const struct command_flag *f = command_flag(c, rows[k].flag);
        const char *why = f && command_given(c, rows[k].flag) ? rows[k].why(s) : NULL;
        if (why)
            log_warning("%s%s has no effect: %s", setting_prefix(f->row), f->row->name, why);
    }
    if (!(s->light.classes & ~(unsigned)PATH_CAUSTICS) && s->light.caustics == PLAN_NONE)
        log_warning("--paths caustics shows only what --caustics none leaves out: the image is black");
    const long processors = sysconf(_SC_NPROCESSORS_ONLN);
    if (processors > 0 && s->threads > (unsigned long)processors)
        log_warning("--threads %u: this machine has %ld processors; more threads than that make it slower", s->threads,
                    processors);
}

void setup_report_unused(const struct setup *s, const struct prepared_scene *set)
{
    if (s->initial.lamps != 1.0 && !scene_has_lamps(set->scene))
        log_warning("--lamps has no effect: the scene has none");
    if (s->light.particles > 0 && !without_tracer(s) && set->facts.casters == 0 && s->light.indirect != PLAN_LIGHT)
        log_warning(
            "--particles has no effect: the scene has no mirror and no glass, and --indirect light is not given");
}
