/* [DH09, Fig. 5] again: how far each technique's caustics are from the truth after equal time. Each gets the samples
 * that it can take in the same CPU time; runs are interleaved, one seed each, so that a noisy machine does not decide.
 *
 * Two figures stand for each: the median over the runs, which is what one image mostly shows, and the mean, which is
 * the relMSE that the estimator has by definition. Where a technique meets the sun by accident the two differ: few
 * images have nearly all of the error, in single pixels of enormous value. Error x time is the figure that does not
 * depend on the time taken, as long as error falls with its inverse: for the means. */
#include "figure.h"

#include "light/estimators/seen_caustics.h"
#include "light/frame/frame_plan.h"

#include <inttypes.h>
#include <omp.h>

#define RUNS_MAX 99

static const double shares[] = { 0.05, 0.1, 0.25, 0.5 }; /* regions: caustics' least part of a pixel's light */
#define REGIONS (sizeof(shares) / sizeof(shares[0]))

struct measured {
    uint32_t samples; /* in each run */
    double seconds[RUNS_MAX], error[REGIONS][RUNS_MAX];
    uint64_t rays;
};

struct figure {
    struct seen seen;
    struct relighter *relighter;
    bool whole;
    uint32_t particles; /* a pixel for each eye path */
    float *rgb;
    uint8_t *region[REGIONS];
    uint32_t count[REGIONS];
    struct measured measured[SEEN_BY_COUNT];
};

struct flags {
    const char *scene, *sky;
    uint32_t size[2], runs, particles, reference, threads, samples;
    double seconds;
    bool whole;
};

static const struct setting rows[] = {
    { "scene", "FILE", "scene with mirrors or glass", RING, ALL, TEXT, AT(scene) },
    { "sky", "S", "source of the light, its first frame is used", "sky:sun_ratio=1000", ALL, TEXT, AT(sky) },
    { "size", "WxH", "of the images, in pixels", "320x180", ALL, .type = SETTING_SIZE, AT(size) },
    { "runs", "N", "interleaved runs, 1 to 99", "9", ALL, WHOLE(1, RUNS_MAX), AT(runs) },
    { "seconds", "T", "CPU time of each technique in a run, 0.01 to 1000", "4", ALL, REAL(0.01, 1000.0), AT(seconds) },
    { "samples", "N", "of each technique in a run, for a second row as in the figure; 0: none", "0", ALL,
      WHOLE(0, 1000000), AT(samples) },
    { "whole", NULL, "all light, by the program's own frame: direct light and eye paths beside the caustics", NULL, ALL,
      SWITCH, AT(whole) },
    { "particles", "N", "of --whole's light tracer, a pixel for each eye path", "1", ALL, WHOLE(1, 1000),
      AT(particles) },
    { "reference", "N", "particles a pixel of the truth", "1000", ALL, WHOLE(4, 1000000), AT(reference) },
    { "threads", "N", "1: times are the techniques' own; 0: as many as there are processors", "1", ALL, WHOLE(0, 1024),
      AT(threads) },
    { .name = NULL },
};

/* All light: the program's frame with 8 samples of direct light and so many particles for each eye path. Its points lie
 * in the pixels' centres, which after long times is the error that is left. */
static uint64_t render_whole(struct figure *f, enum seen_by by, uint32_t samples, uint64_t seed)
{
    const struct relight_desc d = {
        .direct = { .method = by == SEEN_PATH  ? METHOD_PATH
                              : by == SEEN_MLT ? METHOD_MLT
                                               : METHOD_MIS,
                    .samples = by == SEEN_PATH || by == SEEN_MLT ? samples : 8 * samples,
                    .seed = seed },
        .classes = PATH_ALL,
        .caustics = by == SEEN_EYE ? PLAN_EYE : PLAN_LIGHT,
        .indirect = PLAN_EYE,
        .particles = (uint64_t)f->particles * samples * f->seen.pixels,
    };
    const struct reason none = { { 0 } };
    struct relight_stats stats;

    seen_must(relighter_run(f->relighter, f->seen.environment, &d, f->rgb, &stats), &none);
    return stats.reference_rays + stats.direct.rays + stats.eye.rays + stats.light.rays;
}

static uint64_t render(struct figure *f, enum seen_by by, uint32_t samples, uint64_t seed, double *seconds)
{
    const double begun = figure_cpu_s();
    const uint64_t rays =
        f->whole ? render_whole(f, by, samples, seed) : seen_caustics(&f->seen, by, samples, seed, f->rgb);

    *seconds = figure_cpu_s() - begun;
    return rays;
}

/* How many samples a technique takes in the time: by a run of the time's tenth, found by doubling. */
static uint32_t samples_in(struct figure *f, enum seen_by by, double seconds)
{
    for (uint32_t samples = 1;; samples *= 2) {
        double took;
        render(f, by, samples, UINT64_C(1) << 61, &took);
        if (took >= 0.1 * seconds)
            return (uint32_t)fmax(1.0, round(samples * seconds / took));
    }
}

static void run(struct figure *f, enum seen_by by, uint32_t k)
{
    struct measured *m = &f->measured[by];

    m->rays += render(f, by, m->samples, k, &m->seconds[k]);
    for (size_t r = 0; r < REGIONS; r++)
        m->error[r][k] = seen_error(&f->seen, f->region[r], f->rgb, f->whole ? f->seen.whole : f->seen.caustics);
}

static double mean(const double *v, uint32_t n)
{
    double sum = 0.0;
    for (uint32_t i = 0; i < n; i++)
        sum += v[i];
    return sum / n;
}

static void print_region(struct figure *f, size_t r, uint32_t runs)
{
    double light_median = 0.0, light_mean = 0.0;

    printf("\nwhere caustics bring at least %.0f %% of the light: %" PRIu32 " pixels\n", 100.0 * shares[r],
           f->count[r]);
    if (f->count[r] == 0)
        return;
    printf("%-14s %8s %8s %8s %8s %11s %11s %19s %15s\n", "technique", "samples", "CPU s", "10^6rays", "us/ray",
           "relMSE med", "relMSE mean", "range", "x time / light");
    for (int by = SEEN_BY_COUNT - 1; by >= 0; by--) {
        struct measured *m = &f->measured[by];
        const double seconds = mean(m->seconds, runs), rays = (double)m->rays / runs;
        const double average = mean(m->error[r], runs), middle = figure_median(m->error[r], runs);
        if (by == SEEN_LIGHT) {
            light_median = middle * seconds;
            light_mean = average * seconds;
        }
        double least = INFINITY, most = 0.0;
        for (uint32_t k = 0; k < runs; k++) {
            least = fmin(least, m->error[r][k]);
            most = fmax(most, m->error[r][k]);
        }
        printf("%-14s %8" PRIu32 " %8.2f %8.1f %8.3f %11.4g %11.4g %9.3g to %6.3g %7.2f %7.2f\n", seen_names[by],
               m->samples, seconds, rays * 1e-6, 1e6 * seconds / rays, middle, average, least, most,
               middle * seconds / light_median, average * seconds / light_mean);
    }
}

/* A row of the figure, of so many samples or, with 0, of equal time. */
static void print_row(struct figure *f, const struct flags *o, uint32_t samples)
{
    for (int by = 0; by < SEEN_BY_COUNT; by++)
        f->measured[by] =
            (struct measured){ .samples = samples ? samples : samples_in(f, (enum seen_by)by, o->seconds) };
    for (uint32_t k = 0; k < o->runs; k++)
        for (int by = 0; by < SEEN_BY_COUNT; by++)
            run(f, (enum seen_by)by, k);
    if (samples)
        printf("\n%" PRIu32 " samples each\n", samples);
    else
        printf("\n%g s of processor time each\n", o->seconds);
    for (size_t r = 0; r < REGIONS; r++)
        print_region(f, r, o->runs);
}

static void set_up(struct figure *f, const struct flags *o)
{
    const struct kernels *kernels;
    struct reason why = { "" };

    figure_must(kernels_select(NULL, &kernels, &why), &why);
    if (o->threads)
        omp_set_num_threads((int)o->threads);
    f->whole = o->whole;
    f->particles = o->particles;
    seen_open(&f->seen, o->scene, o->sky, o->size[0], o->size[1]);
    seen_refer(&f->seen, o->scene, 4, o->reference / 4, f->whole ? 16 : 2);
    f->relighter = relighter_create(f->seen.set, kernels);
    f->rgb = mem_alloc(f->seen.pixels, 3 * sizeof(float));
    for (size_t r = 0; r < REGIONS; r++) {
        f->region[r] = mem_alloc(f->seen.pixels, 1);
        f->count[r] = seen_region(&f->seen, shares[r], f->region[r]);
    }
    figure_must(f->relighter && f->rgb ? ERR_OK : ERR_NOMEM, &why);
}

int main(int argc, char **argv)
{
    struct flags flags = { 0 };
    struct command command = {
        .name = "figure5",
        .synopsis = "[flags]",
        .about =
            "Caustics by path tracer, Metropolis sampling, eye paths and light tracer, each in the same CPU time:\n"
            "relMSE against the light tracer's mean over other seeds, and its ratio to the light tracer's own.",
        .lists = { { rows, &flags } },
    };
    struct figure f = { 0 };

    figure_begin(&command, argc, argv);
    set_up(&f, &flags);
    printf("%s, %s, peakedness %.2f, %" PRIu32 "x%" PRIu32 ", %s, %d threads, %" PRIu32 " runs\n", f.seen.set->name,
           f.seen.environment->name, facts_peakedness(f.seen.environment), f.seen.width, f.seen.height,
           f.whole ? "all light" : "caustics alone", omp_get_max_threads(), flags.runs);
    print_row(&f, &flags, 0);
    if (flags.samples)
        print_row(&f, &flags, flags.samples);
    for (size_t r = 0; r < REGIONS; r++)
        mem_free(f.region[r]);
    mem_free(f.rgb);
    relighter_destroy(f.relighter);
    seen_close(&f.seen);
    return 0;
}
