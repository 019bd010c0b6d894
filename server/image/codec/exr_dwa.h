/* DWAA and DWAB parts of OpenEXR files by OpenEXR's C++ library, since OpenEXRCore decodes them only from 3.1.10 on.
 * Private to this room. Thread: any. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct exr_dwa { /* the part to read; borrowed */
    const uint8_t *bytes;
    size_t size;
    int part;
    const char *channels[3];
    int32_t left, top; /* data window */
    uint32_t width, height;
};

enum exr_dwa_result {
    EXR_DWA_OK,
    EXR_DWA_DAMAGED, /* why says what is wrong */
    EXR_DWA_NO_MEMORY,
};

/* Writes the three channels to rgb, float[height][width][3]. */
enum exr_dwa_result exr_dwa_read(const struct exr_dwa *x, float *rgb, char why[128]);

#ifdef __cplusplus
}
#endif
