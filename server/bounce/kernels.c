#include "bounce/parts.h"

extern const struct bounce_kernels bounce_kernels_baseline;
#ifdef __x86_64__
extern const struct bounce_kernels bounce_kernels_v3, bounce_kernels_v4;
#endif

const struct bounce_kernels *bounce_kernels_of(const struct kernels *k)
{
    static const struct bounce_kernels *const by_level[CPU_LEVELS] = {
        [CPU_BASELINE] = &bounce_kernels_baseline,
#ifdef __x86_64__
        [CPU_V3] = &bounce_kernels_v3,
        [CPU_V4] = &bounce_kernels_v4,
#endif
    };

    return by_level[k->cpu];
}
