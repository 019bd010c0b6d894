#include "image/video/ffmpeg.h"

#include "base/log.h"

#include <dlfcn.h>
#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>

/* The version whose headers this was compiled with: "libavcodec.so.59". */
#define SONAME(library, version) "lib" library ".so." AV_STRINGIFY(version)

static struct ffmpeg table;
static bool complete;

#define ENTRY(name) { #name, offsetof(struct ffmpeg, name) },

static const struct function {
    const char *name;
    size_t at; /* in struct ffmpeg */
} util[] = { FFMPEG_UTIL(ENTRY) }, codec[] = { FFMPEG_CODEC(ENTRY) };

#ifdef RELIGHT_MOVIES
static const struct function format[] = { FFMPEG_FORMAT(ENTRY) };
#endif

static bool load(const char *library, const struct function *functions, size_t count)
{
    void *handle = dlopen(library, RTLD_LAZY | RTLD_LOCAL); /* never closed */

    if (!handle) {
        log_warning("no video: %s", dlerror());
        return false;
    }
    for (size_t i = 0; i < count; i++) {
        void *symbol = dlsym(handle, functions[i].name);
        if (!symbol) {
            log_warning("no video: %s lacks %s", library, functions[i].name);
            return false;
        }
        *(void **)((char *)&table + functions[i].at) = symbol; /* POSIX: functions fit in object pointers */
    }
    return true;
}

static void load_all(void)
{
    complete = load(SONAME("avutil", LIBAVUTIL_VERSION_MAJOR), util, sizeof(util) / sizeof(util[0])) &&
               load(SONAME("avcodec", LIBAVCODEC_VERSION_MAJOR), codec, sizeof(codec) / sizeof(codec[0]));
#ifdef RELIGHT_MOVIES
    complete =
        complete && load(SONAME("avformat", LIBAVFORMAT_VERSION_MAJOR), format, sizeof(format) / sizeof(format[0]));
#endif
}

const struct ffmpeg *ffmpeg(void)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;

    pthread_once(&once, load_all);
    return complete ? &table : NULL;
}
