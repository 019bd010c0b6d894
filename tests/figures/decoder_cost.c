/* What it costs that a stranger's file is decoded in a process of its own: the ratio of both times for the same bytes,
 * in turns, as the median over pairs. For the files that are named. */
#include "base/clock.h"
#include "base/mem.h"
#include "import/decoder/decoder.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

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

static uint8_t *read_file(const char *path, size_t *size)
{
    FILE *f = fopen(path, "rb");
    uint8_t *bytes = NULL;

    if (f && fseek(f, 0, SEEK_END) == 0) {
        const long length = ftell(f);
        rewind(f);
        bytes = mem_alloc((size_t)length, 1);
        *size = bytes ? fread(bytes, 1, (size_t)length, f) : 0;
    }
    if (f)
        fclose(f);
    return bytes;
}

/* Processor seconds of this thread; of processes that were waited for. */
static double here_s(void)
{
    struct timespec t;

    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static double ended_s(void)
{
    struct rusage u;

    getrusage(RUSAGE_CHILDREN, &u);
    return (double)(u.ru_utime.tv_sec + u.ru_stime.tv_sec) + 1e-6 * (double)(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

/* Wall-clock times include the waiting for a processor where others are at work; processor times do not. */
static int measure(const char *name, const uint8_t *bytes, size_t size)
{
    struct decoder *d = NULL;
    struct image near = { 0 }, far = { 0 };
    struct reason why = { "" };
    double here[PAIRS], there[PAIRS], ratio[PAIRS], cpu[2] = { 0.0, 0.0 };

    if (decoder_create(&(struct decoder_desc){ 0 }, &d, &why)) {
        fprintf(stderr, "%s\n", why.text);
        return 1;
    }
    for (int i = -2; i < PAIRS; i++) { /* two of them make room */
        const double a = clock_seconds(), a_cpu = here_s();
        if (decode_image(bytes, size, name, &near, &why))
            break;
        const double b = clock_seconds(), b_cpu = here_s();
        if (decoder_decode(d, bytes, size, name, &far, &why))
            break;
        const double c = clock_seconds();
        cpu[0] += b_cpu - a_cpu;
        cpu[1] += here_s() - b_cpu;
        if (i < 0)
            continue;
        here[i] = b - a;
        there[i] = c - b;
        ratio[i] = there[i] / here[i];
    }
    if (near.width != far.width || memcmp(near.rgb, far.rgb, 12 * (size_t)near.width * near.height) != 0) {
        fprintf(stderr, "%s: not decoded, or not to the same bits: %s\n", name, why.text);
        return 1;
    }
    const double before = ended_s();
    decoder_destroy(d);
    const double child = ended_s() - before;
    printf("%s: %ux%u, %.1f MB\n", name, near.width, near.height, (double)size / 1e6);
    printf("    wall clock, medians: %.2f ms in this process, %.2f ms in its own, of pairs %.3f\n", 1e3 * median(here),
           1e3 * median(there), median(ratio));
    printf("    processor, means: %.2f ms in this process, %.2f + %.2f ms in its own and here, %.3f\n",
           1e3 * cpu[0] / (PAIRS + 2), 1e3 * child / (PAIRS + 2), 1e3 * cpu[1] / (PAIRS + 2),
           (child + cpu[1]) / cpu[0]);
    image_finish(&near);
    image_finish(&far);
    return 0;
}

int main(int argc, char **argv)
{
    int failed = 0;

    for (int i = 1; i < argc; i++) {
        size_t size = 0;
        uint8_t *bytes = read_file(argv[i], &size);
        failed |= !bytes || measure(argv[i], bytes, size);
        mem_free(bytes);
    }
    return failed;
}
