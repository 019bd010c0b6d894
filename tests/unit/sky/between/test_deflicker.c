/* The camera's share of what changes from sky to sky is found and undone, the weather's and the sun's stays. Skies are
 * made here: a gradient with thin haze, patches of cloud that drift, ground, and a sun of one texel, 1e5 times as
 * bright. */
#include "support/unit.h"

#include "sky/between/deflicker.h"

#include <math.h>

enum { WIDE = 128, HIGH = 64, FRAMES = 130, FIRST = 10 }; /* FIRST: from here on its start is forgotten */

#define STEP_S 15.0

static float rgb[3 * 4 * WIDE * HIGH]; /* up to twice as wide and high */

/* A frame of the clean sequence in any size: clouds move by a texel of 128 in each frame. veil: of the sun. */
static void make_sky(int frame, int wide, int high, double light, double veil)
{
    for (int y = 0; y < high; y++)
        for (int x = 0; x < wide; x++) {
            const double u = 128.0 * x / wide, v = 64.0 * y / high, at = u - frame;
            const double shape = sin(0.21 * at) + sin(0.13 * at + 0.3 * v) + sin(0.05 * at - 0.2 * v);
            const double cloud = fmin(fmax(shape - 0.3, 0.0), 1.0), up = 1.0 - v / 32.0;
            const double haze = 1.0 + 0.01 * sin(0.3 * at + 0.2 * v);
            const double tint[3] = { 0.3 - 0.1 * up, 0.5 - 0.1 * up, 0.9 };
            float *texel = rgb + 3 * (y * wide + x);
            for (int c = 0; c < 3; c++)
                texel[c] = (float)(light * haze *
                                   (v >= 32.0 ? 0.1
                                              : tint[c] * (1.0 - cloud) +
                                                    (1.1 - 0.2 * up + 0.15 * sin(0.9 * at + 0.4 * v)) * cloud));
            if (x == 90 * wide / 128 && y == 12 * high / 64)
                for (int c = 0; c < 3; c++)
                    texel[c] = (float)(1e5 * light * veil);
        }
}

static void expose(int wide, int high, const double gain[3])
{
    for (int i = 0; i < 3 * wide * high; i++)
        rgb[i] *= (float)gain[i % 3];
}

static double gauss(void)
{
    static uint64_t state = 1;
    double sum = -6.0;

    for (int i = 0; i < 12; i++) {
        state = state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
        sum += (double)(state >> 11) * 0x1p-53;
    }
    return sum;
}

/* Takes FRAMES skies of which the camera exposes each anew, and gives the logarithms of the exposures that are left in
 * green and red, the mean of the last FRAMES - FIRST subtracted. */
static void run(double jitter, double white, double (*light)(int frame), double left[2][FRAMES])
{
    static struct deflicker d;
    struct deflicker_result r;

    memset(&d, 0, sizeof(d));
    for (int i = 0; i < FRAMES; i++) {
        const double all = exp(jitter * gauss());
        const double gain[3] = { all * exp(white * gauss()), all * exp(white * gauss()), all * exp(white * gauss()) };
        make_sky(i, WIDE, HIGH, light ? light(i) : 1.0, 1.0);
        expose(WIDE, HIGH, gain);
        deflicker_take(&d, rgb, WIDE, HIGH, i ? STEP_S : 0.0, &r);
        assert_true(r.restarted == (i == 0) && !r.blind && !r.jumped);
        assert_true(i == 0 ? r.spread == 0.0f : r.spread > 0.0f && r.spread < 0.5f);
        assert_true(fabs((double)r.stops - log2((double)r.gain[1])) < 1e-6);
        left[0][i] = log(gain[1] * (double)r.gain[1]);
        left[1][i] = log(gain[0] * (double)r.gain[0]);
    }
    for (int k = 0; k < 2; k++) {
        double mean = 0.0;
        for (int i = FIRST; i < FRAMES; i++)
            mean += left[k][i] / (FRAMES - FIRST);
        for (int i = 0; i < FRAMES; i++)
            left[k][i] -= mean;
    }
}

/* Root mean squares of the second differences in time, and of the values. */
static double flicker(const double *v, int first)
{
    double sum = 0.0;

    for (int i = first; i < FRAMES; i++)
        sum += (v[i] - 2.0 * v[i - 1] + v[i - 2]) * (v[i] - 2.0 * v[i - 1] + v[i - 2]);
    return sqrt(sum / (FRAMES - first));
}

static double deviation(const double *v, int first)
{
    double sum = 0.0;

    for (int i = first; i < FRAMES; i++)
        sum += v[i] * v[i];
    return sqrt(sum / (FRAMES - first));
}

/* 5 % of exposure and 3 % of white balance flicker by sqrt(6) times as much, 14 %: a fiftieth is left. */
static void jitter_is_taken_out(void **state)
{
    double left[2][FRAMES];

    (void)state;
    run(0.05, 0.03, NULL, left);
    for (int k = 0; k < 2; k++)
        if (!(flicker(left[k], FIRST) < 0.003 && deviation(left[k], FIRST) < 0.025))
            fail_msg("flickers by %.4f, deviates by %.4f", flicker(left[k], FIRST), deviation(left[k], FIRST));
}

static void a_steady_camera_is_left_alone(void **state)
{
    double left[2][FRAMES];

    (void)state;
    run(0.0, 0.0, NULL, left);
    for (int k = 0; k < 2; k++)
        if (!(flicker(left[k], FIRST) < 0.0015 && deviation(left[k], FIRST) < 0.008))
            fail_msg("flickers by %.4f, deviates by %.4f", flicker(left[k], FIRST), deviation(left[k], FIRST));
}

/* Up to 0.8 stops a degree and a twentieth of a degree in each frame: 4 % from one to the next. */
static double dusk(int frame)
{
    const double degrees = frame / 20.0;

    return exp2(-0.055 * degrees * degrees);
}

static double dawn(int frame)
{
    return dusk(FRAMES - frame) / dusk(FRAMES);
}

static void dusk_and_dawn_stay(void **state)
{
    double left[2][FRAMES];

    (void)state;
    for (int k = 0; k < 2; k++) {
        run(0.0, 0.0, k ? dawn : dusk, left);
        for (int i = FIRST; i < FRAMES; i++)
            if (!(fabs(left[0][i]) < 0.02))
                fail_msg("frame %d of %d is off by %.4f", i, k, left[0][i]);
        run(0.05, 0.0, k ? dawn : dusk, left);
        if (!(deviation(left[0], FIRST) < 0.04 && flicker(left[0], FIRST) < 0.01))
            fail_msg("with scatter, %d is off by %.4f, flickers by %.4f", k, deviation(left[0], FIRST),
                     flicker(left[0], FIRST));
    }
}

/* Takes sky `frame` with all channels times `gain`, in a size of the caller's, and returns the exposure that is left.
 */
static double take(struct deflicker *d, int frame, double gain, int wide, struct deflicker_result *r)
{
    make_sky(frame, wide, wide / 2, 1.0, frame >= 60 ? 0.1 : 1.0); /* in frame 60 a cloud takes 90 % of the sun */
    expose(wide, wide / 2, (double[]){ gain, gain, gain });
    deflicker_take(d, rgb, (uint32_t)wide, (uint32_t)wide / 2, frame ? STEP_S : 0.0, r);
    return gain * (double)r->gain[1];
}

static void a_cloud_takes_the_sun_in_full(void **state)
{
    static struct deflicker d;
    struct deflicker_result r;

    (void)state;
    for (int i = 0; i < 80; i++)
        assert_true(fabs(take(&d, i, 1.0, WIDE, &r) - 1.0) < 0.01 && !r.jumped);
}

static void a_jump_is_undone_at_once_and_told(void **state)
{
    static struct deflicker d;
    struct deflicker_result r;

    (void)state;
    for (int i = 0; i < 60; i++) {
        const double gain = i < 20 ? 1.0 : i < 40 ? 1.0 / 256.0 : 2.0;
        const double left = take(&d, i, gain, WIDE, &r);
        if (!(fabs(left - 1.0) < 0.01) || r.jumped != (i == 20 || i == 40))
            fail_msg("frame %d is left with %.4f, jumped: %d", i, left, r.jumped);
    }
}

/* Most of the sky is white at every exposure: what is below has the camera's ratio. */
static void clipped_areas_do_not_count(void **state)
{
    static struct deflicker d;
    struct deflicker_result r;

    (void)state;
    for (int i = 0; i < 40; i++) {
        const double gain = i < 20 ? 1.0 : 1.5;
        make_sky(i, WIDE, HIGH, 1.0, 1.0);
        for (int k = 0; k < 3 * WIDE * HIGH; k++)
            rgb[k] = fminf((k / 3 % WIDE < 90 ? 4.0f : 0.4f) * (float)gain * rgb[k], 1.0f);
        deflicker_take(&d, rgb, WIDE, HIGH, STEP_S, &r);
        for (int c = 0; c < 3; c++)
            if (!(fabs(gain * (double)r.gain[c] - 1.0) < 0.02))
                fail_msg("frame %d, channel %d is left with %.4f", i, c, gain * (double)r.gain[c]);
        assert_int_equal(r.jumped, i == 20);
    }
}

/* Half of the sky a stop darker from one frame to the next is a front; the camera's flicker before it does not hide it.
 */
static void what_half_the_sky_does_is_weather(void **state)
{
    static struct deflicker d;
    struct deflicker_result r;

    (void)state;
    for (int i = 0; i < 40; i++) {
        make_sky(i, WIDE, HIGH, 1.0, 1.0);
        for (int k = 0; i >= 20 && k < 3 * WIDE * HIGH; k++)
            if (k / 3 % WIDE < 70)
                rgb[k] *= 0.5f;
        deflicker_take(&d, rgb, WIDE, HIGH, STEP_S, &r);
        if (!(fabsf(r.stops) < 0.02f) || r.jumped)
            fail_msg("frame %d gets %.4f stops", i, (double)r.stops);
    }
}

static void sizes_may_change(void **state)
{
    static const int sizes[] = { WIDE, 2 * WIDE, 96, 100, WIDE };
    static struct deflicker d;
    struct deflicker_result r;

    (void)state;
    for (int i = 0; i < 60; i++) {
        const double left = take(&d, i, i < 20 ? 1.0 : 4.0, sizes[i / 5 % 5], &r);
        assert_true(r.restarted == (i == 0) && !r.blind);
        if (!(fabs(left - 1.0) < 0.03)) /* texels of the coarse ones lie elsewhere in the clouds */
            fail_msg("frame %d, %d wide, is left with %.4f", i, sizes[i / 5 % 5], left);
    }
}

/* A lens cap, and one frame of light without form: the sky after them is compared with the one before. */
static void black_frames_change_nothing(void **state)
{
    static struct deflicker d;
    struct deflicker_result r;

    (void)state;
    for (int i = 0; i < 30; i++) {
        const bool black = i == 0 || (i >= 10 && i < 13);
        const double left = take(&d, i, black ? 0.0 : i < 13 ? 1.0 : 8.0, WIDE, &r);
        assert_true(r.blind == black && isfinite(r.gain[0]) && r.gain[0] > 0.0f);
        assert_true(r.jumped == (i == 13) && r.restarted == (i < 2));
        if (!black && !(fabs(left - 1.0) < 0.02))
            fail_msg("frame %d is left with %.4f", i, left);
    }
}

static void earlier_times_and_gaps_begin_anew(void **state)
{
    static const double gaps[] = { -15.0, 1e9, NAN, INFINITY, -0.001 };
    static struct deflicker d;
    struct deflicker_result r;

    (void)state;
    for (size_t i = 0; i < sizeof(gaps) / sizeof(gaps[0]); i++) {
        for (int k = 0; k < 6; k++) {
            make_sky(k, WIDE, HIGH, k < 3 ? 1.0 : 16.0, 1.0);
            deflicker_take(&d, rgb, WIDE, HIGH, k ? k % 2 * STEP_S : gaps[i], &r);
            assert_true(r.restarted == (k == 0) && r.jumped == (k == 3));
        }
        assert_true(fabsf(r.stops + 4.0f) < 0.02f);
    }
    deflicker_take(&d, rgb, WIDE, HIGH, -1.0, &r);
    assert_true(r.gain[0] == 1.0f && r.gain[1] == 1.0f && r.gain[2] == 1.0f && r.stops == 0.0f);
}

/* Tiny and even skies: finite gains; one that is even is steadied all the same. */
static void any_sky_gives_finite_gains(void **state)
{
    static struct deflicker d;
    struct deflicker_result r;

    (void)state;
    for (int wide = 1; wide < 70; wide++)
        for (int high = 1; high < 40; high += 3) {
            for (int i = 0; i < 3 * wide * high; i++)
                rgb[i] = i % 7 ? (float)(i % 5) * (wide % 3 ? 1.0f : 1e12f) : 0.0f;
            deflicker_take(&d, rgb, (uint32_t)wide, (uint32_t)high, 1.0, &r);
            for (int c = 0; c < 3; c++)
                assert_true(isfinite(r.gain[c]) && r.gain[c] > 0.0f);
        }
    memset(&d, 0, sizeof(d));
    for (int i = 0; i < 10; i++) {
        for (int k = 0; k < 3 * WIDE * HIGH; k++)
            rgb[k] = i < 5 ? 1.0f : 0.25f;
        deflicker_take(&d, rgb, WIDE, HIGH, 1.0, &r);
        assert_true(!r.blind && fabsf(r.stops - (i < 5 ? 0.0f : 2.0f)) < 1e-3f);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(jitter_is_taken_out),
    cmocka_unit_test(a_steady_camera_is_left_alone),
    cmocka_unit_test(dusk_and_dawn_stay),
    cmocka_unit_test(a_cloud_takes_the_sun_in_full),
    cmocka_unit_test(a_jump_is_undone_at_once_and_told),
    cmocka_unit_test(clipped_areas_do_not_count),
    cmocka_unit_test(what_half_the_sky_does_is_weather),
    cmocka_unit_test(sizes_may_change),
    cmocka_unit_test(black_frames_change_nothing),
    cmocka_unit_test(earlier_times_and_gaps_begin_anew),
    cmocka_unit_test(any_sky_gives_finite_gains),
};

UNIT_MAIN(tests)
