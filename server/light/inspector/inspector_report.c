#include "light/inspector/inspector.h"

#include "base/mem.h"
#include "base/setting.h"
#include "base/text.h"
#include "image/codec/encode.h"
#include "image/film/film.h"
#include "light/estimators/sunlight.h"

#include <jansson.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

struct inspector {
    const struct prepared_scene *set;
    const struct kernels *kernels;
    struct inspection *inspection;
    struct jpeg_encoder *jpeg;
    struct inspect_result answer;          /* too large for the stack */
    double row_cosine[INSPECT_SKY_HEIGHT]; /* cosine of the polar angle of each row of the sky image */
    float sky[3 * INSPECT_SKY_WIDTH * INSPECT_SKY_HEIGHT];
    uint8_t display[3 * INSPECT_SKY_WIDTH * INSPECT_SKY_HEIGHT];
};

struct inspector *inspector_create(const struct prepared_scene *set, const struct kernels *kernels)
{
    struct inspector *p = mem_alloc(1, sizeof(*p));

    if (!p)
        return NULL;
    p->set = set;
    p->kernels = kernels;
    p->inspection = inspect_create(kernels);
    p->jpeg = jpeg_encoder_create();
    for (uint32_t y = 0; y < INSPECT_SKY_HEIGHT; y++)
        p->row_cosine[y] = cos(PI * (y + 0.5) / INSPECT_SKY_HEIGHT);
    if (!p->inspection || !p->jpeg) {
        inspector_destroy(p);
        return NULL;
    }
    return p;
}

void inspector_destroy(struct inspector *p)
{
    if (!p)
        return;
    inspect_destroy(p->inspection);
    jpeg_encoder_destroy(p->jpeg);
    mem_free(p);
}

/* JSON has no NaN or infinity. */
static json_t *number(double x)
{
    return json_real(isfinite(x) ? x : 0.0);
}

/* Four decimals: for directions and weights, which are numerous. */
static json_t *small(double x)
{
    return number(round(1e4 * x) / 1e4);
}

static json_t *triple(const float x[3])
{
    return json_pack("[o, o, o]", number(x[0]), number(x[1]), number(x[2]));
}

static json_t *vector(struct vec3 v)
{
    return json_pack("[o, o, o]", number(v.x), number(v.y), number(v.z));
}

static json_t *mean_json(const struct inspect_mean *m)
{
    return json_pack("{s:[o, o, o], s:[o, o, o], s:i}", "mean", number(m->mean[0]), number(m->mean[1]),
                     number(m->mean[2]), "error", number(m->error[0]), number(m->error[1]), number(m->error[2]),
                     "estimates", (int)m->estimates);
}

/* The material as described in the scene, without textures. */
static json_t *material_json(const struct scene *scene, uint32_t index)
{
    const struct material *m = &scene->materials[index];
    json_t *j = json_pack("{s:o, s:s}", "name", words_to_json(m->name), "kind", material_kind_name(m->kind));

    if (m->kind == MATERIAL_PHONG)
        json_object_set_new(j, "exponent", number(m->exponent));
    if (material_has_finish(m)) {
        json_object_set_new(j, "metallic", number(m->metallic));
        json_object_set_new(j, "roughness", number(m->roughness));
    }
    if (m->kind == MATERIAL_GLASS && m->thin)
        json_object_set_new(j, "thin", json_true());
    if (m->kind == MATERIAL_GLASS)
        json_object_set_new(j, "ior", number(m->ior));
    if (m->kind == MATERIAL_MIRROR)
        json_object_set_new(j, "reflectance", vector(m->diffuse));
    return j;
}

/* The BRDF at the point, with textures and the preset applied. */
static json_t *lobe_json(const struct shade_packet *at)
{
    json_t *j = json_pack("{s:s, s:[o, o, o]}", "kind", lobe_kind_name((enum lobe_kind)at->kind), "diffuse",
                          number(at->diffuse[0][0]), number(at->diffuse[1][0]), number(at->diffuse[2][0]));

    if (at->kind == LOBE_LAMBERT)
        return j;
    json_object_set_new(
        j, "specular",
        json_pack("[o, o, o]", number(at->specular[0][0]), number(at->specular[1][0]), number(at->specular[2][0])));
    json_object_set_new(j, at->kind == LOBE_PHONG ? "exponent" : "alpha", number(at->gloss[0]));
    return j;
}

static json_t *visibility_json(const struct inspect_result *a)
{
    static const char marks[] = { [INSPECT_BEHIND] = '-', [INSPECT_BLOCKED] = '#', [INSPECT_OPEN] = '.' };
    json_t *rows = json_array();

    for (uint32_t y = 0; y < INSPECT_MAP_HEIGHT; y++) {
        char row[INSPECT_MAP_WIDTH];
        for (uint32_t x = 0; x < INSPECT_MAP_WIDTH; x++)
            row[x] = marks[a->map[y][x]];
        json_array_append_new(rows, json_stringn(row, INSPECT_MAP_WIDTH));
    }
    return rows;
}

static json_t *point_json(const struct inspector *p, const struct inspect_result *a)
{
    const struct shade_packet *at = &a->lane0;
    json_t *j = json_pack("{s:i, s:b, s:o, s:o, s:o, s:o, s:o}", "index", (int)a->point, "behind", at->behind[0],
                          "weight", triple(a->weight), "position", vector(vec3_make(at->x[0], at->y[0], at->z[0])),
                          "normal", vector(vec3_make(at->ns_x[0], at->ns_y[0], at->ns_z[0])), "geometric_normal",
                          vector(vec3_make(at->ng_x[0], at->ng_y[0], at->ng_z[0])), "to_eye",
                          vector(vec3_make(at->wo_x[0], at->wo_y[0], at->wo_z[0])));

    json_object_set_new(j, "material", material_json(p->set->scene, at->material[0]));
    json_object_set_new(j, "lobe", lobe_json(at));
    json_object_set_new(j, "radiance", triple(a->lo));
    json_object_set_new(j, "reference", mean_json(&a->lo_reference));
    json_object_set_new(j, "open", small(a->open));
    json_object_set_new(j, "open_cosine", small(a->open_cosine));
    json_object_set_new(j, "visibility", visibility_json(a));
    return j;
}

/* The strata of one face, or the sun. */
static json_t *share_json(const struct direct_log *log, const char *name, uint32_t first, uint32_t last, double total)
{
    double share = 0.0, count = 0.0, energy = 0.0;
    int chosen = 0, effective = 0, visible = 0;

    for (uint32_t f = first; f < last; f++) {
        share += (double)log->share[f];
        count += (double)log->count[f];
        energy += log->energy[f];
    }
    for (uint32_t k = log->first[first]; k < log->first[last]; k++) {
        chosen += log->light[k].chosen;
        effective += log->light[k].effective;
        visible += log->light[k].visible;
    }
    return json_pack("{s:s, s:o, s:o, s:o, s:i, s:i, s:i, s:i}", "face", name, "share", number(share), "count",
                     number(count), "energy", number(total > 0.0 ? energy / total : 0.0), "generated",
                     (int)(log->first[last] - log->first[first]), "chosen", chosen, "effective", effective, "visible",
                     visible);
}

static json_t *shares_json(const struct direct_log *log)
{
    static const char *const names[] = { "+X", "-X", "+Y", "-Y", "+Z", "-Z" };
    const uint32_t cells = log->cells * log->cells;
    json_t *all = json_array();
    double total = 0.0;

    for (uint32_t f = 0; f < log->strata; f++)
        total += log->energy[f];
    for (uint32_t face = 0; face < CUBE_FACES && log->strata > 0; face++)
        json_array_append_new(all, share_json(log, names[face], face * cells, (face + 1) * cells, total));
    if (log->has_sun)
        json_array_append_new(all, share_json(log, "sun", log->strata - 1, log->strata, total));
    return all;
}

/* A sample that was not chosen is [x, y, z], a chosen one [x, y, z, state, beta, mis, r, g, b]. State 0: no cosine or
 * no light; 1: occluded; 2: contributes. r, g, b is the contribution without occlusion. */
static json_t *samples_json(const struct direct_log_sample *notes, uint32_t count, uint32_t samples)
{
    json_t *all = json_array();

    for (uint32_t k = 0; k < count; k++) {
        const struct direct_log_sample *n = &notes[k];
        json_t *one = json_pack("[o, o, o]", small(n->w[0]), small(n->w[1]), small(n->w[2]));
        if (n->chosen) {
            json_array_append_new(one, json_integer(n->visible ? 2 : n->effective ? 1 : 0));
            json_array_append_new(one, small(n->beta));
            json_array_append_new(one, small(n->mis));
            for (int c = 0; c < 3 && n->effective; c++)
                json_array_append_new(one, number(n->rgb[c] / (float)samples));
        }
        json_array_append_new(all, one);
    }
    return all;
}

static json_t *base64(const uint8_t *bytes, size_t size)
{
    struct text t = { .bytes = NULL };

    text_add_base64(&t, bytes, size);
    json_t *s = t.failed ? NULL : json_stringn(t.bytes, t.size);
    text_finish(&t);
    return s;
}

/* Filters the sky by a pixel's footprint, so that a small sun is not missed. */
static void paint_sky(struct inspector *p, const struct environment *e)
{
    const float width = (float)(PI / INSPECT_SKY_HEIGHT);

    environment_complete_pyramid(e);
#pragma omp parallel for schedule(static)
    for (uint32_t x = 0; x < INSPECT_SKY_WIDTH; x++) {
        const double phi = PI - 2.0 * PI * (x + 0.5) / INSPECT_SKY_WIDTH, sine = sin(phi), cosine = cos(phi);
        for (uint32_t y = 0; y < INSPECT_SKY_HEIGHT; y++) {
            const double up = p->row_cosine[y], r = sqrt(1.0 - up * up);
            environment_lookup_wide(e, vec3_make((float)(r * sine), (float)up, (float)(r * cosine)), width,
                                    p->sky + 3 * (y * INSPECT_SKY_WIDTH + x));
        }
    }
}

/* The sky image, with its own exposure. */
static json_t *sky_json(struct inspector *p, const struct environment *e)
{
    const uint8_t *bytes;
    double log2_mean = 0.0;
    size_t size;

    paint_sky(p, e);
    exposure_log2_mean(p->sky, NULL, INSPECT_SKY_WIDTH, INSPECT_SKY_HEIGHT, &log2_mean);
    const double gain = 0.18 * exp2(-log2_mean);
    const struct tone_desc tone = { gain, TONE_FILMIC, p->kernels->level };
    tone_map(p->sky, INSPECT_SKY_WIDTH, INSPECT_SKY_HEIGHT, &tone, p->display);
    if (jpeg_encode(p->jpeg, p->display, INSPECT_SKY_WIDTH, INSPECT_SKY_HEIGHT, 82, &bytes, &size))
        return NULL;
    return json_pack("{s:i, s:i, s:o, s:o}", "width", INSPECT_SKY_WIDTH, "height", INSPECT_SKY_HEIGHT, "gain",
                     number(gain), "jpeg", base64(bytes, size));
}

static const char *sees(const struct inspect_result *a)
{
    if (a->hit && a->first.delta != DELTA_NONE && !a->first.rough)
        return a->first.delta == DELTA_GLASS ? "glass" : "mirror";
    return a->points > 0 ? "surface" : a->misses > 0 ? "sky" : "nothing";
}

/* By class of light; those that the image does not have are left out. */
static json_t *parts_json(const struct inspect_parts *parts)
{
    static const char *const names[INSPECT_PARTS] = { "direct", "indirect", "caustics", "background" };
    json_t *all = parts->known ? json_object() : json_null();

    for (int k = 0; k < INSPECT_PARTS; k++) {
        if (!inspect_has_part(parts, (enum inspect_part)k))
            continue;
        json_t *one = mean_json(&parts->of[k]);
        json_object_set_new(one, "share", number(parts->share[k]));
        json_object_set_new(all, names[k], one);
    }
    return all;
}

static json_t *pixel_json(const struct inspect_result *a)
{
    return json_pack("{s:i, s:i, s:o, s:o, s:o, s:o}", "points", (int)a->points, "escapes", (int)a->misses, "radiance",
                     triple(a->radiance), "background", triple(a->background), "reference", mean_json(&a->reference),
                     "parts", parts_json(&a->parts));
}

static json_t *first_json(const struct inspector *p, const struct inspect_result *a)
{
    if (!a->hit)
        return json_null();
    return json_pack("{s:o, s:o, s:o}", "position", vector(a->first.surface.position), "normal",
                     vector(a->first.surface.shading), "material", material_json(p->set->scene, a->first.material));
}

/* Their part of the image. */
static json_t *lamps_json(const struct probe_lamps *l)
{
    const float s = (float)l->scale, part[3] = { s * l->rgb[0], s * l->rgb[1], s * l->rgb[2] };

    return json_pack("{s:o, s:o}", "scale", number(l->scale), "radiance", triple(part));
}

#define SUN_STEPS 288 /* of a day */

/* When the heaviest point sees the sun on this day: for each five minutes from midnight on "0" to "9", ninths of its
 * disc, and
 * "-" where it is below the horizon. */
static json_t *sunlight_json(const struct inspector *p, const struct inspect_request *q, const struct shade_packet *at)
{
    const struct sensor point = { vec3_make(at->x[0], at->y[0], at->z[0]),
                                  vec3_make(at->ns_x[0], at->ns_y[0], at->ns_z[0]) };
    const struct sun_day day = *q->day;
    char text[SUN_STEPS + 1] = "";
    double seen = 0.0, up = 0.0, share[SUN_STEPS];

#pragma omp parallel for schedule(dynamic, 8)
    for (int k = 0; k < SUN_STEPS; k++) {
        double w[3];
        sun_day_at(&day, 24.0 * (k + 0.5) / SUN_STEPS, w);
        share[k] = sunlight_share(p->set->scene, p->set->rays, &point, w);
        text[k] = w[1] > 0.0 ? (char)('0' + lround(9.0 * share[k])) : '-';
    }
    for (int k = 0; k < SUN_STEPS; k++) {
        up += text[k] != '-' ? 24.0 / SUN_STEPS : 0.0;
        seen += share[k] * 24.0 / SUN_STEPS;
    }
    return json_pack("{s:i, s:o, s:o, s:i, s:s}", "day", (day.day - 1) % 365 + 1, "hours", number(seen), "daylight",
                     number(up), "step_minutes", 24 * 60 / SUN_STEPS, "shares", text);
}

static json_t *report_json(struct inspector *p, const struct environment *e, const struct inspect_desc *d,
                           const struct inspect_request *q, const float *rgb, const struct probe_lamps *lamps)
{
    const struct inspect_result *a = &p->answer;
    const struct gbuffer *g = d->gbuffer;
    json_t *j = json_pack("{s:i, s:i, s:i, s:i, s:I, s:o, s:s, s:i, s:o, s:s}", "x", (int)q->x, "y", (int)q->y, "width",
                          (int)g->width, "height", (int)g->height, "frame", (json_int_t)e->number, "camera",
                          words_to_json(p->set->camera), "method", method_name(a->method), "samples", (int)a->samples,
                          "preset", q->figure ? json_string("fig1") : json_null(), "sees", sees(a));

    if (!j)
        return NULL;
    json_object_set_new(j, "unit", json_string(environment_unit(e)));
    json_object_set_new(j, "picture", rgb ? triple(rgb + 3 * ((size_t)q->y * g->width + q->x)) : json_null());
    json_object_set_new(j, "lamps", lamps ? lamps_json(lamps) : json_null());
    json_object_set_new(j, "pixel", q->figure ? json_null() : pixel_json(a));
    json_object_set_new(j, "first", first_json(p, a));
    json_object_set_new(j, "escape", a->misses > 0 ? vector(a->miss) : json_null());
    json_object_set_new(j, "point", a->points > 0 ? point_json(p, a) : json_null());
    json_object_set_new(j, "sunlight", q->day && a->points > 0 ? sunlight_json(p, q, &a->lane0) : json_null());
    json_object_set_new(j, "shares", shares_json(&a->log));
    json_object_set_new(j, "light", samples_json(a->log.light, a->log.light_count, a->samples));
    json_object_set_new(j, "lobes", samples_json(a->log.lobes, a->log.lobe_count, a->samples));
    json_object_set_new(j, "correction", triple(a->log.known));
    return j;
}

#define DUMP (JSON_COMPACT | JSON_REAL_PRECISION(7))

enum err inspector_report(struct inspector *p, const struct environment *e, const struct relight_desc *light,
                          const struct inspect_request *q, const float *rgb, const struct probe_lamps *lamps,
                          char **text)
{
    struct inspect_desc d = {
        .scene = p->set->scene,
        .view = &p->set->view,
        .gbuffer = p->set->gbuffer,
        .rays = p->set->rays,
        .environment = e,
        .direct = light->direct,
        .classes = light->classes,
        .x = q->x,
        .y = q->y,
        .figure = q->figure,
    };

    *text = NULL;
    if (q->samples > 0)
        d.direct.samples = q->samples;
    const enum err result = inspect_run(p->inspection, &d, &p->answer);
    if (result)
        return result;
    json_t *j = report_json(p, e, &d, q, rgb, lamps);
    if (j && q->sky)
        json_object_set_new(j, "sky", sky_json(p, e));
    *text = j ? json_dumps(j, DUMP) : NULL;
    if (*text && strlen(*text) > INSPECT_TEXT_MAX) {
        json_object_set_new(j, "sky", json_null());
        mem_free(*text);
        *text = json_dumps(j, DUMP);
    }
    json_decref(j);
    return *text ? ERR_OK : ERR_NOMEM;
}

enum err inspector_sky(struct inspector *p, const struct environment *e, char **text)
{
    json_t *j = json_pack("{s:I, s:o, s:o}", "frame", (json_int_t)e->number, "rotate_degrees",
                          number(e->rotation * 180.0 / PI), "sky", sky_json(p, e));

    *text = j ? json_dumps(j, DUMP) : NULL;
    json_decref(j);
    return *text ? ERR_OK : ERR_NOMEM;
}

enum err inspector_print(struct inspector *p, const struct environment *e, const struct relight_desc *light,
                         const struct inspect_request *q, const float *rgb, const struct probe_lamps *lamps,
                         struct reason *why)
{
    char *text;
    const enum err result = inspector_report(p, e, light, q, rgb, lamps, &text);

    if (result)
        return result == ERR_NOMEM ? err_say(why, result, "%s: out of memory for the probe report", e->name) : result;
    const bool failed = puts(text) == EOF || fflush(stdout) == EOF;
    mem_free(text);
    return failed ? err_say(why, ERR_IO, "cannot write to standard output") : ERR_OK;
}
