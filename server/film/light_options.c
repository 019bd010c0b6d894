#include "light_options.h"

#include <string.h>

static const struct option_row table[LIGHT_OPTIONS] = {
    { "", NULL, "which light, and by whom", NULL },
    { "method", "M",
      "of direct light: uniform, brdf, light, faces-uniform, faces, mis, latlong, latlong-rows, cached (computes what "
      "stands still beforehand; biased) or auto; of the whole "
      "picture: path, mlt, photons or vpl",
      "auto" },
    { "samples", "N", "N_s per shade point; of a reference, per pixel", NULL },
    { "paths", "P", "direct, caustics, indirect (interreflection) or all", NULL },
    { "caustics", "BY",
      "light (the light tracer), eye (eye paths), stored (light paths that are kept; --method cached has them), none "
      "or "
      "auto",
      "auto" },
    { "indirect", "BY", "interreflection, likewise", "auto" },
    { "particles", "N", "of the light tracer; 0: as the plan has it", "0" },
    { "eye-paths", "N", "per shade point; 0: as the plan has it", "0" },
    { "start", "WHERE", "of light paths: faces (of the boxes around what they are for), quad or disc", "faces" },
    { "cells", "K", "strata of faces and mis: K x K on each face of the cube; 1, 2, 4 or 8", "1" },
    { "sun", NULL, "the sun, where there is one, is a stratum by itself", NULL },
    { "compensate", "C", "of mis: light samples leave to the lobes what those do well; off, on or auto", "off" },
    { "interleave", "K", "K x K sets of light samples among neighbouring pixels; 1, 2 or 4", "1" },
    { "importance", "I", "of the sky's texels: luminance, mean or max", "luminance" },
    { "no-visibility", NULL, "trace no shadows, as the paper", NULL },
    { "cache-memory", "MB", "of --method cached: the most that what is computed beforehand may take", "1024" },
    { "cache-file", "FILE",
      "of --method cached: where that is kept for the next run, or off; left out: beside the scene, else among the "
      "user's caches",
      NULL },
    { "stored-paths", "N", "of --caustics stored: how many are kept; 0: 64 a pixel", "0" },
    { "renew", "K", "of --caustics stored: one of K parts is drawn anew for each picture; 0: none", "512" },
    { "seed", "K", "of all random numbers", "0" },
    { NULL, NULL, NULL, NULL },
};

void light_options_init(struct option_row rows[LIGHT_OPTIONS], const char *samples, const char *paths)
{
    memcpy(rows, table, sizeof(table));
    for (struct option_row *r = rows; r->name; r++) {
        if (strcmp(r->name, "samples") == 0)
            r->given = samples;
        else if (strcmp(r->name, "paths") == 0)
            r->given = paths;
    }
}

static const struct {
    const char *name;
    uint32_t classes;
} known_paths[] = {
    { "direct", PATH_BACKGROUND | PATH_DIRECT },
    { "caustics", PATH_CAUSTICS },
    { "indirect", PATH_INDIRECT },
    { "all", PATH_ALL },
};

const char *paths_name(uint32_t classes)
{
    for (size_t k = 0; k < sizeof(known_paths) / sizeof(known_paths[0]); k++)
        if (known_paths[k].classes == classes)
            return known_paths[k].name;
    return "";
}

enum err paths_parse(const char *name, uint32_t *classes, struct reason *why)
{
    for (size_t k = 0; k < sizeof(known_paths) / sizeof(known_paths[0]); k++)
        if (strcmp(name, known_paths[k].name) == 0) {
            *classes = known_paths[k].classes;
            return ERR_OK;
        }
    return err_say(why, ERR_USAGE, "--paths '%s' is not known; there are direct, caustics, indirect and all", name);
}

static enum err read_start(const char *name, enum start_kind *out, struct reason *why)
{
    static const char *const names[] = { [START_FACES] = "faces", [START_QUAD] = "quad", [START_DISC] = "disc" };

    for (int k = 0; k < 3; k++)
        if (strcmp(name, names[k]) == 0) {
            *out = (enum start_kind)k;
            return ERR_OK;
        }
    return err_say(why, ERR_USAGE, "--start '%s' is not known; there are faces, quad and disc", name);
}

static enum err read_compensate(const char *name, enum compensate *out, struct reason *why)
{
    static const char *const names[] = { [COMPENSATE_OFF] = "off", [COMPENSATE_ON] = "on", [COMPENSATE_AUTO] = "auto" };

    for (int k = 0; k < 3; k++)
        if (strcmp(name, names[k]) == 0) {
            *out = (enum compensate)k;
            return ERR_OK;
        }
    return err_say(why, ERR_USAGE, "--compensate '%s' is not known; there are off, on and auto", name);
}

/* A power of two up to `most`. */
static enum err read_power(const struct options *o, const char *flag, uint32_t most, uint32_t *out, struct reason *why)
{
    uint64_t v = 0;
    const enum err e = options_u64(o, flag, 1, most, &v, why);

    if (e)
        return e;
    if (v & (v - 1))
        return err_say(why, ERR_USAGE, "--%s '%s' is no power of two", flag, options_get(o, flag));
    *out = (uint32_t)v;
    return ERR_OK;
}

static enum err read_numbers(const struct options *o, struct relight_desc *light, struct reason *why)
{
    uint64_t samples = 0, eye_paths = 0, megabytes = 0, renew = 0;
    enum err e = options_u64(o, "samples", 1, 1 << 20, &samples, why);

    if (!e)
        e = options_u64(o, "seed", 0, UINT64_MAX, &light->direct.seed, why);
    if (!e)
        e = options_u64(o, "particles", 0, (uint64_t)1 << 40, &light->particles, why);
    if (!e)
        e = options_u64(o, "eye-paths", 0, 1 << 20, &eye_paths, why);
    if (!e)
        e = read_power(o, "cells", 8, &light->direct.cells, why);
    if (!e)
        e = read_power(o, "interleave", 4, &light->direct.interleave, why);
    if (!e)
        e = options_u64(o, "stored-paths", 0, (uint64_t)1 << 40, &light->stored_paths, why);
    if (!e)
        e = options_u64(o, "renew", 0, CAUSTIC_PARTS_MAX, &renew, why);
    if (!e)
        e = options_u64(o, "cache-memory", 1, (uint64_t)1 << 30, &megabytes, why);
    light->cache_bytes = megabytes * 1000000;
    light->direct.samples = (uint32_t)samples;
    light->eye_paths = (uint32_t)eye_paths;
    light->renew = (uint32_t)renew;
    return e;
}

enum err light_options_read(const struct options *o, struct relight_desc *light, struct set_desc *set,
                            struct environment_desc *environment, struct reason *why)
{
    enum err e = method_parse(options_get(o, "method"), &light->direct.method, why);

    if (!e)
        e = paths_parse(options_get(o, "paths"), &light->classes, why);
    if (!e)
        e = plan_estimator_parse(options_get(o, "caustics"), "--caustics", &light->caustics, why);
    if (!e)
        e = plan_estimator_parse(options_get(o, "indirect"), "--indirect", &light->indirect, why);
    if (!e)
        e = read_start(options_get(o, "start"), &light->start, why);
    if (!e)
        e = read_compensate(options_get(o, "compensate"), &light->direct.compensate, why);
    if (!e)
        e = importance_parse(options_get(o, "importance"), &environment->importance, why);
    if (!e)
        e = read_numbers(o, light, why);
    const char *file = options_get(o, "cache-file");
    light->cache_file = !file ? "" : strcmp(file, "off") == 0 ? NULL : file;
    light->direct.sun = options_on(o, "sun");
    light->direct.no_visibility = options_on(o, "no-visibility");
    set->interleave = light->direct.interleave;
    return e;
}
