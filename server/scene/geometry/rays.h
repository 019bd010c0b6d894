/* Ray queries on a scene, through Embree, which no other file uses. Rays pass through holes in surfaces (coverage.h).
 * Thread: any, once rays_create_for has returned. The caller owns all arrays. */
#pragma once

#include "base/cpu.h"
#include "scene/geometry/scene.h"
#include "scene/surface/material.h"
#include "scene/surface/packet.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct rays;

/* A ray packet in Embree's memory layout (RTCRay16), 64-byte aligned; rays.c verifies it at compile time. Directions
 * need not be unit; t is in units of their length. */
struct ray16 {
    _Alignas(64) float org_x[PACKET];
    float org_y[PACKET], org_z[PACKET], tnear[PACKET];
    float dir_x[PACKET], dir_y[PACKET], dir_z[PACKET], time[PACKET];
    float tfar[PACKET]; /* in: end of the ray; after rays_occluded16: -inf if occluded */
    uint32_t mask[PACKET], id[PACKET], flags[PACKET];
};

/* Builds the BVH of the scene's triangles; the scene must outlive it. Embree uses no instructions above `level`, so
 * that one machine can test the code path of another. The caller owns the result. NULL when out of memory or when
 * Embree fails, which is logged. Runs on all OpenMP threads. */
struct rays *rays_create_for(const struct scene *scene, enum cpu_level level);
void rays_destroy(struct rays *r); /* NULL is allowed */

/* Coherence of a packet's rays: a performance hint that does not affect results. */
enum ray_spread {
    RAYS_TOGETHER, /* coherent: adjacent origins, similar directions */
    RAYS_APART,    /* incoherent: directions differ, so rays diverge after a few common nodes */
};

/* Sets tfar to -inf in each lane whose valid is -1 and whose ray meets anything between tnear and tfar; leaves the
 * other lanes alone. valid: 0 or -1 a lane. Without native packets of 16, Embree gets packets of 8 or 4. */
void rays_occluded16(const struct rays *r, enum ray_spread spread, const int32_t valid[PACKET], struct ray16 *packet);

struct ray_single { /* a query of rays_intersect or rays_blocked */
    struct vec3 origin, dir;
    float tnear, tfar;
    bool blocked; /* an occlusion query; else for the first hit */
};

/* A recording of queries, for replay in benchmarks. The caller owns the arrays. */
struct ray_log {
    struct ray16 *packets; /* from rays_occluded16, before the query */
    int32_t (*valid)[PACKET];
    enum ray_spread *spread;
    size_t count, capacity; /* further queries are dropped */
    struct ray_single *singles;
    size_t single_count, single_capacity; /* likewise */
};

/* Records every query from now on; NULL stops. While recording, only one thread may query. */
void rays_set_log(struct rays *r, struct ray_log *log);

/* Replays queries first .. last - 1 of the log, one after another: the bare cost of tracing. Returns the number of
 * occluded lanes, so that the work is not optimised away. */
uint64_t rays_replay(const struct rays *r, const struct ray_log *log, size_t first, size_t last);

/* The same for single rays. Returns the number of hits. */
uint64_t rays_replay_singles(const struct rays *r, const struct ray_log *log, size_t first, size_t last);

/* The first hit of a ray beyond tnear, in *out. False: no hit. */
bool rays_intersect(const struct rays *r, struct vec3 origin, struct vec3 dir, float tnear, struct hit *out);

/* As rays_intersect, for a unit dir from the camera whose neighbours are `angle` radians away. With ALPHA_BLEND and
 * thin glass, which other queries resolve at random, every hit counts; the caller weights it by coverage_seen and
 * continues behind it with tnear just beyond. *varies: a mask (ALPHA_MASK) up to the hit has both holes and surface
 * within the angle. */
bool rays_see(const struct rays *r, struct vec3 origin, struct vec3 dir, float tnear, float angle, struct hit *out,
              bool *varies);

/* Whether anything lies along dir between tnear and tfar. */
bool rays_blocked(const struct rays *r, struct vec3 origin, struct vec3 dir, float tnear, float tfar);

/* Whether the scene has meshes that rays meet only in part. */
bool rays_have_holes(const struct rays *r);

/* The surface at a hit. `towards` points away from the surface, back along the ray. */
void rays_surface(const struct rays *r, const struct hit *h, struct vec3 towards, struct surface *out);
