#include "base/process.h"

#include <errno.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

/* A path, or with a leading '@' a Linux abstract socket name. Other kinds of address are not supported. */
static bool address_of(const char *name, struct sockaddr_un *address, socklen_t *size)
{
    const size_t length = name ? strlen(name) : 0;

    if (length < 2 || length >= sizeof(address->sun_path) || (name[0] != '/' && name[0] != '@'))
        return false;
    *address = (struct sockaddr_un){ .sun_family = AF_UNIX };
    memcpy(address->sun_path, name, length);
    if (name[0] == '@')
        address->sun_path[0] = '\0';
    *size = (socklen_t)(offsetof(struct sockaddr_un, sun_path) + length +
                        (name[0] == '/')); /* an abstract name is not NUL-terminated */
    return true;
}

bool notify_enabled(void)
{
    struct sockaddr_un address;
    socklen_t size;

    return address_of(getenv("NOTIFY_SOCKET"), &address, &size);
}

bool notify_send(const char *format, ...)
{
    struct sockaddr_un address;
    socklen_t size;
    char text[1024];
    va_list args;

    if (!address_of(getenv("NOTIFY_SOCKET"), &address, &size))
        return false;
    va_start(args, format);
    const int length = vsnprintf(text, sizeof(text), format, args);
    va_end(args);
    if (length < 0 || length >= (int)sizeof(text))
        return false;
    const int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return false;
    const ssize_t sent =
        sendto(fd, text, (size_t)length, MSG_NOSIGNAL | MSG_DONTWAIT, (struct sockaddr *)&address, size);
    close(fd);
    return sent == length;
}

uint64_t notify_watchdog_us(void)
{
    const char *us = getenv("WATCHDOG_USEC"), *pid = getenv("WATCHDOG_PID");
    char *end;

    if (!us || !notify_enabled())
        return 0;
    if (pid && strtoll(pid, NULL, 10) != (long long)getpid()) /* inherited from a parent, meant for another process */
        return 0;
    errno = 0;
    const unsigned long long v = strtoull(us, &end, 10);
    return errno || end == us || *end || us[0] == '-' ? 0 : v;
}
