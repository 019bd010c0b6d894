#include "light/cache_indirect/internal.h"

extern const struct indirect_kernels indirect_kernels_baseline, indirect_kernels_v3, indirect_kernels_v4;

const struct indirect_kernels *indirect_kernels_of(const struct kernels *k)
{
    static const struct indirect_kernels *const by_level[CPU_LEVELS] = KERNEL_TABLE(indirect_kernels);

    return by_level[k->cpu];
}
