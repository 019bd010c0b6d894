/* Distributes frames among the ranks of a job, joins their statistics in frame order, and keeps existing images
 * (--resume). */
#include "programs/render/render.h"

#include "base/mem.h"
#include "relightd/settings/settings.h"

#include <stdlib.h>
#include <string.h>

bool render_deals(const struct render *r)
{
    return r->desc.ranks && !r->desc.split;
}

/* Each needs frames that do not depend on those before. */
enum err render_check_shared(const struct render *r, struct reason *why)
{
    const struct render_desc *d = &r->desc;
    const char *what = d->resume ? "--resume" : "rendering on several ranks";

    if (!d->resume && !render_deals(r))
        return d->ranks && d->inspection
                   ? err_say(why, ERR_USAGE, "--probe is for one process: start relight-render without mpirun")
                   : ERR_OK;
    if (render_deals(r) && d->setup.source_desc.between.deflicker)
        return err_say(why, ERR_USAGE, "--deflicker needs the skies in order: start relight-render without mpirun");
    if (r->output && output_is_stream(r->output))
        return err_say(why, ERR_USAGE,
                       "%s needs a file per image: a video, or standard output, holds all frames in order; render to "
                       "'NAME.%%04d.png' and make the video from these",
                       what);
    if (d->output.pattern && r->output && output_is_exposed(r->output) &&
        d->setup.initial.exposure_stops == EXPOSURE_FOLLOW)
        return err_say(why, ERR_USAGE,
                       "%s cannot be used with --exposure follow, which makes each image depend on earlier ones: use "
                       "auto or a number",
                       what);
    if (d->resume && !d->output.pattern)
        return err_say(why, ERR_USAGE, "--resume needs --out");
    if (d->ranks && d->inspection)
        return err_say(why, ERR_USAGE, "--probe is for one process: start relight-render without mpirun");
    if (render_deals(r) && (source_count(r->source) == 0 || !source_seek(r->source, 0)))
        return err_say(why, ERR_USAGE,
                       "several ranks need a source whose frames can be taken in any order: files, a video, or sky: "
                       "with --frames; not %s",
                       d->setup.source_desc.spec);
    return ERR_OK;
}

enum err render_take(struct render *r, struct reason *why)
{
    if (render_deals(r)) {
        r->position = ranks_take(r->desc.ranks);
        if (r->position >= source_count(r->source) || !source_seek(r->source, r->position))
            return ERR_END;
    }
    if (r->ahead.taken)
        return render_split_take(r, why);
    r->decoded = false;
    return source_next(r->source, &r->frame, why);
}

bool render_is_kept(const struct render *r, const struct frame *frame)
{
    if (render_collects(r))
        return r->desc.resume && render_collect_has(r, frame->number);
    return r->desc.resume && r->output && output_exists(r->output, frame->number);
}

/* ---- Statistics ---- */

/* What a rank keeps of a frame, before its text. */
struct note {
    uint64_t position, size;
};

enum err render_note(struct render *r, char *text)
{
    const struct note n = { r->position, text ? strlen(text) : 0 };
    struct bytes *b = &r->texts;

    if (!text)
        return ERR_NOMEM;
    if (!render_deals(r)) {
        fprintf(r->stats, "%s%s", r->rendered ? ",\n" : "\n", text);
        free(text);
        return ERR_OK;
    }
    if (b->size + sizeof(n) + n.size > b->capacity) {
        const size_t more = 2 * (b->size + sizeof(n) + n.size);
        char *at = mem_grow(b->at, b->size, more, 1);
        if (!at) {
            free(text);
            return ERR_NOMEM;
        }
        b->at = at;
        b->capacity = more;
    }
    memcpy(b->at + b->size, &n, sizeof(n));
    memcpy(b->at + b->size + sizeof(n), text, n.size);
    b->size += sizeof(n) + n.size;
    free(text);
    return ERR_OK;
}

/* All notes, and where each begins, once they are in order. */
struct notes {
    struct bytes all;
    size_t *begin;
    size_t count, capacity;
};

static enum err take_notes(void *context, const void *bytes, size_t size)
{
    struct notes *notes = context;
    char *at = mem_grow(notes->all.at, notes->all.size, notes->all.size + size + 1, 1);
    struct note n;

    if (!at)
        return ERR_NOMEM;
    notes->all.at = at;
    memcpy(at + notes->all.size, bytes, size);
    for (size_t k = 0; k < size; k += sizeof(n) + n.size) {
        memcpy(&n, (const char *)bytes + k, sizeof(n));
        if (!mem_reserve(&notes->begin, notes->count, &notes->capacity, sizeof(*notes->begin)))
            return ERR_NOMEM;
        notes->begin[notes->count++] = notes->all.size + k;
    }
    notes->all.size += size;
    return ERR_OK;
}

static struct note note_at(const struct notes *notes, size_t k)
{
    struct note n;

    memcpy(&n, notes->all.at + notes->begin[k], sizeof(n));
    return n;
}

/* In the order of their frames. Ranks take ascending numbers, so the lists are joined by sorting in place. */
static void sort_notes(struct notes *notes)
{
    for (size_t k = 1; k < notes->count; k++) {
        const size_t begin = notes->begin[k];
        const uint64_t position = note_at(notes, k).position;
        size_t to = k;
        for (; to > 0 && note_at(notes, to - 1).position > position; to--)
            notes->begin[to] = notes->begin[to - 1];
        notes->begin[to] = begin;
    }
}

enum err render_join(struct render *r, struct reason *why)
{
    struct notes notes = { 0 };

    if (!render_deals(r) || !r->desc.stats_path)
        return ERR_OK;
    const enum err e = ranks_gather(r->desc.ranks, r->texts.at, r->texts.size, take_notes, &notes);
    sort_notes(&notes);
    for (size_t k = 0; r->stats && k < notes.count; k++) {
        fputs(k ? ",\n" : "\n", r->stats);
        fwrite(notes.all.at + notes.begin[k] + sizeof(struct note), 1, note_at(&notes, k).size, r->stats);
    }
    mem_free(notes.all.at);
    mem_free(notes.begin);
    return e ? err_say(why, e, "out of memory for the statistics of all ranks") : ERR_OK;
}
