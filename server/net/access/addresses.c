#include "net/access/site.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <netinet/in.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>

bool address_is_loopback(const char *text)
{
    return strcasecmp(text, "localhost") == 0 || strcmp(text, "::1") == 0 ||
           (strncmp(text, "127.", 4) == 0 && text[strspn(text, "0123456789.")] == 0);
}

static const char *text_of(const struct sockaddr *a, char *out)
{
    const struct sockaddr_in *four = (const struct sockaddr_in *)(const void *)a;
    const struct sockaddr_in6 *six = (const struct sockaddr_in6 *)(const void *)a;

    if (a->sa_family == AF_INET && ntohl(four->sin_addr.s_addr) >> 24 != 127 &&
        ntohl(four->sin_addr.s_addr) >> 16 != 0xa9fe) /* 169.254.0.0/16 is link-local */
        return inet_ntop(AF_INET, &four->sin_addr, out, ADDRESS_TEXT);
    if (a->sa_family == AF_INET6 && !IN6_IS_ADDR_LINKLOCAL(&six->sin6_addr) && !IN6_IS_ADDR_LOOPBACK(&six->sin6_addr))
        return inet_ntop(AF_INET6, &six->sin6_addr, out, ADDRESS_TEXT);
    return NULL;
}

size_t addresses_of_machine(char out[ADDRESSES_MAX][ADDRESS_TEXT])
{
    static const int families[] = { AF_INET, AF_INET6 };
    struct ifaddrs *all = NULL;
    size_t count = 0;

    if (getifaddrs(&all) != 0)
        return 0;
    for (int k = 0; k < 2; k++)
        for (const struct ifaddrs *i = all; i; i = i->ifa_next)
            if (count < ADDRESSES_MAX && i->ifa_addr && i->ifa_addr->sa_family == families[k] &&
                text_of(i->ifa_addr, out[count]))
                count++;
    freeifaddrs(all);
    return count;
}
