/* Computes the basis over the sky's cells from the variation of the light that points gather. */
#include "base/mem.h"
#include "light/cache_indirect/internal.h"

#include <cblas.h>
#include <lapacke.h>

#include <math.h>

#define ENOUGH 2e-3 /* share of the norm that the basis may leave out */

/* The eigenvectors of M' M with the largest eigenvalues, as many as ENOUGH requires. */
enum err indirect_basis_init(struct indirect_basis *b, const float *m, uint32_t rows, uint32_t at_most)
{
    const int n = SKY_CELLS, most = (int)at_most;
    float *gram = mem_alloc((size_t)n * n, sizeof(*gram)), *values = mem_alloc((size_t)n, sizeof(*values));
    lapack_int *support = mem_alloc(2 * (size_t)most, sizeof(*support)), found = 0;
    double whole = 0.0, kept = 0.0;
    enum err e = ERR_NOMEM;

    *b = (struct indirect_basis){ .count = PACKET };
    b->rows = mem_alloc((size_t)most * SKY_CELLS, sizeof(*b->rows));
    if (!gram || !values || !support || !b->rows)
        goto done;
    cblas_ssyrk(CblasRowMajor, CblasLower, CblasTrans, n, (int)rows, 1.0f, m, n, 0.0f, gram, n);
    for (int i = 0; i < n; i++)
        whole += (double)gram[(size_t)i * n + i];
    /* row-major lower is column-major upper */
    if (LAPACKE_ssyevr(LAPACK_COL_MAJOR, 'V', 'I', 'U', n, gram, n, 0.0f, 0.0f, n - most + 1, n, 0.0f, &found, values,
                       b->rows, n, support) ||
        found != most)
        goto done;
    e = ERR_OK;
    for (uint32_t i = 0; i < (uint32_t)most / 2; i++) /* the largest first */
        cblas_sswap(n, b->rows + (size_t)i * n, 1, b->rows + (size_t)(most - 1 - (int)i) * n, 1);
    for (int i = 0; i < most; i++) {
        kept += fmax(0.0, (double)values[most - 1 - i]);
        if ((i + 1) % PACKET != 0)
            continue;
        b->count = (uint32_t)i + 1;
        b->rest = whole > 0.0 ? sqrt(fmax(0.0, 1.0 - kept / whole)) : 0.0;
        if (b->rest <= ENOUGH)
            break;
    }
done:
    mem_free(support);
    mem_free(values);
    mem_free(gram);
    return e;
}

void indirect_basis_finish(struct indirect_basis *b)
{
    mem_free(b->rows);
    *b = (struct indirect_basis){ .count = 0 };
}
