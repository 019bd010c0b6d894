/* What every unit test file shares: the cmocka header with what it needs, and a main that runs one claim by name. */
#pragma once

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define UNIT_SKIPPED 77

/* With a name: that claim alone, and 1 when there is none of that name, so that a claim left out of the table cannot
 * pass. Without: all. */
static inline int unit_main(int argc, char **argv, const struct CMUnitTest *tests, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (argc < 2 || strcmp(argv[1], tests[i].name) == 0) {
            const struct CMUnitTest one[] = { tests[i] };
            const int failed = cmocka_run_group_tests(one, NULL, NULL);
            if (argc >= 2 || failed)
                return failed;
        }
    }
    if (argc >= 2)
        fprintf(stderr, "no claim named '%s' in the table\n", argv[1]);
    return argc >= 2;
}

#define UNIT_MAIN(tests)                                                                                               \
    int main(int argc, char **argv)                                                                                    \
    {                                                                                                                  \
        return unit_main(argc, argv, tests, sizeof(tests) / sizeof((tests)[0]));                                       \
    }

/* How many seeds a test of means draws: `few` in each run, `all` in `./test --long`, which sets RELIGHT_LONG. */
static inline uint32_t seeds_count(uint32_t few, uint32_t all)
{
    return getenv("RELIGHT_LONG") ? all : few;
}

/* How many times as large as by all seeds the standard error of a mean is: what is asserted of it grows by as much. */
static inline double seeds_blur(uint32_t few, uint32_t all)
{
    return sqrt((double)all / seeds_count(few, all));
}

/* A path below RELIGHT_TEST_DATA (static storage, one at a time); ends the program as skipped when that is not set. */
static inline const char *unit_data(const char *relative)
{
    static char path[4096];
    const char *root = getenv("RELIGHT_TEST_DATA");

    if (!root || !root[0]) {
        printf("skipped: RELIGHT_TEST_DATA is not set\n");
        fflush(stdout);
        exit(UNIT_SKIPPED);
    }
    snprintf(path, sizeof(path), "%s/%s", root, relative);
    return path;
}
