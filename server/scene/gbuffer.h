/* server/scene/gbuffer.h */
/* What the camera sees, without light: the input of relighting. Not pixels but shade points: a pixel is
 *     sum over its entries   weight * Lo(shade point)  +  sum over its escapes  weight * Lenv(direction)
 * A plain pixel has one of the two with weight 1; a pixel on an edge of geometry has several, from more camera rays.
 * Camera rays are followed through mirrors and smooth glass, so that a weight may be coloured; the weights of a pixel
 * without them sum to 1. Inside glass of index n a point weighs n^-2, since radiance there is n^2 as large.
 * Shade points stand in packets of 16 that are near each other in the picture and scatter by the same kind of lobe.
 * Never changes after gbuffer_create: any number of threads may read one. */
#ifndef SCENE_GBUFFER_H
#define SCENE_GBUFFER_H

#include "err.h"
#include "rays.h"
#include "scatter.h"
#include "scene.h"

#include <stdint.h>

struct progress;

struct shade_packet { /* 16 shade points; lanes >= count repeat the last one and are not shaded */
    _Alignas(64) float x[PACKET];
    float y[PACKET], z[PACKET];                     /* m: where rays start, already moved off the surface */
    float ng_x[PACKET], ng_y[PACKET], ng_z[PACKET]; /* geometric normal, towards the viewer */
    float ns_x[PACKET], ns_y[PACKET], ns_z[PACKET]; /* shading normal, same side */
    float wo_x[PACKET], wo_y[PACKET], wo_z[PACKET]; /* to the viewer, unit */
    float diffuse[3][PACKET], specular[3][PACKET];  /* linear Rec.709, textures applied */
    float gloss[PACKET];                            /* phong: exponent; ggx: alpha */
    int32_t valid[PACKET];                          /* -1 lit, 0 padding */
    uint32_t mesh[PACKET], material[PACKET];
    uint8_t behind[PACKET]; /* 1: the camera sees it in a mirror or through glass; 0: directly */
    uint32_t kind;          /* enum lobe_kind */
    uint32_t count;         /* 1..16 */
    uint32_t set;           /* (y mod K) K + x mod K of its pixels, K = interleave: 0 at K = 1 */
};

/* One point into a lane of another packet, of which kind, count and set stay as they are. */
void shade_packet_put(struct shade_packet *to, uint32_t at, const struct shade_packet *from, uint32_t lane,
                      int32_t valid);

/* Some of a G-buffer's packets, by their places, each once: what is asked to be shaded where not all is. */
struct packet_list {
    const uint32_t *index;
    uint32_t count;
};

struct gbuffer_entry {
    uint32_t point; /* packet * 16 + lane */
    float weight[3];
};

struct gbuffer_escape {
    struct vec3 direction; /* unit, world */
    float weight[3];
    float width; /* radians, > 0: edge of the square of directions that it stands for, as mirrors and glass spread the
                  * pixel's or camera ray's own; what environment_look_wide asks for */
};

struct gbuffer {
    uint32_t width, height;
    uint32_t interleave; /* K, at least 1; 0 says 1 too, in one that is made by hand */
    struct shade_packet *packets;
    uint32_t packet_count;
    uint64_t point_count;  /* lanes in use */
    uint32_t *entry_first; /* [width * height + 1]: pixel i owns entries entry_first[i] .. entry_first[i + 1] */
    struct gbuffer_entry *entries;
    uint32_t *escape_first; /* likewise */
    struct gbuffer_escape *escapes;
    uint64_t edge_pixels; /* got more camera rays than one */
    uint64_t camera_rays; /* with those that follow mirrors and glass */
    double cut_weight;    /* sum over all camera rays of what was left when a chain of mirrors and glass was cut */
    uint64_t bytes;       /* what all of it takes, once it is built */
    float pixel_angle;    /* radians, height of a pixel at the picture's centre */
};

struct gbuffer_desc {
    const struct camera *camera;
    uint32_t width, height; /* 1..16384 */
    uint32_t edge_rays;     /* per side: an edge pixel gets edge_rays^2 camera rays; 0: 4, 1: none extra; at most 64 */
    bool every_pixel;       /* treat all pixels as edges */
    uint32_t interleave;    /* 1, 2 or 4 = K: packets hold pixels of one place in the K x K pattern, so that each place
                             * can have light samples of its own [Keller and Heidrich 2001]; 0: 1 */
    uint64_t max_bytes;     /* of all that is held at once, building included, about 1.3 times what stays; 0: 4 GiB;
                             * ERR_RANGE beyond */
    struct progress *progress; /* may be NULL; stepped once per row */
};

/* On ERR_OK the caller owns *out. ERR_RANGE: size, interleave or memory cap. ERR_NOMEM. */
MUST_CHECK enum err gbuffer_create(const struct scene *scene, const struct rays *rays, const struct gbuffer_desc *desc,
                                   struct gbuffer **out, struct reason *why);
void gbuffer_destroy(struct gbuffer *g); /* NULL is allowed */

/* The same with one shade point a pixel: the heaviest of its entries has the weight of all; escapes stay. No edge is
 * smooth in it, and it has a half of the points, or a third. On ERR_OK the caller owns *out. ERR_NOMEM. */
MUST_CHECK enum err gbuffer_thin(const struct gbuffer *g, struct gbuffer **out);

#endif
