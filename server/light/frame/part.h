/* Distributes one image over several processes that hold the same set. The first process has the image's
 * environment. It describes the passes (job/team/team_internal.h) and assigns the shade points; others run the passes
 * for a part of the packets, and the results are collected in one array. The bits equal those of one process, since a
 * packet's light depends on no other packet.
 *
 * The first process does everything else: light added to pixels, resolving, histories and filters of noisy images. An
 * image that needs these at its shade points is not distributed. Thread: the relighter's. */
#pragma once

#include "light/frame/frame_plan.h"

struct cache_share;

struct light_part {
    uint32_t first, end;          /* packets first .. end - 1 */
    enum transport_narrow narrow; /* of the cache */
    bool sky_taken;               /* by transport_take_sky or transport_unpack_sky */
};

/* Lights all shade points of an image into lo with several processes; *stats is that of the caller's part. */
struct light_team {
    enum err (*points)(void *context, struct relighter *r, const struct environment *e, const struct frame_plan *plan,
                       float *lo, struct relight_stats *stats);
    void *context;
};

/* From now on the relighter distributes its images where possible. team is borrowed; NULL ends it. */
void relighter_join(struct relighter *r, const struct light_team *team);

/* From now on the relighter computes its cache with other processes, which call relighter_prepare at the same time, or
 * from share->begin; it keeps what its packets need. share is borrowed; NULL ends it. */
void relighter_share(struct relighter *r, const struct cache_share *share);

/* Frees what the caches hold outside share->first .. share->end - 1, a range that has shrunk since the caches were
 * made. Between images' points. ERR_NOMEM. */
MUST_CHECK enum err relighter_narrow(struct relighter *r);

/* Rounds light at shade points to half floats, at most 65504, whichever process computes it. */
void relighter_round(struct relighter *r, bool half);

/* The same for an array. */
void light_round(float *lo, size_t count);

/* Whether a method lights each shade point from the sky's cube faces alone. Methods on the lat-long image do not, and
 * references light pixels. */
bool light_deals(enum method method);

/* Whether every packet's light in these passes depends on that packet alone. */
bool relighter_can_deal(const struct relighter *r, const struct frame_plan *plan);

/* The cache that these passes use; NULL if none or if it is incomplete. */
struct transport *relighter_transport(const struct relighter *r, const struct frame_plan *plan);
const struct transport_indirect *relighter_indirect(const struct relighter *r, const struct frame_plan *plan,
                                                    const struct plan *choice);

/* The cache of direct light; NULL if there is none. */
const struct transport *relighter_cache(const struct relighter *r);

/* Whether all caches of a request with indirect light are there, so that none will be computed any more. */
bool relighter_is_complete(const struct relighter *r);

/* Bytes of the G-buffer and the caches. */
uint64_t relighter_memory(const struct relighter *r);

/* The packets of an ascending list that belong to a part. */
struct packet_list light_part_list(const struct packet_list *all, const struct light_part *part);

/* Runs the passes for a part, into its packets of lo: float[packet_count][3][16]. Errors are those of relighter_run. */
MUST_CHECK enum err relighter_run_part(struct relighter *r, const struct environment *e, const struct frame_plan *plan,
                                       const struct light_part *part, float *lo, struct relight_stats *stats);
