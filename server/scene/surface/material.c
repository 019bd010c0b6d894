#include "scene/surface/material.h"

#include <assert.h>
#include <math.h>

#define F0_DIELECTRIC 0.04f         /* [glTF 2.0, appendix B.2]: an index of 1.5 */
#define MATTE_GAIN 1.0485f          /* 21/20 less 0.14 %: at roughness 0.3 the lobe reflects so much more than F */
#define MEAN_SCHLICK (1.0f / 21.0f) /* of (1 - cos)^5 over a hemisphere, weighted by the cosine */
#define STEPS 20                    /* of roughness in the tables below */

/* From quadrature of the lobe with F = 1 and albedo E(cos), at roughness 0, 0.05, ..., 1: */
static const float mean_loss[STEPS + 1] = {
    /* the mean of 1 - E */
    0.0f,    0.0f,    0.0004f, 0.0017f, 0.0049f, 0.0118f, 0.0242f, 0.0386f, 0.0595f, 0.0858f, 0.1177f,
    0.1549f, 0.1971f, 0.2433f, 0.2926f, 0.3438f, 0.3958f, 0.4474f, 0.4976f, 0.5457f, 0.5909f,
};
static const float most_matte[STEPS + 1] = {
    /* the minimum over cos of (1 - E) / (20/21 S) */
    0.0f,    0.0f,    0.0f,    0.0f,    0.0001f, 0.0049f, 0.0102f, 0.0187f, 0.0343f, 0.0565f, 0.0883f,
    0.1310f, 0.1843f, 0.2472f, 0.3167f, 0.3512f, 0.3882f, 0.4272f, 0.4683f, 0.5107f, 0.5539f,
};

struct vec3 ggx_f0(struct vec3 base, float metallic, struct vec3 more)
{
    const float d = 1.0f - metallic;
    return vec3_make((F0_DIELECTRIC + more.x) * d + base.x * metallic, (F0_DIELECTRIC + more.y) * d + base.y * metallic,
                     (F0_DIELECTRIC + more.z) * d + base.z * metallic);
}

static float matte_of(float base, float f0, float metallic, float loss, float most)
{
    const float f = f0 + (1.0f - f0) * MEAN_SCHLICK;
    return (1.0f - metallic) * base * (1.0f - f0) * MATTE_GAIN + f * f * (1.0f - loss) / (1.0f - f * loss) * most;
}

struct vec3 ggx_matte(struct vec3 base, float metallic, float roughness, struct vec3 more)
{
    const struct vec3 f0 = ggx_f0(base, metallic, more);
    const float at = fminf(fmaxf(roughness, 0.0f), 1.0f) * (float)STEPS, step = fminf(floorf(at), (float)STEPS - 1.0f);
    const int i = (int)step;
    const float loss = mean_loss[i] + (at - step) * (mean_loss[i + 1] - mean_loss[i]);
    const float most = most_matte[i] + (at - step) * (most_matte[i + 1] - most_matte[i]);

    return vec3_make(matte_of(base.x, f0.x, metallic, loss, most), matte_of(base.y, f0.y, metallic, loss, most),
                     matte_of(base.z, f0.z, metallic, loss, most));
}

struct vec3 ggx_below(struct vec3 colour, struct vec3 base, float metallic, struct vec3 more)
{
    const struct vec3 f0 = ggx_f0(base, metallic, more);
    const float gain = (1.0f - metallic) * MATTE_GAIN;

    return vec3_make(gain * colour.x * (1.0f - f0.x), gain * colour.y * (1.0f - f0.y), gain * colour.z * (1.0f - f0.z));
}

static float attenuation_of(float share, double distance)
{
    return (float)fmin(-log(fmin(fmax((double)share, 1e-12), 1.0)) / distance, (double)ATTENUATION_MAX);
}

struct vec3 attenuation_from(struct vec3 colour, double distance)
{
    return vec3_make(attenuation_of(colour.x, distance), attenuation_of(colour.y, distance),
                     attenuation_of(colour.z, distance));
}

const char *material_kind_name(enum material_kind kind)
{
    switch (kind) {
    case MATERIAL_LAMBERT: return "lambert";
    case MATERIAL_PHONG: return "phong";
    case MATERIAL_GGX: return "ggx";
    case MATERIAL_MIRROR: return "mirror";
    case MATERIAL_GLASS: return "glass";
    }
    assert(!"invalid material kind");
    return "";
}
