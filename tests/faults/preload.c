/* Loaded before the libraries (LD_PRELOAD), this makes calls of the system fail as the environment asks, or as a file
 * whose path it gives appears:
 *   RELIGHT_FAIL_THREAD=N   the N-th pthread_create finds no thread
 *   RELIGHT_FAIL_EMBREE=1   rtcNewDevice has no device
 *   RELIGHT_FAIL_CODEC=1    avcodec_open2, which the program looks up with dlsym, has no encoder
 *   RELIGHT_CLOCK_FILE=F    the wall clock is so many seconds ahead as F says; without F it is right */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>
#include <time.h>

void *rtcNewDevice(const char *config);

int pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*begin)(void *), void *argument)
{
    static atomic_int count;
    static int (*real)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);
    const char *fail = getenv("RELIGHT_FAIL_THREAD");

    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "pthread_create");
    if (fail && atomic_fetch_add(&count, 1) + 1 == atoi(fail))
        return EAGAIN;
    return real(thread, attributes, begin, argument);
}

void *rtcNewDevice(const char *config)
{
    static void *(*real)(const char *);

    if (getenv("RELIGHT_FAIL_EMBREE"))
        return NULL;
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "rtcNewDevice");
    return real(config);
}

static int no_encoder(void)
{
    return -1;
}

void *dlsym(void *restrict handle, const char *restrict name)
{
    void *(*real)(void *, const char *);

    *(void **)&real = dlvsym(RTLD_NEXT, "dlsym", "GLIBC_2.34");
    if (getenv("RELIGHT_FAIL_CODEC") && strcmp(name, "avcodec_open2") == 0) {
        int (*found)(void) = no_encoder;
        return *(void **)&found;
    }
    return real(handle, name);
}

static long ahead_s(void)
{
    const char *path = getenv("RELIGHT_CLOCK_FILE");
    FILE *f = path ? fopen(path, "r") : NULL;
    long s = 0;

    if (f) {
        if (fscanf(f, "%ld", &s) != 1)
            s = 0;
        fclose(f);
    }
    return s;
}

int clock_gettime(clockid_t which, struct timespec *out)
{
    static int (*real)(clockid_t, struct timespec *);

    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "clock_gettime");
    const int result = real(which, out);
    if (which == CLOCK_REALTIME)
        out->tv_sec += ahead_s();
    return result;
}

int gettimeofday(struct timeval *restrict out, void *restrict zone)
{
    struct timespec now;

    (void)zone;
    clock_gettime(CLOCK_REALTIME, &now);
    *out = (struct timeval){ .tv_sec = now.tv_sec, .tv_usec = now.tv_nsec / 1000 };
    return 0;
}
