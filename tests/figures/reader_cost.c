/* What it costs that a scene is read in a process of its own: both times for the same file, in turns. For the scene
 * files that are named. Wall-clock times include the waiting for a processor where others are at work. */
#include "base/clock.h"
#include "base/log.h"
#include "import/formats/import.h"
#include "import/reader/reader.h"
#include "tests/unit/scene/geometry/host_here.h"

#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>

#define PAIRS 15

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *v)
{
    qsort(v, PAIRS, sizeof(*v), by_value);
    return v[PAIRS / 2];
}

/* Processor seconds of this process and those that it waited for. */
static double processor_s(void)
{
    double sum = 0.0;

    for (int k = 0; k < 2; k++) {
        struct rusage u;
        getrusage(k ? RUSAGE_CHILDREN : RUSAGE_SELF, &u);
        sum +=
            (double)(u.ru_utime.tv_sec + u.ru_stime.tv_sec) + 1e-6 * (double)(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
    }
    return sum;
}

static enum err read_here(const char *path, struct scene **out, struct reason *why)
{
    struct scene_files files;

    enum err e = scene_files_init(&files, path, SIZE_MAX);
    if (!e) {
        const struct host host = host_here(&files);
        e = import_scene(path, &host, out, why);
    }
    scene_files_finish(&files);
    return e;
}

static int measure(const char *path)
{
    double wall[2][PAIRS], processor[2][PAIRS];
    struct reason why = { "" };
    uint64_t triangles = 0;

    for (int i = 0; i < 2 * PAIRS; i++) {
        struct scene *s = NULL;
        const double from = clock_seconds(), from_cpu = processor_s();
        if (i % 2 ? scene_load(path, NULL, &s, NULL, &why) : read_here(path, &s, &why)) {
            fprintf(stderr, "%s\n", why.text);
            return 1;
        }
        wall[i % 2][i / 2] = clock_seconds() - from;
        processor[i % 2][i / 2] = processor_s() - from_cpu;
        triangles = s->triangle_count;
        scene_destroy(s);
    }
    printf("%s: %llu triangles; medians of %d, in this process and in its own: wall clock %.0f and %.0f ms, processor "
           "%.0f "
           "and %.0f ms\n",
           path, (unsigned long long)triangles, PAIRS, 1e3 * median(wall[0]), 1e3 * median(wall[1]),
           1e3 * median(processor[0]), 1e3 * median(processor[1]));
    return 0;
}

int main(int argc, char **argv)
{
    int failed = 0;

    log_init("reader_cost", LOG_ERROR);
    for (int i = 1; i < argc; i++)
        failed |= measure(argv[i]);
    return failed;
}
