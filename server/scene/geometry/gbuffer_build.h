/* Construction of the G-buffer. Private to the gbuffer*.c files. Thread: any, on separate objects. */
#pragma once

#include "scene/geometry/gbuffer.h"
#include "scene/geometry/view.h"
#include "scene/surface/scatter.h"

#include <stdbool.h>

/* An end point of a camera ray traced through mirrors and glass: on a rough surface or in the environment. */
struct leaf {
    bool missed;
    uint32_t bounces;              /* mirrors and glass along the way */
    struct vec3 arrival;           /* unit: direction of the last ray */
    float weight[3];               /* share of the camera ray */
    uint32_t mesh, material, kind; /* enum lobe_kind; this and the following only if not escaped */
    uint32_t layer;                /* enum scatter_layer */
    struct surface surface;
    struct vec3 diffuse, specular; /* with textures applied */
    float gloss;
    float pixel;     /* m: height of the pixel there; 0 behind mirrors and glass */
    uint32_t cells;  /* bits of the cells that it stands for */
    uint32_t cell;   /* as in struct shade_packet */
    float footprint; /* approximate height of a pixel there, m; if escaped, width in the environment, radians */
};

/* maximum number of leaves of a camera ray */
#define LEAF_MAX 64

struct sight {
    const struct scene *scene;
    const struct rays *rays;
    float pixel_angle; /* radians */
    bool lamps;        /* some surface may emit light */
    bool holes;        /* some surface has holes, which a ray's width matters to */
};

/* Ray differentials: first derivatives of a ray's origin and direction with respect to steps of one pixel (or part of
 * one) to the right and down. */
struct cone {
    struct vec3 origin[2]; /* m */
    struct vec3 dir[2];    /* perpendicular to the ray's unit direction, radians */
};

/* Differentials at a hit: where the neighbouring rays meet the triangle's plane, and how its interpolated normal
 * changes. */
struct footprint {
    struct vec3 step[2]; /* m */
    struct vec3 shading; /* the interpolated normal, */
    struct vec3 turn[2]; /* and its change, perpendicular to it, radians: by cone_bend */
};

void cone_begin(struct cone *c, struct vec3 dir, float angle); /* from one point, neighbours `angle` radians apart */
float cone_width(const struct cone *c);                        /* radians; finite */

/* Transfers the differentials to the surface that the ray hits. */
void cone_meet(const struct cone *c, const struct hit *h, const struct surface *s, struct vec3 dir,
               struct footprint *out);

/* Fills `turn`, which only mirrors and glass need. */
void cone_bend(const struct scene *scene, const struct hit *h, struct footprint *at);

/* The same as steps in the mesh's first and second texture coordinates (scatter_on). */
void cone_uv(const struct scene *scene, const struct hit *h, const struct footprint *at, float uv_step[4][2]);

/* The differentials of ray `to`, which scatter_eye produced from dir; back: the reflection it produced. */
void cone_turn(const struct cone *c, const struct footprint *at, const struct scatter *s, struct vec3 dir,
               const struct delta_ray *back, const struct delta_ray *to, struct cone *out);

/* Statistics of tracing, per thread and row. */
struct sight_count {
    uint64_t rays;
    double cut; /* sum of the weights cut off, over all camera rays */
};

/* The results of a camera ray other than its leaves. */
struct sighting {
    bool uneven;   /* the first surface is a mirror, glass or a mask that has both holes and surface in the pixel */
    float glow[3]; /* the emission of the surfaces it hit, times their weights */
};

/* Traces a camera ray whose neighbours are `angle` radians away. Returns the number of leaves, 0 only if everything was
 * absorbed. glance: ends where it finds the ray uneven, whose leaves and glow are then incomplete. */
uint32_t sight_trace(const struct sight *s, struct vec3 origin, struct vec3 dir, float angle, bool glance,
                     struct leaf out[LEAF_MAX], struct sighting *found, struct sight_count *count);

/* Whether two leaves can be shaded as one point at most `reach` footprints apart, or looked up as one direction. */
bool leaf_alike(const struct sight *s, const struct leaf *a, const struct leaf *b, float reach);

/* Of clusters of leaves: lists in the leaves' order. */
struct leaf_link {
    uint32_t next; /* in this leaf's cluster; LEAF_END: none */
    uint32_t last; /* of the cluster, if this leaf is its first */
    uint32_t seed; /* at place k: the first leaf of cluster k */
};
#define LEAF_END UINT32_MAX

/* Whether a surface rises so little to another point, relative to its offset, that rays may start between them. */
static inline bool leaf_level(const struct leaf *own, const struct leaf *other, float limit)
{
    return vec3_dot(vec3_sub(other->surface.position, own->surface.position), own->surface.geometric) <=
           limit * own->surface.offset;
}

/* Merges similar leaves. In: leaves[count], weighted by their camera rays' shares of the pixel. Out: the first *count
 * leaves, each the one nearest to the mean of its cluster, with the sum of the weights and the mean colour (with a
 * roughness map: the mean lobe; with a normal map: the mean normal; escapes: the mean direction and a width of the
 * cluster's variance). links: scratch memory for count of them. */
void leaves_merge(const struct sight *s, struct leaf *leaves, struct leaf_link *links, uint32_t *count);

#define LEAF_LEAST (1.0 / 128.0) /* of a pixel: two codes of 8 bits */

/* Points behind mirrors and glass that bring less than LEAF_LEAST of a pixel stand for each other, by systematic
 * sampling [Cochran 1977, chapter 8]: each is kept with the probability weight / LEAF_LEAST, and has the weight
 * LEAF_LEAST then. The pixel's expected value stays, and the sum of its weights changes by less than LEAF_LEAST. start:
 * 0..1, evenly distributed over pixels. */
void leaves_thin(struct leaf *leaves, double start, uint32_t *count);

/* A shading point before it is packed. */
struct shade_point {
    struct vec3 position; /* offset from the surface */
    struct vec3 geometric, shading, wo;
    struct vec3 diffuse, specular;
    float gloss;
    float pixel;
    uint32_t cells, cell;
    uint32_t mesh, material, kind, layer;
    bool behind;   /* seen in a mirror or through glass */
    uint32_t x, y; /* pixel */
};

struct slab; /* memory of several rows */

/* The result of one row of pixels. A draft owns growing arrays; finished rows live in slabs. */
struct row {
    struct slab *slab;
    struct shade_point *points;
    struct gbuffer_entry *entries; /* as many as points; .point counts from the row's first */
    struct gbuffer_miss *misses;
    uint32_t point_count, miss_count;
    size_t point_room, entry_room, miss_room; /* capacity of a draft's arrays */
    uint32_t edge_pixels;
    struct sight_count count;
};

/* A packet's properties, known before it is filled. */
struct packet_head {
    uint8_t kind, count;
    bool begun; /* its memory has been zeroed */
};

/* The assignment of points to packets: one kind per packet, close together, similar where possible. */
struct packing {
    uint32_t *slots; /* [point_count]: packet * 16 + lane, for the points of all rows in order */
    struct packet_head *heads;
    uint32_t packet_count;
};

#define PACKING_BYTES 24 /* memory per point that packing_init needs while sorting */

/* Assigns all points of the rows; uses only their points. ERR_NOMEM: *p is then finished. */
MUST_CHECK enum err packing_init(struct packing *p, const struct row *rows, uint32_t row_count, uint32_t point_count);
void packing_finish(struct packing *p); /* frees the memory; zeroed memory is allowed */

/* Writes a row's points to their packets; `first` is the number of the row's first point. Call it once per row, in any
 * order; `packets` may be uninitialised and is complete after the last row. */
void packing_put(struct packing *p, const struct row *r, uint32_t first, const struct view *view,
                 struct shade_packet *packets);
