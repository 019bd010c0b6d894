#include "bounce.h"

#include "bounce_parts.h"
#include "denormals.h"
#include "mem.h"

#include <string.h>

void bounce_destroy(struct bounce *b)
{
    if (!b)
        return;
    for (uint32_t k = 0; b->blocks && k < b->block_count; k++)
        for (uint32_t r = 0; r < TRANSPORT_ROWS; r++)
            mem_free(b->blocks[k].pieces[r].halves);
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

static void shade_block(const struct bounce *b, const struct bounce_block *block, const float *y, float *lo)
{
    const struct shade_packet *packets = &b->gbuffer->packets[block->first];
    _Alignas(64) float sum[3][TRANSPORT_POINTS];

    for (uint32_t r = 0; r < block->rows; r++) {
        if (!block->pieces[r].halves)
            continue;
        b->kernels->expand(&block->pieces[r], y, b->basis.count, block->packets * PACKET, sum);
        for (uint32_t k = 0; k < block->packets; k++)
            b->kernels->paint(&packets[k], r, sum, k * PACKET, lo + (size_t)k * 3 * PACKET);
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
#pragma omp for schedule(dynamic, 16)
        for (uint32_t k = 0; k < b->block_count; k++)
            if (!cancel || !atomic_load_explicit(cancel, memory_order_relaxed))
                shade_block(b, &b->blocks[k], y, lo + (size_t)b->blocks[k].first * 3 * PACKET);
        denormals_restore(before);
    }
    mem_free(sky);
    return ERR_OK;
}
