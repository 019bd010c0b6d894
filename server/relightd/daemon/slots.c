#include "relightd/daemon/shared.h"

#include "base/mem.h"
#include "relightd/daemon/config.h"
#include "sky/tables/resample.h"

enum err frame_slots_init(struct frame_slots *s, const struct daemon_config *config, int count)
{
    bool ok;

    handoff_init(&s->handoff);
    s->tables = resample_tables_create();
    s->count = count;
    ok = s->tables != NULL;
    for (int i = 0; i < count && ok; i++) {
        s->slot[i].environment =
            environment_create(&(struct environment_desc){ .layout = config->setup.environment.layout,
                                                           .tables = s->tables,
                                                           .like = i > 0 ? s->slot[0].environment : NULL });
        ok = s->slot[i].environment != NULL;
    }
    return ok ? ERR_OK : ERR_NOMEM;
}

void frame_slots_finish(struct frame_slots *s)
{
    for (int i = 0; i < s->count; i++)
        environment_destroy(s->slot[i].environment);
    resample_tables_destroy(s->tables);
    handoff_finish(&s->handoff);
}

enum err image_slots_init(struct image_slots *s, uint32_t width, uint32_t height)
{
    bool ok = true;

    handoff_init(&s->handoff);
    for (int i = 0; i < HANDOFF_SLOTS && ok; i++) {
        s->slot[i].rgb = mem_alloc((size_t)width * height, 3 * sizeof(float));
        s->slot[i].changes = mem_alloc_raw((size_t)width * height, 3); /* untouched until somebody asks */
        ok = s->slot[i].rgb && s->slot[i].changes;
    }
    return ok ? ERR_OK : ERR_NOMEM;
}

void image_slots_finish(struct image_slots *s)
{
    for (int i = 0; i < HANDOFF_SLOTS; i++) {
        mem_free(s->slot[i].rgb);
        mem_free(s->slot[i].changes);
    }
    handoff_finish(&s->handoff);
}

void image_slots_publish(struct image_slots *s, int slot, struct server *server)
{
    const int dropped = handoff_publish(&s->handoff, slot);

    if (dropped != HANDOFF_NONE)
        server_frame_fate(server, &s->slot[dropped].ticket, SERVER_SUPERSEDED, NULL);
}
