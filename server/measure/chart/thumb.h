/* Small images within a page: JPEG in data: addresses. One thread at a time per encoder. */
#pragma once

#include "base/text.h"
#include "image/codec/jpeg.h"
#include "measure/chart/panel.h"

/* Adds `data:image/jpeg;base64,...` of a linear image under the panel's exposure, or of its errors: relative error
 * from 0.1 % (black) over violet and red to 100 % (pale yellow), grey where nothing is compared. ERR_NOMEM. */
MUST_CHECK enum err thumb_image(struct text *t, struct jpeg_encoder *j, const struct panel *p, const float *rgb);
MUST_CHECK enum err thumb_errors(struct text *t, struct jpeg_encoder *j, const struct panel *p, const float *rgb);
