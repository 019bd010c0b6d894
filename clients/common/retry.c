#include "clients/common/connection.h"

#include <stddef.h>

struct retry_rule retry_after_close(int code)
{
    static const struct {
        int code;
        struct retry_rule rule;
    } table[] = {
        { 1000, { RETRY_AGAIN, false, "done" } },
        { 1001, { RETRY_AGAIN, false, "the server is shutting down" } },
        { 1002, { RETRY_NEVER, false, "malformed WebSocket frames" } },
        { 1006, { RETRY_AGAIN, false, "the connection broke" } },
        { 1007, { RETRY_NEVER, false, "text that is not UTF-8" } },
        { 1009, { RETRY_NEVER, false, "too_big" } },
        { 4001, { RETRY_NEVER, false, "bad_json" } },
        { 4002, { RETRY_NEVER, false, "bad_field" } },
        { 4003, { RETRY_NEVER, false, "bad_order" } },
        { 4004, { RETRY_NEVER, true, "wrong_role" } },
        { 4005, { RETRY_NEVER, true, "bad_version" } },
        { 4006, { RETRY_NEVER, true, "bad_token" } },
        { 4007, { RETRY_LATER, true, "full" } },
        { 4008, { RETRY_AGAIN, false, "no_hello" } },
        { 4009, { RETRY_AGAIN, false, "stalled" } },
        { 4010, { RETRY_LATER, false, "too_fast" } },
        { 4011, { RETRY_NEVER, true, "superseded" } },
        { 4012, { RETRY_LATER, true, "busy" } },
        { 4013, { RETRY_AGAIN, false, "too_slow" } },
        { 4014, { RETRY_NEVER, false, "no_credit" } },
    };

    for (size_t i = 0; i < sizeof(table) / sizeof(table[0]); i++)
        if (table[i].code == code)
            return table[i].rule;
    return (struct retry_rule){ RETRY_LATER, false, "an unknown close code" };
}

struct retry_rule retry_after_status(int status)
{
    if (status == 0)
        return (struct retry_rule){ RETRY_AGAIN, false, "no answer" };
    if (status == 408 || status == 429 || status >= 500) /* a proxy whose server is away, or that is overrun */
        return (struct retry_rule){ RETRY_AGAIN, false, "not now" };
    return (struct retry_rule){ RETRY_NEVER, true, "this address does not speak relight.v1" };
}

int retry_wait_ms(unsigned tries, enum retry_when when, struct rng *rng)
{
    int ms = RETRY_FIRST_MS;

    while (tries-- > 0 && ms < RETRY_MOST_MS)
        ms *= 2;
    if (ms > RETRY_MOST_MS)
        ms = RETRY_MOST_MS;
    const double jitter = RETRY_JITTER * (2.0 * rng_next(rng) - 1.0);
    if (when == RETRY_LATER) /* never before */
        return (int)(RETRY_MOST_MS * (1.0 + (jitter < 0.0 ? -jitter : jitter)));
    ms = (int)(ms * (1.0 + jitter));
    return ms < RETRY_MOST_MS ? ms : RETRY_MOST_MS;
}
