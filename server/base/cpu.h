/* x86-64 micro-architecture levels. Rooms that build a kernel for several levels select one here, so that --cpu LEVEL
 * lowers all of them. Other architectures have the baseline only. Thread: any. */
#pragma once

#include "base/err.h"

#include <stdint.h>

enum cpu_level {
    CPU_BASELINE, /* SSE2, which every x86-64 CPU has */
    CPU_V3,       /* AVX2 */
    CPU_V4,       /* AVX-512 */
    CPU_LEVELS,
};

/* For sources that are compiled once per level (kernels() in server/CMakeLists.txt): KERNEL(x) names the level's own x,
 * KERNEL_TABLE(x) initialises an array of pointers to them, indexed by enum cpu_level. */
#define KERNEL(name) KERNEL_JOIN(name, KERNEL_LEVEL)
#define KERNEL_JOIN(name, level) KERNEL_JOINED(name, level)
#define KERNEL_JOINED(name, level) name##_##level
#ifdef __x86_64__
#define KERNEL_TABLE(name)                                                                                             \
    {                                                                                                                  \
        &name##_baseline, &name##_v3, &name##_v4                                                                       \
    }
#else
#define KERNEL_TABLE(name)                                                                                             \
    {                                                                                                                  \
        &name##_baseline                                                                                               \
    }
#endif

/* Family and model of this CPU, in one number; 0: unknown. For what another model may compute with other rounding. */
uint32_t cpu_model(void);

/* The highest level this CPU supports; it also supports all lower ones. */
enum cpu_level cpu_best(void);

extern const char *const cpu_names[CPU_LEVELS]; /* "baseline", "v3", "v4" */

/* Finds a level by name; NULL means the highest. ERR_USAGE: unknown, or not supported by this CPU. */
MUST_CHECK enum err cpu_select(const char *name, enum cpu_level *out, struct reason *why);
