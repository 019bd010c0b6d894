#include "server.h"

#include "internal.h"

#include <time.h>

bool server_take_frame(struct server *s, struct frame *f, struct server_ticket *ticket, int timeout_ms)
{
    (void)s;
    (void)f;
    *ticket = (struct server_ticket){ 0 };
    nanosleep(&(struct timespec){ timeout_ms / 1000, timeout_ms % 1000 * 1000000L }, NULL);
    return false;
}

void server_frame_fate(struct server *s, const struct server_ticket *ticket, enum server_fate fate, const char *why)
{
    (void)s;
    (void)ticket;
    (void)fate;
    (void)why;
}

void server_publish_for(struct server *s, struct picture *picture, const struct server_ticket *ticket)
{
    (void)ticket;
    server_publish(s, picture);
}

bool server_take_control(struct server *s, struct server_control *out)
{
    (void)s;
    (void)out;
    return false;
}

void server_set_control(struct server *s, const struct server_control *now, const struct server_control *answered,
                        const char *error)
{
    (void)s;
    (void)now;
    (void)answered;
    (void)error;
}
