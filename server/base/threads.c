#include "base/process.h"

#include "base/mem.h"

#include <errno.h>
#include <pthread.h>
#include <string.h>
#include <unistd.h>

#define VARIABLES_MOST 4096 /* of the environment; those beyond are lost to the restarted program */

extern char **environ;

/* What libraries read when they are loaded. */
static char passive[] = "OMP_WAIT_POLICY=passive", one[] = "OPENBLAS_NUM_THREADS=1",
            large[] = "GLIBC_TUNABLES=glibc.malloc.hugetlb=1";
static char *const wanted[] = { passive, one, large };
enum { WANTED = sizeof(wanted) / sizeof(wanted[0]) };

/* Whether a variable of that name is among them. */
static bool has(char *const *variables, const char *wish)
{
    const size_t length = (size_t)(strchr(wish, '=') - wish) + 1;

    for (; *variables; variables++)
        if (strncmp(*variables, wish, length) == 0)
            return true;
    return false;
}

/* The C library is not initialised yet where this runs before the others: it calls the kernel and copies memory. */
static void execute_again(int argc, char **argv, char **variables)
{
    static char *all[VARIABLES_MOST + WANTED + 1];
    static char path[4096]; /* the program's own path, so that it keeps its name in process lists */
    size_t count = 0, own = 0;

    (void)argc;
    for (; variables[count] && count < VARIABLES_MOST; count++)
        all[count] = variables[count];
    for (int k = 0; k < WANTED; k++)
        if (!has(variables, wanted[k]))
            all[count + own++] = wanted[k];
    if (own > 0 && readlink("/proc/self/exe", path, sizeof(path) - 1) > 0)
        execve(path, argv, all);
    /* If that fails, spinning and small pages only cost speed. */
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
/* Called before the initialisers of all libraries. */
__attribute__((section(".preinit_array"), used)) static void (*const before_libraries)(int, char **,
                                                                                       char **) = execute_again;
#endif

void process_settle(char **argv)
{
    execute_again(0, argv, environ);
}

static void *wait_for_all(void *gate)
{
    pthread_mutex_lock(gate);
    pthread_mutex_unlock(gate);
    return NULL;
}

bool threads_can_start(unsigned count, struct reason *why)
{
    pthread_mutex_t gate = PTHREAD_MUTEX_INITIALIZER;
    pthread_t *threads = mem_alloc(count, sizeof(*threads));
    unsigned started = 0;
    int failed = threads ? 0 : ENOMEM;

    pthread_mutex_lock(&gate);
    while (started < count && !failed) {
        failed = pthread_create(&threads[started], NULL, wait_for_all, &gate);
        started += !failed;
    }
    pthread_mutex_unlock(&gate);
    for (unsigned i = 0; i < started; i++)
        pthread_join(threads[i], NULL);
    mem_free(threads);
    if (failed)
        err_say(why, ERR_NOMEM, "only %u of %u threads can be started: %s", started, count, strerror(failed));
    return !failed;
}
