/* --collect: the other ranks send their images to rank 0, which writes them, for hosts without a shared folder. */
#include "programs/render/render.h"

#include "base/mem.h"
#include "base/sort.h"

#include <stdlib.h>
#include <string.h>

static size_t values_of(const struct render *r)
{
    return (size_t)r->desc.setup.set_desc.width * r->desc.setup.set_desc.height;
}

bool render_collects(const struct render *r)
{
    return render_deals(r) && r->desc.collect;
}

/* Which images rank 0 has, for --resume. */
enum err render_collect_begin(struct render *r, struct reason *why)
{
    const bool first = ranks_index(r->desc.ranks) == 0;
    uint64_t count = 0;
    enum err e = ERR_OK;

    if (!render_collects(r))
        return ERR_OK;
    if (first && r->desc.resume && r->output)
        e = output_numbers(r->output, &r->existing, &r->existing_count);
    e = ranks_agree(r->desc.ranks, e ? err_say(why, e, "out of memory for the list of existing images") : e, why);
    count = r->existing_count;
    if (!e)
        e = ranks_broadcast(r->desc.ranks, &count, sizeof(count));
    if (!e && !first) {
        r->existing = mem_alloc(count, sizeof(*r->existing));
        r->existing_count = count;
        if (!r->existing)
            ranks_abort(r->desc.ranks, "out of memory for the list of existing images");
    }
    if (!e && count > 0)
        e = ranks_broadcast(r->desc.ranks, r->existing, count * sizeof(*r->existing));
    return e ? err_say(why, e, "rank 0 no longer answers") : ERR_OK;
}

bool render_collect_has(const struct render *r, uint64_t number)
{
    return r->existing_count > 0 &&
           bsearch(&number, r->existing, r->existing_count, sizeof(number), sort_compares_whole);
}

/* The image's number, its radiance and, if requested, its foreground. */
enum err render_collect_post(struct render *r, struct reason *why)
{
    const size_t rgb = values_of(r) * 3 * sizeof(float), rgba = r->rgba ? values_of(r) * 4 * sizeof(float) : 0;
    uint8_t *bytes = mem_alloc_raw(sizeof(uint64_t) + rgb + rgba, 1);

    if (!bytes)
        return err_say(why, ERR_NOMEM, "out of memory for --collect");
    memcpy(bytes, &r->frame.number, sizeof(uint64_t));
    memcpy(bytes + sizeof(uint64_t), r->rgb, rgb);
    if (rgba > 0)
        memcpy(bytes + sizeof(uint64_t) + rgb, r->rgba, rgba);
    const enum err e = ranks_post(r->desc.ranks, bytes, sizeof(uint64_t) + rgb + rgba);
    mem_free(bytes);
    return e ? err_say(why, e, "--collect: an image is too large to be sent") : ERR_OK;
}

struct taking {
    struct render *r;
    struct reason *why;
};

static enum err write_one(void *context, const void *bytes, size_t size)
{
    const struct taking *t = context;
    const size_t rgb = values_of(t->r) * 3;
    const float *values = (const float *)(const void *)((const uint8_t *)bytes + sizeof(uint64_t));
    uint64_t number;

    memcpy(&number, bytes, sizeof(number));
    const float *rgba = size > sizeof(number) + rgb * sizeof(float) ? values + rgb : NULL;
    const enum err e = output_write(t->r->output, values, rgba, number, t->why);
    if (e)
        ranks_stop(t->r->desc.ranks);
    return e;
}

enum err render_collect_take(struct render *r, bool all, struct reason *why)
{
    struct taking t = { r, why };

    return ranks_collect(r->desc.ranks, all, r->output ? write_one : NULL, &t);
}

enum err render_collect_end(struct render *r, enum err own, struct reason *why)
{
    struct reason later;

    if (!render_collects(r))
        return own;
    if (ranks_index(r->desc.ranks) > 0) {
        const enum err e = ranks_post(r->desc.ranks, NULL, 0);
        return own || !e ? own : err_say(why, e, "out of memory for --collect");
    }
    if (own) { /* receive and discard, so that no rank waits */
        const enum err e = ranks_collect(r->desc.ranks, true, NULL, NULL);
        (void)e;
        return own;
    }
    const enum err e = render_collect_take(r, true, &later);
    if (e)
        *why = later;
    return e;
}
