#include "net/stream/limits.h"

#include "base/log.h"
#include "base/mem.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <string.h>

#define LOG_EVERY_US ((int64_t)60 * 1000000)

static const uint8_t mapped[12] = { [10] = 0xff, [11] = 0xff }; /* ::ffff:0:0/96 holds IPv4 [RFC 4291, 2.5.5.2] */

/* ---- Token buckets ---- */

double bucket_fill(struct bucket *b, double most, double rate, int64_t now_us)
{
    const double left = b->left + (double)(now_us - b->at_us) * 1e-6 * rate;

    b->left = b->at_us == 0 || left > most ? most : left;
    b->at_us = now_us;
    return b->left;
}

bool bucket_take(struct bucket *b, double most, double rate, int64_t now_us)
{
    if (bucket_fill(b, most, rate, now_us) < 1.0)
        return false;
    b->left -= 1.0;
    return true;
}

/* ---- Clients ---- */

bool limits_init(struct limits *l, uint32_t connections)
{
    l->count = connections + CLIENTS_REMEMBERED;
    l->clients = mem_alloc(l->count, sizeof(*l->clients));
    return l->clients != NULL;
}

void limits_finish(struct limits *l)
{
    mem_free(l->clients);
    l->clients = NULL;
    l->count = 0;
}

bool address_take(const struct sockaddr *address, uint8_t out[16])
{
    memcpy(out, mapped, sizeof(mapped));
    if (address->sa_family == AF_INET)
        memcpy(out + 12, &((const struct sockaddr_in *)(const void *)address)->sin_addr, 4);
    else if (address->sa_family == AF_INET6)
        memcpy(out, &((const struct sockaddr_in6 *)(const void *)address)->sin6_addr, 16);
    return address->sa_family == AF_INET || address->sa_family == AF_INET6;
}

bool address_read(const char *text, uint8_t out[16])
{
    memcpy(out, mapped, sizeof(mapped));
    return inet_pton(AF_INET, text, out + 12) == 1 || inet_pton(AF_INET6, text, out) == 1;
}

struct client *client_find(struct limits *l, const uint8_t address[16], int64_t now_us)
{
    const bool four = memcmp(address, mapped, sizeof(mapped)) == 0;
    struct client *take = NULL;
    uint8_t wanted[16] = { 0 };

    memcpy(wanted, address, four ? 16 : 8);
    for (uint32_t i = 0; i < l->count; i++) {
        struct client *c = &l->clients[i];
        if (c->used && memcmp(c->address, wanted, sizeof(wanted)) == 0)
            return c;
        /* A free row, or else the one whose last guess is oldest. */
        if (!take || (take->used && (!c->used || c->guesses.at_us < take->guesses.at_us)))
            take = client_connections(c) == 0 ? c : take;
    }
    if (!take)
        return NULL;
    const bool loopback = four ? address[12] == 127 : memcmp(address, &in6addr_loopback, 16) == 0;
    *take = (struct client){ .used = true, .loopback = loopback, .guesses = { CLIENT_GUESSES, now_us } };
    memcpy(take->address, wanted, sizeof(wanted));
    return take;
}

struct client *client_forwarded(struct limits *l, const char *header, int64_t now_us)
{
    const char *last = strrchr(header, ',');
    char text[INET6_ADDRSTRLEN];
    uint8_t address[16];

    last = last ? last + 1 : header;
    last += strspn(last, " \t");
    const size_t length = strcspn(last, " \t");
    if (length >= sizeof(text) || last[length + strspn(last + length, " \t")])
        return NULL;
    memcpy(text, last, length);
    text[length] = 0;
    struct client *c = address_read(text, address) ? client_find(l, address, now_us) : NULL;
    if (c)
        c->named = true;
    return c;
}

char *client_name(const struct client *c, char out[CLIENT_NAME])
{
    const bool four = memcmp(c->address, mapped, sizeof(mapped)) == 0;

    if (!inet_ntop(four ? AF_INET : AF_INET6, four ? c->address + 12 : c->address, out, CLIENT_NAME))
        out[0] = 0;
    return out;
}

uint32_t client_connections(const struct client *c)
{
    return c->connections[CONNECTION_ARRIVING] + c->connections[CONNECTION_ADMITTED] +
           c->connections[CONNECTION_LEAVING];
}

int client_crowds(const struct client *const holders[], unsigned count, const struct client *by)
{
    unsigned most = 1, mine = 0;
    int out = -1;

    for (unsigned i = 0; i < count; i++)
        mine += holders[i] == by;
    for (unsigned i = 0; i < count; i++) {
        unsigned has = 0;
        for (unsigned k = 0; k < count && holders[i]; k++)
            has += holders[k] == holders[i];
        if (has >= mine + 2 && has >= most) {
            most = has;
            out = (int)i;
        }
    }
    return out;
}

bool client_may_guess(struct limits *l, struct client *c, int64_t now_us)
{
    const enum guess_group group = c->named ? GROUP_NAMED : GROUP_LOCAL;

    if (bucket_fill(&c->guesses, CLIENT_GUESSES, CLIENT_GUESSES_A_S, now_us) < 1.0)
        return false;
    if (c->known || !(c->named || c->loopback) ||
        bucket_fill(&l->guesses[group].all, GROUP_GUESSES, GROUP_GUESSES_A_S, now_us) >= 1.0)
        return true;
    return !c->guessed && bucket_fill(&l->guesses[group].first, FIRST_GUESSES, FIRST_GUESSES_A_S, now_us) >= 1.0;
}

void client_guessed_wrong(struct limits *l, struct client *c, int64_t now_us)
{
    const enum guess_group group = c->named ? GROUP_NAMED : GROUP_LOCAL;

    bucket_take(&c->guesses, CLIENT_GUESSES, CLIENT_GUESSES_A_S, now_us);
    if (!c->known && (c->named || c->loopback) &&
        !bucket_take(&l->guesses[group].all, GROUP_GUESSES, GROUP_GUESSES_A_S, now_us))
        bucket_take(&l->guesses[group].first, FIRST_GUESSES, FIRST_GUESSES_A_S, now_us);
    c->guessed = true;
}

/* ---- Reports ---- */

static const struct {
    const char *name, *text;
} limits[LIMITS] = {
    [LIMIT_ARRIVALS] = { "arrivals", "closed connections without hello to make room for newcomers" },
    [LIMIT_CLIENTS] = { "clients", "refused or closed clients, since all connections are taken (--max-connections)" },
    [LIMIT_ADDRESS] = { "address", "refused connections of an address that has its share (--max-per-address)" },
    [LIMIT_NAMES] = { "names", "refused or took back names of lockstep sequences, since all are in use" },
    [LIMIT_GUESSES] = { "guesses", "ignored tokens after too many wrong ones" },
    [LIMIT_MEMORY] = { "memory", "cut slow clients, since what all of them had not read took too much memory" },
    [LIMIT_WIDTHS] = { "widths", "refused or ended requests for a width of their own, since all are taken" },
    [LIMIT_PIXELS] = { "pixels", "refused or dropped questions about pixels, since too many wait or are followed" },
};

const char *limit_name(enum limit limit)
{
    return limits[limit].name;
}

void limit_reached(struct limits *l, enum limit limit, const struct client *c)
{
    struct limit_count *count = &l->reached[limit];

    atomic_fetch_add(&count->reached, 1);
    count->address[0] = '\0';
    if (c)
        client_name(c, count->address);
}

void limits_tick(struct limits *l, int64_t now_us)
{
    for (int k = 0; k < LIMITS; k++) {
        struct limit_count *c = &l->reached[k];
        const uint64_t reached = atomic_load(&c->reached);

        if (reached == c->logged || (c->logged_us > 0 && now_us - c->logged_us < LOG_EVERY_US))
            continue;
        log_warning("%s: %llu times, last because of %s", limits[k].text, (unsigned long long)(reached - c->logged),
                    c->address[0] ? c->address : "an unknown address");
        c->logged = reached;
        c->logged_us = now_us;
    }
}
