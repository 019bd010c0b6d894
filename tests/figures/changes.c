/* What an image of --method cached costs of which only a part of the sky has changed, relative to the same image
 * computed whole: processor time of one thread for lighting and resolving, in turns, and medians. Both must have the
 * same bits. */
#include "figure.h"

#include "base/mem.h"
#include "base/vec.h"
#include "light/estimators/kernels.h"
#include "light/frame/relight.h"

#include <math.h>
#include <omp.h>
#include <string.h>

#define TURNS_MAX 99

struct flags {
    const char *scene, *sky;
    uint32_t size[2], turns, samples;
    double share, factor;
};

static const struct setting rows[] = {
    { "scene", "FILE", "scene; without it the built-in one", NULL, ALL, TEXT, AT(scene) },
    { "sky", "S", "source of the sky, its first frame is used", "sky:", ALL, TEXT, AT(sky) },
    { "size", "WxH", "of the images, in pixels", "640x360", ALL, .type = SETTING_SIZE, AT(size) },
    { "turns", "N", "pictures of each kind, 1 to 99", "9", ALL, WHOLE(1, TURNS_MAX), AT(turns) },
    { "samples", "N", "of direct light", "64", ALL, WHOLE(1, 4096), AT(samples) },
    { "share", "S", "of the sphere that changes, 0.001 to 0.5", "0.1", ALL, REAL(0.001, 0.5), AT(share) },
    { "factor", "F", "by which its light changes", "0.8", ALL, REAL(0.0, 100.0), AT(factor) },
    { .name = NULL },
};

/* A cloud of `share` of the sphere passes: from the horizon to 60 degrees above it, opposite the brightest texel. */
static void change(struct frame *f, const struct flags *o)
{
    const uint32_t w = f->width, h = f->height, low = h / 2, high = h / 6;
    const uint32_t wide = (uint32_t)round(o->share * 2.0 / sin(PI / 3.0) * w);
    size_t most = 0;

    for (size_t i = 0; i < 3 * (size_t)w * h; i++)
        if (f->rgb[i] > f->rgb[most])
            most = i;
    const uint32_t middle = (uint32_t)(most / 3 % w) + w / 2;
    for (uint32_t y = high; y < low; y++)
        for (uint32_t x = 0; x < wide && x < w; x++)
            for (uint32_t c = 0; c < 3; c++)
                f->rgb[3 * ((size_t)y * w + (middle + x + w - wide / 2) % w) + c] *= (float)o->factor;
}

struct changes {
    struct prepared_scene *set;
    struct relighter *relighter[2]; /* of the changes, and of whole images */
    struct environment *sky[3];     /* and one that has nothing in common with them */
    float *rgb[2];
    size_t bytes;
};

static void set_up(struct changes *s, const struct flags *o)
{
    struct prepared_scene_desc desc = { .scene = o->scene, .width = o->size[0], .height = o->size[1] };
    struct frame frame = figure_frame(o->sky);
    struct reason why = { "" };

    if (frame.kind != FRAME_TEXELS)
        figure_must(err_say(&why, ERR_USAGE, "%s is no computed sky", o->sky), &why);
    for (int k = 0; k < 3; k++) {
        if (k == 1)
            change(&frame, o);
        for (size_t i = 0; i < 3 * (size_t)frame.width * frame.height && k == 2; i++)
            frame.rgb[i] = 1.0f + (float)(i % 7);
        s->sky[k] = figure_sky(&frame, true);
    }
    frame_finish(&frame);
    figure_must(kernels_select(NULL, &desc.kernels, &why), &why);
    figure_must(set_create(&desc, &s->set, &why), &why);
    s->bytes = (size_t)o->size[0] * o->size[1] * 3 * sizeof(float);
    s->rgb[0] = mem_alloc(s->bytes, 1);
    s->rgb[1] = mem_alloc(s->bytes, 1);
    for (int k = 0; k < 2; k++)
        s->relighter[k] = relighter_create(s->set, desc.kernels);
    figure_must(s->rgb[0] && s->rgb[1] && s->relighter[0] && s->relighter[1] ? ERR_OK : ERR_NOMEM, &why);
}

/* The image of a sky by one of the relighters: milliseconds. */
static double image(struct changes *s, const struct relight_desc *light, int by, int k, float *rgb,
                      struct relight_stats *stats)
{
    const double begun = 1e3 * figure_cpu_s();

    if (relighter_run(s->relighter[by], s->sky[k], light, rgb, stats))
        exit(1);
    return 1e3 * figure_cpu_s() - begun;
}

static bool compare(struct changes *s, const struct flags *o, uint32_t classes, const char *name)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = o->samples },
                                  .classes = classes,
                                  .cache_file = "" };
    double whole[TURNS_MAX], part[TURNS_MAX];
    struct relight_stats stats;
    bool same = true;

    for (int k = 0; k < 4; k++)
        image(s, &light, 0, k % 2, s->rgb[0], &stats);
    for (uint32_t k = 0; k < o->turns; k++) {
        part[k] = image(s, &light, 0, (int)(k % 2), s->rgb[0], &stats);
        image(s, &light, 1, 2, s->rgb[1], &stats);
        whole[k] = image(s, &light, 1, (int)(k % 2), s->rgb[1], &stats);
        if (stats.cache_frame.lit < stats.cache.packets)
            exit(1);
        same = same && memcmp(s->rgb[0], s->rgb[1], s->bytes) == 0;
    }
    const double a = figure_median(part, o->turns), b = figure_median(whole, o->turns);
    printf("%s: %.1f ms of %.1f, ratio %.3f; %s\n", name, a, b, a / b, same ? "the same bits" : "OTHER BITS");
    return same;
}

int main(int argc, char **argv)
{
    struct flags flags = { 0 };
    struct command command = {
        .name = "changes",
        .synopsis = "[flags]",
        .about = "Processor time of a cached image of which a part of the sky has changed, and of the whole image.",
        .lists = { { rows, &flags } },
    };
    struct changes s = { 0 };

    figure_begin(&command, argc, argv);
    omp_set_num_threads(1);
    set_up(&s, &flags);
    bool same = compare(&s, &flags, PATH_BACKGROUND | PATH_DIRECT, "direct light");
    same = compare(&s, &flags, PATH_ALL, "all light") && same;
    for (int k = 0; k < 2; k++) {
        relighter_destroy(s.relighter[k]);
        mem_free(s.rgb[k]);
    }
    set_destroy(s.set);
    for (int k = 0; k < 3; k++)
        environment_destroy(s.sky[k]);
    return same ? 0 : 1;
}
