/* Embree 3 or 4, whichever the build found: what the two call differently. A query's context comes first, so that a
 * filter function gets the query from it. Private to this room; the only file that includes Embree. Thread: any; a
 * query belongs to one thread. */
#pragma once

#include "scene/geometry/coverage.h"
#include "scene/geometry/rays.h"

#include <stdbool.h>

#if RELIGHT_EMBREE == 4
#include <embree4/rtcore.h>

struct embree_query {
    struct RTCRayQueryContext context;
    enum RTCRayQueryFlags flags;
};

static inline void embree_query_init(struct embree_query *q)
{
    rtcInitRayQueryContext(&q->context);
    q->flags = RTC_RAY_QUERY_FLAG_INCOHERENT;
}

/* Whether the rays of the packets that follow lie close together. */
static inline void embree_query_spread(struct embree_query *q, bool coherent)
{
    q->flags = coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
}

static inline struct RTCOccludedArguments embree_arguments(struct embree_query *q)
{
    struct RTCOccludedArguments a;

    rtcInitOccludedArguments(&a);
    a.context = &q->context;
    a.flags = q->flags;
    return a;
}

#define EMBREE_OCCLUDED(n)                                                                                            \
    static inline void embree_occluded##n(const int *valid, RTCScene bvh, struct embree_query *q, struct RTCRay##n *r)\
    {                                                                                                                 \
        struct RTCOccludedArguments a = embree_arguments(q);                                                          \
        rtcOccluded##n(valid, bvh, r, &a);                                                                            \
    }

static inline void embree_occluded1(RTCScene scene, struct embree_query *q, struct RTCRay *ray)
{
    struct RTCOccludedArguments a = embree_arguments(q);

    rtcOccluded1(scene, ray, &a);
}

static inline void embree_intersect1(RTCScene scene, struct embree_query *q, struct RTCRayHit *hit)
{
    struct RTCIntersectArguments a;

    rtcInitIntersectArguments(&a);
    a.context = &q->context;
    a.flags = q->flags;
    rtcIntersect1(scene, hit, &a);
}

#else
#include <embree3/rtcore.h>

struct embree_query {
    struct RTCIntersectContext context;
};

static inline void embree_query_init(struct embree_query *q)
{
    rtcInitIntersectContext(&q->context);
}

static inline void embree_query_spread(struct embree_query *q, bool coherent)
{
    q->context.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
}

#define EMBREE_OCCLUDED(n)                                                                                            \
    static inline void embree_occluded##n(const int *valid, RTCScene bvh, struct embree_query *q, struct RTCRay##n *r)\
    {                                                                                                                 \
        rtcOccluded##n(valid, bvh, &q->context, r);                                                                   \
    }

static inline void embree_occluded1(RTCScene scene, struct embree_query *q, struct RTCRay *ray)
{
    rtcOccluded1(scene, &q->context, ray);
}

static inline void embree_intersect1(RTCScene scene, struct embree_query *q, struct RTCRayHit *hit)
{
    rtcIntersect1(scene, &q->context, hit);
}
#endif

EMBREE_OCCLUDED(4)
EMBREE_OCCLUDED(8)
EMBREE_OCCLUDED(16)

/* ---- Scenes for Embree ---- */

/* The parts of rays.h. Private to this room. Thread: any. */

struct rays {
    const struct scene *scene;
    struct mask *masks; /* [mesh_count]; filled for the meshes with holes */
    bool has_masks;     /* some are filled, */
    bool placed_masks;  /* of placed meshes, too */
    RTCDevice device;
    RTCScene bvh;        /* meshes in world space and instances of parts: an id is that of the mesh */
    RTCScene *parts;     /* [mesh_count], of placed meshes with arrays of their own; NULL: no mesh is placed */
    int width;           /* lanes of the widest packets that Embree traces natively: 16, 8 or 4 */
    struct ray_log *log; /* NULL except in benchmarks */
};

/* Embree's filter function for meshes with holes: rejects hits in holes. Embree may call it more than once per ray and
 * triangle. */
void rays_drop_holes(const struct RTCFilterFunctionNArguments *a);
