/* How a G-buffer is put together: for the gbuffer*.c files alone. */
#ifndef SCENE_GBUFFER_BUILD_H
#define SCENE_GBUFFER_BUILD_H

#include "gbuffer.h"

/* One end of a camera ray that was followed through mirrors and glass: a rough surface, or the environment. */
struct leaf {
    bool escaped;
    uint32_t bounces;              /* mirrors and glass on the way */
    struct vec3 arrival;           /* unit: where the last ray was going */
    float weight[3];               /* share of the camera ray */
    uint32_t mesh, material, kind; /* enum lobe_kind; from here on only where not escaped */
    struct surface surface;
    struct vec3 diffuse, specular; /* textures applied */
    float gloss;
    float footprint; /* m: about the height of a pixel there */
};

/* What a camera ray can come to. */
#define LEAF_MAX 64

struct sight {
    const struct scene *scene;
    const struct rays *rays;
    float pixel_angle; /* radians */
};

/* What tracing costs and leaves out; each thread and row has its own. */
struct sight_count {
    uint64_t rays;
    double cut; /* sum of the weights not followed, of all camera rays */
};

/* Follows the camera ray; returns how many leaves were written, 0 only where everything was absorbed. *specular: the
 * first surface was a mirror or glass. Any thread. */
uint32_t sight_trace(const struct sight *s, struct vec3 origin, struct vec3 dir, struct leaf out[LEAF_MAX],
                     bool *specular, struct sight_count *count);

/* True when the two can be shaded as one point, or looked up as one direction. */
bool leaf_alike(const struct sight *s, const struct leaf *a, const struct leaf *b);

/* Merges leaves that are alike. In: leaves[count], each of the weight its camera ray has in the pixel. Out: the
 * first *count leaves, each the real one nearest to the mean of those merged, with their weights' sum and the mean
 * colour (escapes: the mean direction). owner: room for count numbers. */
void leaves_merge(const struct sight *s, struct leaf *leaves, uint32_t *owner, uint32_t *count);

/* One shade point before it has its place in a packet. */
struct shade_point {
    struct vec3 position; /* off the surface */
    struct vec3 geometric, shading, wo;
    struct vec3 diffuse, specular;
    float gloss;
    uint32_t mesh, material, kind;
    uint32_t x, y; /* pixel */
};

/* Sorts points into packets: homogeneous in kind, near each other, alike where they can be. *packets is allocated and
 * slots[i] tells where point i went: packet * 16 + lane. ERR_NOMEM. */
MUST_CHECK enum err points_pack(const struct shade_point *points, uint32_t count, struct shade_packet **packets,
                                uint32_t *packet_count, uint32_t *slots);

#endif
