/* The video format that a container or network protocol declares, passed from the process that demultiplexes (demux)
 * to the one that decodes (decoder). Untrusted. Any thread. */
#pragma once

#include <stdint.h>

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
