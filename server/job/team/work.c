#include "job/team/team_internal.h"

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

static void pack_eye(const struct eye_paths_desc *eye, struct light_work *work)
{
    struct eye_paths_desc *own = &work->eye[eye->only != NULL];

    work->eye_left |= eye->only != NULL;
    *own = *eye;
    own->counts = NULL;
    own->only = NULL;
    own->cancel = NULL;
    own->progress = NULL;
    own->scratch = NULL;
}

void light_work_pack(const struct frame_plan *plan, const struct relight_stats *stats, struct light_work *work)
{
    *work = (struct light_work){ .plan = stats->plan };
    for (uint32_t k = 0; k < PLAN_LEFT_OUT_MAX; k++)
        work->plan.left_out[k] = NULL;
    work->plan.left_out_count = 0;
    for (uint32_t k = 0; k < plan->count; k++) {
        const struct pass *s = &plan->pass[k];
        if (s->kind == PASS_CACHED) {
            work->by_cache = true;
            work->cached = light_work_request(s->request);
        } else if (s->kind == PASS_DIRECT) {
            work->direct = s->direct;
            forget_pointers(&work->direct);
        } else if (s->kind == PASS_EYE) {
            pack_eye(&s->eye, work);
        }
    }
}

enum err light_work_unpack(struct relighter *r, const struct light_work *work, struct frame_plan *plan,
                           struct relight_stats *stats)
{
    const struct packet_list *left = relighter_left(r);

    plan->count = 0;
    plan->background = false;
    plan->cancel = NULL;
    *stats = (struct relight_stats){ .plan = work->plan };
    if (work->by_cache)
        frame_plan_add(plan, PASS_CACHED, PATH_DIRECT)->request = &work->cached;
    else
        frame_plan_add(plan, PASS_DIRECT, PATH_DIRECT)->direct = work->direct;
    for (int k = 0; k < (work->eye_left ? 2 : 1); k++) {
        struct pass *s = frame_plan_add(plan, PASS_EYE, work->eye[k].classes | work->eye[k].behind_classes);
        s->eye = work->eye[k];
        s->eye.only = k ? left : NULL;
    }
    const bool complete = !work->by_cache || relighter_transport(r, plan);
    return complete && (!work->eye_left || left) && (work->plan.indirect != PLAN_CACHE || !work->by_cache || left)
               ? ERR_OK
               : ERR_IO;
}
