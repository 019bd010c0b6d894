#include "relightd/settings/settings.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

const struct setting_choice inspect_presets[] = {
    { "fig1", true, "as in figure 1 of Lu, Pacanowski and Granier 2013", 0 },
    { NULL, 0, NULL, 0 },
};

enum err inspect_options_read(const struct command *c, uint32_t width, uint32_t height, bool *asked,
                              struct inspect_request *out, struct reason *why)
{
    const char *text = command_get(c, "probe");
    char end;

    *asked = text != NULL;
    if (!text && (command_get(c, "probe-preset") || command_get(c, "probe-samples")))
        return err_say(why, ERR_USAGE, "--probe-samples and --probe-preset are for --probe, which is missing");
    if (!text)
        return ERR_OK;
    if (strspn(text, "0123456789,") != strlen(text) ||
        sscanf(text, "%5" SCNu32 ",%5" SCNu32 "%c", &out->x, &out->y, &end) != 2 || out->x >= width || out->y >= height)
        return err_say(why, ERR_USAGE, "--probe '%s' is not a pixel of %ux%u, given as X,Y from 0,0 at the top left",
                       text, width, height);
    out->sky = true;
    return ERR_OK;
}
