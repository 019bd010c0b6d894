#include "net/publish/publish.h"

#include <stddef.h>

#pragma GCC diagnostic ignored "-Wunused-parameter" /* nothing is done with them */

enum err publish_available(struct reason *why)
{
    return err_say(why, ERR_UNSUPPORTED,
                   "--publish: this build was made without libavcodec or libavformat (RELIGHT_H264, RELIGHT_VIDEO)");
}

enum err publisher_create(const struct publish_target *targets, uint32_t count, struct publisher **out,
                          struct reason *why)
{
    *out = NULL;
    return count > 0 ? publish_available(why) : ERR_OK;
}

bool publisher_wants(struct publisher *p, bool *key)
{
    *key = false;
    return false;
}

void publisher_push(struct publisher *p, struct sent_image *image, int64_t time_us)
{
}

uint32_t publisher_report(struct publisher *p, struct server_publish out[SERVER_PUBLISH_MAX])
{
    return 0;
}

bool publisher_destroy(struct publisher *p)
{
    return true;
}
