#include "light/radiance/components.h"

#include "base/log.h"
#include "base/mem.h"
#include "base/progress.h"
#include "image/codec/encode.h"
#include "image/codec/frame.h"
#include "sky/daylight/reinhart.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define DEGREES (180.0 / PI)

struct components {
    uint32_t mf;
    struct relight_desc light;
    struct relighter *relighter;
    struct environment *environment;
    struct frame sky;
};

/* ---- Arguments ---- */

static enum err check_folder(const char *out, struct reason *why)
{
    const char *slash = strrchr(out, '/');
    char folder[4096];

    const int n = snprintf(folder, sizeof(folder), "%.*s", slash ? (int)(slash - out) + 1 : 1, slash ? out : ".");
    if (n < 0 || (size_t)n >= sizeof(folder))
        return err_say(why, ERR_USAGE, "--components '%.200s': the name is too long", out);
    return access(folder, W_OK | X_OK) == 0 ? ERR_OK
                                            : err_say(why, ERR_IO, "--components '%s': %s", out, strerror(errno));
}

enum err components_read(const char *text, struct components_desc *out, struct reason *why)
{
    const enum err e = file_pattern_parse(text, "--components", &out->out, why);

    if (e)
        return e;
    if (!out->out.length)
        return err_say(why, ERR_USAGE, "--components '%s' names one file, but each patch needs one: add %%03d", text);
    if (strlen(text) < 4 || strcmp(text + strlen(text) - 4, ".hdr") != 0)
        return err_say(why, ERR_USAGE, "--components '%s' must end in .hdr", text);
    return check_folder(text, why);
}

/* ---- Images ---- */

enum err components_create(const struct components_desc *desc, struct components **out, struct reason *why)
{
    struct components *c = mem_alloc(1, sizeof(*c));
    struct environment_desc environment = *desc->environment;
    uint32_t width, height;
    double ms;

    *out = NULL;
    if (!c)
        return err_say(why, ERR_NOMEM, "out of memory");
    c->mf = desc->mf;
    c->light = *desc->light;
    c->light.unsplit = true;
    c->light.turn = c->light.direct.pass = 0;
    c->light.direct.why = why;
    environment.layout = LAYOUT_LATLONG;
    c->relighter = relighter_create(desc->set, desc->kernels);
    c->environment = environment_create(&environment);
    reinhart_size(desc->mf, &width, &height);
    enum err e = c->relighter && c->environment ? frame_reserve_texels(&c->sky, width, height) : ERR_NOMEM;
    snprintf(c->sky.name, sizeof(c->sky.name), "a sky of patches");
    if (e)
        e = err_say(why, e, "no memory for skies of %ux%u texels", width, height);
    else
        e = relighter_prepare(c->relighter, &c->light, desc->progress, &ms);
    if (e) {
        components_destroy(c);
        return e;
    }
    *out = c;
    return ERR_OK;
}

void components_destroy(struct components *c)
{
    if (!c)
        return;
    relighter_destroy(c->relighter);
    environment_destroy(c->environment);
    frame_finish(&c->sky);
    mem_free(c);
}

enum err components_image(struct components *c, const float (*radiance)[3], float *rgb, struct reason *why)
{
    struct relight_stats stats;

    c->light.direct.why = why;
    reinhart_sky(c->mf, radiance, c->sky.rgb);
    const enum err e = environment_update(c->environment, &c->sky, why);
    return e ? e : relighter_run(c->relighter, c->environment, &c->light, rgb, &stats);
}

/* ---- Files ---- */

/* The header's lines: what the image is, and its view. */
static void describe(const struct components_desc *d, uint32_t patch, char *out, size_t size)
{
    const struct reinhart_patch at = reinhart_patch(d->mf, patch);
    char view[RADIANCE_VIEW_LINE];

    radiance_view_line(&d->set->view, view);
    snprintf(
        out, size,
        "relight-render: daylight coefficients of patch %u of Reinhart MF:%u, altitude %.6g, azimuth %.6g, %.6g sr\n%s",
        patch, d->mf, DEGREES * at.altitude, DEGREES * at.azimuth, at.solid_angle, view);
}

static enum err write_one(const struct components_desc *d, struct components *c, uint32_t patch, float (*radiance)[3],
                          float *rgb, struct reason *why)
{
    char name[4096], lines[1024];
    const struct hdr_desc hdr = { rgb, d->set->view.width, d->set->view.height, lines };

    for (int k = 0; k < 3; k++)
        radiance[patch][k] = 1.0f;
    enum err e = components_image(c, (const float(*)[3])radiance, rgb, why);
    for (int k = 0; k < 3; k++)
        radiance[patch][k] = 0.0f;
    if (!e)
        e = file_pattern_name(&d->out, patch, name, sizeof(name), why);
    if (e)
        return e;
    describe(d, patch, lines, sizeof(lines));
    return hdr_write(&hdr, name, why);
}

enum err components_write(const struct components_desc *d, struct reason *why)
{
    const uint32_t count = reinhart_count(d->mf);
    struct components *c = NULL;
    struct progress line;

    float(*radiance)[3] = mem_alloc(count, sizeof(*radiance));
    float *rgb = mem_alloc((size_t)d->set->view.width * d->set->view.height, 3 * sizeof(float));
    enum err e = radiance && rgb ? components_create(d, &c, why) : err_say(why, ERR_NOMEM, "out of memory");
    if (!e) {
        progress_begin(&line, "writing components", count, d->progress ? stderr : NULL);
        for (uint32_t k = 0; k < count && !e; k++) {
            e = write_one(d, c, k, radiance, rgb, why);
            progress_step(&line, 1);
        }
        progress_end(&line);
    }
    if (!e)
        log_info("%u component images for a sky of Reinhart MF:%u", count, d->mf);
    components_destroy(c);
    mem_free(radiance);
    mem_free(rgb);
    return e;
}
