#include "clients/common/message.h"

void offset_add(struct offset *o, int64_t sent_us, int64_t received_us, int64_t server_us)
{
    const int64_t trip_us = received_us - sent_us;

    if (trip_us < 0)
        return;
    o->trips[o->count % OFFSET_TRIPS] = (struct offset_trip){ server_us - (sent_us + trip_us / 2), trip_us };
    o->count++;
}

bool offset_get(const struct offset *o, int64_t *ahead_us, int64_t *uncertain_us)
{
    const size_t kept = o->count < OFFSET_TRIPS ? o->count : OFFSET_TRIPS;
    size_t best = 0;

    if (kept == 0)
        return false;
    for (size_t i = 1; i < kept; i++)
        if (o->trips[i].trip_us < o->trips[best].trip_us)
            best = i;
    *ahead_us = o->trips[best].ahead_us;
    *uncertain_us = (o->trips[best].trip_us + 1) / 2;
    return true;
}
