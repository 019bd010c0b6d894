#include "transport/parts.h"

extern const struct transport_kernels transport_kernels_baseline;
#ifdef __x86_64__
extern const struct transport_kernels transport_kernels_v3, transport_kernels_v4;
#endif

const struct transport_kernels *transport_kernels_of(const struct kernels *k)
{
    static const struct transport_kernels *const by_level[CPU_LEVELS] = {
        [CPU_BASELINE] = &transport_kernels_baseline,
#ifdef __x86_64__
        [CPU_V3] = &transport_kernels_v3,
        [CPU_V4] = &transport_kernels_v4,
#endif
    };

    return by_level[k->cpu];
}
