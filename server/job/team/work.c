#include "job/team/work.h"

/* Whatever points into this process's memory. */
static void forget_pointers(struct direct_desc *d)
{
    d->only = NULL;
    d->counts = NULL;
    d->log = NULL;
    d->cancel = NULL;
    d->progress = NULL;
    d->why = NULL;
}

struct relight_desc light_work_request(const struct relight_desc *request)
{
    struct relight_desc d = *request;

    d.cache_file = d.cache_dir = NULL;
    d.progress = NULL;
    forget_pointers(&d.direct);
    return d;
}

void light_work_pack(const struct image_passes *passes, const struct relight_stats *stats, struct light_work *work)
{
    *work = (struct light_work){ .by_cache = passes->cached != NULL,
                                 .eye_left = passes->eye[1].only != NULL,
                                 .direct = passes->direct,
                                 .eye = { passes->eye[0], passes->eye[1] },
                                 .plan = stats->plan };
    for (uint32_t k = 0; k < PLAN_LEFT_OUT_MAX; k++)
        work->plan.left_out[k] = NULL;
    work->plan.left_out_count = 0;
    if (passes->cached)
        work->cached = light_work_request(passes->cached);
    forget_pointers(&work->direct);
    for (int k = 0; k < 2; k++) {
        work->eye[k].counts = NULL;
        work->eye[k].only = NULL;
        work->eye[k].cancel = NULL;
        work->eye[k].progress = NULL;
        work->eye[k].scratch = NULL;
    }
}

enum err light_work_unpack(struct relighter *r, const struct light_work *work, struct image_passes *passes,
                           struct relight_stats *stats)
{
    *passes = (struct image_passes){ .cached = work->by_cache ? &work->cached : NULL,
                                       .direct = work->direct,
                                       .eye = { work->eye[0], work->eye[1] } };
    *stats = (struct relight_stats){ .plan = work->plan };
    if (work->eye_left)
        passes->eye[1].only = relighter_left(r);
    const bool complete = !work->by_cache || relighter_transport(r, passes);
    return complete && (!work->eye_left || passes->eye[1].only) &&
                   (work->plan.indirect != PLAN_CACHE || !work->by_cache || relighter_left(r))
               ? ERR_OK
               : ERR_IO;
}
