#include "film/tone_kernel.h"

#include "base/cpu.h"
#include "film/tone_loop.h"

void tone_ref(const struct tone_table *t, const float *in, size_t count, float gain, uint8_t *out)
{
    tone_loop(t, in, count, gain, out);
}

const struct tone_kernel *const *tone_kernels_all(void)
{
    static const struct tone_kernel reference = { "baseline", tone_ref };
#ifdef __x86_64__
    static const struct tone_kernel v3 = { "v3", tone_v3 }, v4 = { "v4", tone_v4 };
#endif
    static const struct tone_kernel *const upto[CPU_LEVELS][CPU_LEVELS + 1] = {
        [CPU_BASELINE] = { &reference },
#ifdef __x86_64__
        [CPU_V3] = { &reference, &v3 },
        [CPU_V4] = { &reference, &v3, &v4 },
#endif
    };

    return upto[cpu_best()];
}

const struct tone_kernel *tone_kernel_select(const char *level)
{
    const struct tone_kernel *const *k = tone_kernels_all();

    while (k[1] && !(level && strcmp(level, k[0]->level) == 0))
        k++;
    return *k;
}
