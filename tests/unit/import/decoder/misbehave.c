/* relight-decoder as a file of a stranger might make it: what the file says is done instead of decoding. A file that
 * says nothing of the kind is decoded. */
#define _GNU_SOURCE
#include "import/decoder/internal.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

/* A GiB, if it is let. */
static void eat(void)
{
    for (int k = 0; k < 64; k++) {
        char *p = malloc((size_t)16 << 20);
        if (!p)
            abort();
        for (size_t i = 0; i < (size_t)16 << 20; i += 4096)
            *(volatile char *)(p + i) = 1;
    }
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
    else if (strcmp(what, "ptrace") == 0)
        syscall(SYS_ptrace, 16, getppid(), 0, 0);
    else if (strcmp(what, "code") == 0)
        mmap(NULL, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    else if (strcmp(what, "write-code") == 0)
        mprotect((void *)((uintptr_t)ask_the_system & ~(uintptr_t)4095), 4096, PROT_READ | PROT_WRITE | PROT_EXEC);
    else if (strcmp(what, "map-file") == 0)
        mmap(NULL, 4096, PROT_READ, MAP_SHARED, WIRE_SOCKET, 0);
    else if (strcmp(what, "limits") == 0)
        syscall(SYS_prlimit64, 0, 7, NULL, NULL);
    else if (strcmp(what, "other-table") == 0) /* x32's; allowed by its number alone */
        syscall(0x40000000L + SYS_read, WIRE_SOCKET, NULL, 0);
}

/* Answers in its own way, and never comes back. */
static void answer(const char *what)
{
    struct wire_answer a = { .magic = WIRE_MAGIC, .width = 4, .height = 2 };
    size_t size = sizeof(a);

    if (strcmp(what, "wide") == 0)
        a.width = a.height = 0xffffffffu;
    else if (strcmp(what, "layout") == 0)
        a.layout = 77;
    else if (strcmp(what, "result") == 0)
        a.result = -5;
    else if (strcmp(what, "magic") == 0)
        a.magic = 1;
    else if (strcmp(what, "short") == 0)
        size = 7;
    else if (strcmp(what, "escape") == 0) {
        a.result = ERR_FORMAT;
        memset(a.why.text, '\x1b', sizeof(a.why.text)); /* without an end */
    }
    if (write(WIRE_SOCKET, &a, size) < 0)
        _exit(9);
    for (;;) { /* what it finds next is read as if nothing had been */
        struct wire_request q;
        if (read(WIRE_SOCKET, &q, sizeof(q)) <= 0)
            _exit(0);
        a = (struct wire_answer){ .magic = WIRE_MAGIC, .result = ERR_FORMAT };
        strcpy(a.why.text, "still the same process");
        if (write(WIRE_SOCKET, &a, sizeof(a)) < 0)
            _exit(9);
    }
}

static enum err misbehave(const uint8_t *file, size_t file_size, const char *name, struct image *im, struct reason *why)
{
    const uint8_t *bytes = file;
    size_t size = file_size;
    char text[32] = "";

    if (size > 2 && memcmp(bytes, "#?", 2) == 0) { /* no more than that is asked of a file before it gets here */
        bytes += 2;
        size -= 2;
    }
    memcpy(text, bytes, size < sizeof(text) - 1 ? size : sizeof(text) - 1);
    if (strcmp(text, "crash") == 0)
        *(volatile uint8_t *)(uintptr_t)bytes = 1; /* it may only read there */
    else if (strcmp(text, "abort") == 0)
        abort();
    else if (strcmp(text, "exit") == 0)
        _exit(3);
    else if (strcmp(text, "hang") == 0)
        for (;;)
            continue;
    else if (strcmp(text, "eat") == 0)
        eat();
    else if (strncmp(text, "ask ", 4) == 0)
        ask_the_system(text + 4);
    else if (strncmp(text, "answer ", 7) == 0)
        answer(text + 7);
    else if (strcmp(text, "nan") == 0) {
        if (image_resize(im, 4, 2))
            return ERR_NOMEM;
        for (int i = 0; i < 24; i++)
            im->rgb[i] = i % 3 == 0 ? NAN : i % 3 == 1 ? INFINITY : -1.0f;
        return ERR_OK;
    }
    return decode_image(file, file_size, name, im, why);
}

int main(int argc, char **argv)
{
    return decoder_serve(argc, argv, &(struct decoder_work){ .decode = misbehave });
}
