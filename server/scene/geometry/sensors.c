#include "scene/geometry/gbuffer.h"

#include "base/mem.h"

#include <math.h>
#include <string.h>

/* Points on a spiral over a disc about the sensor: thin glass decides at random, but by a ray's origin and direction,
 * whether the ray passes. Equal points would all pass or all be stopped. */
static struct vec3 place(const struct sensor *s, uint32_t k)
{
    const struct vec3 n = s->normal;
    const struct vec3 side = fabsf(n.y) < 0.9f ? vec3_make(0.0f, 1.0f, 0.0f) : vec3_make(1.0f, 0.0f, 0.0f);
    const struct vec3 u = vec3_normalize(vec3_cross(side, n)), v = vec3_cross(n, u);
    const float r = SENSOR_RADIUS * sqrtf((float)(2 * k + 1) / (2 * PACKET)), turn = 2.3999632f * (float)k;

    return vec3_add(s->position, vec3_add(vec3_scale(u, r * cosf(turn)), vec3_scale(v, r * sinf(turn))));
}

static void fill(struct shade_packet *p, const struct sensor *s)
{
    memset(p, 0, sizeof(*p));
    for (uint32_t l = 0; l < PACKET; l++) {
        const struct vec3 at = place(s, l);
        p->x[l] = at.x;
        p->y[l] = at.y;
        p->z[l] = at.z;
        p->ng_x[l] = p->ns_x[l] = p->wo_x[l] = s->normal.x;
        p->ng_y[l] = p->ns_y[l] = p->wo_y[l] = s->normal.y;
        p->ng_z[l] = p->ns_z[l] = p->wo_z[l] = s->normal.z;
        p->diffuse[0][l] = p->diffuse[1][l] = p->diffuse[2][l] = 1.0f;
        p->valid[l] = -1;
    }
    p->kind = LOBE_LAMBERT;
    p->count = PACKET;
}

enum err gbuffer_add_sensors(struct gbuffer *g, const struct sensor *sensors, uint32_t count, uint32_t *first)
{
    *first = g->packet_count;
    if (count > UINT32_MAX / PACKET - g->packet_count)
        return ERR_NOMEM;
    struct shade_packet *packets = mem_alloc_raw((size_t)g->packet_count + count, sizeof(*packets));
    if (!packets)
        return ERR_NOMEM;
    memcpy(packets, g->packets, g->packet_count * sizeof(*packets));
    for (uint32_t i = 0; i < count; i++)
        fill(&packets[g->packet_count + i], &sensors[i]);
    mem_free(g->packets);
    g->packets = packets;
    g->packet_count += count;
    g->point_count += (uint64_t)count * PACKET;
    g->bytes += count * sizeof(*packets);
    return ERR_OK;
}

void sensor_radiance(const float *lo, uint32_t packet, double rgb[3])
{
    for (int c = 0; c < 3; c++) {
        rgb[c] = 0.0;
        for (uint32_t l = 0; l < PACKET; l++)
            rgb[c] += (double)lo[((size_t)packet * 3 + (size_t)c) * PACKET + l] / PACKET;
    }
}
