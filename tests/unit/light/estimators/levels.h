/* All kernels that this CPU supports, lowest level first, ended by NULL. */
#pragma once

#include "image/film/tone_kernel.h"
#include "light/estimators/kernels.h"
#include "support/unit.h"

static inline const struct kernels *const *kernels_all(void)
{
    static const struct kernels *all[CPU_LEVELS + 1];
    struct reason why;

    for (int k = 0; k <= (int)cpu_best(); k++)
        assert_int_equal(kernels_select(cpu_names[k], &all[k], &why), ERR_OK);
    return all;
}

static inline const struct tone_kernel *const *tone_kernels_all(void)
{
    static const struct tone_kernel *all[CPU_LEVELS + 1];

    for (int k = 0; k <= (int)cpu_best(); k++)
        all[k] = tone_kernel_select(cpu_names[k]);
    return all;
}
