#include "import/sandbox/helper_process.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

int helper_refuse(int argc, char **argv, const char *purpose)
{
    fprintf(stderr, "other relightd programs start this one to %s; it cannot be used alone.\n", purpose);
    return argc >= 2 && strcmp(argv[1], "--help") == 0 ? 0 : 2;
}

bool helper_receive(void *message, size_t size)
{
    uint32_t magic;
    ssize_t got;

    do
        got = read(WIRE_SOCKET, message, size);
    while (got < 0 && errno == EINTR);
    memcpy(&magic, message, sizeof(magic));
    return got == (ssize_t)size && magic == WIRE_MAGIC;
}

bool helper_send(const void *message, size_t size)
{
    return write(WIRE_SOCKET, message, size) == (ssize_t)size;
}

bool helper_hello(int unconfined)
{
    const struct wire_hello hello = { WIRE_MAGIC, unconfined };

    return helper_send(&hello, sizeof(hello));
}
