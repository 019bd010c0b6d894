#include "base/cpu.h"

#include <string.h>
#ifdef __x86_64__
#include <cpuid.h>
#endif

const char *const cpu_names[CPU_LEVELS] = { "baseline", "v3", "v4" };

enum cpu_level cpu_best(void)
{
#ifdef __x86_64__
    const int v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2");
    const int v4 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                   __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
    if (v3)
        return v4 ? CPU_V4 : CPU_V3;
#endif
    return CPU_BASELINE;
}

uint32_t cpu_model(void)
{
#ifdef __x86_64__
    unsigned a, b, c, d;
    if (__get_cpuid(1, &a, &b, &c, &d))
        return a & ~0xfu; /* the last digit is the stepping */
#endif
    return 0;
}

enum err cpu_select(const char *name, enum cpu_level *out, struct reason *why)
{
    const enum cpu_level best = cpu_best();

    *out = best;
    if (!name)
        return ERR_OK;
    for (int k = 0; k <= (int)best; k++)
        if (strcmp(name, cpu_names[k]) == 0) {
            *out = (enum cpu_level)k;
            return ERR_OK;
        }
    return err_say(why, ERR_USAGE, "--cpu '%s' is unknown or not supported by this CPU; it supports %s%s%s", name,
                   cpu_names[0], best >= CPU_V3 ? ", v3" : "", best >= CPU_V4 ? ", v4" : "");
}
