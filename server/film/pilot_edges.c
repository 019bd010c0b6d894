/* server/film/pilot_edges.c: smooth edges, or time for everything else.
 *
 * Most shade points may stand in the few pixels on edges of geometry. With one point for each of these (gbuffer_thin) a
 * sample for every point takes a half of the time, or a third, and the edges are jagged: an error that no time takes
 * away. What it would be is read beside the noise (pair.edge), what the time would do otherwise says the budget. */
#include "pilot_parts.h"

#include "mem.h"

#include <math.h>

#define WORTH_JAGGED 0.5  /* of the error is what jagged edges must promise: they are seen in any light */
#define WORTH_SMOOTH 0.95 /* and smooth ones, to come back */
#define FRAMES_BEFORE 16  /* under one sky */

static bool allot(struct allotment *a, const struct groups *s)
{
    bool all = true;

    for (int kind = 0; kind < SURFACE_KINDS; kind++)
        all = allot_init(&a[kind], s->gbuffer, &s->all.list[kind]) && all;
    return allot_init(&a[PILOT_EYE], s->gbuffer, &s->all.both) && all;
}

/* A pixel's heaviest entry. */
static uint32_t heaviest(const struct gbuffer *g, size_t pixel)
{
    uint32_t best = g->entry_first[pixel];
    float most = -1.0f;

    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const float *w = g->entries[k].weight;
        if (w[0] + w[1] + w[2] > most) {
            most = w[0] + w[1] + w[2];
            best = k;
        }
    }
    return best;
}

/* How many of each packet's points the thin one keeps. */
static bool count_kept(struct pilot *p)
{
    const struct gbuffer *g = p->set->gbuffer;
    const size_t pixels = (size_t)g->width * g->height;

    p->kept = mem_alloc(g->packet_count, 1);
    for (size_t i = 0; i < pixels && p->kept; i++)
        if (g->entry_first[i + 1] > g->entry_first[i])
            p->kept[g->entries[heaviest(g, i)].point / PACKET]++;
    return p->kept;
}

bool pilot_edges_init(struct pilot *p)
{
    const struct gbuffer *g = p->set->gbuffer;

    p->gbuffer = g;
    if (!groups_init(&p->groups, g))
        return false;
    p->edge_points = p->groups.edge_points;
    if (!allot(p->allot, &p->groups) || gbuffer_thin(g, &p->thin) != ERR_OK ||
        !groups_init(&p->spare_groups, p->thin) || !allot(p->spare_allot, &p->spare_groups))
        return false;
    return count_kept(p);
}

void pilot_edges_finish(struct pilot *p)
{
    for (int part = 0; part <= PILOT_EYE; part++) {
        allot_finish(&p->allot[part]);
        allot_finish(&p->spare_allot[part]);
    }
    groups_finish(&p->groups);
    groups_finish(&p->spare_groups);
    gbuffer_destroy(p->thin);
    mem_free(p->kept);
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

/* Samples for one point a pixel over those for all, as all have them. */
static double share_of_thin(const struct pilot *p)
{
    const struct gbuffer *g = p->set->gbuffer;
    const struct allotment *allot = pilot_edges_are_jagged(p) ? p->spare_allot : p->allot;
    double all = 0.0, kept = 0.0;

    for (int kind = 0; kind < SURFACE_KINDS; kind++) {
        const struct packet_list *list = &allot[kind].list;
        const uint32_t way = p->choice.way[kind];
        if (way == WAY_NONE || list->count == 0)
            continue;
        const struct allot_wish wish = pilot_deal(way, p->choice.n[kind]);
        const double factor = allot_factor(&allot[kind], &wish);
        for (uint32_t k = 0; k < list->count; k++) {
            const uint32_t i = list->index[k];
            const double n = allot_real(&allot[kind], &wish, factor, i);
            all += n * g->packets[i].count;
            kept += n * p->kept[i];
        }
    }
    return all > 0.0 ? kept / all : 1.0;
}

void pilot_edges_take(struct pilot *p, bool jagged)
{
    const struct groups groups = p->groups;
    const uint64_t all = p->set->gbuffer->point_count;

    if (pilot_edges_are_jagged(p) == jagged || all == 0)
        return;
    /* A count is a mean over the points, and edges have had fewer than the others: with the same mean, these now have
     * less. */
    const double points = (double)p->thin->point_count / (double)all, fewer = share_of_thin(p) / points;
    const double times = jagged ? points : 1.0 / points;
    p->groups = p->spare_groups;
    p->spare_groups = groups;
    for (int part = 0; part <= PILOT_EYE; part++) {
        const struct allotment other = p->allot[part];
        p->allot[part] = p->spare_allot[part];
        p->spare_allot[part] = other;
    }
    p->gbuffer = jagged ? p->thin : p->set->gbuffer;
    for (uint32_t way = 0; way < WAYS; way++) {
        p->seen_on[way] = NULL;
        if (way >= WAY_AIMED)
            continue;
        p->model[way].base_s *= times;
        p->model[way].unit_s *= times;
        model_ease(&p->model[way], jagged ? fewer : 1.0 / fewer);
    }
    for (int part = 0; part <= PILOT_EYE; part++)
        if (p->choice.way[part] != WAY_NONE)
            p->choice.n[part] = fmax(2.0, p->choice.n[part] / times);
}

bool pilot_edges_turn(struct pilot *p, const struct pilot_wish *left)
{
    const bool jagged = pilot_edges_are_jagged(p);
    const double edges = pilot_edge_error(p);

    if (jagged && (p->frames == 0 || !(left->seconds > 0.0)))
        return true; /* what edges cost under this sky is not known; without a time there is no haste */
    if (p->frames < FRAMES_BEFORE || !(left->seconds > 0.0) || !(edges > 0.0) ||
        (left->error > 0.0 && p->budget.met && !jagged))
        return false;
    const double share = share_of_thin(p);
    if (!(share < 1.0))
        return false;
    const double other = pilot_error_at(p, jagged ? left->seconds * share : left->seconds / share);
    return jagged ? other < WORTH_SMOOTH * (p->budget.error + edges) : other + edges < WORTH_JAGGED * p->budget.error;
}
