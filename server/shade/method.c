#include "method.h"

#include <assert.h>
#include <string.h>

static const struct method_recipe recipes[METHOD_COUNT] = {
    [METHOD_UNIFORM] = { "uniform", "evenly over the sphere", STRATA_SPHERE, SHARE_WHOLE, 1.0f, 0.0f },
    [METHOD_BRDF] = { "brdf", "by the material's lobes", STRATA_FACES, SHARE_CORNERS, 0.0f, 1.0f },
    [METHOD_LIGHT] = { "light", "by the sky's luminance", STRATA_ALL, SHARE_WHOLE, 1.0f, 0.0f },
    [METHOD_FACES_UNIFORM] = { "faces-uniform", "six faces, even shares", STRATA_FACES, SHARE_EVEN, 1.0f, 0.0f },
    [METHOD_FACES] = { "faces", "six faces, shares by normal", STRATA_FACES, SHARE_CORNERS, 1.0f, 0.0f },
    [METHOD_MIS] = { "mis", "faces and lobes, balanced", STRATA_FACES, SHARE_CORNERS, 0.5f, 0.5f },
    [METHOD_LATLONG] = { "latlong", "by the source's texels", STRATA_LATLONG, SHARE_WHOLE, 1.0f, 0.0f },
    [METHOD_LATLONG_ROWS] = { "latlong-rows", "likewise, one table", STRATA_ROWS, SHARE_WHOLE, 1.0f, 0.0f },
    [METHOD_PATH] = { .name = "path", .about = "path tracing, the whole picture" },
    [METHOD_MLT] = { .name = "mlt", .about = "Metropolis sampling, the whole picture" },
    [METHOD_PHOTONS] = { .name = "photons", .about = "a photon map, the whole picture, biased" },
    [METHOD_VPL] = { .name = "vpl", .about = "virtual point lights, the whole picture, biased" },
    [METHOD_CACHED] = { "cached", "what stands still computed beforehand; lobes that are too narrow by auto",
                        STRATA_FACES, SHARE_CORNERS, 0.5f, 0.5f },
    [METHOD_AUTO] = { "auto", "chosen for scene and sky", STRATA_FACES, SHARE_CORNERS, 0.5f, 0.5f },
};

const struct method_recipe *method_recipe(enum method m)
{
    assert(m < METHOD_COUNT);
    return &recipes[m == METHOD_AUTO ? METHOD_MIS : m];
}

enum err method_parse(const char *name, enum method *out, struct reason *why)
{
    for (int m = 0; m < METHOD_COUNT; m++)
        if (strcmp(name, recipes[m].name) == 0) {
            *out = (enum method)m;
            return ERR_OK;
        }
    return err_say(why, ERR_USAGE,
                   "unknown method '%s'; there are uniform, brdf, light, faces-uniform, faces, mis, latlong, "
                   "latlong-rows, path, mlt, photons, vpl, cached and auto",
                   name);
}

const char *method_name(enum method m)
{
    assert(m < METHOD_COUNT);
    return recipes[m].name;
}

bool method_is_reference(enum method m)
{
    return m == METHOD_PATH || m == METHOD_MLT || m == METHOD_PHOTONS || m == METHOD_VPL;
}
