#include "base/mem.h"
#include "base/rng.h"
#include "light/cache_direct/internal.h"

#include <math.h>

uint16_t transport_unit_at(uint32_t face, int i, int j, int edge)
{
    const bool above = i < 0 || i >= edge, beside = j < 0 || j >= edge;
    const uint32_t cells = SKY_EDGE / (uint32_t)edge;

    if (above && beside)
        return transport_unit_at(face, i < 0 ? 0 : edge - 1, j < 0 ? 0 : edge - 1, edge);
    face = cube_step_over(face, edge, &i, &j);
    return (uint16_t)(sky_cell(face, (uint32_t)i * cells, (uint32_t)j * cells) / (cells * cells));
}

static enum err find_units(struct transport_directions *d)
{
    const int edge = d->group == 1 ? SKY_EDGE : SKY_EDGE / 4;

    if (d->group * d->per_group != TRANSPORT_UNIT)
        return ERR_OK;
    d->units = SKY_CELLS / d->group * d->per_group / TRANSPORT_UNIT;
    d->around = mem_alloc(d->units, sizeof(*d->around));
    if (!d->around)
        return ERR_NOMEM;
    for (uint32_t face = 0; face < CUBE_FACES; face++)
        for (int at = 0; at < edge * edge; at++) {
            const int i = at / edge, j = at % edge;
            uint16_t *around = d->around[transport_unit_at(face, i, j, edge)];
            for (int k = 0; k < 9; k++)
                if (k != 4)
                    *around++ = transport_unit_at(face, i + k / 3 - 1, j + k % 3 - 1, edge);
        }
    return ERR_OK;
}

/* Weights are solid angles per sample, scaled to sum to the group's own, so that the light of a constant sky does not
 * depend on the jitter. */
enum err transport_directions_init(struct transport_directions *d, uint32_t side, uint32_t edge, uint64_t seed)
{
    const uint32_t edges = SKY_EDGE / edge; /* groups along a face's edge */
    const size_t count = (size_t)CUBE_FACES * edges * edges * side * side;
    const double step = 2.0 / edges;

    *d = (struct transport_directions){ .group = edge * edge, .per_group = side * side };
    d->x = mem_alloc(count, sizeof(float));
    d->y = mem_alloc(count, sizeof(float));
    d->z = mem_alloc(count, sizeof(float));
    d->weight = mem_alloc(count, sizeof(float));
    if (!d->x || !d->y || !d->z || !d->weight)
        return ERR_NOMEM;
    for (uint32_t at = 0; at < CUBE_FACES * edges * edges; at++) {
        const uint32_t face = at / (edges * edges), i = at / edges % edges, j = at % edges;
        const uint32_t cell = sky_cell(face, i * edge, j * edge), first = cell / d->group * d->per_group;
        struct rng r = { rng_mix(seed, at) };
        double sum = 0.0, whole = 0.0;
        for (uint32_t k = 0; k < d->per_group; k++) {
            const double u = -1.0 + step * (j + (k % side + rng_next(&r)) / side);
            const double v = -1.0 + step * (i + (k / side + rng_next(&r)) / side), r2 = 1.0 + u * u + v * v;
            double w[3];
            cube_direction(face, u, v, w);
            d->x[first + k] = (float)(w[0] / sqrt(r2));
            d->y[first + k] = (float)(w[1] / sqrt(r2));
            d->z[first + k] = (float)(w[2] / sqrt(r2));
            d->weight[first + k] = (float)(1.0 / (r2 * sqrt(r2)));
            sum += (double)d->weight[first + k];
        }
        for (uint32_t k = 0; k < d->group; k++)
            whole += sky_cell_solid_angle(cell + k);
        for (uint32_t k = 0; k < d->per_group; k++)
            d->weight[first + k] *= (float)(whole / sum);
    }
    return find_units(d);
}

void transport_directions_finish(struct transport_directions *d)
{
    mem_free(d->x);
    mem_free(d->y);
    mem_free(d->z);
    mem_free(d->weight);
    mem_free(d->around);
    *d = (struct transport_directions){ .group = 0 };
}
