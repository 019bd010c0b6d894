#include "light/cache_direct/internal.h"

extern const struct transport_kernels transport_kernels_baseline, transport_kernels_v3, transport_kernels_v4;

const struct transport_kernels *transport_kernels_of(const struct kernels *k)
{
    static const struct transport_kernels *const by_level[CPU_LEVELS] = KERNEL_TABLE(transport_kernels);

    return by_level[k->cpu];
}
