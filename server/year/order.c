/* Writes rows in chronological order, whichever rank of a job has lit the moments, because measures are sums, and
 * because --resume continues after the first rows. */
#include "year/annual.h"

#include "base/mem.h"

#include <string.h>

/* As ranks send it. */
struct lit_moment {
    uint64_t index;
    struct ledger_row row;
    float lux[]; /* of the sensors, and after these by the sun alone */
};

static size_t bytes_of(const struct annual *a)
{
    return sizeof(struct lit_moment) + 2 * a->points.count * sizeof(float);
}

enum err annual_order_begin(struct annual *a, struct reason *why)
{
    a->next = a->resumed;
    a->lit = mem_alloc(a->weather->count + 1, sizeof(struct lit_moment *));
    return a->lit ? ERR_OK : err_say(why, ERR_NOMEM, "out of memory");
}

/* Writes all rows whose turn it is. */
static enum err write_rows(struct annual *a, struct reason *why)
{
    enum err e = ERR_OK;

    for (; !e && a->next < a->weather->count && a->lit[a->next]; a->next++) {
        struct lit_moment *l = a->lit[a->next];
        annual_count(a, daylight_moment(a->weather, a->next), l->lux, l->lux + a->points.count);
        e = ledger_add(&a->ledger, &l->row, l->lux, why);
        mem_free(l);
        a->lit[a->next] = NULL;
    }
    return e;
}

struct taking {
    struct annual *a;
    struct reason *why;
};

static enum err take(void *context, const void *bytes, size_t size)
{
    const struct taking *t = context;
    struct lit_moment *l = mem_alloc_raw(size, 1);

    if (!l)
        return err_say(t->why, ERR_NOMEM, "out of memory");
    memcpy(l, bytes, size);
    t->a->lit[l->index] = l;
    const enum err e = write_rows(t->a, t->why);
    if (e)
        ranks_stop(t->a->desc.ranks);
    return e;
}

enum err annual_order_add(struct annual *a, size_t i, const struct ledger_row *row, struct reason *why)
{
    struct taking t = { a, why };
    struct lit_moment *l = mem_alloc_raw(bytes_of(a), 1);

    if (!l)
        return err_say(why, ERR_NOMEM, "out of memory");
    l->index = i;
    l->row = *row;
    memcpy(l->lux, a->lux, a->points.count * sizeof(float));
    memcpy(l->lux + a->points.count, a->sun_lux, a->points.count * sizeof(float));
    if (ranks_index(a->desc.ranks) > 0) {
        const enum err e = ranks_post(a->desc.ranks, l, bytes_of(a));
        mem_free(l);
        return e ? err_say(why, e, "no memory for the sensors' light on its way to rank 0") : ERR_OK;
    }
    a->lit[i] = l;
    const enum err e = write_rows(a, why);
    return e || !a->desc.ranks ? e : ranks_collect(a->desc.ranks, false, take, &t);
}

enum err annual_order_end(struct annual *a, enum err own, struct reason *why)
{
    struct taking t = { a, why };
    struct ranks *ranks = a->desc.ranks;

    if (!ranks)
        return own;
    if (own)
        ranks_stop(ranks);
    if (ranks_index(ranks) > 0) {
        const enum err e = ranks_post(ranks, NULL, 0);
        return own || !e ? own : err_say(why, e, "out of memory");
    }
    const enum err e = ranks_collect(ranks, true, own ? NULL : take, &t);
    return own ? own : e;
}

void annual_order_finish(struct annual *a)
{
    for (size_t i = 0; a->lit && i < a->weather->count; i++)
        mem_free(a->lit[i]);
    mem_free(a->lit);
}
