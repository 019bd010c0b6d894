/* Lets the ranks of a job compute a cache of light transport together: implements the functions of
 * light/cache/cache_share.h with ranks/. Thread: the relighter's. */
#pragma once

#include "job/ranks/ranks.h"
#include "light/cache/cache_share.h"

/* This rank's share, of all packets; ranks must outlive it. Every rank calls relighter_prepare at the same time, as
 * there is no `begin`. Errors of agree and pass are ERR_IO if a rank does not answer. */
struct cache_share team_share(struct ranks *ranks);
