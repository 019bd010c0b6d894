/* server/base/cpu.h */
/* Which instructions a program may use: every room that has more than one build of a loop asks here, so that one flag,
 * --cpu LEVEL, lowers them all. Levels are x86-64's micro-architecture levels; elsewhere there is the baseline only. */
#ifndef BASE_CPU_H
#define BASE_CPU_H

#include "err.h"

enum cpu_level {
    CPU_BASELINE, /* what every CPU has: SSE2 */
    CPU_V3,       /* AVX2 */
    CPU_V4,       /* AVX-512 */
    CPU_LEVELS,
};

/* The best that this CPU has; it has all below. */
enum cpu_level cpu_best(void);

const char *cpu_name(enum cpu_level level); /* "baseline", "v3", "v4" */

/* The level of that name; NULL: the best. ERR_USAGE when it is unknown or the CPU lacks it. */
MUST_CHECK enum err cpu_select(const char *name, enum cpu_level *out, struct reason *why);

#endif
