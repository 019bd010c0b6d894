#include "image/codec/image.h"

#include "base/mem.h"
#include "base/scratch.h"
#include "image/codec/exr_zip.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

#define HALF_MAX 65504.0f /* the largest finite half float */
#define BLOCK 64          /* texels processed together: 768 bytes, which stay in the first-level cache */

const struct setting_choice layout_choices[] = {
    { "auto", LAYOUT_AUTO, "as the file says; otherwise 2:1 is lat-long", 0 },
    { "latlong", LAYOUT_LATLONG, "lat-long, 2:1", 0 },
    { "latlong-bottom", LAYOUT_LATLONG_BOTTOM_FIRST, "lat-long with the bottom row first", 0 },
    { "cube", LAYOUT_CUBE, "six stacked cube faces, 1:6", 0 },
    { "hcross", LAYOUT_HCROSS, "horizontal cross, 4:3", 0 },
    { "vcross", LAYOUT_VCROSS, "vertical cross, 3:4", 0 },
    { "ball", LAYOUT_BALL, "mirror ball", 0 },
    { "cube-3x2", LAYOUT_CUBE_3X2, "cube faces of video in two rows, 3:2", 0 },
    { "cube-6x1", LAYOUT_CUBE_6X1, "cube faces of video in one row, 6:1", 0 },
    { "fisheye", LAYOUT_FISHEYE, "equidistant fisheye of the upper hemisphere", 0 },
    { NULL, 0, NULL, 0 },
};

enum err image_check_size(const struct image *im, uint64_t width, uint64_t height, const char *where,
                          struct reason *why)
{
    const uint64_t side = im->max_side ? im->max_side : IMAGE_MAX_SIDE, texels = side * ((side + 1) / 2);

    if (width > side || height > side || width * height > texels)
        return err_say(why, ERR_RANGE,
                       "%s: an image of %" PRIu64 "x%" PRIu64 " texels is too large; the limit is %" PRIu64
                       " per side and %" PRIu64 " in all",
                       where, width, height, side, texels);
    return ERR_OK;
}

enum err image_resize(struct image *im, uint32_t width, uint32_t height)
{
    struct reason why;

    if (width == 0 || height == 0 || image_check_size(im, width, height, "", &why))
        return ERR_RANGE;
    const size_t count = (size_t)width * height * 3;
    if (count > im->capacity) {
        /* freed first: both may not fit at once */
        mem_free(im->rgb);
        im->width = im->height = 0;
        im->capacity = 0;
        im->rgb = mem_alloc_raw(count, sizeof(*im->rgb));
        if (!im->rgb)
            return ERR_NOMEM;
        im->capacity = count;
    }
    im->width = width;
    im->height = height;
    im->layout = LAYOUT_AUTO;
    memset(&im->faults, 0, sizeof(im->faults));
    return ERR_OK;
}

void image_trim(struct image *im)
{
    const size_t count = (size_t)im->width * im->height * 3, bytes = count * sizeof(*im->rgb);

    recent_add(&im->recent, bytes);
    if (!recent_is_outgrown(&im->recent, im->capacity * sizeof(*im->rgb)))
        return;
    float *rgb = mem_alloc_raw(count, sizeof(*rgb));
    if (!rgb)
        return;
    memcpy(rgb, im->rgb, bytes);
    mem_free(im->rgb);
    im->rgb = rgb;
    im->capacity = count;
    mem_trim(); /* the resampling tables of such an image were freed in pieces */
}

void image_finish(struct image *im)
{
    if (!im)
        return;
    mem_free(im->rgb);
    scratch_destroy(im->scratch);
    exr_inflater_destroy(im->inflater);
    memset(im, 0, sizeof(*im));
}

/* Whether no value needs to be corrected or counted: the common case, one comparison per value and no branch. */
static bool are_plain(const float *v, size_t count)
{
    int odd = 0;

    for (size_t i = 0; i < count; i++)
        odd |= !(v[i] >= 0.0f && v[i] < HALF_MAX);
    return !odd;
}

/* Before the change of primaries: removes NaN and clamps to +-IMAGE_MAX. */
static void bound(float *v, size_t count, struct image_faults *faults)
{
    for (size_t i = 0; i < count; i++) {
        if (isnan(v[i])) {
            faults->nan++;
            v[i] = 0.0f;
        } else if (fabsf(v[i]) > IMAGE_MAX) {
            faults->infinite++;
            v[i] = v[i] > 0.0f ? IMAGE_MAX : 0.0f;
        } else if (v[i] == HALF_MAX) {
            faults->clipped++;
        }
    }
}

static void drop_negative(float *v, size_t count, struct image_faults *faults)
{
    for (size_t i = 0; i < count; i++) {
        if (v[i] < 0.0f) {
            faults->negative++;
            v[i] = 0.0f;
        }
    }
}

/* A bounded value can exceed the bound only by the matrix; it is clamped without counting it again. */
static void transform(float *v, size_t texels, const float *m)
{
    for (size_t i = 0; i < texels; i++, v += 3) {
        const float r = v[0], g = v[1], b = v[2];
        for (int c = 0; c < 3; c++)
            v[c] = fminf(m[3 * c] * r + m[3 * c + 1] * g + m[3 * c + 2] * b, IMAGE_MAX);
    }
}

void image_sanitise_texels(float *rgb, size_t count, const float *to_rec709, struct image_faults *faults)
{
    for (size_t done = 0; done < count; done += BLOCK) {
        const size_t texels = count - done < BLOCK ? count - done : BLOCK;
        float *v = rgb + 3 * done;

        const bool plain = are_plain(v, 3 * texels);
        if (!plain)
            bound(v, 3 * texels, faults);
        if (to_rec709)
            transform(v, texels, to_rec709);
        if (to_rec709 || !plain)
            drop_negative(v, 3 * texels, faults);
    }
}

const char *layout_name(enum layout layout)
{
    return choice_name(layout_choices, (int)layout);
}
