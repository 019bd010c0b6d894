/* The G-buffer: what the camera sees, without light. Instead of pixels it holds shading points; a pixel is
 *     sum over its entries   weight * Lo(shading point)  +  sum over its escapes  weight * Lenv(direction)
 * A plain pixel has a single entry or escape of weight 1; a pixel on a geometric edge has several, from more camera
 * rays. Camera rays are traced through mirrors and smooth glass, where weights may be coloured; the weights of a pixel
 * without them sum to 1. Inside glass of index n a point's weight has a factor n^-2, since radiance there is n^2 as
 * large. Shading points are stored in packets of 16 that are close together in the image and have the same kind of
 * lobe. Immutable after gbuffer_create. Thread: any number may read. */
#pragma once

#include "base/err.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"
#include "scene/surface/scatter.h"

#include <stdint.h>

struct progress;

/* Copies one point to a lane of another packet, whose kind and count are unchanged. */
void shade_packet_put(struct shade_packet *to, uint32_t at, const struct shade_packet *from, uint32_t lane,
                      int32_t valid);

/* Neighbouring packets can use different light samples: packet `index` uses one of PACKET_SETS sets. Multiplying by
 * 2^32 / phi spreads neighbours over them. */
#define PACKET_SETS 16
static inline uint32_t packet_set(uint32_t index)
{
    return (index * 2654435769u) >> 28;
}

/* A subset of a G-buffer's packets, by index, without duplicates. */
struct packet_list {
    const uint32_t *index;
    uint32_t count;
};

struct gbuffer_entry {
    uint32_t point; /* packet * 16 + lane */
    float weight[3];
};

struct gbuffer_miss {
    struct vec3 direction; /* unit, world */
    float weight[3];
    float width; /* radians, > 0: edge of the square of directions that it covers, after mirrors and glass spread it;
                    the filter width for environment_lookup_wide */
};

struct gbuffer {
    uint32_t width, height;
    struct shade_packet *packets;
    uint32_t packet_count;
    uint64_t point_count;  /* lanes in use, without padding */
    uint32_t *entry_first; /* [width * height + 1]: pixel i owns entries entry_first[i] .. entry_first[i + 1] */
    struct gbuffer_entry *entries;
    uint32_t *miss_first; /* likewise, for escapes */
    struct gbuffer_miss *misses;
    float *glow; /* [height][width][3]: emission of the surfaces in a pixel, including those in mirrors and behind
                    glass; NULL: the scene has no lamps */
    uint64_t edge_pixels; /* pixels that got more than one camera ray */
    uint64_t camera_rays; /* including those that continue through mirrors and glass */
    double cut_weight;    /* total weight of all camera rays lost where chains of mirrors and glass were cut */
    uint64_t bytes;       /* memory in use after construction */
    float pixel_angle;    /* radians: height of a pixel at the image centre */
};

struct gbuffer_desc {
    const struct camera *camera;
    uint32_t width, height; /* 1..16384 */
    uint32_t edge_rays;  /* per side: an edge pixel gets edge_rays^2 camera rays; 0: 4, 1: no extra ones; at most 64 */
    bool every_pixel;    /* treat all pixels as edges */
    uint64_t max_bytes;  /* limit of memory during construction, about 1.3 times the final size; 0: 4 GiB */
    struct progress *progress; /* may be NULL; stepped once per row */
};

/* Traces a camera's G-buffer on all OpenMP threads. The caller owns *out, NULL on error. ERR_RANGE: size or
 * max_bytes. ERR_NOMEM. */
MUST_CHECK enum err gbuffer_create(const struct scene *scene, const struct rays *rays, const struct gbuffer_desc *desc,
                                   struct gbuffer **out, struct reason *why);

/* Returns the memory of packets first .. end - 1, or of the pixels' entries and escapes, to the system, for a process
 * that does not need them; they read as zeros from then on. Adjusts g->bytes. Thread: no other may read g. */
void gbuffer_release_packets(struct gbuffer *g, uint32_t first, uint32_t end);
void gbuffer_release_pixels(struct gbuffer *g);
void gbuffer_destroy(struct gbuffer *g); /* NULL is allowed */

/* ---- Sensors ---- */

/* Light sensors in a G-buffer: each is lit like a white matte surface with its position and normal, so its illuminance
 * is pi times its radiance. They follow the camera's packets and belong to no pixel. Thread: one. */

#define SENSOR_RADIUS 0.005f /* m: as of the head of a photometer */

struct sensor {
    struct vec3 position; /* m */
    struct vec3 normal;   /* unit */
};

/* Adds one packet per sensor, with 16 points spread over a disc of SENSOR_RADIUS, so that their mean has less noise.
 * Returns the index of the first packet in *first. Call it before anything else uses g. ERR_NOMEM: g is unchanged. */
MUST_CHECK enum err gbuffer_add_sensors(struct gbuffer *g, const struct sensor *sensors, uint32_t count,
                                        uint32_t *first);

/* The mean radiance of a sensor's points: lo holds all packets, float[packet_count][3][16]. */
void sensor_radiance(const float *lo, uint32_t packet, double rgb[3]);
