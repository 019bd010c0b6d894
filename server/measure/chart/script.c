#include "measure/chart/script.h"

#include "import/sandbox/helper_process.h"

#include <errno.h>
#include <math.h>
#include <omp.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#ifndef RELIGHT_COMMIT
#define RELIGHT_COMMIT "unknown" /* outside a repository */
#endif

extern char **environ;

enum err script_start(struct script *s, const char *name, const char *argument, struct reason *why)
{
    char file[64], path[4096];
    char *const arguments[] = { (char[]){ "python3" }, (char[]){ "-B" }, path, (char *)argument, NULL };
    posix_spawn_file_actions_t files;
    int ends[2];

    snprintf(file, sizeof(file), "relight-scripts/%s", name);
    const enum err e = child_find(file, NULL, path, sizeof(path), why);
    if (e)
        return e;
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends))
        return err_say(why, ERR_IO, "no socket for %s: %s", name, strerror(errno));
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_adddup2(&files, ends[1], STDIN_FILENO);
    const int failed = posix_spawnp(&s->pid, arguments[0], &files, NULL, arguments, environ);
    posix_spawn_file_actions_destroy(&files);
    close(ends[1]);
    s->name = name;
    s->socket = ends[0];
    if (!failed)
        return ERR_OK;
    close(ends[0]);
    s->pid = 0;
    return err_say(why, ERR_IO, "python3 cannot be started: %s", strerror(failed));
}

enum err script_tell(struct script *s, json_t *what, struct reason *why)
{
    char *line = what ? json_dumps(what, JSON_COMPACT) : NULL, answer[sizeof(why->text)];

    json_decref(what);
    if (!line)
        return err_say(why, ERR_NOMEM, "out of memory");
    const size_t size = strlen(line);
    line[size] = '\n'; /* instead of its 0 */
    ssize_t n = send(s->socket, line, size + 1, MSG_NOSIGNAL);
    free(line);
    if (n > 0)
        n = recv(s->socket, answer, sizeof(answer), 0);
    if (n <= 0)
        return err_say(why, ERR_IO, "%s has failed", s->name);
    answer[n - 1] = '\0';
    return answer[0] ? err_say(why, ERR_IO, "%s", answer) : ERR_OK;
}

void script_end(struct script *s)
{
    if (!s->pid)
        return;
    close(s->socket);
    waitpid(s->pid, NULL, 0);
}

json_t *script_number(double v)
{
    return isfinite(v) ? json_real(v) : json_null();
}

json_t *script_machine(int threads, const char *level)
{
    return json_pack("{s:i, s:i, s:s, s:s, s:s}", "threads", threads, "processors", omp_get_num_procs(), "level", level,
                     "commit", RELIGHT_COMMIT, "version", RELIGHT_VERSION);
}
