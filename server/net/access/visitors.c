#include "net/access/visitors.h"

#include "base/mem.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <string.h>

static const uint8_t mapped[12] = { [10] = 0xff, [11] = 0xff }; /* ::ffff:0:0/96 holds IPv4 [RFC 4291, 2.5.5.2] */

bool visitors_init(struct visitors *g, uint32_t connections)
{
    g->count = connections + VISITORS_REMEMBERED;
    g->named_guesses = VISITORS_NAMED_GUESSES;
    g->named_us = 0;
    g->rows = mem_alloc(g->count, sizeof(*g->rows));
    return g->rows != NULL;
}

void visitors_finish(struct visitors *g)
{
    mem_free(g->rows);
    *g = (struct visitors){ 0 };
}

/* False: neither IPv4 nor IPv6. */
static bool take_address(const struct sockaddr *address, uint8_t out[16], bool *loopback)
{
    memcpy(out, mapped, sizeof(mapped));
    if (address->sa_family == AF_INET) {
        memcpy(out + 12, &((const struct sockaddr_in *)(const void *)address)->sin_addr, 4);
    } else if (address->sa_family == AF_INET6) {
        memcpy(out, &((const struct sockaddr_in6 *)(const void *)address)->sin6_addr, 16);
    } else {
        return false;
    }
    const bool four = memcmp(out, mapped, sizeof(mapped)) == 0;
    *loopback = four ? out[12] == 127 : memcmp(out, &in6addr_loopback, 16) == 0;
    if (!four)
        memset(out + 8, 0, 8);
    return true;
}

static void fill(double *bucket, int64_t *at_us, double rate, double most, int64_t now_us)
{
    *bucket += (double)(now_us - *at_us) * 1e-6 * rate;
    *at_us = now_us;
    if (*bucket > most)
        *bucket = most;
}

static void refill(struct visitors *g, struct visitor *v, int64_t now_us)
{
    fill(&v->guesses, &v->guesses_us, VISITORS_GUESSES_A_S, VISITORS_GUESSES, now_us);
    fill(&g->named_guesses, &g->named_us, VISITORS_NAMED_GUESSES_A_S, VISITORS_NAMED_GUESSES, now_us);
}

struct visitor *visitors_find(struct visitors *g, const struct sockaddr *address, int64_t now_us)
{
    struct visitor *take = NULL;
    uint8_t wanted[16];
    bool loopback;

    if (!take_address(address, wanted, &loopback))
        return NULL;
    for (uint32_t i = 0; i < g->count; i++) {
        struct visitor *v = &g->rows[i];
        if (v->used && memcmp(v->address, wanted, sizeof(wanted)) == 0)
            return v;
        /* A free row, or else the one whose last guess is oldest. */
        if (!take || (take->used && (!v->used || v->guesses_us < take->guesses_us)))
            take = v->connections == 0 ? v : take;
    }
    if (!take)
        return NULL;
    *take = (struct visitor){ .used = true, .loopback = loopback, .guesses = VISITORS_GUESSES, .guesses_us = now_us };
    memcpy(take->address, wanted, sizeof(wanted));
    return take;
}

struct visitor *visitors_forwarded(struct visitors *g, const char *header, int64_t now_us, char *out, size_t size)
{
    struct sockaddr_in four = { .sin_family = AF_INET };
    struct sockaddr_in6 six = { .sin6_family = AF_INET6 };
    const char *last = strrchr(header, ',');

    last = last ? last + 1 : header;
    last += strspn(last, " \t");
    const size_t length = strcspn(last, " \t");
    if (length >= size || last[length + strspn(last + length, " \t")])
        return NULL;
    memcpy(out, last, length);
    out[length] = 0;
    struct visitor *v = NULL;
    if (inet_pton(AF_INET, out, &four.sin_addr) == 1)
        v = visitors_find(g, (const struct sockaddr *)&four, now_us);
    else if (inet_pton(AF_INET6, out, &six.sin6_addr) == 1)
        v = visitors_find(g, (const struct sockaddr *)&six, now_us);
    if (v)
        v->named = true;
    return v;
}

char *visitor_name(const struct visitor *v, char out[VISITOR_NAME])
{
    const bool four = memcmp(v->address, mapped, sizeof(mapped)) == 0;

    if (!inet_ntop(four ? AF_INET : AF_INET6, four ? v->address + 12 : v->address, out, VISITOR_NAME))
        out[0] = 0;
    return out;
}

bool visitor_may_guess(struct visitors *g, struct visitor *v, int64_t now_us)
{
    refill(g, v, now_us);
    return v->guesses >= 1.0 && (!v->named || v->known || g->named_guesses >= 1.0);
}

void visitor_guessed_wrong(struct visitors *g, struct visitor *v, int64_t now_us)
{
    refill(g, v, now_us);
    v->guesses = v->guesses >= 1.0 ? v->guesses - 1.0 : 0.0;
    if (v->named)
        g->named_guesses = g->named_guesses >= 1.0 ? g->named_guesses - 1.0 : 0.0;
}
