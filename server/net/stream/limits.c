#include "net/stream/limits.h"

#include "base/log.h"
#include "net/stream/internal.h"

#define LOG_EVERY_US ((int64_t)60 * 1000000)

static const struct {
    const char *name, *text;
} limits[LIMITS] = {
    [LIMIT_ARRIVALS] = { "arrivals", "closed connections without hello to make room for newcomers" },
    [LIMIT_CLIENTS] = { "clients", "refused or closed clients, since all connections are taken (--max-connections)" },
    [LIMIT_ADDRESS] = { "address", "refused connections of an address that has its share (--max-per-address)" },
    [LIMIT_NAMES] = { "names", "refused or took back names of lockstep sequences, since all are in use" },
    [LIMIT_GUESSES] = { "guesses", "ignored tokens after too many wrong ones" },
};

const char *limit_name(enum limit limit)
{
    return limits[limit].name;
}

void limit_reached(struct server *s, enum limit limit, const struct visitor *v)
{
    struct limit_count *c = &s->limits[limit];

    c->reached++;
    c->address[0] = '\0';
    if (v)
        visitor_name(v, c->address);
}

void limits_tick(struct server *s, int64_t now_us)
{
    for (int k = 0; k < LIMITS; k++) {
        struct limit_count *c = &s->limits[k];

        if (c->reached == c->logged || (c->logged_us > 0 && now_us - c->logged_us < LOG_EVERY_US))
            continue;
        log_warning("%s: %llu times, last because of %s", limits[k].text, (unsigned long long)(c->reached - c->logged),
                    c->address[0] ? c->address : "an unknown address");
        c->logged = c->reached;
        c->logged_us = now_us;
    }
}
