#include "import/decoder/internal.h"

#include "base/mem.h"

#include <libavutil/frame.h>
#include <libavutil/pixdesc.h>
#include <string.h>

#define HD_WIDTH 1280 /* from here on, video that does not state its matrix is BT.709, else BT.601 */
#define HD_HEIGHT 577

enum { ROW_A, ROW_B, ROW_C, ROW_CHROMA, ROW_OTHER, ROWS };

/* ---- Colour ---- */

static uint8_t matrix_of(const AVFrame *f)
{
    if (f->colorspace != AVCOL_SPC_UNSPECIFIED)
        return (uint8_t)f->colorspace;
    if (f->color_primaries == AVCOL_PRI_BT2020)
        return AVCOL_SPC_BT2020_NCL;
    return f->width >= HD_WIDTH || f->height >= HD_HEIGHT ? AVCOL_SPC_BT709 : AVCOL_SPC_SMPTE170M;
}

static bool is_full_range(const AVFrame *f, const AVPixFmtDescriptor *d)
{
    if (f->color_range != AVCOL_RANGE_UNSPECIFIED)
        return f->color_range == AVCOL_RANGE_JPEG;
    return (d->flags & AV_PIX_FMT_FLAG_RGB) || f->format == AV_PIX_FMT_YUVJ420P || f->format == AV_PIX_FMT_YUVJ422P ||
           f->format == AV_PIX_FMT_YUVJ444P || f->format == AV_PIX_FMT_YUVJ440P;
}

/* Prepares the conversion, unless the last image had the same colours. */
static enum err match_signal(struct texels *t, const AVFrame *f, const AVPixFmtDescriptor *d, const char *name,
                             struct reason *why)
{
    struct signal_desc want;

    memset(&want, 0, sizeof(want)); /* padding too: it is compared */
    want.primaries = (uint8_t)f->color_primaries;
    want.transfer = (uint8_t)f->color_trc;
    want.matrix = matrix_of(f);
    want.full_range = is_full_range(f, d);
    want.rgb = d->flags & AV_PIX_FMT_FLAG_RGB;
    want.depth = (uint32_t)d->comp[0].depth;
    want.override = t->override;
    want.peak_cdm2 = t->peak_cdm2;
    if (t->prepared && memcmp(&want, &t->desc, sizeof(want)) == 0)
        return ERR_OK;
    t->prepared = false;
    if (!t->signal)
        t->signal = mem_alloc(1, sizeof(*t->signal));
    if (!t->signal)
        return err_say(why, ERR_NOMEM, "%s: out of memory for its colours", name);
    const enum err e = signal_prepare(&want, name, t->signal, why);
    t->prepared = !e;
    t->desc = want;
    return e;
}

/* ---- Components ---- */

/* Where component c of an image's row y lies, and how far apart its values are. */
struct component {
    const uint8_t *at;
    int step, shift;
    uint32_t mask;
    bool wide, swapped; /* two bytes each; big-endian */
};

static struct component component_of(const AVFrame *f, const AVPixFmtDescriptor *d, int c, int y)
{
    const AVComponentDescriptor *k = &d->comp[c];

    return (struct component){
        .at = f->data[k->plane] + (ptrdiff_t)y * f->linesize[k->plane] + k->offset,
        .step = k->step,
        .shift = k->shift,
        .mask = (1u << k->depth) - 1u,
        .wide = k->depth + k->shift > 8,
        .swapped = d->flags & AV_PIX_FMT_FLAG_BE,
    };
}

static void read_row(const struct component *k, uint32_t count, float *out)
{
    const uint8_t *p = k->at;

    if (!k->wide && k->step == 1 && k->shift == 0) {
        for (uint32_t x = 0; x < count; x++)
            out[x] = p[x];
        return;
    }
    for (uint32_t x = 0; x < count; x++, p += k->step) {
        uint32_t v = p[0];
        if (k->wide)
            v = k->swapped ? v << 8 | p[1] : v | (uint32_t)p[1] << 8;
        out[x] = (float)(v >> k->shift & k->mask);
    }
}

/* Where the chroma sample of index 0 lies among the luma samples, in each direction: at the first one or in the middle
 * of those it stands for [ITU-T H.273, chroma sample location]. */
static void find_sites(const AVFrame *f, const AVPixFmtDescriptor *d, float *across, float *down)
{
    const float middle_x = 0.5f * (float)((1 << d->log2_chroma_w) - 1),
                middle_y = 0.5f * (float)((1 << d->log2_chroma_h) - 1);
    const int site = f->chroma_location;

    *across = site == AVCHROMA_LOC_CENTER || site == AVCHROMA_LOC_TOP || site == AVCHROMA_LOC_BOTTOM ? middle_x : 0.0f;
    *down = site == AVCHROMA_LOC_TOPLEFT || site == AVCHROMA_LOC_TOP         ? 0.0f
            : site == AVCHROMA_LOC_BOTTOMLEFT || site == AVCHROMA_LOC_BOTTOM ? 2.0f * middle_y
                                                                             : middle_y;
}

/* The chroma component c of luma row y, interpolated to the width of luma. */
static void read_chroma(const struct texels *t, const AVFrame *f, const AVPixFmtDescriptor *d, int c, int y, float *out)
{
    const int width = AV_CEIL_RSHIFT(f->width, d->log2_chroma_w), height = AV_CEIL_RSHIFT(f->height, d->log2_chroma_h);
    const float per_x = 1.0f / (float)(1 << d->log2_chroma_w), per_y = 1.0f / (float)(1 << d->log2_chroma_h);
    float *upper = t->rows + (size_t)ROW_CHROMA * t->width, *lower = t->rows + (size_t)ROW_OTHER * t->width, x0, y0;

    find_sites(f, d, &x0, &y0);
    float at = ((float)y - y0) * per_y;
    at = at > 0.0f ? at : 0.0f;
    const int first = (int)at < height ? (int)at : height - 1, second = first + 1 < height ? first + 1 : first;
    const float part = at - (float)first;
    struct component k = component_of(f, d, c, first);
    read_row(&k, (uint32_t)width, upper);
    if (part > 0.0f && second != first) {
        k = component_of(f, d, c, second);
        read_row(&k, (uint32_t)width, lower);
        for (int x = 0; x < width; x++)
            upper[x] += part * (lower[x] - upper[x]);
    }
    for (int x = 0; x < f->width; x++) {
        float place = ((float)x - x0) * per_x;
        place = place > 0.0f ? place : 0.0f;
        const int left = (int)place < width ? (int)place : width - 1, right = left + 1 < width ? left + 1 : left;
        out[x] = upper[left] + (place - (float)left) * (upper[right] - upper[left]);
    }
}

static void read_component(const struct texels *t, const AVFrame *f, const AVPixFmtDescriptor *d, int c, int y,
                           float *out)
{
    const bool chroma = c > 0 && !(d->flags & AV_PIX_FMT_FLAG_RGB);

    if (chroma && (d->log2_chroma_w || d->log2_chroma_h)) {
        read_chroma(t, f, d, c, y, out);
    } else {
        const struct component k = component_of(f, d, c, y);
        read_row(&k, (uint32_t)f->width, out);
    }
}

/* ---- Images ---- */

static enum err check_format(const AVFrame *f, const AVPixFmtDescriptor *d, const char *name, struct reason *why)
{
    const uint64_t barred = AV_PIX_FMT_FLAG_PAL | AV_PIX_FMT_FLAG_BITSTREAM | AV_PIX_FMT_FLAG_HWACCEL |
                            AV_PIX_FMT_FLAG_FLOAT | AV_PIX_FMT_FLAG_BAYER;
    bool plain = d && !(d->flags & barred);

    for (int c = 0; plain && c < d->nb_components; c++)
        plain = f->data[d->comp[c].plane] && d->comp[c].depth == d->comp[0].depth;
    if (plain)
        return ERR_OK;
    return err_say(why, ERR_UNSUPPORTED, "%s: its pixel format %s is not supported", name, d ? d->name : "(unknown)");
}

static enum err reserve_rows(struct texels *t, uint32_t width)
{
    if (t->rows && t->width >= width)
        return ERR_OK;
    mem_free(t->rows);
    t->width = 0;
    t->rows = mem_alloc_raw(width, ROWS * sizeof(float));
    if (!t->rows)
        return ERR_NOMEM;
    t->width = width;
    return ERR_OK;
}

enum err texels_convert(struct texels *t, const AVFrame *f, const char *name, struct image *im, struct reason *why)
{
    const AVPixFmtDescriptor *d = av_pix_fmt_desc_get((enum AVPixelFormat)f->format);
    const uint32_t width = (uint32_t)f->width, height = (uint32_t)f->height;

    enum err e = check_format(f, d, name, why);
    if (!e)
        e = match_signal(t, f, d, name, why);
    if (!e)
        e = image_check_size(im, width, height, name, why);
    if (!e && (image_resize(im, width, height) || reserve_rows(t, width)))
        e = err_say(why, ERR_NOMEM, "%s: out of memory for %ux%u texels", name, width, height);
    if (e)
        return e;
    float *a = t->rows + (size_t)ROW_A * t->width, *b = t->rows + (size_t)ROW_B * t->width,
          *c = t->rows + (size_t)ROW_C * t->width;
    const bool grey = d->nb_components < 3;
    for (uint32_t x = 0; grey && x < width; x++) /* no colour difference */
        b[x] = c[x] = (float)(1u << (d->comp[0].depth - 1));
    for (int y = 0; y < f->height; y++) {
        read_component(t, f, d, 0, y, a);
        if (!grey) {
            read_component(t, f, d, 1, y, b);
            read_component(t, f, d, 2, y, c);
        }
        signal_row(t->signal, a, b, c, width, im->rgb + 3 * (size_t)width * (size_t)y);
    }
    return ERR_OK;
}

void texels_finish(struct texels *t)
{
    mem_free(t->signal);
    mem_free(t->rows);
    *t = (struct texels){ .signal = NULL };
}
