#include "programs/render/render.h"

#include "base/mem.h"

#include <string.h>

/* A PNG of exact colours: linear 0 and 1 are 0 and 255 without a tone curve. */
enum err render_changes_create(struct render *r, struct reason *why)
{
    const struct render_desc *d = &r->desc;
    const struct output_desc output = { .pattern = d->changes, .tone = TONE_LINEAR };

    if (!d->changes)
        return ERR_OK;
    if (render_deals(r))
        return err_say(why, ERR_USAGE,
                       "--changes compares with the last frame, which another rank may have: start it "
                       "without mpirun");
    enum err e = output_check(&output, why);
    if (!e && strcmp(output_extension(&output), ".png") != 0)
        return err_say(why, ERR_USAGE, "--changes '%s': change maps are .png", d->changes);
    if (!e)
        e = output_create(&output, d->setup.set_desc.width, d->setup.set_desc.height, &r->maps, why);
    if (e) {
        const struct reason same = *why; /* which speaks of --out */
        return err_say(why, e, "--changes: %s", same.text);
    }
    if (!e && !output_is_numbered(r->maps) && source_count(r->source) > 1)
        e = err_say(why, ERR_USAGE, "--changes '%s' names one file: add %%04d", d->changes);
    if (!e)
        output_fix_exposure(r->maps, 0.0);
    return e;
}

static enum err write_map(struct render *r, struct reason *why)
{
    uint8_t *bytes = mem_alloc(r->changes.pixels, 3);
    float *rgb = mem_alloc(r->changes.pixels, 3 * sizeof(float));
    enum err e = bytes && rgb ? ERR_OK : err_say(why, ERR_NOMEM, "no memory for a change map");

    if (!e) {
        changes_paint(&r->changes, bytes);
        for (size_t i = 0; i < (size_t)3 * r->changes.pixels; i++)
            rgb[i] = bytes[i] ? 1.0f : 0.0f;
        e = output_write(r->maps, rgb, NULL, r->frame.number, why);
    }
    mem_free(bytes);
    mem_free(rgb);
    return e;
}

enum err render_changes(struct render *r, const struct relight_stats *stats, struct reason *why)
{
    if (!r->maps && !r->desc.stats_path)
        return ERR_OK;
    if (changes_take(&r->changes, r->relighter, stats, r->rgb))
        return err_say(why, ERR_NOMEM, "no memory for a change map");
    return r->maps ? write_map(r, why) : ERR_OK;
}
