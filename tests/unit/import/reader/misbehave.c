/* relight-reader as a hostile scene file might make it: what the file's name says is done instead of reading. */
#define _GNU_SOURCE
#include "import/formats/import.h"
#include "import/reader/host.h"
#include "import/reader/wire.h"

#include <fcntl.h>
#include <jansson.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

/* Memory without end, if it is let. */
static enum err eat(void)
{
    for (;;) {
        char *p = malloc((size_t)16 << 20);
        if (!p)
            return ERR_NOMEM;
        for (size_t i = 0; i < (size_t)16 << 20; i += 4096)
            *(volatile char *)(p + i) = 1;
    }
}

/* Fills the shared memory, if it is let. */
static enum err fill(void)
{
    static char block[1 << 20];

    for (;;)
        if (write(WIRE_PARCEL, block, sizeof(block)) <= 0)
            return ERR_NOMEM;
}

/* Each of these must end the process. */
static void ask_the_system(const char *what)
{
    if (strcmp(what, "open") == 0)
        open("/etc/passwd", O_RDONLY);
    else if (strcmp(what, "socket") == 0)
        socket(AF_INET, SOCK_STREAM, 0);
    else if (strcmp(what, "fork") == 0)
        fork();
    else if (strcmp(what, "exec") == 0)
        execl("/bin/true", "true", (char *)NULL);
    else if (strcmp(what, "kill") == 0)
        kill(getppid(), SIGTERM);
    else if (strcmp(what, "code") == 0)
        mmap(NULL, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    else if (strcmp(what, "limits") == 0)
        syscall(SYS_prlimit64, 0, 7, NULL, NULL);
}

static enum err send_message(uint32_t magic, uint32_t kind, int code, size_t size)
{
    struct wire_message m = { .magic = magic, .kind = kind, .code = code };

    memset(m.text, '\x1b', sizeof(m.text)); /* without an end */
    if (write(WIRE_SOCKET, &m, size) < 0)
        _exit(9);
    for (;;)
        pause();
}

static enum err talk(const char *what)
{
    const size_t all = sizeof(struct wire_message);

    if (strcmp(what, "magic") == 0)
        return send_message(1, WIRE_STEP, 0, all);
    if (strcmp(what, "kind") == 0)
        return send_message(WIRE_MAGIC, 77, 0, all);
    if (strcmp(what, "hello") == 0)
        return send_message(WIRE_MAGIC, 0, 0, all);
    if (strcmp(what, "result") == 0)
        return send_message(WIRE_MAGIC, WIRE_DONE, -5, all);
    if (strcmp(what, "empty") == 0)
        return send_message(WIRE_MAGIC, WIRE_DONE, ERR_OK, all);
    if (strcmp(what, "escape") == 0)
        return send_message(WIRE_MAGIC, WIRE_DONE, ERR_FORMAT, all);
    return send_message(WIRE_MAGIC, WIRE_STEP, 0, 7);
}

static enum err misbehave(const char *path, const struct host *host, struct scene **out, struct reason *why)
{
    const char *slash = strrchr(path, '/');
    char deed[64];
    size_t size;
    int fd;

    snprintf(deed, sizeof(deed), "%.*s", (int)strcspn(slash + 1, "."), slash + 1);
    if (strcmp(deed, "crash") == 0)
        *(volatile char *)(uintptr_t)path[0] = 1; /* nothing is mapped that low */
    else if (strcmp(deed, "abort") == 0)
        abort();
    else if (strcmp(deed, "exit") == 0)
        _exit(3);
    else if (strcmp(deed, "hang") == 0)
        for (;;)
            continue;
    else if (strcmp(deed, "eat") == 0)
        return eat();
    else if (strcmp(deed, "fill") == 0)
        return fill();
    else if (strncmp(deed, "ask-", 4) == 0)
        ask_the_system(deed + 4);
    else if (strncmp(deed, "talk-", 5) == 0)
        return talk(deed + 5);
    else if (strcmp(deed, "outside") == 0)
        return host->open(host->context, "/etc/passwd", &fd, &size, why);
    else if (strcmp(deed, "late") == 0) { /* to widen what it may read, after a model has been opened */
        if (host->open(host->context, "/nowhere", &fd, &size, why))
            return host->allow(host->context, "/etc/passwd", why);
    }
    return import_scene(path, host, out, why);
}

int main(int argc, char **argv)
{
    json_object_seed(1);
    return reader_serve(argc, argv, misbehave);
}
