#include "measure/chart/judge.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/progress.h"
#include "base/rng.h"
#include "light/cache/cache_file.h"
#include "light/estimators/baselines/path.h"
#include "light/resolve/resolve.h"
#include "scene/geometry/scene_digest.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

/* Increment it when the estimators of a reference or their combination change. */
#define VERSION 2
#define SEED 0x7472757468u
#define SECTION "reference"
#define BEHIND_RAYS 4 /* per side of a pixel */

#define BY_LIGHT (PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC)

struct maker { /* of one reference */
    const struct truth_desc *desc;
    uint32_t by_path, by_light; /* classes */
    uint64_t seed;
    struct light_tracer *light;
    const struct gbuffer *dense; /* points behind mirrors and glass are taken from it; NULL: there are none */
    float *lo;                   /* its points */
    float *part, *more;          /* [height][width][3] */
};

struct truth_sum {
    double *rgb;    /* [height][width][3]: sum over the parts */
    uint32_t parts; /* done */
};

static size_t values_of(const struct truth_desc *d)
{
    return 3 * (size_t)d->set->view.width * d->set->view.height;
}

/* The frame's bytes or texels and its layout, not its name or number. */
static void digest_frame(struct digest *d, const struct frame *frame)
{
    digest_u64(d, (uint64_t)frame->kind);
    digest_bytes(d, frame->layout, strlen(frame->layout));
    if (frame->kind == FRAME_FILE) {
        digest_bytes(d, frame->faces, sizeof(frame->faces));
        digest_bytes(d, frame->bytes, frame->size);
    } else if (frame->kind == FRAME_TEXELS) {
        digest_u64(d, (uint64_t)frame->width << 32 | frame->height);
        digest_bytes(d, frame->rgb, 3 * sizeof(float) * frame->width * frame->height);
    }
}

static struct digest key_of(const struct truth_desc *desc, int half)
{
    struct digest d = { { 0 } };

    digest_u64(&d, VERSION);
    digest_u64(&d, TRUTH_PART);
    digest_scene(&d, desc->set->scene);
    digest_view(&d, &desc->set->view);
    digest_frame(&d, desc->frame);
    digest_u64(&d, desc->environment->n);
    if (desc->environment->rotation != 0.0) /* without one the key stays as it was */
        digest_bytes(&d, &desc->environment->rotation, sizeof(desc->environment->rotation));
    digest_u64(&d, desc->classes);
    digest_u64(&d, (uint64_t)half);
    return d;
}

void truth_name(const struct truth_desc *desc, int half, char *name, size_t size)
{
    const struct digest d = key_of(desc, half);
    snprintf(name, size, "%s/%016" PRIx64 "%016" PRIx64 ".truth", desc->cache, d.half[0], d.half[1]);
}

/* Adds what the file has to a sum of zeros. No file is no error; on one the sum is zero. */
static enum err load_sum(const struct truth_desc *d, const char *path, const struct digest *key, struct truth_sum *sum,
                         struct reason *why)
{
    const size_t bytes = values_of(d) * sizeof(double);
    struct cache_reader *r;
    enum err e = cache_reader_open(path, &r, why);

    if (e || !r)
        return e;
    e = cache_reader_find(r, SECTION, key, why);
    if (!e)
        e = cache_reader_get(r, &sum->parts, sizeof(sum->parts), why);
    if (!e)
        e = cache_reader_get(r, sum->rgb, bytes, why);
    if (!e)
        e = cache_reader_end(r, why);
    cache_reader_close(r);
    if (e) {
        memset(sum->rgb, 0, bytes);
        sum->parts = 0;
    }
    return e;
}

static enum err store_sum(const struct truth_desc *d, const char *path, const struct digest *key,
                          const struct truth_sum *sum, struct reason *why)
{
    struct cache_writer *w = cache_writer_create();

    if (!w)
        return err_say(why, ERR_NOMEM, "%s: no memory to write it", path);
    cache_writer_section(w, SECTION, key);
    cache_writer_put(w, &sum->parts, sizeof(sum->parts));
    cache_writer_put(w, sum->rgb, values_of(d) * sizeof(double));
    const enum err e = cache_writer_store(w, path, why);
    cache_writer_destroy(w);
    return e;
}

/* Light that only the light tracer finds, and behind mirrors and glass the eye paths, into m->part. */
static enum err add_caustics(struct maker *m, uint32_t pass)
{
    const struct truth_desc *d = m->desc;
    const struct prepared_scene *set = d->set;
    const struct light_tracer_desc light = {
        .classes = m->by_light,
        .particles = (uint64_t)TRUTH_PART * set->view.width * set->view.height,
        .seed = rng_mix(m->seed, 1),
        .pass = pass,
    };
    const struct eye_paths_desc eye = {
        .behind_classes = m->by_light,
        .paths = TRUTH_PART / (BEHIND_RAYS * BEHIND_RAYS),
        .seed = rng_mix(m->seed, 2),
        .pass = pass,
    };
    struct light_tracer_stats light_stats;
    struct eye_paths_stats eye_stats;

    enum err e = light_tracer_run(m->light, d->environment, &light, m->part, &light_stats);
    if (e || !m->dense)
        return e;
    memset(m->lo, 0, (size_t)m->dense->packet_count * 3 * PACKET * sizeof(float));
    e = eye_paths_shade(set->scene, set->rays, m->dense, d->environment, &eye, m->lo, &eye_stats);
    if (e)
        return e;
    resolve_pixels(m->dense, m->lo, NULL, m->more);
    for (size_t i = 0; i < values_of(d); i++)
        m->part[i] += m->more[i];
    return ERR_OK;
}

/* One more part onto the sum. */
static enum err add_part(struct maker *m, struct truth_sum *sum)
{
    const struct truth_desc *d = m->desc;
    const struct path_world world = { d->set->scene, d->set->rays, &d->set->view, d->environment, NULL };
    const struct path_desc path = { .classes = m->by_path, .samples = TRUTH_PART, .seed = m->seed, .pass = sum->parts };
    struct path_stats stats;

    enum err e = path_render(&world, &path, m->part, &stats);
    if (!e && m->by_light)
        e = add_caustics(m, sum->parts);
    for (size_t i = 0; i < values_of(d) && !e; i++)
        sum->rgb[i] += m->part[i];
    sum->parts += !e;
    return e;
}

static enum err make_parts(struct maker *m, int half, struct truth_sum *sum, struct truth *out, struct reason *why)
{
    const struct truth_desc *d = m->desc;
    const struct digest key = key_of(d, half);
    const uint32_t wanted = (d->samples + TRUTH_PART - 1) / TRUTH_PART;
    struct reason fault = { "" };
    char name[4096];
    enum err e = ERR_OK;

    if (d->cache) {
        truth_name(d, half, name, sizeof(name));
        e = load_sum(d, name, &key, sum, &fault);
        if (e == ERR_IO || e == ERR_NOMEM)
            return err_say(why, e, "%s", fault.text);
        if (e)
            log_warning("%s; computing it again", fault.text);
        e = ERR_OK;
    }
    out->found[half] = sum->parts * TRUTH_PART;
    progress_step(d->line, sum->parts < wanted ? sum->parts * TRUTH_PART : wanted * TRUTH_PART);
    m->seed = rng_mix(SEED, (uint64_t)half);
    while (sum->parts < wanted && !e) {
        e = add_part(m, sum);
        if (e)
            return err_say(why, e, "no memory for the reference");
        if (d->cache)
            e = store_sum(d, name, &key, sum, why);
        progress_step(d->line, TRUTH_PART);
    }
    out->samples[half] = sum->parts * TRUTH_PART;
    for (size_t i = 0; i < values_of(d) && !e; i++)
        out->half[half][i] = (float)(sum->rgb[i] / sum->parts);
    return e;
}

/* The points behind mirrors and glass, with more camera rays than an image's own. */
static enum err make_dense(const struct truth_desc *d, struct gbuffer **out, struct reason *why)
{
    const struct prepared_scene *set = d->set;
    struct gbuffer_desc g = {
        .camera = set->scene->cameras,
        .width = set->view.width,
        .height = set->view.height,
        .edge_rays = BEHIND_RAYS,
        .every_pixel = true,
    };
    return gbuffer_create(set->scene, set->rays, &g, out, why);
}

static enum err make_both(struct maker *m, struct truth *out, struct reason *why)
{
    const struct truth_desc *d = m->desc;
    struct truth_sum sum = { .rgb = mem_alloc(values_of(d), sizeof(double)) };
    enum err e = ERR_OK;

    m->part = mem_alloc(values_of(d), sizeof(float));
    m->more = mem_alloc(values_of(d), sizeof(float));
    m->light = light_tracer_create(d->set->scene, d->set->rays, &d->set->view);
    m->lo = mem_alloc(m->dense ? m->dense->packet_count : 1, 3 * PACKET * sizeof(float));
    if (!sum.rgb || !m->part || !m->more || !m->light || !m->lo)
        e = err_say(why, ERR_NOMEM, "no memory for the reference");
    for (int half = 0; half < 2 && !e; half++) {
        out->half[half] = mem_alloc(values_of(d), sizeof(float));
        memset(sum.rgb, 0, values_of(d) * sizeof(double));
        sum.parts = 0;
        e = out->half[half] ? make_parts(m, half, &sum, out, why)
                            : err_say(why, ERR_NOMEM, "no memory for the reference");
    }
    mem_free(sum.rgb);
    mem_free(m->part);
    mem_free(m->more);
    mem_free(m->lo);
    light_tracer_destroy(m->light);
    return e;
}

enum err truth_make(const struct truth_desc *desc, struct truth *out, struct reason *why)
{
    const bool casters = desc->set->facts.casters > 0;
    struct maker m = { .desc = desc, .by_light = casters ? desc->classes & BY_LIGHT : 0 };
    struct gbuffer *dense = NULL;
    const double start = clock_seconds();
    enum err e = ERR_OK;

    *out = (struct truth){ .seconds = 0.0 };
    m.by_path = desc->classes & ~(uint32_t)BY_LIGHT;
    if (m.by_light && desc->set->facts.behind > 0)
        e = make_dense(desc, &dense, why);
    m.dense = dense;
    if (!e)
        e = make_both(&m, out, why);
    gbuffer_destroy(dense);
    out->seconds = clock_seconds() - start;
    if (e)
        truth_finish(out);
    return e;
}

void truth_finish(struct truth *t)
{
    mem_free(t->half[0]);
    mem_free(t->half[1]);
    *t = (struct truth){ .seconds = 0.0 };
}
