/* A map of the hours of sun: how long each pixel's surface sees the sun, on the day of a computed sky, or in all
 * moments of a weather file with sunshine, which are those of 120 W/m^2 of direct normal irradiance and more [WMO
 * 2021]. Glass and mirrors show the hours of what is seen in them. One thread of control; all OpenMP threads are used.
 */
#pragma once

#include "base/err.h"
#include "relightd/settings/settings.h"

struct sun_hours_desc {
    struct setup setup; /* its source, scene, view and rotation count */
    const char *path;   /* .exr: hours, in all three channels; .png: in colour, with a line at each step of the scale */
};

/* ERR_USAGE: another extension, or a source whose sun's way is not known. Errors of daylight_open, source_open,
 * set_create, exr_write and file_store; ERR_NOMEM. */
MUST_CHECK enum err sun_hours_write(const struct sun_hours_desc *desc, struct reason *why);
