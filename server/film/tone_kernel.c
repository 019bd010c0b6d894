#include "tone_kernel.h"

#include "tone_loop.h"

#include <stdbool.h>

void tone_ref(const struct tone_table *t, const float *in, size_t count, float gain, uint8_t *out)
{
    tone_loop(t, in, count, gain, out);
}

static const struct tone_kernel reference = { "baseline", tone_ref };

const struct tone_kernel *const *tone_kernels_all(void)
{
#ifdef __x86_64__
    static const struct tone_kernel v3 = { "v3", tone_v3 }, v4 = { "v4", tone_v4 };
    static const struct tone_kernel *const upto_v4[] = { &reference, &v3, &v4, NULL };
    static const struct tone_kernel *const upto_v3[] = { &reference, &v3, NULL };
    const bool has_v3 =
        __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2");
    if (has_v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw"))
        return upto_v4;
    if (has_v3)
        return upto_v3;
#endif
    static const struct tone_kernel *const only_reference[] = { &reference, NULL };
    return only_reference;
}

const struct tone_kernel *tone_kernel_best(void)
{
    const struct tone_kernel *const *k = tone_kernels_all();

    while (k[1])
        k++;
    return *k;
}
