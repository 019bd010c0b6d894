/* processor_time FILE NAME COMMAND...: runs a test and appends "user system elapsed NAME", in seconds, to FILE; the
 * processor time is that of all of its processes, also of those that a killed one left behind. Ends as the test does.
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static double now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static double seconds(struct timeval t)
{
    return (double)t.tv_sec + 1e-6 * (double)t.tv_usec;
}

int main(int argc, char **argv)
{
    const double start = now();
    struct rusage used;
    char line[1000];
    int status = 0, other;
    pid_t ended;

    if (argc < 4)
        return 2;
    prctl(PR_SET_CHILD_SUBREAPER, 1L);
    const pid_t test = fork();
    if (test == 0) {
        execvp(argv[3], argv + 3);
        _exit(127);
    }
    while ((ended = waitpid(-1, &other, 0)) > 0 && ended != test)
        ;
    status = other;
    while (waitpid(-1, &other, WNOHANG) > 0)
        ;
    getrusage(RUSAGE_CHILDREN, &used);
    const int length = snprintf(line, sizeof(line), "%.2f %.2f %.2f %s\n", seconds(used.ru_utime),
                                seconds(used.ru_stime), now() - start, argv[2]);
    const int file = open(argv[1], O_WRONLY | O_CREAT | O_APPEND, 0666);
    if (file < 0 || write(file, line, (size_t)length) != length)
        perror(argv[1]);
    if (WIFSIGNALED(status)) {
        signal(WTERMSIG(status), SIG_DFL);
        raise(WTERMSIG(status));
    }
    return WEXITSTATUS(status);
}
