#include "base/mem.h"
#include "base/rng.h"
#include "transport/parts.h"

#include <math.h>

/* The unit at that row and column of a face with `edge` of them along its edge. They may be one beyond it: then it is
 * the neighbouring face's, or at a corner, where there is none, that on the face itself. */
static uint16_t unit_at(uint32_t face, int i, int j, int edge)
{
    const bool above = i < 0 || i >= edge, beside = j < 0 || j >= edge;
    const uint32_t cells = SKY_EDGE / (uint32_t)edge;

    if (above && beside)
        return unit_at(face, i < 0 ? 0 : edge - 1, j < 0 ? 0 : edge - 1, edge);
    if (above || beside) {
        double w[3];
        float x[3], u, v;
        cube_direction(face, -1.0 + 2.0 / edge * (j + 0.5), -1.0 + 2.0 / edge * (i + 0.5), w);
        for (int k = 0; k < 3; k++)
            x[k] = (float)w[k];
        face = cube_locate(x, &u, &v);
        i = (int)((v + 1.0f) * 0.5f * (float)edge);
        j = (int)((u + 1.0f) * 0.5f * (float)edge);
        i = i < edge ? i : edge - 1;
        j = j < edge ? j : edge - 1;
    }
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
            uint16_t *around = d->around[unit_at(face, i, j, edge)];
            for (int k = 0; k < 9; k++)
                if (k != 4)
                    *around++ = unit_at(face, i + k / 3 - 1, j + k % 3 - 1, edge);
        }
    return ERR_OK;
}

/* side x side jittered places in each group. Weights are solid angles per sample, brought to the group's own in sum, so
 * that nothing of a constant sky depends on where the places fall. */
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
