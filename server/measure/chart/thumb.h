/* Small images within a page: data: addresses of JPEG files. Owned by the caller; NULL: out of memory. Any thread. */
#pragma once

#include "measure/chart/judge.h"

#include <jansson.h>

/* Of a linear image rgb[height][width][3] with this gain, or of its errors: relative error from 0.1 % (black) over
 * violet and red to 100 % (pale yellow), grey where nothing is compared. */
json_t *thumb_image(const struct judge *j, double gain, const float *rgb);
json_t *thumb_errors(const struct judge *j, const float *rgb);
