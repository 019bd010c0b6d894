#include "estimators/kernels.h"

#include "base/cpu.h"

extern const struct kernels kernels_baseline;
#ifdef __x86_64__
extern const struct kernels kernels_v3, kernels_v4;
#endif

const struct kernels *const *kernels_all(void)
{
    /* One constant list per CPU level, ended by NULL. */
    static const struct kernels *const upto[CPU_LEVELS][CPU_LEVELS + 1] = {
        [CPU_BASELINE] = { &kernels_baseline },
#ifdef __x86_64__
        [CPU_V3] = { &kernels_baseline, &kernels_v3 },
        [CPU_V4] = { &kernels_baseline, &kernels_v3, &kernels_v4 },
#endif
    };

    return upto[cpu_best()];
}

enum err kernels_select(const char *level, const struct kernels **out, struct reason *why)
{
    enum cpu_level chosen;
    const enum err e = cpu_select(level, &chosen, why);

    *out = e ? NULL : kernels_all()[chosen];
    return e;
}
