#include "base/threads.h"

#include <stdlib.h>
#include <unistd.h>

void threads_wait_passively(char **argv)
{
    char path[4096]; /* the program's own path, so that it keeps its name in process lists */

    if (getenv("OMP_WAIT_POLICY"))
        return;
    const ssize_t length = readlink("/proc/self/exe", path, sizeof(path) - 1);
    if (length <= 0)
        return;
    path[length] = '\0';
    setenv("OMP_WAIT_POLICY", "passive", 1);
    execv(path, argv);
    /* If exec fails, spinning only costs speed. */
}
