#include "sky/tables/environment.h"

#include "base/log.h"
#include "base/mem.h"
#include "base/rng.h"
#include "sky/tables/layout.h"
#include "sky/tables/pyramid.h"
#include "sky/tables/resample.h"
#include "sky/tables/sky_table.h"

#include <assert.h>
#include <inttypes.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

#define DEFAULT_N 256 /* of a cube face: the resolution of a lat-long map of 1024 x 512 */
#define MAX_N 1024    /* bounds tables, and arrays on the stack */
#define BAND 8        /* rows of a face per band, as in resample.h */
#define SAID_STRETCHED (IMAGE_SAID_LAST << 1)
#define SAID_SUNLESS (IMAGE_SAID_LAST << 2)

/* The state of deferred work (see lean). */
struct environment_rest {
    pthread_mutex_t lock; /* held while completing */
    atomic_bool made, pyramid_made;
};

struct environment *environment_create(const struct environment_desc *desc)
{
    const uint32_t n = desc->n ? desc->n : DEFAULT_N;
    const size_t texels = (size_t)CUBE_FACES * n * n;

    if (n > MAX_N)
        return NULL;
    struct environment *e = mem_alloc(1, sizeof(*e));
    if (!e)
        return NULL;
    e->n = n;
    e->tables = desc->tables;
    /* What the first frame writes takes no memory before: a server has environments that it may never need. */
    e->texels = mem_alloc_large_raw(texels, sizeof(*e->texels));
    e->row_cdf = mem_alloc_large_raw(texels, sizeof(*e->row_cdf));
    e->face_cdf = mem_alloc((size_t)CUBE_FACES * n, sizeof(*e->face_cdf));
    e->solid_angle = mem_alloc_raw((size_t)n * n, sizeof(*e->solid_angle));
    e->rest = mem_alloc(1, sizeof(*e->rest));
    if (e->rest)
        pthread_mutex_init(&e->rest->lock, NULL);
    if (!e->texels || !e->row_cdf || !e->face_cdf || !e->solid_angle || !e->rest) {
        environment_destroy(e);
        return NULL;
    }
    assert(!desc->like || desc->like->n == n);
    if (desc->like)
        memcpy(e->solid_angle, desc->like->solid_angle, (size_t)n * n * sizeof(*e->solid_angle));
    else
        cube_solid_angles(n, e->solid_angle);
    e->pyramid = desc->like ? pyramid_create_like(desc->like->pyramid) : pyramid_create(n, e->solid_angle);
    if (!e->pyramid) {
        environment_destroy(e);
        return NULL;
    }
    environment_configure(e, desc);
    return e;
}

void environment_release_memory(struct environment *e)
{
    e->ready = false;
    image_finish(&e->image);
    image_finish(&e->face);
    resampler_destroy(e->resampler);
    e->resampler = NULL;
    mem_trim();
}

void environment_destroy(struct environment *e)
{
    if (!e)
        return;
    environment_release_memory(e);
    mem_free(e->texels);
    mem_free(e->row_cdf);
    mem_free(e->face_cdf);
    mem_free(e->solid_angle);
    pyramid_destroy(e->pyramid);
    if (e->rest)
        pthread_mutex_destroy(&e->rest->lock);
    mem_free(e->rest);
    mem_free(e);
}

void environment_configure(struct environment *e, const struct environment_desc *desc)
{
    e->layout = desc->layout;
    e->rotation = e->configured = desc->rotation_degrees * PI / 180.0;
    e->sun_azimuth = desc->sun_azimuth;
    e->gain = (float)exp2(desc->scale_stops);
    e->calibrated = desc->calibrated;
    e->lean = desc->lean;
    e->decoder = desc->decoder;
    e->max_side = desc->max_side;
    e->layer = desc->layer;
}

/* Layouts take precedence in this order: the user's, the sender's, the file's. A sender's "" has no meaning. Neither
 * does "auto", except that texels are then not assumed to be lat-long. */
static enum err take_layout(struct environment *e, const struct frame *f, struct reason *why)
{
    struct reason fault;
    int layout;

    if (!f->layout[0])
        return ERR_OK;
    if (choice_parse(layout_choices, 0, "layout", f->layout, &layout, &fault))
        return err_say(why, ERR_FORMAT, "%s: %s", f->name, fault.text);
    if (layout != LAYOUT_AUTO || f->kind == FRAME_TEXELS)
        e->image.layout = (enum layout)layout;
    return ERR_OK;
}

static void add_faults(struct image_faults *to, const struct image_faults *more)
{
    to->nan += more->nan;
    to->infinite += more->infinite;
    to->negative += more->negative;
    to->clipped += more->clipped;
}

/* Copies one of six face files to its place in OpenEXR's cube; the first face sets the size. Graphics libraries name
 * faces so that px is to the right of pz, seen from inside, as in a horizontal cross: with pz at +Z that is -X. Their
 * py and ny, rotated by 180 degrees, are OpenEXR's. */
static enum err place_face(struct image *cube, struct image *face, uint32_t k, const char *name, struct reason *why)
{
    static const uint32_t slot[CUBE_FACES] = { 1, 0, 2, 3, 4, 5 };
    const uint32_t size = face->width;

    const enum err e = k == 0 && size == face->height ? image_resize(cube, size, CUBE_FACES * size) : ERR_OK;
    if (e)
        return err_say(why, e, "%s: too large: six faces of %ux%u texels", name, size, size);
    if (size != face->height || size != cube->width || CUBE_FACES * size != cube->height)
        return err_say(why, ERR_FORMAT, "%s: %ux%u texels; the face must be square and as large as the first", name,
                       size, face->height);
    const size_t texels = (size_t)size * size;
    float *to = cube->rgb + 3 * texels * slot[k];
    if (k == 2 || k == 3)
        for (size_t t = 0; t < texels; t++)
            memcpy(to + 3 * t, face->rgb + 3 * (texels - 1 - t), 3 * sizeof(float));
    else
        memcpy(to, face->rgb, 3 * texels * sizeof(float));
    add_faults(&cube->faults, &face->faults);
    return ERR_OK;
}

static enum err decode(const struct environment *e, const uint8_t *bytes, size_t size, const char *name,
                       struct image *im, struct reason *why)
{
    return e->decoder ? e->decoder->decode(e->decoder->context, bytes, size, name, im, why)
                      : decode_image(bytes, size, name, im, why);
}

static enum err decode_faces(struct environment *e, const struct frame *f, struct reason *why)
{
    static const char *const names[CUBE_FACES] = { "px", "nx", "py", "ny", "pz", "nz" };
    char name[sizeof(f->name) + 16];
    enum err result = ERR_OK;
    size_t at = 0;

    for (uint32_t k = 0; k < CUBE_FACES && !result; at += f->faces[k++]) {
        snprintf(name, sizeof(name), "%s (face %s)", f->name, names[k]);
        result = decode(e, f->bytes + at, f->faces[k], name, &e->face, why);
        if (!result)
            result = place_face(&e->image, &e->face, k, name, why);
    }
    e->image.layout = LAYOUT_CUBE;
    e->image.low_range = e->face.low_range;
    e->image.taken_us = e->face.taken_us;
    e->image.exposure_s = e->face.exposure_s;
    memcpy(e->image.note, e->face.note, sizeof(e->image.note));
    return result;
}

/* Copies row by row, sanitising each row while it is in the cache. A copy is needed because the frame may be processed
 * again with another rotation while the source is paused. */
static void take_texels(struct image *im, const struct frame *f)
{
    const size_t row = 3 * (size_t)f->width;

    for (size_t at = 0; at < row * f->height; at += row) {
        memcpy(im->rgb + at, f->rgb + at, row * sizeof(float));
        image_sanitise_texels(im->rgb + at, f->width, NULL, &im->faults);
    }
    image_mend(im);
    im->layout = LAYOUT_LATLONG;
    im->low_range = false;
}

enum err environment_decode(struct environment *e, const struct frame *f, struct reason *why)
{
    enum err result = ERR_OK;

    e->ready = false;
    e->image.max_side = e->face.max_side = e->max_side;
    e->image.layer = e->face.layer = e->layer;
    if (f->kind == FRAME_FILE && f->faces[0]) {
        result = decode_faces(e, f, why);
    } else if (f->kind == FRAME_FILE) {
        result = decode(e, f->bytes, f->size, f->name, &e->image, why);
    } else if (f->kind == FRAME_TEXELS) {
        result = image_check_size(&e->image, f->width, f->height, f->name, why);
        if (result)
            return result;
        result = image_resize(&e->image, f->width, f->height);
        if (result)
            return err_say(why, result, "%s: too large: an image of %ux%u texels", f->name, f->width, f->height);
        take_texels(&e->image, f);
    } else {
        return err_say(why, ERR_FORMAT, "%s: the frame is empty", f->name);
    }
    if (!result)
        result = take_layout(e, f, why);
    if (result)
        return result;
    image_trim(&e->image);
    image_trim(&e->face);
    e->placed = f->placed;
    e->rotation = e->configured + f->turn * PI / 180.0;
    e->units = f->units;
    e->number = f->number;
    e->capture_us = f->capture_us;
    memcpy(e->name, f->name, sizeof(e->name));
    return ERR_OK;
}

const char *environment_unit(const struct environment *e)
{
    return e->calibrated || fabs(e->units * (double)e->gain - 1.0) < 1e-6 ? "W sr^-1 m^-2" : "relative";
}

/* The user's choice, unless the texels were made here, else the file's, else from the aspect ratio. */
static enum err choose_layout(const struct environment *e, enum layout *out, struct reason *why)
{
    const uint32_t w = e->image.width, h = e->image.height;

    *out = e->layout != LAYOUT_AUTO && !e->placed ? e->layout : e->image.layout;
    return *out == LAYOUT_AUTO ? layout_guess(w, h, e->name, out, why) : layout_fits(*out, w, h, e->name, why);
}

static enum err match_resampler(struct environment *e, enum layout layout, struct reason *why)
{
    const struct resample_key key = { layout, e->image.width, e->image.height, e->n, e->rotation };

    if (e->resampler && resample_key_equal(&e->resampler->table->key, &key))
        return ERR_OK;
    resampler_destroy(e->resampler);
    e->resampler = NULL;
    const enum err result = resampler_create(e->tables, &key, &e->resampler);
    return result ? err_say(why, result, "%s: out of memory for resampling %ux%u texels", e->name, e->image.width,
                            e->image.height)
                  : ERR_OK;
}

/* Stores a row's radiance and density. weight: luminance x solid angle. */
static inline void weigh_row(const struct environment *e, const float *from, const double *solid_angle, struct texel *t,
                             double *weight)
{
    const uint32_t n = e->n;
    const double per_uv = 0.25 * n * n;

    for (uint32_t j = 0; j < n; j++) {
        const float r = from[4 * j], g = from[4 * j + 1], b = from[4 * j + 2];
        weight[j] = rgb_luminance(r, g, b) * solid_angle[j];
        t[j] = (struct texel){ r, g, b, (float)(weight[j] * per_uv) };
    }
}

/* CDFs along all rows of a band [LPG13, 2.2], interleaved, because each running sum has a serial dependency. */
static inline void sum_rows(double *cdf, uint32_t n, uint32_t rows, double *whole)
{
    double sum[BAND] = { 0.0 };

    for (uint32_t j = 0; j < n; j++)
        for (uint32_t i = 0; i < rows; i++)
            cdf[(size_t)i * n + j] = sum[i] += cdf[(size_t)i * n + j];
    for (uint32_t i = 0; i < rows; i++)
        whole[i] = sum[i];
}

static void sum_band(double *cdf, uint32_t n, uint32_t rows, double *whole)
{
    if (rows == BAND)
        sum_rows(cdf, n, BAND, whole);
    else
        sum_rows(cdf, n, rows, whole);
}

/* Builds rows 8 b .. of a face: texels, densities, CDFs and, while they are in the cache, their part of the pyramid. */
static void rebuild_band(struct environment *e, uint32_t face, uint32_t b)
{
    const uint32_t n = e->n, i0 = BAND * b, rows = n - i0 < BAND ? n - i0 : BAND, row = face * n + i0;
    _Alignas(64) float light[4 * BAND * RESAMPLE_PITCH(MAX_N)];
    double weight[BAND * MAX_N], *cdf = e->lean ? weight : e->row_cdf + (size_t)row * n;

    resampler_band(e->resampler, e->gain, face, b, light);
    for (uint32_t i = 0; i < rows; i++) {
        const float *from = light + 4 * (size_t)i * RESAMPLE_PITCH(n);
        const double *solid_angle = e->solid_angle + (size_t)(i0 + i) * n;
        struct texel *t = e->texels + (size_t)(row + i) * n;
        weigh_row(e, from, solid_angle, t, cdf + (size_t)i * n);
    }
    sum_band(cdf, n, rows, e->face_cdf + row);
    if (!e->lean)
        pyramid_band(e->pyramid, face, b);
}

/* From the totals of rows, which face_cdf holds, to its sums and the energies. */
static void sum_faces(struct environment *e)
{
    const uint32_t n = e->n;

    e->total_energy = 0.0;
    for (uint32_t f = 0; f < CUBE_FACES; f++) {
        double sum = 0.0;
        for (uint32_t i = 0; i < n; i++)
            e->face_cdf[(size_t)f * n + i] = sum += e->face_cdf[(size_t)f * n + i];
        e->energy[f] = sum;
        e->total_energy += sum;
    }
    e->ready = true;
}

static enum err rebuild(struct environment *e, struct reason *why)
{
    const uint32_t n = e->n, bands = (n + BAND - 1) / BAND;
    enum layout layout;

    enum err result = choose_layout(e, &layout, why);
    if (!result)
        result = match_resampler(e, layout, why);
    if (result)
        return result;
    resampler_load(e->resampler, e->image.rgb);
    if (!e->lean)
        pyramid_begin(e->pyramid, &e->texels->r);
#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t k = 0; k < CUBE_FACES * bands; k++)
        rebuild_band(e, k / bands, k % bands);
    if (!e->lean)
        pyramid_end(e->pyramid);
    atomic_store(&e->rest->made, !e->lean);
    atomic_store(&e->rest->pyramid_made, !e->lean);
    sum_faces(e);
    return ERR_OK;
}

enum err environment_rebuild(struct environment *e, struct reason *why)
{
    struct sun_place sun;
    const enum err result = rebuild(e, why);

    e->sunless = !result && e->sun_azimuth > 0.0 && !sky_find_sun(e, &sun);
    if (result || e->sun_azimuth <= 0.0 || e->sunless)
        return result;
    e->rotation = remainder(e->rotation + (sun.azimuth - e->sun_azimuth) * PI / 180.0, 2.0 * PI);
    return rebuild(e, why);
}

/* ---- Faces of another process ---- */

void environment_get_faces(const struct environment *e, float *rgb)
{
    for (size_t k = 0; k < (size_t)CUBE_FACES * e->n * e->n; k++)
        memcpy(rgb + 3 * k, &e->texels[k].r, 3 * sizeof(*rgb));
}

void environment_set_faces(struct environment *e, const float *rgb)
{
    const uint32_t n = e->n;

#pragma omp parallel for schedule(static)
    for (uint32_t row = 0; row < CUBE_FACES * n; row++) {
        double sum = 0.0;
        for (uint32_t j = 0; j < n; j++) {
            const size_t at = (size_t)row * n + j;
            const float r = rgb[3 * at], g = rgb[3 * at + 1], b = rgb[3 * at + 2];
            const double weight = rgb_luminance(r, g, b) * e->solid_angle[(size_t)(row % n) * n + j];
            e->texels[at] = (struct texel){ r, g, b, (float)(weight * (0.25 * n * n)) };
            sum += weight;
        }
        e->face_cdf[row] = sum;
    }
    atomic_store(&e->rest->made, false);
    atomic_store(&e->rest->pyramid_made, false);
    sum_faces(e);
}

bool environment_is_latlong(const struct environment *e)
{
    const enum layout layout = e->resampler->table->key.layout;

    return layout == LAYOUT_LATLONG || layout == LAYOUT_LATLONG_BOTTOM_FIRST;
}

bool environment_is_complete(const struct environment *e)
{
    return atomic_load(&e->rest->made);
}

bool environment_has_pyramid(const struct environment *e)
{
    return atomic_load(&e->rest->pyramid_made);
}

/* Completes rows 8 b .. of a face from their texels. */
static void complete_band(const struct environment *e, uint32_t face, uint32_t b)
{
    const uint32_t n = e->n, i0 = BAND * b, rows = n - i0 < BAND ? n - i0 : BAND, row = face * n + i0;
    double *cdf = e->row_cdf + (size_t)row * n, whole[BAND];

    for (uint32_t i = 0; i < rows; i++)
        for (uint32_t j = 0; j < n; j++) {
            const struct texel *t = &e->texels[(size_t)(row + i) * n + j];
            cdf[(size_t)i * n + j] = rgb_luminance(t->r, t->g, t->b) * e->solid_angle[(size_t)(i0 + i) * n + j];
        }
    sum_band(cdf, n, rows, whole);
}

/* Completes a lean rebuild: the pyramid and, with `tables`, the CDFs. */
static void complete(const struct environment *e, bool tables)
{
    const uint32_t bands = (e->n + BAND - 1) / BAND;
    const bool pyramid = !environment_has_pyramid(e);

    if (pyramid)
        pyramid_begin(e->pyramid, &e->texels->r);
#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t k = 0; k < CUBE_FACES * bands; k++) {
        if (tables)
            complete_band(e, k / bands, k % bands);
        if (pyramid)
            pyramid_band(e->pyramid, k / bands, k % bands);
    }
    if (pyramid)
        pyramid_end(e->pyramid);
    atomic_store(&e->rest->pyramid_made, true);
    if (tables)
        atomic_store(&e->rest->made, true);
}

void environment_complete_pyramid(const struct environment *e)
{
    if (environment_has_pyramid(e))
        return;
    pthread_mutex_lock(&e->rest->lock);
    if (!environment_has_pyramid(e))
        complete(e, false);
    pthread_mutex_unlock(&e->rest->lock);
}

void environment_complete(const struct environment *e)
{
    if (environment_is_complete(e))
        return;
    pthread_mutex_lock(&e->rest->lock);
    if (!environment_is_complete(e))
        complete(e, true);
    pthread_mutex_unlock(&e->rest->lock);
}

enum err environment_update(struct environment *e, const struct frame *f, struct reason *why)
{
    const enum err result = environment_decode(e, f, why);
    return result ? result : environment_rebuild(e, why);
}

void environment_report(const struct environment *e, unsigned *said)
{
    const struct image *im = &e->image;
    const bool stretched = (e->layout == LAYOUT_LATLONG || e->layout == LAYOUT_LATLONG_BOTTOM_FIRST) &&
                           im->layout != LAYOUT_LATLONG && im->width != 2 * im->height;

    if (stretched && !(*said & SAID_STRETCHED))
        log_warning("%s: %ux%u is not 2:1, the aspect ratio of a lat-long image: it is stretched", e->name, im->width,
                    im->height);
    if (e->sunless && !(*said & SAID_SUNLESS))
        log_warning("%s: no sun is found in it for --sun-azimuth to turn: --rotate DEGREES turns any map", e->name);
    *said |= (stretched ? SAID_STRETCHED : 0) | (e->sunless ? SAID_SUNLESS : 0);
    image_report(im, e->name, said);
}

uint32_t environment_evaluate(const struct environment *e, const float w[3], float rgb[3], float *pdf)
{
    float u, v;
    const uint32_t at = cube_texel(e->n, w, &u, &v), face = at / (e->n * e->n);
    const struct texel *t = &e->texels[at];

    rgb[0] = t->r;
    rgb[1] = t->g;
    rgb[2] = t->b;
    *pdf = e->energy[face] > 0.0 ? t->density * cube_jacobian(u, v) / (float)e->energy[face] : 0.0f;
    return face;
}

uint64_t environment_digest(const struct environment *e)
{
    uint64_t out = rng_mix(e->n, 0);

    for (int f = 0; f < CUBE_FACES; f++) {
        uint64_t bits;
        memcpy(&bits, &e->energy[f], sizeof(bits));
        out = rng_mix(out, bits);
    }
    return out;
}
