/* Serialises the passes of an image for another process. Thread: the relighter's. */
#pragma once

#include "light/frame/part.h"

/* The passes at the shade points without pointers, for another process of the same program. */
struct light_work {
    bool by_cache, eye_left; /* eye[1] is used, for the packets that the cache omits */
    struct relight_desc cached;
    struct direct_desc direct;
    struct eye_paths_desc eye[2];
    struct plan plan;
};

/* Pack the passes and *stats in one process and unpack them in another, where *work must live as long as *plan.
 * light_work_unpack: ERR_IO if the passes need a cache and this process has none. */
void light_work_pack(const struct frame_plan *plan, const struct relight_stats *stats, struct light_work *work);
MUST_CHECK enum err light_work_unpack(struct relighter *r, const struct light_work *work, struct frame_plan *plan,
                                      struct relight_stats *stats);

/* Copies a request without its pointers. */
struct relight_desc light_work_request(const struct relight_desc *request);
