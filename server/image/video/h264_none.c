#include "image/video/h264.h"

#pragma GCC diagnostic ignored "-Wunused-parameter" /* nothing is done with them */

bool h264_built(void)
{
    return false;
}

bool h264_available(void)
{
    return false;
}

double h264_max_useful_rate(uint32_t width, uint32_t height, double rate)
{
    return 0.0;
}

struct h264_encoder *h264_encoder_create(void)
{
    return NULL;
}

void h264_encoder_destroy(struct h264_encoder *h)
{
}

enum err h264_encode(struct h264_encoder *h, const uint8_t *rgb, const struct h264_desc *desc, struct h264_output *out)
{
    *out = (struct h264_output){ 0 };
    return ERR_UNSUPPORTED;
}
