/* Images of libavcodec to linear texels. Part of relight-video alone. Thread: one. */
#pragma once

#include "image/codec/image.h"
#include "image/codec/signal.h"

struct AVFrame;

struct texels {              /* zeroed memory is empty */
    struct signal_desc desc; /* of `signal`, if it is prepared */
    struct signal *signal;   /* owned */
    bool prepared;
    float *rows; /* owned; five rows of `width` floats */
    uint32_t width;
    enum signal_transfer override;
    double peak_cdm2;
};

/* Converts every component of an image that is planar or packed, RGB, grey or Y'CbCr, with any subsampling and 8 to 16
 * bits: linear Rec.709 in cd/m^2. Chroma is interpolated between its sites. ERR_UNSUPPORTED: another pixel format or
 * colour. ERR_RANGE: too large. ERR_NOMEM. */
MUST_CHECK enum err texels_convert(struct texels *t, const struct AVFrame *f, const char *name, struct image *im,
                                   struct reason *why);
void texels_finish(struct texels *t);
