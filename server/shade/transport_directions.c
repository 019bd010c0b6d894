#include "mem.h"
#include "rng.h"
#include "transport_parts.h"

#include <math.h>

/* side x side jittered places in each group. Weights are solid angles per sample, brought to the group's own in sum, so
 * that nothing of a constant sky depends on where the places fall. */
enum err transport_directions_init(struct transport_directions *d, uint32_t side, uint32_t edge, uint64_t seed)
{
    const uint32_t edges = TRANSPORT_EDGE / edge; /* groups along a face's edge */
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
        const uint32_t cell = transport_cell(face, i * edge, j * edge), first = cell / d->group * d->per_group;
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
            whole += transport_cell_solid_angle(cell + k);
        for (uint32_t k = 0; k < d->per_group; k++)
            d->weight[first + k] *= (float)(whole / sum);
    }
    return ERR_OK;
}

void transport_directions_finish(struct transport_directions *d)
{
    mem_free(d->x);
    mem_free(d->y);
    mem_free(d->z);
    mem_free(d->weight);
    *d = (struct transport_directions){ .group = 0 };
}
