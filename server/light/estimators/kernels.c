#include "light/estimators/kernels.h"

extern const struct kernels kernels_baseline, kernels_v3, kernels_v4;

enum err kernels_select(const char *level, const struct kernels **out, struct reason *why)
{
    static const struct kernels *const by_level[CPU_LEVELS] = KERNEL_TABLE(kernels);
    enum cpu_level chosen;
    const enum err e = cpu_select(level, &chosen, why);

    *out = e ? NULL : by_level[chosen];
    return e;
}
