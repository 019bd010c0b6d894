/* Light sensors in a G-buffer: each is lit like a white matte surface with its position and normal, so its illuminance
 * is pi times its radiance. They follow the camera's packets and belong to no pixel. Thread: one. */
#pragma once

#include "scene/geometry/gbuffer.h"

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
