/* One picture on several processes that hold the same set. The first, which has the picture's environment, deals the
 * shade points out: it describes the passes (team/work.h), others run them for a part of the packets, and
 * their light comes together in one array. The bits are those of one process, since a packet's light depends on no
 * other packet.
 *
 * All else is the first one's own: what adds light to pixels, the resolving, histories and filters of noisy pictures. A
 * picture that needs these at its points is not dealt. Thread: the relighter's. */
#ifndef LIGHT_PART_H
#define LIGHT_PART_H

#include "light/relight_passes.h"

struct light_part {
    uint32_t first, end;          /* packets first .. end - 1 */
    enum transport_narrow narrow; /* of the cache */
    bool sky_taken;               /* by transport_take_sky or transport_unpack_sky */
};

/* Lights all shade points of a picture into lo by several processes; *stats is that of the caller's part. */
struct light_team {
    enum err (*points)(void *context, struct relighter *r, const struct environment *e,
                       const struct picture_passes *passes, float *lo, struct relight_stats *stats);
    void *context;
};

/* From now on the relighter's pictures are dealt where they can be. team is borrowed; NULL ends it. */
void relighter_join(struct relighter *r, const struct light_team *team);

/* Light at shade points is rounded to half floats, at most 65504, whoever computes it. */
void relighter_round(struct relighter *r, bool half);

/* The same for an array. */
void light_round(float *lo, size_t count);

/* Whether a method lights each shade point by the faces of the sky alone: those of the lat-long image need that, and
 * references light pixels. */
bool light_deals(enum method method);

/* Whether these passes at the shade points are each packet's own. */
bool relighter_can_deal(const struct relighter *r, const struct picture_passes *passes);

/* The cache that these passes use: NULL: none, or it is not complete. */
struct transport *relighter_transport(const struct relighter *r, const struct picture_passes *passes);
const struct transport_indirect *relighter_indirect(const struct relighter *r, const struct picture_passes *passes,
                                                    const struct plan *plan);

/* The packets of a list, which is ascending, that belong to a part. */
struct packet_list light_part_list(const struct packet_list *all, const struct light_part *part);

/* Runs them for a part, into its packets of lo: float[packet_count][3][16]. Errors are those of relighter_run. */
MUST_CHECK enum err relighter_run_part(struct relighter *r, const struct environment *e,
                                       const struct picture_passes *passes, const struct light_part *part, float *lo,
                                       struct relight_stats *stats);

#endif
