#include "base/precedence.h"

#include "base/clock.h"

#include <time.h>

void precedence_init(struct precedence *p, double credit_s)
{
    atomic_init(&p->until_s, 0.0);
    p->ended_s = clock_seconds() - credit_s;
}

void precedence_begin(struct precedence *p)
{
    const double now_s = clock_seconds();

    if (p)
        atomic_store(&p->until_s, now_s + (now_s - p->ended_s));
}

void precedence_end(struct precedence *p)
{
    if (!p)
        return;
    p->ended_s = clock_seconds();
    atomic_store(&p->until_s, 0.0);
}

void precedence_give_way(const struct precedence *p)
{
    while (p && clock_seconds() < atomic_load_explicit(&p->until_s, memory_order_relaxed))
        nanosleep(&(struct timespec){ .tv_nsec = 500000 }, NULL);
}
