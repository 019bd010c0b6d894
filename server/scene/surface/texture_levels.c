#include "scene/surface/texture.h"

#include "base/mem.h"

#include <math.h>
#include <string.h>

/* [IEC 61966-2-1, section 5.2]: byte / 255 in sRGB to linear, to the nearest float. */
const float texture_srgb[256] = {
    /* clang-format off */
    0.0f, 0.000303527f, 0.000607054f, 0.000910581f, 0.001214108f, 0.001517635f, 0.001821162f, 0.0021246888f,
    0.002428216f, 0.0027317428f, 0.00303527f, 0.0033465358f, 0.0036765074f, 0.004024717f, 0.004391442f, 0.0047769533f,
    0.0051815165f, 0.0056053917f, 0.006048833f, 0.0065120906f, 0.00699541f, 0.007499032f, 0.008023193f, 0.008568126f,
    0.009134059f, 0.009721218f, 0.010329823f, 0.010960094f, 0.011612245f, 0.012286488f, 0.0129830325f, 0.013702083f,
    0.014443844f, 0.015208514f, 0.015996294f, 0.016807375f, 0.017641954f, 0.01850022f, 0.019382361f, 0.020288562f,
    0.02121901f, 0.022173885f, 0.023153367f, 0.024157632f, 0.02518686f, 0.026241222f, 0.027320892f, 0.02842604f,
    0.029556835f, 0.030713445f, 0.031896032f, 0.033104766f, 0.034339808f, 0.035601314f, 0.03688945f, 0.038204372f,
    0.039546236f, 0.0409152f, 0.04231141f, 0.04373503f, 0.045186203f, 0.046665087f, 0.048171826f, 0.049706567f,
    0.051269457f, 0.052860647f, 0.054480277f, 0.05612849f, 0.05780543f, 0.059511237f, 0.061246052f, 0.063010015f,
    0.064803265f, 0.06662594f, 0.06847817f, 0.070360094f, 0.07227185f, 0.07421357f, 0.07618538f, 0.07818742f,
    0.08021982f, 0.08228271f, 0.08437621f, 0.08650046f, 0.08865558f, 0.09084171f, 0.093058966f, 0.09530747f,
    0.09758735f, 0.099898726f, 0.10224173f, 0.104616486f, 0.107023105f, 0.10946171f, 0.11193243f, 0.114435375f,
    0.116970666f, 0.11953843f, 0.122138776f, 0.12477182f, 0.12743768f, 0.13013647f, 0.13286832f, 0.13563333f,
    0.13843161f, 0.14126329f, 0.14412847f, 0.14702727f, 0.14995979f, 0.15292615f, 0.15592647f, 0.15896083f,
    0.16202937f, 0.1651322f, 0.1682694f, 0.17144111f, 0.1746474f, 0.17788842f, 0.18116425f, 0.18447499f, 0.18782078f,
    0.19120169f, 0.19461784f, 0.19806932f, 0.20155625f, 0.20507874f, 0.20863687f, 0.21223076f, 0.2158605f, 0.2195262f,
    0.22322796f, 0.22696587f, 0.23074006f, 0.23455058f, 0.23839757f, 0.24228112f, 0.24620132f, 0.25015828f,
    0.2541521f, 0.25818285f, 0.26225066f, 0.2663556f, 0.2704978f, 0.2746773f, 0.27889428f, 0.28314874f, 0.28744084f,
    0.29177064f, 0.29613826f, 0.30054379f, 0.3049873f, 0.30946892f, 0.31398872f, 0.31854677f, 0.3231432f, 0.3277781f,
    0.33245152f, 0.33716363f, 0.34191442f, 0.34670407f, 0.3515326f, 0.35640013f, 0.3613068f, 0.3662526f, 0.3712377f,
    0.37626213f, 0.38132602f, 0.38642943f, 0.39157248f, 0.39675522f, 0.40197778f, 0.4072402f, 0.4125426f, 0.41788507f,
    0.42326766f, 0.4286905f, 0.43415365f, 0.43965718f, 0.4452012f, 0.4507858f, 0.45641103f, 0.462077f, 0.4677838f,
    0.47353148f, 0.47932017f, 0.48514995f, 0.49102086f, 0.49693298f, 0.5028865f, 0.50888133f, 0.5149177f, 0.52099556f,
    0.5271151f, 0.5332764f, 0.5394795f, 0.54572445f, 0.55201143f, 0.5583404f, 0.5647115f, 0.57112485f, 0.57758045f,
    0.58407843f, 0.59061885f, 0.59720176f, 0.60382736f, 0.61049557f, 0.6172066f, 0.6239604f, 0.63075715f, 0.63759685f,
    0.6444797f, 0.65140563f, 0.65837485f, 0.6653873f, 0.67244315f, 0.6795425f, 0.6866853f, 0.69387174f, 0.7011019f,
    0.70837575f, 0.7156935f, 0.7230551f, 0.73046076f, 0.7379104f, 0.7454042f, 0.7529422f, 0.7605245f, 0.76815116f,
    0.7758222f, 0.7835378f, 0.7912979f, 0.7991027f, 0.80695224f, 0.8148466f, 0.82278574f, 0.8307699f, 0.838799f,
    0.8468732f, 0.8549926f, 0.8631572f, 0.8713671f, 0.8796224f, 0.8879231f, 0.8962694f, 0.9046612f, 0.91309863f,
    0.92158186f, 0.9301109f, 0.9386857f, 0.9473065f, 0.9559733f, 0.9646863f, 0.9734453f, 0.9822506f, 0.9911021f, 1.0f,
    /* clang-format on */
};

#define GUESSES 4096 /* 1 / GUESSES is less than the distance of any two values of texture_srgb */

/* Linear values to the byte with the nearest one. */
struct encoder {
    const float *linear;    /* [256], rising */
    uint8_t first[GUESSES]; /* the byte for the lower end of each interval */
};

/* Whether the byte's successor is nearer. Halves become even: rounded up or down at each level, they would add up. */
static bool is_above(const float *linear, unsigned byte, float x)
{
    const float half = byte < 255 ? 0.5f * (linear[byte] + linear[byte + 1]) : INFINITY;
    return x > half || (x == half && byte % 2 == 1);
}

static void encoder_init(struct encoder *e, const float *linear)
{
    unsigned byte = 0;

    e->linear = linear;
    for (unsigned i = 0; i < GUESSES; i++) {
        while (is_above(linear, byte, (float)i / GUESSES))
            byte++;
        e->first[i] = (uint8_t)byte;
    }
}

static uint8_t encode(const struct encoder *e, float x)
{
    const unsigned at = (unsigned)(x * GUESSES);
    unsigned byte = e->first[at < GUESSES ? at : GUESSES - 1];

    while (is_above(e->linear, byte, x))
        byte++;
    return (uint8_t)byte;
}

/* The texels 2 i .. 2 i + 2 of a row of n that texel i of the next level covers, and their shares. If n is odd, a texel
 * covers more than two [Guthe and Heckbert 2005]. Returns their number. */
static uint32_t cover(uint32_t n, uint32_t i, float share[3])
{
    const uint32_t half = n / 2;

    if (n == 1) {
        share[0] = 1.0f;
        return 1;
    }
    if (n % 2 == 0) {
        share[0] = share[1] = 0.5f;
        return 2;
    }
    share[0] = (float)(half - i) / (float)n;
    share[1] = (float)half / (float)n;
    share[2] = (float)(i + 1) / (float)n;
    return 3;
}

/* Texel (x, y) of the next level: the mean of the area that it covers. */
static void mean_texel(const struct texture *t, const struct encoder *e, const uint8_t *from, uint32_t width,
                       uint32_t height, uint32_t x, uint32_t y, uint8_t out[4])
{
    float share_x[3], share_y[3], colour[3] = { 0 }, covered[3] = { 0 }, alpha = 0.0f;
    const uint32_t columns = cover(width, x, share_x), rows = cover(height, y, share_y);

    for (uint32_t j = 0; j < rows; j++) {
        for (uint32_t i = 0; i < columns; i++) {
            const uint8_t *texel = from + 4 * ((size_t)(2 * y + j) * width + 2 * x + i);
            const float w = share_x[i] * share_y[j], a = w * (float)texel[3];
            alpha += a;
            for (int k = 0; k < 3; k++) {
                colour[k] += w * e->linear[texel[k]];
                covered[k] += a * e->linear[texel[k]];
            }
        }
    }
    for (int k = 0; k < 3; k++) {
        const bool by_alpha = t->values == TEXTURE_CUTOUT && alpha > 0.0f;
        out[k] = encode(e, by_alpha ? covered[k] / alpha : colour[k]);
    }
    out[3] = (uint8_t)lrintf(alpha);
}

uint32_t texture_level_count(uint32_t width, uint32_t height)
{
    uint32_t levels = 1;

    while ((width >> levels) | (height >> levels))
        levels++;
    return levels;
}

uint64_t texture_texel_count(uint32_t width, uint32_t height)
{
    uint64_t count = 0;

    for (uint32_t level = 0; level < texture_level_count(width, height); level++)
        count += (uint64_t)texture_level_side(width, level) * texture_level_side(height, level);
    return count;
}

enum err texture_init(struct texture *t, uint32_t width, uint32_t height, enum texture_values values)
{
    *t = (struct texture){ .width = width, .height = height, .values = values };
    t->texels = mem_alloc_raw(texture_texel_count(width, height), 4);
    return t->texels ? ERR_OK : ERR_NOMEM;
}

void texture_finish(struct texture *t)
{
    mem_free(t->texels);
    *t = (struct texture){ 0 };
}

enum err texture_coarsen(struct texture *t)
{
    const uint32_t width = texture_level_side(t->width, 1), height = texture_level_side(t->height, 1);
    const size_t count = texture_texel_count(width, height);
    uint8_t *texels = mem_alloc_raw(count, 4);

    if (!texels)
        return ERR_NOMEM;
    memcpy(texels, t->texels + 4 * (size_t)t->width * t->height, 4 * count);
    mem_free(t->texels);
    t->texels = texels;
    t->width = width;
    t->height = height;
    t->left_out++;
    return ERR_OK;
}

void texture_build_levels(struct texture *t)
{
    const uint32_t levels = texture_level_count(t->width, t->height);
    float numbers[256];
    struct encoder e;
    uint8_t *from = t->texels;

    for (int i = 0; i < 256; i++)
        numbers[i] = (float)i / 256.0f; /* exact, as are then the means */
    encoder_init(&e, t->values == TEXTURE_LINEAR ? numbers : texture_srgb);
    for (uint32_t level = 1; level < levels; level++) {
        const uint32_t width = texture_level_side(t->width, level - 1);
        const uint32_t height = texture_level_side(t->height, level - 1);
        uint8_t *out = from + 4 * (size_t)width * height;
        const uint32_t half = texture_level_side(width, 1);
        for (uint32_t y = 0; y < texture_level_side(height, 1); y++) {
            for (uint32_t x = 0; x < half; x++)
                mean_texel(t, &e, from, width, height, x, y, out + 4 * ((size_t)y * half + x));
        }
        from = out;
    }
}
