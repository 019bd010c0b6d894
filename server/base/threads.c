#include "base/process.h"

#include "base/mem.h"

#include <errno.h>
#include <pthread.h>
#include <string.h>
#include <unistd.h>

#define VARIABLES_MOST 4096 /* of the environment; those beyond are lost to the restarted program */

extern char **environ;

static bool has(char *const *variables, const char *name)
{
    const size_t length = strlen(name);

    for (; *variables; variables++)
        if (strncmp(*variables, name, length) == 0 && (*variables)[length] == '=')
            return true;
    return false;
}

/* The C library is not initialised yet where this runs before the others: it calls the kernel and copies memory. */
static void execute_again(int argc, char **argv, char **variables)
{
    static char passive[] = "OMP_WAIT_POLICY=passive", one[] = "OPENBLAS_NUM_THREADS=1";
    static char *all[VARIABLES_MOST + 3];
    static char path[4096]; /* the program's own path, so that it keeps its name in process lists */
    size_t count = 0;

    (void)argc;
    if (has(variables, "OMP_WAIT_POLICY") && has(variables, "OPENBLAS_NUM_THREADS"))
        return;
    for (; variables[count] && count < VARIABLES_MOST; count++)
        all[count] = variables[count];
    if (!has(variables, "OMP_WAIT_POLICY"))
        all[count++] = passive;
    if (!has(variables, "OPENBLAS_NUM_THREADS"))
        all[count++] = one;
    if (readlink("/proc/self/exe", path, sizeof(path) - 1) > 0)
        execve(path, argv, all);
    /* If that fails, spinning only costs speed. */
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
/* Called before the initialisers of all libraries. */
__attribute__((section(".preinit_array"), used)) static void (*const before_libraries)(int, char **,
                                                                                       char **) = execute_again;
#endif

void threads_wait_passively(char **argv)
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
