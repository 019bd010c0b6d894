/* The order of methods that [LPG13, section 4] claims, on the built-in scene under a clear noon: balancing by faces
 * needs fewer samples than as many from each, and with the material's lobes fewer still. A statement about errors at
 * equal samples, not about time. */
#include "measure/chart/chart.h"

#include "light/estimators/kernels.h"
#include "sky/source/source.h"
#include "support/sets.h"
#include "support/unit.h"

#include <math.h>

enum { FACES_UNIFORM, FACES, MIS, CURVES, SEEDS = 64 };

static json_t *measure(const char *sky, const uint32_t *budgets, uint32_t count)
{
    const struct prepared_scene_desc stage = { .width = 20, .height = 11 };
    const struct source_desc from = { .spec = sky };
    struct frame frame = { .kind = FRAME_NONE };
    struct source *source;
    struct reason why = { "" };
    struct panel_desc d = {
        .scene = "builtin",
        .source = "noon",
        .frame = &frame,
        .light_class = LIGHT_DIRECT,
        .budgets = budgets,
        .budget_count = count,
        .seeds = SEEDS,
        .techniques = "faces-uniform,faces,mis",
        .truth_samples = 128,
    };
    struct prepared_scene *set;
    json_t *p;

    set = set_of(&stage);
    assert_int_equal(kernels_select(NULL, &d.kernels, &why), ERR_OK);
    assert_int_equal(source_open(&from, &source, &why), ERR_OK);
    assert_int_equal(source_next(source, &frame, &why), ERR_OK);
    source_close(source);
    d.set = set;
    d.environment = environment_create(&(struct environment_desc){ .n = 128 });
    assert_int_equal(environment_update(d.environment, &frame, &why), ERR_OK);
    if (panel_measure(&d, &p, &why))
        fail_msg("%s", why.text);
    environment_destroy(d.environment);
    set_destroy(set);
    frame_finish(&frame);
    return p;
}

/* Of the logarithms of noise over the seeds: mean, and the square of its standard error. */
static double mean_log(const json_t *curve, size_t budget, double *doubt2)
{
    const json_t *point = json_array_get(json_object_get(curve, "points"), budget);
    const json_t *noise = json_object_get(json_object_get(point, "errors"), "noise"), *v;
    double sum = 0.0, square = 0.0;
    size_t s;

    assert_int_equal(json_array_size(noise), SEEDS);
    json_array_foreach(noise, s, v)
    {
        const double e = log(json_number_value(v));
        sum += e / SEEDS;
        square += e * e / SEEDS;
    }
    *doubt2 = (square - sum * sum) / (SEEDS - 1);
    return sum;
}

/* At 32 and 64 samples: each of the two steps lowers the noise, by more than 3 of its standard errors, which are those
 * of a geometric mean over 64 seeds; all points of an image share their light samples, so that a seed is one
 * observation. Four comparisons: by chance once in two hundred sets of seeds, and these are fixed. A method that lowers
 * the noise by half is found; measured were 0.4 to 0.6 for the first step, 0.2 to 0.3 for the second. */
static void faces_beat_even_faces_and_lobes_beat_both(void **state)
{
    static const uint32_t budgets[] = { 32, 64 };
    (void)state;

    json_t *p = measure("sky:hour=12,size=256x128", budgets, 2);
    const json_t *curves = json_object_get(p, "curves");
    assert_int_equal(json_array_size(curves), CURVES);
    for (size_t b = 0; b < 2; b++)
        for (size_t c = FACES; c <= MIS; c++) {
            const json_t *one = json_array_get(curves, c - 1), *next = json_array_get(curves, c);
            double before2, after2;
            const double before = mean_log(one, b, &before2), after = mean_log(next, b, &after2);
            const double z = (before - after) / sqrt(before2 + after2);
            print_message("%u samples: %s has %.3f of the noise of %s, z %.1f\n", budgets[b],
                          json_string_value(json_object_get(next, "technique")), exp(after - before),
                          json_string_value(json_object_get(one, "technique")), z);
            assert_true(z > 3.0);
        }
    json_decref(p);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(faces_beat_even_faces_and_lobes_beat_both),
};
UNIT_MAIN(tests)
