#include "relightd/daemon/shared.h"

enum err shared_init(struct shared *s, struct reason *why)
{
    const uint32_t width = s->config.setup.set_desc.width, height = s->config.setup.set_desc.height;

    settings_init(&s->settings, &s->config);
    status_init(&s->status, s);
    if (frame_slots_init(&s->frames, &s->config, s->ranks ? HANDOFF_SLOTS_EARLY : HANDOFF_SLOTS) ||
        image_slots_init(&s->images, width, height))
        return err_say(why, ERR_NOMEM, "no memory for images of %ux%u", width, height);
    return ERR_OK;
}

void shared_finish(struct shared *s)
{
    frame_slots_finish(&s->frames);
    image_slots_finish(&s->images);
    settings_finish(&s->settings);
    status_finish(&s->status);
}

void shared_close(struct shared *s)
{
    handoff_close(&s->frames.handoff);
    handoff_close(&s->images.handoff);
}

bool shared_is_stopping(struct shared *s)
{
    return atomic_load(s->stop) || handoff_is_closed(&s->frames.handoff);
}

void shared_demand(struct shared *s, struct server_demand *out)
{
    bool key;

    server_demand(s->server, out);
    if (!publisher_wants(s->publisher, &key))
        return;
    out->viewers++;
    out->max_rate = 0.0;
    out->formats |= 1u << PROTOCOL_H264;
    out->h264 |= 1u << SHARED_PUBLISH_TRACK;
    out->h264_keys |= key ? 1u << SHARED_PUBLISH_TRACK : 0;
}
