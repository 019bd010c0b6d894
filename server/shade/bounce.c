#include "bounce.h"

#include "bounce_parts.h"
#include "denormals.h"
#include "mem.h"

#include <string.h>

void bounce_destroy(struct bounce *b)
{
    if (!b)
        return;
    for (uint32_t k = 0; b->groups && k < b->group_count; k++)
        for (uint32_t r = 0; r < TRANSPORT_ROWS; r++)
            mem_free(b->groups[k].pieces[r].bytes);
    mem_free(b->groups);
    mem_free(b->blocks);
    mem_free(b->left_index);
    bounce_basis_finish(&b->basis);
    mem_free(b);
}

const struct bounce_stats *bounce_stats(const struct bounce *b)
{
    return &b->stats;
}

const struct packet_list *bounce_left(const struct bounce *b)
{
    return &b->left;
}

/* The sky's coefficients: y = Q L. */
static void project_sky(const struct bounce_basis *basis, float (*sky)[TRANSPORT_CELLS], float *y)
{
#pragma omp parallel for schedule(static)
    for (uint32_t k = 0; k < basis->count; k++) {
        const float *row = basis->rows + (size_t)k * TRANSPORT_CELLS;
        for (uint32_t c = 0; c < 3; c++) {
            float sum[PACKET] = { 0.0f };
            for (uint32_t i = 0; i < TRANSPORT_CELLS; i += PACKET)
                for (uint32_t l = 0; l < PACKET; l++)
                    sum[l] += row[i + l] * sky[c][i + l];
            for (uint32_t l = 1; l < PACKET; l++)
                sum[0] += sum[l];
            y[c * basis->count + k] = sum[0];
        }
    }
}

/* One row of a group's blocks. */
static void shade_piece(const struct bounce *b, const struct bounce_group *g, uint32_t row, const float *y, float *lo)
{
    const struct bounce_piece *q = &g->pieces[row];
    const uint32_t columns = bounce_columns(q->rank);
    _Alignas(64) float z[3 * BOUNCE_GROUP * TRANSPORT_POINTS], sum[3][TRANSPORT_POINTS];

    if (!q->bytes)
        return;
    b->kernels->project(q, y, b->basis.count, z);
    const int8_t *bytes = q->bytes + (size_t)q->rank * 3 * q->basis;
    for (uint32_t k = g->first; k < g->first + g->count; k++) {
        const struct bounce_block *block = &b->blocks[k];
        const uint32_t points = block->packets * PACKET;
        if (block->rank[row] == 0)
            continue;
        for (uint32_t i = 0; i < block->packets; i++) /* they stand far apart, and are asked for in good time */
            for (int c = 0; c < 3; c++)
                __builtin_prefetch(b->gbuffer->packets[block->first + i].diffuse[c]);
        b->kernels->expand(bytes, block->rank[row], z, columns, points, sum);
        bytes += bounce_block_bytes(block->rank[row], columns, points);
        for (uint32_t i = 0; i < block->packets; i++)
            b->kernels->paint(&b->gbuffer->packets[block->first + i], row, sum, i * PACKET,
                              lo + (size_t)(block->first + i) * 3 * PACKET);
    }
}

enum err bounce_shade(struct bounce *b, const struct environment *e, const atomic_bool *cancel, float *lo)
{
    float(*sky)[TRANSPORT_CELLS] = mem_alloc(3, sizeof(*sky));
    _Alignas(64) float y[3 * BOUNCE_BASIS_MAX];

    if (!sky)
        return ERR_NOMEM;
    bounce_sky_take(e, sky);
    project_sky(&b->basis, sky, y);
#pragma omp parallel
    {
        const unsigned before = denormals_flush();
#pragma omp for schedule(dynamic, 1)
        for (uint32_t k = 0; k < b->group_count; k++)
            for (uint32_t r = 0; r < b->groups[k].rows; r++)
                if (!cancel || !atomic_load_explicit(cancel, memory_order_relaxed))
                    shade_piece(b, &b->groups[k], r, y, lo);
        denormals_restore(before);
    }
    mem_free(sky);
    return ERR_OK;
}
