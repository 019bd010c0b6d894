#include "light/estimators/method.h"

#include <assert.h>

const struct setting_choice method_choices[] = {
    { "uniform", METHOD_UNIFORM, "uniform over the sphere", 0 },
    { "brdf", METHOD_BRDF, "BRDF importance sampling", 0 },
    { "light", METHOD_LIGHT, "by the environment map's luminance", 0 },
    { "faces-uniform", METHOD_FACES_UNIFORM, "six cube faces, equal shares", 0 },
    { "faces", METHOD_FACES, "six cube faces, shares by normal", 0 },
    { "mis", METHOD_MIS, "faces and BRDF, balance heuristic", 0 },
    { "latlong", METHOD_LATLONG, "by the texels of a lat-long environment map, row by row", 0 },
    { "latlong-rows", METHOD_LATLONG_ROWS, "by the texels of a lat-long environment map, one table", 0 },
    { "path", METHOD_PATH, "reference: path tracing of the whole image", FOR_RENDER },
    { "mlt", METHOD_MLT, "reference: Metropolis light transport, the whole image", FOR_RENDER },
    { "photons", METHOD_PHOTONS, "reference: photon mapping of the whole image, biased", FOR_RENDER },
    { "vpl", METHOD_VPL,
      "reference: virtual point lights; no caustics; wrong in corners, and everywhere with few lights", FOR_RENDER },
    { "components", METHOD_COMPONENTS, "adds up the images of --parts, one rendered for each patch of Radiance's sky",
      FOR_RELIGHTD | FOR_RENDER },
    { "cached", METHOD_CACHED, "cached light transport of the static scene, biased; auto for narrow lobes",
      FOR_RELIGHTD | FOR_RENDER | FOR_CONTROL },
    { "auto", METHOD_AUTO, "chosen for scene and environment", 0 },
    { NULL, 0, NULL, 0 },
};

static const struct method_recipe recipes[METHOD_COUNT] = {
    [METHOD_UNIFORM] = { STRATA_SPHERE, SHARE_WHOLE, 1.0f, 0.0f, false, false },
    [METHOD_BRDF] = { STRATA_FACES, SHARE_CORNERS, 0.0f, 1.0f, false, false },
    [METHOD_LIGHT] = { STRATA_ALL, SHARE_WHOLE, 1.0f, 0.0f, false, false },
    [METHOD_FACES_UNIFORM] = { STRATA_FACES, SHARE_EVEN, 1.0f, 0.0f, false, false },
    [METHOD_FACES] = { STRATA_FACES, SHARE_CORNERS, 1.0f, 0.0f, false, false },
    [METHOD_MIS] = { STRATA_FACES, SHARE_CORNERS, 0.5f, 0.5f, false, false },
    [METHOD_LATLONG] = { STRATA_LATLONG, SHARE_WHOLE, 1.0f, 0.0f, false, false },
    [METHOD_LATLONG_ROWS] = { STRATA_ROWS, SHARE_WHOLE, 1.0f, 0.0f, false, false },
    [METHOD_CACHED] = { STRATA_FACES, SHARE_CORNERS, 0.5f, 0.5f, false, false },
    [METHOD_AUTO] = { STRATA_FACES, SHARE_CORNERS, 0.5f, 0.5f, true, true },
};

const struct method_recipe *method_recipe(enum method m)
{
    assert(m < METHOD_COUNT);
    return &recipes[m];
}

enum method method_by_rule(enum method m)
{
    return m == METHOD_AUTO ? METHOD_MIS : m;
}

const char *method_name(enum method m)
{
    return choice_name(method_choices, (int)m);
}

bool method_is_reference(enum method m)
{
    return m == METHOD_PATH || m == METHOD_MLT || m == METHOD_PHOTONS || m == METHOD_VPL || m == METHOD_COMPONENTS;
}
