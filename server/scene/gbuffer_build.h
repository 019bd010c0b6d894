/* How a G-buffer is put together: for the gbuffer*.c files alone. */
#ifndef SCENE_GBUFFER_BUILD_H
#define SCENE_GBUFFER_BUILD_H

#include "gbuffer.h"
#include "scatter.h"

#include <stdbool.h>

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
    float footprint; /* about the height of a pixel there, m; escaped: of what it sees of the environment, radians */
};

/* What a camera ray can come to. */
#define LEAF_MAX 64

struct sight {
    const struct scene *scene;
    const struct rays *rays;
    float pixel_angle; /* radians */
};

/* What lies between a ray and its neighbours one pixel (or part of one) to the right and down: first derivatives. */
struct cone {
    struct vec3 origin[2]; /* m */
    struct vec3 dir[2];    /* across the ray's unit direction, radians */
};

/* Where the neighbours meet the triangle's plane, and how its interpolated normal turns on the way there. */
struct footprint {
    struct vec3 step[2]; /* m */
    struct vec3 turn[2]; /* across the shading normal, radians */
};

void cone_begin(struct cone *c, struct vec3 dir, float angle); /* from one point, `angle` radians apart */
float cone_width(const struct cone *c);                        /* radians between its directions; finite */
void cone_meet(const struct cone *c, const struct scene *scene, const struct hit *h, const struct surface *s,
               struct vec3 dir, struct footprint *out);

/* The cone of the ray `to` that scatter_eye made of dir; back: the reflection among those it made. */
void cone_turn(const struct cone *c, const struct footprint *at, const struct scatter *s, struct vec3 dir,
               const struct delta_ray *back, const struct delta_ray *to, struct cone *out);

/* What tracing costs and leaves out; each thread and row has its own. */
struct sight_count {
    uint64_t rays;
    double cut; /* sum of the weights not followed, of all camera rays */
};

/* Follows the camera ray, which is `angle` radians from its neighbours; returns how many leaves were written, 0 only
 * where everything was absorbed. *specular: the first surface was a mirror or glass. Any thread. */
uint32_t sight_trace(const struct sight *s, struct vec3 origin, struct vec3 dir, float angle, struct leaf out[LEAF_MAX],
                     bool *specular, struct sight_count *count);

/* True when the two can be shaded as one point, or looked up as one direction. */
bool leaf_alike(const struct sight *s, const struct leaf *a, const struct leaf *b);

/* Merges leaves that are alike. In: leaves[count], each of the weight its camera ray has in the pixel. Out: the
 * first *count leaves, each the real one nearest to the mean of those merged, with their weights' sum and the mean
 * colour (escapes: the mean direction, and a footprint of the variance that all have together). owner: room for count
 * numbers. */
void leaves_merge(const struct sight *s, struct leaf *leaves, uint32_t *owner, uint32_t *count);

/* One shade point before it has its place in a packet. */
struct shade_point {
    struct vec3 position; /* off the surface */
    struct vec3 geometric, shading, wo;
    struct vec3 diffuse, specular;
    float gloss;
    uint32_t mesh, material, kind;
    bool behind;   /* a mirror or glass */
    uint32_t x, y; /* pixel */
};

struct slab; /* memory of several rows */

/* What a row of pixels came to. A draft has arrays of its own that grow; the rows that are kept lie in slabs. */
struct row {
    struct slab *slab;
    struct shade_point *points;
    struct gbuffer_entry *entries; /* as many as points; .point counts from the row's first */
    struct gbuffer_escape *escapes;
    uint32_t point_count, escape_count;
    uint32_t point_room, escape_room; /* of the draft alone: what its arrays can hold */
    uint32_t edge_pixels;
    struct sight_count count;
};

/* What a packet will be, known before it is filled. */
struct packet_head {
    uint8_t kind, count, set;
    bool begun; /* its memory is zeroed */
};

/* Which point goes where: homogeneous in kind and set, near each other, alike where they can be. */
struct packing {
    uint32_t *slots; /* [point_count]: packet * 16 + lane, the points of all rows counted on */
    struct packet_head *heads;
    uint32_t packet_count;
};

#define PACKING_BYTES 24 /* what packing_init takes for each point while it sorts */

/* Needs no more of the rows than their points. interleave: 1, 2 or 4. ERR_NOMEM; then *p is finished. */
MUST_CHECK enum err packing_init(struct packing *p, const struct row *rows, uint32_t row_count, uint32_t point_count,
                                 uint32_t interleave);
void packing_finish(struct packing *p); /* zeroed memory is allowed */

/* Writes a row's points into their places; `first` is the number of the row's first. In any order of rows, each once;
 * no byte of `packets` need be defined before, and after the last row all are. */
void packing_put(struct packing *p, const struct row *r, uint32_t first, struct shade_packet *packets);

#endif
