#include "image/video/movie.h"

#include <stddef.h>

#pragma GCC diagnostic ignored "-Wunused-parameter" /* nothing is done with them */

bool movie_available(void)
{
    return false;
}

static enum err say_none(struct reason *why)
{
    return err_say(why, ERR_UNSUPPORTED,
                   "this build writes no video files: it was made without libavcodec or libavformat");
}

enum err movie_create(const struct movie_desc *desc, struct movie **out, struct reason *why)
{
    *out = NULL;
    return say_none(why);
}

enum err movie_add(struct movie *m, const uint16_t *rgb, struct reason *why)
{
    return say_none(why);
}

enum err movie_finish(struct movie *m, struct reason *why)
{
    return say_none(why);
}

void movie_destroy(struct movie *m)
{
}
