/* server/film/pilot_edges.c: smooth edges, or time for everything else.
 *
 * Most shade points may stand in the few pixels on edges of geometry. With one point for each of these (gbuffer_thin) a
 * sample for every point takes a half of the time, or a third, and the edges are jagged: an error that no time takes
 * away. What it would be is read beside the noise (pair.edge), what the time would do otherwise says the budget. */
#include "pilot_parts.h"

#include "mem.h"

#include <math.h>

#define WORTH_JAGGED 0.7  /* of the error is what jagged edges must promise: they are seen in any light */
#define WORTH_SMOOTH 0.95 /* and smooth ones, to come back */
#define FRAMES_BEFORE 8   /* under one sky */

bool pilot_edges_init(struct pilot *p)
{
    const struct gbuffer *g = p->set->gbuffer;

    p->gbuffer = g;
    if (!groups_init(&p->groups, g))
        return false;
    p->edge_points = p->groups.edge_points;
    return gbuffer_thin(g, &p->thin) == ERR_OK && groups_init(&p->spare_groups, p->thin);
}

void pilot_edges_finish(struct pilot *p)
{
    groups_finish(&p->groups);
    groups_finish(&p->spare_groups);
    gbuffer_destroy(p->thin);
}

bool pilot_edges_are_jagged(const struct pilot *p)
{
    return p->gbuffer == p->thin;
}

double pilot_edge_error(const struct pilot *p)
{
    double error = 0.0;

    for (int kind = 0; kind < SURFACE_KINDS; kind++)
        if (p->edge[kind].pixels)
            error += fmax(0.0, p->edge[kind].edge / (double)p->edge[kind].pixels);
    return error;
}

/* Points of the thin one over those of all. */
static double share_of_thin(const struct pilot *p)
{
    const uint64_t all = p->set->gbuffer->point_count;
    return all ? (double)p->thin->point_count / (double)all : 1.0;
}

void pilot_edges_take(struct pilot *p, bool jagged)
{
    const double share = share_of_thin(p), times = jagged ? share : 1.0 / share;
    const struct groups groups = p->groups;

    if (pilot_edges_are_jagged(p) == jagged || !(share > 0.0))
        return;
    p->groups = p->spare_groups;
    p->spare_groups = groups;
    p->gbuffer = jagged ? p->thin : p->set->gbuffer;
    for (uint32_t way = 0; way < WAYS; way++) {
        p->seen_on[way] = NULL;
        if (way >= WAY_AIMED)
            continue;
        p->model[way].base_s *= times;
        p->model[way].unit_s *= times;
    }
    for (int part = 0; part <= PILOT_EYE; part++) /* whole numbers, and even ones */
        if (p->choice.way[part] != WAY_NONE)
            p->choice.n[part] = 2.0 * fmax(1.0, floor(0.5 * p->choice.n[part] / times));
}

bool pilot_edges_turn(struct pilot *p, const struct pilot_wish *left)
{
    const bool jagged = pilot_edges_are_jagged(p);
    const double share = share_of_thin(p), edges = pilot_edge_error(p);

    if (jagged && (p->frames == 0 || !(left->seconds > 0.0)))
        return true; /* what edges cost under this sky is not known; without a time there is no haste */
    if (p->frames < FRAMES_BEFORE || !(left->seconds > 0.0) || !(edges > 0.0) || !(share < 1.0) ||
        (left->error > 0.0 && p->budget.met && !jagged))
        return false;
    const double other = pilot_error_at(p, jagged ? left->seconds * share : left->seconds / share);
    return jagged ? other < WORTH_SMOOTH * (p->budget.error + edges) : other + edges < WORTH_JAGGED * p->budget.error;
}
