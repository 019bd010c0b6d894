/* Difficult pairs of skies: whatever they are, the light between them goes straight from one to the other, and every
 * value is a radiance. */
#include "stability.h"

#include "sky/between/between.h"
#include "sky/between/between_skies.h"

enum { WIDE = 256, HIGH = 128, STEPS = 8 };

static const double sun[3] = { 6.0, 5.0, 4.0 };

/* Grey of a level with suns of these energies, over the usual one, at these azimuths in degrees. */
static struct frame sky_of(double level, int suns, const double (*of)[2])
{
    struct frame f = sky_constant(WIDE, HIGH, (float)level);

    for (int k = 0; k < suns; k++) {
        const double energy[3] = { of[k][1] * sun[0], of[k][1] * sun[1], of[k][1] * sun[2] };
        double at[3];
        towards(30.0 * DEGREES, of[k][0] * DEGREES, at);
        sun_put(f.rgb, WIDE, HIGH, at, 0.2665 * DEGREES, energy);
    }
    return f;
}

static double light(const struct frame *f, bool *radiance)
{
    double middle[3];

    for (size_t k = 0; k < 3 * (size_t)f->width * f->height; k++)
        *radiance &= isfinite(f->rgb[k]) && f->rgb[k] >= 0.0f;
    return light_of(f->rgb, f->width, f->height, middle);
}

/* Shows the way from one sky to the other by fading and by motion; the largest distance from a straight line, over the
 * lighter sky. */
static void goes_straight(const char *name, struct frame first, struct frame second, double bound)
{
    double worst = 0.0;
    bool radiance = true;

    for (int mode = BETWEEN_FADE; mode <= BETWEEN_MOTION; mode++) {
        struct between *b = NULL;
        struct frame out = { .kind = FRAME_NONE };
        struct reason why;
        double seen[STEPS + 1];
        assert_int_equal(between_create(&(struct between_desc){ .mode = (enum between_mode)mode, .hold = 2 }, &b),
                         ERR_OK);
        assert_int_equal(between_take(b, &first, 0.0, NULL, &why), ERR_OK);
        assert_int_equal(between_take(b, &second, 30.0, NULL, &why), ERR_OK);
        for (int k = 0; k <= STEPS; k++) {
            assert_int_equal(between_show(b, 30.0 * k / STEPS, &out), ERR_OK);
            seen[k] = light(&out, &radiance);
        }
        for (int k = 0; k <= STEPS; k++) {
            const double straight = seen[0] + (seen[STEPS] - seen[0]) * k / STEPS;
            worst = fmax(worst, fabs(seen[k] - straight) / fmax(fmax(seen[0], seen[STEPS]), 1e-30));
        }
        frame_finish(&out);
        between_destroy(b);
    }
    holds_below(name, "fade, motion", "off the straight way, of the lighter sky", radiance ? worst : INFINITY, bound,
                "");
    frame_finish(&first);
    frame_finish(&second);
}

static void light_goes_straight_between_any_two_skies(void **state)
{
    static const double one[][2] = { { 100, 1 } }, moved[][2] = { { 101, 1 } }, dim[][2] = { { 101, 0.1 } };
    static const double two[][2] = { { 100, 1 }, { 200, 1 } }, other_two[][2] = { { 101, 1 }, { 201, 1 } };
    static const double low[][2] = { { 170, 1 } }, strong[][2] = { { 101, 256 } };
    (void)state;

    goes_straight("between: a sun that moves", sky_of(0.5, 1, one), sky_of(0.5, 1, moved), 1e-4);
    goes_straight("between: a cloud takes 90 % of the sun", sky_of(0.5, 1, one), sky_of(0.5, 1, dim), 1e-4);
    goes_straight("between: a cloud takes all of it", sky_of(0.5, 1, one), sky_of(0.5, 0, NULL), 1e-4);
    goes_straight("between: no sun at all", sky_of(0.5, 0, NULL), sky_of(0.7, 0, NULL), 1e-4);
    goes_straight("between: two suns", sky_of(0.5, 2, two), sky_of(0.5, 2, other_two), 1e-4);
    goes_straight("between: one sun becomes two", sky_of(0.5, 1, one), sky_of(0.5, 2, other_two), 1e-4);
    goes_straight("between: a sun 70 degrees away", sky_of(0.5, 1, one), sky_of(0.5, 1, low), 1e-4);
    goes_straight("between: night to day", sky_of(1e-6, 0, NULL), sky_of(0.5, 1, one), 1e-4);
    goes_straight("between: black to day", sky_of(0.0, 0, NULL), sky_of(0.5, 1, one), 1e-4);
    goes_straight("between: exposure by 8 stops", sky_of(0.5, 1, one), sky_of(128.0, 1, strong), 1e-4);
    goes_straight("between: clouds", cloudy(WIDE, HIGH, 0.0, 0.0), cloudy(WIDE, HIGH, 0.3, 0.1), 2e-2);
    verdict();
}

/* Sizes and layouts in turn, and a time that goes on for ever: each sky is shown as it is. */
static void what_has_nothing_between_is_shown_as_it_is(void **state)
{
    struct between *b = NULL;
    struct frame out = { .kind = FRAME_NONE }, skies[4] = { sky_constant(64, 32, 1.0f), sky_constant(32, 192, 2.0f),
                                                            sky_constant(128, 64, 3.0f), sky_constant(64, 32, 4.0f) };
    uint64_t right = 0;
    struct reason why;
    (void)state;

    snprintf(skies[1].layout, sizeof(skies[1].layout), "cube");
    assert_int_equal(between_create(&(struct between_desc){ .mode = BETWEEN_MOTION, .hold = 2 }, &b), ERR_OK);
    for (int k = 0; k < 4; k++) {
        assert_int_equal(between_take(b, &skies[k], 10.0 * k, NULL, &why), ERR_OK);
        for (int i = 0; i < 3; i++) { /* at its time, a little later, a day later */
            assert_int_equal(between_show(b, 10.0 * k + (i == 2 ? 86400.0 : i), &out), ERR_OK);
            right += fabsf(out.rgb[0] - (float)(k + 1)) < 1e-5f;
        }
        frame_finish(&skies[k]);
    }
    frame_finish(&out);
    between_destroy(b);
    holds_all("between: sizes and layouts in turn, and a source that stops", "motion", "shows the last sky", right, 12);
    verdict();
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(light_goes_straight_between_any_two_skies),
    cmocka_unit_test(what_has_nothing_between_is_shown_as_it_is),
};
UNIT_MAIN(tests)
