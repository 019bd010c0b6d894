/* From a video signal to light: code values to linear Rec.709 in cd/m^2, by range, matrix, transfer function and
 * primaries, each of which is a code point of ITU-T H.273, as video streams state them. Thread: any; a prepared signal
 * is only read. */
#pragma once

#include "base/err.h"
#include "base/setting.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* How code values become light. */
enum signal_transfer {
    SIGNAL_AUTO,   /* as declared by the stream */
    SIGNAL_SRGB,   /* IEC 61966-2-1 */
    SIGNAL_BT1886, /* a display's power of 2.4 [ITU-R BT.1886], also for BT.709, BT.601 and BT.2020 without HDR */
    SIGNAL_GAMMA22,
    SIGNAL_GAMMA28,
    SIGNAL_LINEAR,
    SIGNAL_PQ,  /* absolute, up to 10,000 cd/m^2 [ITU-R BT.2100-2] */
    SIGNAL_HLG, /* on a display of `peak`, with its system gamma [ITU-R BT.2100-2] */
};
extern const struct setting_choice signal_transfer_choices[];
const char *signal_transfer_name(enum signal_transfer transfer); /* static */

#define SIGNAL_WHITE_CDM2 203.0     /* white of signals without an absolute scale [ITU-R BT.2408] */
#define SIGNAL_HLG_PEAK_CDM2 1000.0 /* nominal peak of a display for HLG [ITU-R BT.2100-2] */

struct signal_desc {
    uint8_t primaries, transfer, matrix; /* H.273; 2: not stated */
    bool full_range;                     /* else code values of black and white are those of BT.709 or BT.2100 */
    bool rgb;                            /* the components are R', G' and B'; the matrix is ignored */
    uint32_t depth;                      /* bits of a component, 8 to 16 */
    enum signal_transfer override;       /* AUTO: use `transfer` */
    double peak_cdm2;                    /* luminance of white, or of HLG's peak; of PQ: where it clips; 0: default */
};

enum { SIGNAL_STEPS = 1 << 14 };

struct signal {
    enum signal_transfer transfer; /* never AUTO */
    bool transfer_assumed;         /* the stream did not say */
    float scale[3], offset[3];     /* code value to signal: Y' and R'G'B' 0..1, colour differences -0.5..0.5 */
    float red_cr, green_cb, green_cr, blue_cb; /* R'G'B' from Y' and colour differences */
    bool rgb;
    float top;                     /* the largest signal value that is not clamped */
    float to_rec709[9];            /* row-major */
    float luminance[3];            /* of the primaries, for HLG */
    float ootf;                    /* exponent of HLG's luminance, system gamma - 1 */
    float peak;                    /* HLG: cd/m^2 */
    float light[SIGNAL_STEPS + 2]; /* at signal values i / SIGNAL_STEPS * top: cd/m^2, for HLG 0..1 of the scene */
};

/* Prepares *out. ERR_UNSUPPORTED: a code point that this program does not know, or a depth below 8 or above 16; *why
 * begins with `name`. */
MUST_CHECK enum err signal_prepare(const struct signal_desc *d, const char *name, struct signal *out,
                                   struct reason *why);

/* Converts `count` texels: a, b and c are code values (Y', Cb, Cr or R', G', B') as floats; rgb is linear Rec.709 in
 * cd/m^2, [count][3]. Colours outside of Rec.709 have negative components. */
void signal_row(const struct signal *s, const float *a, const float *b, const float *c, size_t count, float *rgb);

/* ---- Formats of streams ---- */

/* The video format that a container or network protocol declares, passed from the process that demultiplexes (demux)
 * to the one that decodes (decoder). Untrusted. Any thread. */

/* Two eyes in one image; the left one is used. */
enum stream_stereo {
    STEREO_NONE,
    STEREO_TOP,    /* the left eye is the upper half, */
    STEREO_BOTTOM, /* the lower, */
    STEREO_LEFT,   /* the left, */
    STEREO_RIGHT,  /* the right */
};

struct stream_format {
    /* Numbers of libavcodec, which both processes link; this program only passes them on. */
    int32_t codec, tag, pixel_format, profile, level, coded_bits;
    int32_t range, chroma_location;
    uint8_t primaries, transfer, matrix; /* ITU-R H.273 code points; 2: not stated */
    uint8_t layout;                      /* enum layout, from spherical metadata; LAYOUT_AUTO: none */
    uint8_t orientation;                 /* as Exif's, of the display matrix; 0: none */
    uint8_t stereo;                      /* enum stream_stereo */
    float aspect;                        /* of a pixel, width per height; 0: unknown */
    uint32_t width, height;              /* texels; 0: not stated */
    double rate;                         /* frames per second; 0: unknown. Finite and not negative. */
    uint64_t frames;                     /* 0: unknown */
    int64_t duration_us, start_us;       /* 0: unknown; the first time stamp */
    int64_t realtime_us;                 /* wall-clock time of time stamp 0, microseconds since 1970; 0: unknown */
    char codec_name[32];                 /* printable ASCII, for messages */
    char note[320];                      /* what of the metadata was left out; "": nothing */
};
