#include "year/annual.h"

#include "base/file_store.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/vec.h"
#include "light/estimators/sunlight.h"
#include "light/frame/part.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/scene_digest.h"
#include "sky/tables/irradiance.h"
#include "year/points.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define DEGREES (180.0 / PI)

/* ---- Setting up ---- */

/* Everything that the tables depend on. */
static struct digest key_of(const struct annual *a)
{
    const struct setup *s = &a->desc.setup;
    const struct daylight *w = a->weather;
    struct digest d = { { 0 } };

    digest_scene(&d, a->set->scene);
    digest_points(&d, a->set->gbuffer);
    digest_bytes(&d, s->source_desc.spec, strlen(s->source_desc.spec));
    for (size_t i = 0; i < w->year.count; i++) {
        const struct moment *m = &w->year.at[i];
        const double v[6] = { (double)m->number, m->direct_normal,     m->diffuse,
                              m->altitude,       m->direct_normal_lux, m->diffuse_lux };
        digest_bytes(&d, v, sizeof(v));
    }
    const struct relight_desc *l = &a->light;
    const double numbers[] = { l->direct.method,
                               l->direct.samples,
                               (double)l->direct.seed,
                               l->direct.no_visibility,
                               l->direct.cells,
                               l->direct.sun,
                               l->direct.compensate,
                               l->classes,
                               l->caustics,
                               l->indirect,
                               (double)l->particles,
                               l->eye_paths,
                               l->start,
                               (double)l->cache_bytes,
                               s->environment.n,
                               s->environment.layout,
                               s->environment.rotation_degrees,
                               s->environment.scale_stops,
                               s->initial.lamps };
    digest_bytes(&d, numbers, sizeof(numbers));
    digest_bytes(&d, &a->desc.measures, sizeof(a->desc.measures));
    digest_u64(&d, a->desc.weights);
    return d;
}

/* The sun alone at the sensors, in a->sun_lux. */
static void find_sunlight(struct annual *a, const struct moment *m)
{
    const double turn = a->desc.setup.environment.rotation_degrees / DEGREES;
    double w[3];

    daylight_sun(a->weather, m, w);
    const double sun[3] = { cos(turn) * w[0] + sin(turn) * w[2], w[1], cos(turn) * w[2] - sin(turn) * w[0] };
    sunlight_lux(a->set->scene, a->set->rays, a->points.at, a->points.count, sun,
                 a->weather->sun ? m->direct_normal_lux : 0.0, a->sun_lux);
}

void annual_count(struct annual *a, const struct moment *m, const float *lux, const float *sun_lux)
{
    const struct measures_desc *d = &a->desc.measures;

    if (m->missing)
        return;
    measures_add(d, m->clock, m->span, lux, sun_lux, a->points.count, a->sensors);
    a->occupied += measures_occupied(d, m->clock) ? m->span : 0.0;
}

/* A row that an earlier run left. */
static void replay(void *self, const struct ledger_row *row, const float *lux)
{
    struct annual *a = self;
    const struct moments *year = &a->weather->year;

    for (size_t i = 0; i < year->count; i++)
        if ((double)year->at[i].number == row->value[LEDGER_NUMBER]) {
            find_sunlight(a, &year->at[i]);
            annual_count(a, &year->at[i], lux, a->sun_lux);
        }
    a->resumed++;
}

static enum err choose_light(struct annual *a, struct reason *why)
{
    struct relight_desc *l = &a->light;

    *l = a->desc.setup.light;
    if (method_is_reference(l->direct.method))
        return err_say(why, ERR_USAGE, "--annual needs a method that lights surfaces, such as cached or mis, not %s",
                       method_name(l->direct.method));
    if (l->direct.method == METHOD_AUTO)
        l->direct.method = METHOD_CACHED;
    l->classes &= ~(uint32_t)(PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC);
    l->cache_background = false;
    l->direct.why = why;
    struct box box;
    if (scene_casters(a->set->scene, &box, 1) > 0 && ranks_index(a->desc.ranks) == 0)
        log_warning("%s: caustics (light via mirrors and solid glass) are left out; model window panes as thin glass",
                    a->set->name);
    if (a->set->scene->ground.radius > 0.0f)
        return err_say(why, ERR_USAGE,
                       "--annual: a scene with a shadow-catching ground has no sensors; model the "
                       "ground as a surface");
    return ERR_OK;
}

static enum err allocate(struct annual *a, struct reason *why)
{
    const struct prepared_scene_desc *d = &a->desc.setup.set_desc;
    const size_t pixels = (size_t)d->width * d->height, sensors = a->points.count + 1;
    struct environment_desc environment = a->desc.setup.environment;

    environment.lean = a->light.direct.method == METHOD_CACHED;
    environment.layout = LAYOUT_LATLONG;
    a->relighter = relighter_create(a->set, a->desc.setup.kernels);
    a->environment = environment_create(&environment);
    a->sensors = mem_alloc(sensors, sizeof(*a->sensors));
    a->lux = mem_alloc(sensors, sizeof(*a->lux));
    a->sun_lux = mem_alloc(sensors, sizeof(*a->sun_lux));
    a->factor = mem_alloc(sensors, sizeof(*a->factor));
    a->rgb = mem_alloc(pixels, 3 * sizeof(*a->rgb));
    a->cdm2 = mem_alloc(pixels, sizeof(*a->cdm2));
    const uint32_t n = a->environment ? a->environment->n : 1;
    a->weights = mem_alloc((size_t)2 * n * n, sizeof(*a->weights));
    if (!a->relighter || !a->environment || !a->sensors || !a->lux || !a->sun_lux || !a->factor || !a->rgb ||
        !a->cdm2 || !a->weights || frame_reserve_texels(&a->frame, a->weather->width, a->weather->height))
        return err_say(why, ERR_NOMEM, "no memory for images of %ux%u and %zu sensors", d->width, d->height,
                       a->points.count);
    irradiance_weights(n, a->weights);
    return glare_view_create(&a->set->view, &a->glare) ? err_say(why, ERR_NOMEM, "out of memory") : ERR_OK;
}

static void warn_of_enclosed(const struct annual *a)
{
    size_t first = 0;
    const size_t count =
        ranks_index(a->desc.ranks) == 0 ? points_enclosed(&a->points, a->set->scene, a->set->rays, &first) : 0;

    if (count > 0)
        log_warning("%s: %zu of %zu sensors seem to lie inside solids, the first is number %zu at %g,%g,%g: their "
                    "values are meaningless but count in sDA and ASE; remove them",
                    a->desc.sensors, count, a->points.count, first, (double)a->points.at[first].position.x,
                    (double)a->points.at[first].position.y, (double)a->points.at[first].position.z);
}

static enum err set_up(struct annual *a, struct reason *why)
{
    const char *spec = a->desc.setup.source_desc.spec;
    enum err e = ERR_OK;

    if (strncmp(spec, "epw:", 4) != 0)
        return err_say(why, ERR_USAGE, "--annual needs the weather of a year: --source epw:FILE, not '%s'", spec);
    e = daylight_open(spec, &a->weather, why);
    if (!e && a->weather->scale != 1.0)
        e = err_say(why, ERR_USAGE, "--annual measures in real units: remove scale=");
    if (!e && a->desc.setup.environment.scale_stops != 0.0)
        e = err_say(why, ERR_USAGE, "--annual measures in real units: remove --scale");
    if (!e)
        e = annual_images_read(a, why);
    if (!e)
        e = folder_make(a->desc.folder, why);
    if (!e)
        e = set_create(&a->desc.setup.set_desc, &a->set, why);
    if (!e && a->desc.sensors)
        e = points_read(a->desc.sensors, a->set->scene, &a->points, why);
    if (!e)
        e = choose_light(a, why);
    if (!e && gbuffer_add_sensors(a->set->gbuffer, a->points.at, (uint32_t)a->points.count, &a->first_packet))
        e = err_say(why, ERR_NOMEM, "no memory for %zu sensors", a->points.count);
    if (!e)
        e = allocate(a, why);
    if (e)
        return e;
    warn_of_enclosed(a);
    if (ranks_index(a->desc.ranks) > 0) /* rank 0 has the tables */
        return ERR_OK;
    const struct digest key = key_of(a);
    e = ledger_open(&a->ledger, a->desc.folder, &key, a->points.count, a->desc.resume, replay, a, why);
    return e ? e : annual_order_begin(a, why);
}

/* Ranks learn which rows are there, and compute the cache together. */
static enum err set_up_all(struct annual *a, struct reason *why)
{
    struct ranks *ranks = a->desc.ranks;
    enum err e = ranks_agree(ranks, set_up(a, why), why);
    uint64_t resumed = a->resumed;
    double ms;

    if (!e && ranks) {
        a->share = team_share(ranks);
        relighter_share(a->relighter, &a->share);
        if (ranks_broadcast(ranks, &resumed, sizeof(resumed)))
            e = err_say(why, ERR_IO, "rank 0 no longer answers");
        a->resumed = (size_t)resumed;
    }
    return e ? e : ranks_agree(ranks, relighter_prepare(a->relighter, &a->light, ranks_index(ranks) == 0, &ms), why);
}

/* ---- A moment ---- */

/* Lights scene and sensors under what a->frame holds. */
static enum err light_frame(struct annual *a, double *open_lux, struct reason *why)
{
    struct relight_stats stats;
    double rgb[3];
    enum err e = environment_update(a->environment, &a->frame, why);

    if (e)
        return e;
    irradiance_upward(a->environment, a->weights, rgb);
    *open_lux = LUMINOUS_EFFICACY * luminance_of(a->desc.weights, rgb);
    e = relighter_run(a->relighter, a->environment, &a->light, a->rgb, &stats);
    if (e)
        return e == ERR_NOMEM ? err_say(why, e, "%s: no memory for its light", a->frame.name) : e;
    const float *lo = relighter_points(a->relighter);
    for (size_t i = 0; i < a->points.count; i++) {
        sensor_radiance(lo, a->first_packet + (uint32_t)i, rgb);
        a->lux[i] = (float)(PI * LUMINOUS_EFFICACY * luminance_of(a->desc.weights, rgb));
    }
    return ERR_OK;
}

static double image_mean(struct annual *a)
{
    const size_t pixels = (size_t)a->desc.setup.set_desc.width * a->desc.setup.set_desc.height;
    double sum = 0.0;

    for (size_t i = 0; i < pixels; i++) {
        const double rgb[3] = { a->rgb[3 * i], a->rgb[3 * i + 1], a->rgb[3 * i + 2] };
        a->cdm2[i] = (float)(LUMINOUS_EFFICACY * luminance_of(a->desc.weights, rgb));
        sum += a->cdm2[i];
    }
    return sum / (double)pixels;
}

static void fill_row(struct annual *a, const struct moment *m, double open_lux, struct ledger_row *row)
{
    double least = INFINITY, most = 0.0, sum = 0.0;
    struct glare glare = { .dgp = NAN, .vertical_lux = NAN };

    for (size_t i = 0; i < a->points.count; i++) {
        sum += a->lux[i];
        least = fmin(least, a->lux[i]);
        most = fmax(most, a->lux[i]);
    }
    const bool any = a->points.count > 0;
    const double mean_cdm2 = image_mean(a);
    if (a->glare && glare_view_measure(a->glare, a->cdm2, &glare))
        glare = (struct glare){ .dgp = NAN, .vertical_lux = NAN };
    const double azimuth = DEGREES * atan2(-m->sun[0], m->sun[2]);
    *row = (struct ledger_row){ {
        [LEDGER_NUMBER] = (double)m->number,
        [LEDGER_MONTH] = m->month,
        [LEDGER_DAY] = m->day,
        [LEDGER_CLOCK] = m->clock,
        [LEDGER_ALTITUDE] = DEGREES * m->altitude,
        [LEDGER_AZIMUTH] = azimuth < 0.0 ? azimuth + 360.0 : azimuth,
        [LEDGER_DIRECT_NORMAL] = m->direct_normal,
        [LEDGER_DIFFUSE] = m->diffuse,
        [LEDGER_OPEN_LUX] = moment_open_lux(m, a->weather->sun, a->weather->sky),
        [LEDGER_RENDERED_LUX] = open_lux,
        [LEDGER_MEAN_LUX] = any ? sum / (double)a->points.count : NAN,
        [LEDGER_LEAST_LUX] = any ? least : NAN,
        [LEDGER_MOST_LUX] = any ? most : NAN,
        [LEDGER_MEAN_CDM2] = mean_cdm2,
        [LEDGER_DGP] = glare.dgp,
        [LEDGER_EYE_LUX] = glare.vertical_lux,
    } };
}

/* Moment i of the lit ones. */
static enum err run_moment(struct annual *a, size_t i, struct reason *why)
{
    const struct moment *m = daylight_moment(a->weather, i);
    struct annual_image *image = annual_image_of(a, m);
    struct ledger_row row;
    double open_lux = 0.0;
    const bool kept = i < a->resumed;
    enum err e;

    if (kept && !image)
        return ERR_OK;
    daylight_render(a->weather, m, a->frame.rgb);
    a->frame.number = m->number;
    moment_name(m, a->frame.name, sizeof(a->frame.name));
    ranks_ask(a->desc.ranks); /* the number arrives meanwhile */
    e = light_frame(a, &open_lux, why);
    if (e)
        return e;
    fill_row(a, m, open_lux, &row);
    if (!kept) {
        find_sunlight(a, m);
        e = annual_order_add(a, i, &row, why);
    }
    for (; !e && image; image = annual_image_of(a, m)) { /* several requested times may give the same moment */
        e = annual_image_write(a, m, why);
        image->done = !e;
    }
    return e;
}

/* Under the CIE Standard Overcast Sky. */
static enum err find_daylight_factors(struct annual *a, struct reason *why)
{
    struct daylight *sky;
    char spec[64];
    double open_lux = 0.0;

    if (a->points.count == 0)
        return ERR_OK;
    snprintf(spec, sizeof(spec), "cie:1,ground=%.4f,size=%ux%u", a->weather->ground_albedo, a->weather->width,
             a->weather->height);
    enum err e = daylight_open(spec, &sky, why);
    if (e)
        return e;
    daylight_render(sky, daylight_moment(sky, 0), a->frame.rgb);
    snprintf(a->frame.name, sizeof(a->frame.name), "%s", cie_name(1));
    daylight_close(sky);
    e = light_frame(a, &open_lux, why);
    for (size_t i = 0; i < a->points.count && !e; i++)
        a->factor[i] = (float)(a->lux[i] / open_lux);
    return e;
}

/* The next moment for this process; weather->count or more: there is none. */
static size_t next_moment(const struct annual *a, size_t before)
{
    return a->desc.ranks ? (size_t)ranks_take(a->desc.ranks) : before + 1;
}

static enum err run_year(struct annual *a, struct reason *why)
{
    const struct daylight *w = a->weather;
    const bool first = ranks_index(a->desc.ranks) == 0;
    struct progress line;
    enum err e = ERR_OK;

    for (size_t i = 0; i < w->year.count; i++)
        if (!w->year.at[i].lit)
            annual_count(a, &w->year.at[i], NULL, NULL);
    if (a->resumed > 0 && first)
        log_info("%s: %zu of %zu hours are already done", a->desc.folder, a->resumed, w->count);
    progress_begin(&line, "a year of light", w->count, first ? stderr : NULL);
    for (size_t i = next_moment(a, SIZE_MAX); i < w->count && !e; i = e ? i : next_moment(a, i)) {
        e = run_moment(a, i, why);
        progress_step(&line, i + 1 - line.done); /* of all ranks */
    }
    e = annual_order_end(a, e, why);
    if (!e && first)
        e = find_daylight_factors(a, why);
    progress_end(&line);
    return e;
}

static void finish(struct annual *a)
{
    annual_order_finish(a);
    ledger_close(&a->ledger);
    glare_view_destroy(a->glare);
    frame_finish(&a->frame);
    relighter_destroy(a->relighter);
    environment_destroy(a->environment);
    set_destroy(a->set);
    daylight_close(a->weather);
    points_finish(&a->points);
    mem_free(a->sensors);
    mem_free(a->lux);
    mem_free(a->sun_lux);
    mem_free(a->factor);
    mem_free(a->rgb);
    mem_free(a->cdm2);
    mem_free(a->weights);
}

enum err annual_run(const struct annual_desc *desc, struct reason *why)
{
    struct annual *a = mem_alloc(1, sizeof(*a));

    if (!a)
        return err_say(why, ERR_NOMEM, "out of memory");
    a->desc = *desc;
    enum err e = set_up_all(a, why);
    if (!e)
        e = ranks_agree(a->desc.ranks, run_year(a, why), why);
    if (!e && ranks_index(a->desc.ranks) == 0)
        e = annual_report(a, why);
    finish(a);
    mem_free(a);
    return e;
}
