/* Compares an image with a reference: means, relative squared error, visible error, and an error map. */
#include "base/file_store.h"
#include "base/log.h"
#include "base/luminance.h"
#include "base/mem.h"
#include "base/setting_table.h"
#include "base/text.h"
#include "base/vec.h"
#include "image/codec/decode.h"
#include "image/codec/encode.h"
#include "image/film/film.h"
#include "measure/compare/error_map.h"
#include "measure/compare/metrics.h"

#include <inttypes.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

enum bound {
    BOUND_MEAN,
    BOUND_RELMSE,
    BOUND_DELTA_E,
    BOUND_FLIP,
    BOUNDS,
};

struct diff {
    const char *names[2]; /* of the image and of the reference */
    struct image images[2];
    double trim, pixels_per_degree;
    uint8_t *mask;
    float *map;
    double means[2][4]; /* luminance, red, green, blue */
    struct metrics metrics;
    double flip;       /* mean */
    struct image half; /* with --half; images[1] is then the mean of both */
    struct metrics_halves halves;
    double half_flip; /* between the halves */
    bool json;
    const char *half_path, *mask_path, *map_path; /* NULL: none */
    struct setting_frames flicker;
    double bounds[BOUNDS]; /* INFINITY: none */
};

#define COMPARED .section = "comparison"
#define RESULT .section = "output"
#define BOUND(index) .section = "bounds: the exit code is 1 beyond any of them", REAL(0.0, 1e9), AT(bounds[index])
#define AT(field) SETTING_AT(diff, field)

static const struct setting rows[] = {
    { "mask", "FILE", "an image of the same size: its black pixels are left out", NULL, COMPARED, TEXT, AT(mask_path) },
    { "half", "FILE",
      "REFERENCE and FILE are two independent halves of the reference: its noise cancels in rel_mse_halves", NULL,
      COMPARED, TEXT, AT(half_path) },
    { "flicker", "A-B",
      "instead of comparing: second differences of the images A to B of a pattern such as p.%d.jpg, in 8-bit codes",
      NULL, COMPARED, .type = SETTING_FRAMES, AT(flicker) },
    { "trim", "SHARE", "share of the worst pixels that the second relMSE leaves out", "0.02", COMPARED, REAL(0.0, 1.0),
      AT(trim) },
    { "pixels-per-degree", "X", "viewing distance for FLIP, in pixels per degree", "67", COMPARED,
      REAL(1.0, FLIP_PIXELS_PER_DEGREE_MAX), AT(pixels_per_degree) },
    { "map", "FILE", "error of each pixel: .png in colours from 0.1 % to 100 %, .exr as squares", NULL, RESULT, TEXT,
      AT(map_path) },
    { "json", NULL, "print one JSON object instead of the table", NULL, RESULT, SWITCH, AT(json) },
    { "max-mean", "X", "on the mean ratio's distance from 1, such as 0.005", NULL, BOUND(BOUND_MEAN) },
    { "max-relmse", "X", "on the relMSE without the worst pixels, such as 1e-3", NULL, BOUND(BOUND_RELMSE) },
    { "max-delta-e", "X", "on the mean visible difference", NULL, BOUND(BOUND_DELTA_E) },
    { "max-flip", "X", "on the mean FLIP", NULL, BOUND(BOUND_FLIP) },
    { .name = NULL },
};

static enum err load(const char *path, struct image *im, struct reason *why)
{
    const enum err e = decode_file(path, im, why);
    if (e)
        return e;
    const struct image_faults *f = &im->faults;
    if (f->nan + f->infinite + f->negative > 0)
        log_warning("%s: corrected before comparing: %" PRIu64 " NaN, %" PRIu64 " infinite, %" PRIu64
                    " negative values",
                    path, f->nan, f->infinite, f->negative);
    return ERR_OK;
}

static enum err want_same_size(const char *name, const struct image *im, const char *other_name,
                               const struct image *other, struct reason *why)
{
    if (im->width == other->width && im->height == other->height)
        return ERR_OK;
    return err_say(why, ERR_RANGE, "%s is %" PRIu32 "x%" PRIu32 ", but %s is %" PRIu32 "x%" PRIu32, name, im->width,
                   im->height, other_name, other->width, other->height);
}

static enum err load_mask(struct diff *d, const char *path, struct reason *why)
{
    struct image im = { 0 };
    const size_t count = (size_t)d->images[1].width * d->images[1].height;
    enum err e = load(path, &im, why);

    if (!e)
        e = want_same_size(path, &im, d->names[1], &d->images[1], why);
    if (e)
        goto done;
    d->mask = mem_alloc(count, 1);
    if (!d->mask) {
        e = err_say(why, ERR_NOMEM, "%s: no memory for the mask", path);
        goto done;
    }
    for (size_t i = 0; i < count; i++)
        d->mask[i] = rgb_luminance(im.rgb[3 * i], im.rgb[3 * i + 1], im.rgb[3 * i + 2]) > 0.0f;
done:
    image_finish(&im);
    return e;
}

static void take_means(struct diff *d)
{
    const size_t count = (size_t)d->images[1].width * d->images[1].height;

    for (int n = 0; n < 2; n++) {
        double sum[3] = { 0.0, 0.0, 0.0 };
        for (size_t i = 0; i < count; i++)
            for (size_t k = 0; k < 3 && (!d->mask || d->mask[i]); k++)
                sum[k] += (double)d->images[n].rgb[3 * i + k];
        for (int k = 0; k < 3; k++)
            d->means[n][k + 1] = sum[k] / (double)d->metrics.pixels;
        d->means[n][0] = luminance_of(LUMINANCE_REC709, d->means[n] + 1);
    }
}

/* images[1] becomes the mean of both halves. */
static enum err compare_halves(struct diff *d, struct reason *why)
{
    struct image *r = &d->images[1];
    const size_t values = 3 * (size_t)r->width * r->height;
    enum err e = load(d->half_path, &d->half, why);

    if (!e)
        e = want_same_size(d->half_path, &d->half, d->names[1], r, why);
    if (e)
        return e;
    if (!metrics_halves(d->images[0].rgb, r->rgb, d->half.rgb, d->mask, r->width, r->height, &d->halves))
        return err_say(why, ERR_RANGE, "no pixel is left to compare: the mask is black, or the reference is");
    if (!flip_compare(d->half.rgb, r->rgb, d->mask, r->width, r->height, d->pixels_per_degree, NULL, &d->half_flip))
        return err_say(why, ERR_NOMEM, "no memory to compare the halves");
    for (size_t v = 0; v < values; v++)
        r->rgb[v] = 0.5f * (r->rgb[v] + d->half.rgb[v]);
    return ERR_OK;
}

static enum err compare(struct diff *d, struct reason *why)
{
    const uint32_t width = d->images[1].width, height = d->images[1].height;

    d->map = mem_alloc((size_t)width * height, sizeof(*d->map));
    if (!d->map)
        return err_say(why, ERR_NOMEM, "no memory for %" PRIu32 "x%" PRIu32 " errors", width, height);
    if (!metrics_compare(d->images[0].rgb, d->images[1].rgb, d->mask, width, height, d->trim, d->map, &d->metrics))
        return err_say(why, ERR_RANGE, "no pixel is left to compare: the mask is black, or out of memory");
    if (!flip_compare(d->images[0].rgb, d->images[1].rgb, d->mask, width, height, d->pixels_per_degree, NULL, &d->flip))
        return err_say(why, ERR_NOMEM, "no memory to compare %" PRIu32 "x%" PRIu32 " for FLIP", width, height);
    take_means(d);
    return ERR_OK;
}

/* The squares themselves, the same in all three channels. */
static enum err write_exr_map(const struct diff *d, const char *path, struct reason *why)
{
    const size_t count = (size_t)d->images[1].width * d->images[1].height;
    const struct exr_attribute attributes[] = { { "comments",
                                                  "relative squared error (x - r)^2 / (r^2 + 1e-2 mean(r)^2)" } };
    float *rgb = mem_alloc(count * 3, sizeof(*rgb));

    if (!rgb)
        return err_say(why, ERR_NOMEM, "%s: no memory for the error map", path);
    for (size_t i = 0; i < 3 * count; i++)
        rgb[i] = d->map[i / 3];
    const struct exr_desc desc = { .rgb = rgb,
                                   .width = d->images[1].width,
                                   .height = d->images[1].height,
                                   .attributes = attributes,
                                   .attribute_count = 1 };
    const enum err e = exr_write(&desc, path, why);
    mem_free(rgb);
    return e;
}

static enum err write_map(const struct diff *d, const char *path, struct reason *why)
{
    if (!path)
        return ERR_OK;
    if (text_ends_with(path, ".exr"))
        return write_exr_map(d, path, why);
    return error_map_write(d->map, d->mask, d->images[1].width, d->images[1].height, path, why);
}

/* Of what would be 0/0: 1, two black images are alike. */
static double ratio(double x, double r)
{
    return x == r ? 1.0 : x / r;
}

static void print_table(const struct diff *d)
{
    static const char *const names[] = { "luminance", "red", "green", "blue" };
    const struct metrics *m = &d->metrics;
    char trimmed[40];

    printf("%s\nagainst %s\n%" PRIu32 " x %" PRIu32 ", %" PRIu64 " pixels compared\n\n", d->names[0], d->names[1],
           d->images[1].width, d->images[1].height, m->pixels);
    printf("mean               image   reference       ratio\n");
    for (int i = 0; i < 4; i++)
        printf("%-12s %11.6g %11.6g %11.5f\n", names[i], d->means[0][i], d->means[1][i],
               ratio(d->means[0][i], d->means[1][i]));
    snprintf(trimmed, sizeof(trimmed), "  without the worst %.3g %%", 100.0 * d->trim);
    printf("\n%-26s%11.4g\n%-26s%11.4g\n", "relMSE", m->rel_mse, trimmed, m->rel_mse_trimmed);
    if (d->half_path)
        printf("%-26s%11.4g +- %.1g\n", "  crosswise, of halves", d->halves.rel_mse, d->halves.standard_error);
    printf("%-26s%11.4g\n", "delta E*ab, mean", m->delta_e);
    printf("%-26s%11.4g\n", "FLIP, mean", d->flip);
    if (d->half_path)
        printf("%-26s%11.4g\n", "  between the halves", d->half_flip);
}

/* JSON knows no infinity: null. */
static json_t *number(double x)
{
    return isfinite(x) ? json_real(x) : json_null();
}

static enum err print_json(const struct diff *d, struct reason *why)
{
    const struct metrics *m = &d->metrics;
    json_t *o = json_pack("{s:s, s:s, s:I, s:I, s:I, s:o, s:o, s:o, s:o, s:o, s:f, s:o, s:f}", "picture", d->names[0],
                          "reference", d->names[1], "width", (json_int_t)d->images[1].width, "height",
                          (json_int_t)d->images[1].height, "pixels", (json_int_t)m->pixels, "mean",
                          number(d->means[0][0]), "mean_reference", number(d->means[1][0]), "mean_ratio",
                          number(m->mean_ratio), "rel_mse", number(m->rel_mse), "rel_mse_trimmed",
                          number(m->rel_mse_trimmed), "trim", d->trim, "delta_e", number(m->delta_e), "flip", d->flip);

    if (d->half_path)
        json_object_update_new(o, json_pack("{s:o, s:o, s:f}", "rel_mse_halves", number(d->halves.rel_mse),
                                            "rel_mse_halves_error", number(d->halves.standard_error), "flip_halves",
                                            d->half_flip));
    /* names that are no UTF-8 cannot stand in JSON */
    if (!o || json_dumpf(o, stdout, JSON_PRESERVE_ORDER | JSON_REAL_PRECISION(9)) != 0) {
        json_decref(o);
        return err_say(why, ERR_FORMAT, "the result cannot be written as JSON: is a file name not UTF-8?");
    }
    putchar('\n');
    json_decref(o);
    return ERR_OK;
}

/* Prints each exceeded bound and returns how many there are. NaN exceeds every bound. */
static int exceeded(const struct diff *d)
{
    static const char *const names[BOUNDS] = { "mean ratio off by", "relMSE without the worst", "delta E*ab", "FLIP" };
    const double values[BOUNDS] = { fabs(d->metrics.mean_ratio - 1.0), d->metrics.rel_mse_trimmed, d->metrics.delta_e,
                                    d->flip };
    int count = 0;

    for (int i = 0; i < BOUNDS; i++) {
        if (isfinite(d->bounds[i]) && !(values[i] <= d->bounds[i])) {
            log_error("%s %.4g exceeds %.4g", names[i], values[i], d->bounds[i]);
            count++;
        }
    }
    return count;
}

/* The image as codes; decoding has made them linear light. */
static enum err load_codes(const char *path, struct image *im, uint8_t **codes, struct reason *why)
{
    const enum err e = decode_file(path, im, why);
    const size_t values = 3 * (size_t)im->width * im->height;

    if (e)
        return e;
    mem_free(*codes);
    *codes = mem_alloc(values, 1);
    if (!*codes)
        return err_say(why, ERR_NOMEM, "%s: out of memory", path);
    for (size_t v = 0; v < values; v++)
        (*codes)[v] = (uint8_t)lrint(255.0 * srgb_encode(fmin((double)im->rgb[v], 1.0)));
    return ERR_OK;
}

/* Numbers without a file interrupt the sequence: only three images in a row count. */
static enum err measure_flicker(const struct diff *d, struct flicker *f, struct reason *why)
{
    struct image im = { 0 };
    uint8_t *codes[3] = { NULL };
    char path[4096];
    struct file_pattern pattern;
    uint64_t in_row = 0;
    size_t values = 0;
    enum err e = file_pattern_parse(d->names[0], "--flicker", &pattern, why);

    for (uint64_t n = d->flicker.first; n <= d->flicker.last && !e; n++) {
        uint8_t *oldest = codes[2];
        if (file_pattern_name(&pattern, n, path, sizeof(path), why) || access(path, F_OK) != 0) {
            in_row = 0;
            continue;
        }
        codes[2] = codes[1];
        codes[1] = codes[0];
        codes[0] = oldest;
        e = load_codes(path, &im, &codes[0], why);
        in_row = 3 * (size_t)im.width * im.height == values ? in_row + 1 : 1;
        values = 3 * (size_t)im.width * im.height;
        if (!e && in_row >= 3)
            flicker_add(f, codes[0], codes[1], codes[2], values);
    }
    for (int k = 0; k < 3; k++)
        mem_free(codes[k]);
    image_finish(&im);
    return e || f->triples > 0 ? e : err_say(why, ERR_RANGE, "%s: no three images in a row", d->names[0]);
}

static enum err run_flicker(const struct diff *d, struct reason *why)
{
    static struct flicker f;
    static const double shares[] = { 0.5, 0.9, 0.99, 0.999, 1.0 };
    const enum err e = measure_flicker(d, &f, why);

    if (e)
        return e;
    printf(d->json ? "{\"triples\": %" PRIu64 ", \"percentiles\": {"
                   : "%" PRIu64 " times three images in a row; codes\n",
           f.triples);
    for (size_t i = 0; i < sizeof(shares) / sizeof(shares[0]); i++)
        printf(d->json ? "%s\"%g\": %d" : "%s%7g %% at most %d\n", d->json && i > 0 ? ", " : "", 100.0 * shares[i],
               flicker_percentile(&f, shares[i]));
    fputs(d->json ? "}}\n" : "", stdout);
    return ERR_OK;
}

/* Checks everything on the command line before any file is opened. */
static enum err read_options(const struct command *c, struct diff *d, struct reason *why)
{
    for (int i = 0; i < BOUNDS; i++)
        d->bounds[i] = INFINITY;
    const enum err e = command_read(c, why);
    if (!e && c->operand_count != (d->flicker.given ? 1 : 2))
        return err_say(why, ERR_USAGE,
                       "expected two images, PICTURE and REFERENCE, or a pattern with --flicker (see %s --help)",
                       c->name);
    d->names[0] = c->operands[0];
    d->names[1] = c->operands[1];
    if (!e && d->map_path && !text_ends_with(d->map_path, ".png") && !text_ends_with(d->map_path, ".exr"))
        return err_say(why, ERR_USAGE, "--map '%s' ends neither in .png nor in .exr", d->map_path);
    return e;
}

static enum err run(const struct command *c, struct diff *d, struct reason *why)
{
    enum err e = read_options(c, d, why);

    if (!e && d->flicker.given)
        return run_flicker(d, why);
    for (int i = 0; i < 2 && !e; i++)
        e = load(d->names[i], &d->images[i], why);
    if (!e)
        e = want_same_size(d->names[0], &d->images[0], d->names[1], &d->images[1], why);
    if (!e && d->mask_path)
        e = load_mask(d, d->mask_path, why);
    if (!e && d->half_path)
        e = compare_halves(d, why);
    if (!e)
        e = compare(d, why);
    if (!e)
        e = write_map(d, d->map_path, why);
    if (e)
        return e;
    if (d->json)
        return print_json(d, why);
    print_table(d);
    return ERR_OK;
}

int main(int argc, char **argv)
{
    struct diff d = { 0 };
    struct command command = {
        .name = "relight-diff",
        .synopsis = "PICTURE REFERENCE [--half FILE] [--map FILE] [--max-relmse X] ...",
        .about = "Compares two linear images (OpenEXR or Radiance .hdr): the ratio of their means, relMSE = mean((x "
                 "- r)^2 /\n"
                 "(r^2 + 0.01 mean(r)^2)) over channels and pixels, and, after one tone map on both (filmic, the "
                 "reference's\n"
                 "log-average at 0.18), the mean CIE76 delta E*ab and FLIP, what an eye notices that sees both in turn "
                 "(0 to 1).\n"
                 "Exit code: 0, 1 beyond a bound or on failure, 2 usage.",
        .lists = { { rows, &d } },
        .operand_max = 2,
    };
    struct reason why = { "" };
    bool done = false;
    int code = 0;

    log_init(command.name, LOG_INFO);
    command_begin(&command);
    enum err e = command_parse(&command, argc, argv, &done, &why);
    if (!e && done)
        return 0;
    if (!e)
        e = run(&command, &d, &why);
    if (e) {
        log_error("%s", why.text[0] ? why.text : err_text(e));
        code = err_exit_code(e);
    } else if (!d.flicker.given && exceeded(&d) > 0) {
        code = 1;
    }
    mem_free(d.map);
    mem_free(d.mask);
    image_finish(&d.images[0]);
    image_finish(&d.images[1]);
    image_finish(&d.half);
    return code;
}
