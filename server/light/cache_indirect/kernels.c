#include "light/cache_indirect/parts.h"

extern const struct bounce_kernels bounce_kernels_baseline, bounce_kernels_v3, bounce_kernels_v4;

const struct bounce_kernels *bounce_kernels_of(const struct kernels *k)
{
    static const struct bounce_kernels *const by_level[CPU_LEVELS] = KERNEL_TABLE(bounce_kernels);

    return by_level[k->cpu];
}
