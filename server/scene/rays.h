/* server/scene/rays.h */
/* Ray queries on a scene: the only room that knows Embree. Any thread may ask once rays_create has returned. */
#ifndef SCENE_RAYS_H
#define SCENE_RAYS_H

#include "scene.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define PACKET 16

struct rays;

/* A packet in Embree's own memory layout (RTCRay16): arrays of 16, 64-byte aligned; rays.c proves it at compile time.
 * Directions need not be unit length; t counts in their lengths. */
struct ray16 {
    _Alignas(64) float org_x[PACKET];
    float org_y[PACKET], org_z[PACKET], tnear[PACKET];
    float dir_x[PACKET], dir_y[PACKET], dir_z[PACKET], time[PACKET];
    float tfar[PACKET]; /* in: the ray's end; after rays_occluded16: -inf where something was in the way */
    uint32_t mask[PACKET], id[PACKET], flags[PACKET];
};

struct hit { /* where one ray met the scene first */
    float t;
    uint32_t mesh, triangle;
    float u, v; /* barycentric: p = (1-u-v) p0 + u p1 + v p2 */
};

/* A hit's surface, from the mesh's own vertices in double precision, so that origins of further rays lie on it. */
struct surface {
    struct vec3 position;  /* m */
    struct vec3 geometric; /* unit normal of the triangle, turned to the side `towards` came from */
    struct vec3 shading;   /* unit, interpolated where the mesh has normals, turned to the same side as geometric */
    bool outside;          /* the ray came from where the triangle's vertices are counter-clockwise */
    float uv[2];
    float offset; /* m: how far along the geometric normal a ray must start so as not to meet its own triangle */
};

/* Builds the BVH with the scene's triangles; the scene must outlive it. NULL when out of memory or Embree fails, which
 * is logged. */
struct rays *rays_create(const struct scene *scene);
void rays_destroy(struct rays *r); /* NULL is allowed */

/* How a packet's rays lie to each other. It changes how fast the answer comes, not what it is. */
enum ray_spread {
    RAYS_TOGETHER, /* from neighbours, in one direction: they take the same way through the tree */
    RAYS_APART,    /* in directions of their own: after a few common nodes each goes alone */
};

/* Sets tfar of each lane whose valid is -1 to -inf when anything lies between tnear and tfar. valid: 0 or -1 a lane. */
void rays_occluded16(const struct rays *r, enum ray_spread spread, const int32_t valid[PACKET], struct ray16 *packet);

struct ray_single { /* a query of rays_intersect, or of rays_blocked */
    struct vec3 origin, dir;
    float tnear, tfar;
    bool blocked; /* asked whether anything is in the way; else what is met first */
};

/* Queries written down as they are asked, to ask them again without anything around them: for benchmarks. */
struct ray_log {
    struct ray16 *packets; /* of rays_occluded16, as they were before the query */
    int32_t (*valid)[PACKET];
    enum ray_spread *spread;
    size_t count, capacity; /* what does not fit is not written down */
    struct ray_single *singles;
    size_t single_count, single_capacity; /* likewise */
};

/* Writes down every query from now on; NULL ends it. While a log is set, only one thread may ask. */
void rays_set_log(struct rays *r, struct ray_log *log);

/* The bare limit: asks the log's queries first .. last again, one after another, and nothing else. Returns how many
 * lanes were occluded, so that the work cannot be left out. */
uint64_t rays_replay(const struct rays *r, const struct ray_log *log, size_t first, size_t last);

/* The same for single rays. Returns how many met something. */
uint64_t rays_replay_singles(const struct rays *r, const struct ray_log *log, size_t first, size_t last);

/* True when dir meets something beyond tnear; *out is set then. */
bool rays_intersect(const struct rays *r, struct vec3 origin, struct vec3 dir, float tnear, struct hit *out);

/* True when anything lies along dir between tnear and tfar. */
bool rays_blocked(const struct rays *r, struct vec3 origin, struct vec3 dir, float tnear, float tfar);

/* The surface at a hit. `towards` points away from the surface, back along the ray that met it. */
void rays_surface(const struct rays *r, const struct hit *h, struct vec3 towards, struct surface *out);

#endif
