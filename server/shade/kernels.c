#include "kernels.h"

#include <string.h>

extern const struct kernels kernels_baseline;
#ifdef __x86_64__
extern const struct kernels kernels_v3, kernels_v4;
#endif

const struct kernels *const *kernels_all(void)
{
    /* Lists ended by NULL, one per CPU: they are constant, so that nothing has to be remembered. */
#ifdef __x86_64__
    static const struct kernels *const upto_v4[] = { &kernels_baseline, &kernels_v3, &kernels_v4, NULL };
    static const struct kernels *const upto_v3[] = { &kernels_baseline, &kernels_v3, NULL };
    const int v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2");
    if (v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw"))
        return upto_v4;
    if (v3)
        return upto_v3;
#endif
    static const struct kernels *const only_baseline[] = { &kernels_baseline, NULL };
    return only_baseline;
}

enum err kernels_select(const char *level, const struct kernels **out, struct reason *why)
{
    const struct kernels *const *all = kernels_all();

    *out = NULL;
    for (size_t i = 0; all[i]; i++)
        if (!level || strcmp(level, all[i]->level) == 0)
            *out = all[i];
    if (!*out)
        return err_say(why, ERR_USAGE, "--cpu '%s' is unknown, or this CPU lacks it; it has %s%s%s", level,
                       all[0]->level, all[1] ? ", v3" : "", all[1] && all[2] ? ", v4" : "");
    return ERR_OK;
}
