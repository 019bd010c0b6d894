#include "light/audit/audit.h"

#include <math.h>
#include <string.h>

#define LEAST 15000.0    /* rays that an audit is worth: live images that cost little pay for one together */
#define ALWAYS 500000.0  /* for an image that is not live */
#define SETTLED 200000.0 /* for the first live one by a finished cache */
#define EACH 4000.0      /* each live image pays, two milliseconds of a processor, */
#define MOST 200000.0    /* and so much is saved up */
#define RAY_S 1e-6       /* processor time of a ray, before any was timed */
#define NEARLY 0.1       /* of a sky's light may move between two images that have anything to tell of each other */

uint64_t purse_pay(struct purse *p, bool live, bool settled, double rays)
{
    if (!live)
        return (uint64_t)(ALWAYS + rays);
    p->rays = fmin(p->rays + fmax(rays, EACH), fmax(MOST, rays));
    if (settled && !p->settled)
        p->rays = SETTLED;
    p->settled = settled;
    return p->rays >= LEAST ? (uint64_t)p->rays : 0;
}

uint64_t purse_limit(struct purse *p, double most, double used_s, uint64_t rays)
{
    if (!(p->begun_s > 0.0))
        p->begun_s = used_s;
    const double ray_s = p->traced > 0.0 ? p->spent_s / p->traced : RAY_S;
    const double left = fmin((most * (used_s - p->begun_s) - p->spent_s) / ray_s, (double)rays);
    return left >= LEAST ? (uint64_t)left : 0;
}

void purse_spend(struct purse *p, bool live, uint64_t rays, double seconds)
{
    p->rays -= live ? (double)rays : 0.0;
    p->traced += (double)rays;
    p->spent_s += seconds;
}

double purse_like_last(struct purse *p, const struct environment *e, uint64_t way)
{
    double moved = 0.0;

    for (int f = 0; f < CUBE_FACES; f++)
        moved += fabs(e->energy[f] - p->energy[f]);
    moved /= e->total_energy;
    const bool like = p->way == way && moved <= NEARLY;
    memcpy(p->energy, e->energy, sizeof(p->energy));
    p->way = way;
    return like ? 1.0 - 2.0 * moved : 0.0;
}
