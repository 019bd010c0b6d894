#include "settings/probe_options.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

enum err probe_options_read(const struct options *o, uint32_t width, uint32_t height, bool *asked,
                            struct probe_request *out, struct reason *why)
{
    const char *text = options_get(o, "probe"), *preset = options_get(o, "probe-preset");
    uint64_t samples = 0;
    char end;

    *asked = text != NULL;
    if (!text && (preset || options_get(o, "probe-samples")))
        return err_say(why, ERR_USAGE, "--probe-samples and --probe-preset are for --probe, which is missing");
    if (!text)
        return ERR_OK;
    if (strspn(text, "0123456789,") != strlen(text) ||
        sscanf(text, "%5" SCNu32 ",%5" SCNu32 "%c", &out->x, &out->y, &end) != 2 || out->x >= width || out->y >= height)
        return err_say(why, ERR_USAGE, "--probe '%s': a pixel of %ux%u is meant, as 0,0, which is at the top left",
                       text, width, height);
    if (preset && strcmp(preset, "fig1") != 0)
        return err_say(why, ERR_USAGE, "--probe-preset '%s': there is fig1", preset);
    out->figure = preset != NULL;
    out->sky = true;
    if (!options_get(o, "probe-samples"))
        return ERR_OK;
    const enum err e = options_u64(o, "probe-samples", 1, PROBE_SAMPLES_MAX, &samples, why);
    out->samples = (uint32_t)samples;
    return e;
}
