/* The loop that lights frames, driven one turn at a time. */
#include "relightd/daemon/fake_server.h"

#include "base/clock.h"
#include "light/denoise/denoise.h"
#include "relightd/daemon/shade.h"

#include <jansson.h>
#include <math.h>

#define TURNS 2000

/* The image of a frame, copied. */
static struct protocol_picture light(struct rig *r, uint64_t number, bool lockstep, float *rgb)
{
    rig_hand_in(r, number, lockstep);
    for (int i = 0; i < TURNS; i++) {
        struct shaded *p = rig_image(r, TURNS);
        assert_non_null(p);
        const struct protocol_picture header = p->header;
        memcpy(rgb, p->rgb, sizeof(float) * 3 * WIDTH * HEIGHT);
        rig_release(r, p);
        if (header.frame == number && !(header.flags & PROTOCOL_PICTURE_FINER))
            return header;
    }
    fail_msg("frame %llu became no picture", (unsigned long long)number);
    return (struct protocol_picture){ 0 };
}

/* A control message, without its braces. */
static void ask(const char *fields)
{
    const char *clause;
    struct reason why;
    char text[200];

    snprintf(text, sizeof(text), "{%s}", fields);
    json_t *object = json_loads(text, 0, NULL);
    fake.ask = (struct server_control){ .asked = 0 };
    assert_int_equal(
        settings_from_json(settings_table, FOR_RELIGHTD, object, &fake.ask.asked, fake.ask.values, &clause, &why),
        ERR_OK);
    json_decref(object);
    fake.has_ask = true;
}

static void a_frame_that_is_handed_in_becomes_an_image(void **state)
{
    (void)state;
    static const char *const flags[] = { "--method", "mis", "--samples", "8", "--converge", "off", NULL };
    static float rgb[3 * WIDTH * HEIGHT];
    struct rig r;
    double sum = 0.0;

    rig_begin(&r, flags);
    rig_load(&r);
    const struct protocol_picture header = light(&r, 7, false, rgb);
    assert_int_equal(header.frame, 7);
    assert_int_equal(header.width, WIDTH);
    assert_int_equal(header.height, HEIGHT);
    assert_int_equal(header.samples, 8);
    for (int i = 0; i < 3 * WIDTH * HEIGHT; i++) {
        assert_true(isfinite(rgb[i]) && rgb[i] >= 0.0f);
        sum += (double)rgb[i];
    }
    assert_true(sum > 0.1 * WIDTH * HEIGHT);
    rig_end(&r);
}

static void settings_take_effect_at_the_next_frame(void **state)
{
    (void)state;
    static const char *const flags[] = { "--method", "mis", "--samples", "8", "--converge", "off", NULL };
    static float rgb[3 * WIDTH * HEIGHT];
    struct rig r;

    rig_begin(&r, flags);
    rig_load(&r);
    assert_int_equal(light(&r, 1, false, rgb).samples, 8);
    ask("\"samples\": 3");
    assert_int_equal(light(&r, 2, false, rgb).samples, 3);
    assert_int_equal(fake.control.samples, 3);
    assert_string_equal(fake.refusal, "");
    ask("\"error\": 0.1"); /* which is for method auto: refused */
    assert_int_equal(light(&r, 3, false, rgb).samples, 3);
    assert_string_not_equal(fake.refusal, "");
    assert_true(fake.control.method == METHOD_MIS && fake.control.error == 0.0);
    rig_end(&r);
}

static void lockstep_renders_with_the_initial_settings(void **state)
{
    (void)state;
    static const char *const flags[] = { "--source", "push:",      "--method", "mis", "--samples",
                                         "8",        "--converge", "off",      NULL };
    static float before[3 * WIDTH * HEIGHT], after[3 * WIDTH * HEIGHT], live[3 * WIDTH * HEIGHT];
    struct rig r;

    rig_begin(&r, flags);
    rig_load(&r);
    light(&r, 1, true, before);
    ask("\"samples\": 2, \"paths\": \"direct\", \"camera\": \"sundial\"");
    for (int i = 0; i < TURNS && strcmp(fake_figures().camera, "sundial") != 0; i++)
        rig_turn(&r);
    assert_string_equal(fake_figures().camera, "sundial");
    assert_int_equal(light(&r, 2, false, live).samples, 2);
    assert_int_equal(light(&r, 1, true, after).samples, 8);
    assert_memory_equal(before, after, sizeof(before));
    assert_memory_not_equal(before, live, sizeof(before));
    rig_end(&r);
}

static void another_camera_lights_the_standing_frame_anew(void **state)
{
    (void)state;
    static const char *const flags[] = { "--method", "mis", "--samples", "2", "--converge", "off", NULL };
    static float rgb[3 * WIDTH * HEIGHT];
    struct rig r;

    rig_begin(&r, flags);
    rig_load(&r);
    light(&r, 1, false, rgb);
    ask("\"camera\": \"gallery\"");
    struct shaded *p = rig_image(&r, TURNS);
    assert_non_null(p);
    assert_true(p->new_view);
    assert_int_equal(p->header.frame, 1);
    assert_memory_not_equal(p->rgb, rgb, sizeof(rgb));
    rig_release(&r, p);
    rig_end(&r);
}

static void a_still_image_refines_and_stops(void **state)
{
    (void)state;
    static const char *const flags[] = { "--method",          "mis", "--samples", "2", "--converge", "1e-9",
                                         "--converge-passes", "6",   NULL };
    static float rgb[3 * WIDTH * HEIGHT];
    struct rig r;
    bool converged = false;

    rig_begin(&r, flags);
    rig_load(&r);
    light(&r, 1, false, rgb);
    for (int i = 0; i < TURNS && !converged; i++) {
        struct shaded *p = rig_image(&r, TURNS);
        assert_non_null(p);
        assert_true(p->header.flags & PROTOCOL_PICTURE_FINER);
        assert_int_equal(p->header.frame, 1);
        rig_release(&r, p);
        converged = fake_figures().converged;
    }
    assert_true(converged);
    assert_int_equal(fake_figures().passes, 6);
    assert_int_equal(fake_figures().all_passes, 6);
    assert_null(rig_image(&r, 20)); /* it stops: some 30 ms a turn, longer than the quiet time */
    assert_int_equal(fake_figures().all_passes, 6);
    rig_end(&r);
}

/* While the cache is being computed, which begins with the first image. */
static void a_still_image_is_lit_again_until_the_cache_is_complete(void **state)
{
    (void)state;
    static const char *const flags[] = { "--cache-dir", "off", "--converge", "1e-9", NULL };
    static float rgb[3 * WIDTH * HEIGHT];
    struct rig r;

    rig_begin(&r, flags);
    rig_load(&r);
    light(&r, 1, false, rgb);
    for (int k = 0; k < ACCUMULATION_GLIDE; k++) { /* the second image, and those that glide to it */
        assert_true(r.shade->decider.cache.begun && r.shade->decider.cache.share < 1.0);
        struct shaded *p = rig_image(&r, TURNS);
        assert_non_null(p);
        assert_true(p->header.flags & PROTOCOL_PICTURE_FINER);
        assert_int_equal(p->header.frame, 1);
        rig_release(&r, p);
    }
    assert_int_equal(fake_figures().all_passes, 0);
    assert_int_equal(fake_figures().used, 1);
    rig_end(&r);
}

/* A frame's next image. */
static void await_image(struct rig *r, float *rgb, bool *new_view)
{
    struct shaded *p = rig_image(r, TURNS);

    assert_non_null(p);
    *new_view = p->new_view;
    memcpy(rgb, p->rgb, sizeof(float) * 3 * WIDTH * HEIGHT);
    rig_release(r, p);
}

static void the_first_image_of_glass_is_coarse_and_the_second_complete(void **state)
{
    (void)state;
    static const char *const flags[] = { "--scene", RING, "--cache-dir", "off", NULL };
    static float coarse[3 * WIDTH * HEIGHT], complete[3 * WIDTH * HEIGHT];
    bool new_view;
    struct rig r;

    rig_begin(&r, flags);
    rig_load(&r);
    for (int i = 0; i < 3; i++) /* no frame is there yet, and no other view is begun before it */
        rig_turn(&r);
    assert_true(r.shade->set->coarse && !r.shade->camera.running);
    light(&r, 1, false, coarse);
    assert_true(r.shade->set->coarse && !r.shade->decider.cache.begun); /* a cache of it would serve nobody */
    assert_non_null(strstr(fake_figures().left_out, "one per pixel"));
    await_image(&r, complete, &new_view);
    assert_true(new_view && !r.shade->set->coarse && r.shade->set == r.shade->first_set);
    assert_true(r.shade->set->gbuffer->edge_pixels > 0 && !r.shade->set->borrowed);
    assert_memory_not_equal(coarse, complete, sizeof(coarse));
    assert_null(strstr(fake_figures().left_out, "one per pixel"));
    assert_true(r.shade->decider.cache.begun);
    rig_end(&r);
}

static void a_coarse_first_view_that_was_left_is_completed_on_return(void **state)
{
    (void)state;
    static const char *const flags[] = { "--scene", RING, "--cache-dir", "off", NULL };
    static float rgb[3 * WIDTH * HEIGHT];
    struct rig r;

    rig_begin(&r, flags);
    rig_load(&r);
    ask("\"camera\": \"@1,2,3;0,0,0;40\"");
    light(&r, 1, false, rgb);
    for (int i = 0; i < TURNS && r.shade->set == r.shade->first_set; i++)
        rig_turn(&r);
    assert_true(r.shade->set != r.shade->first_set && r.shade->first_set->coarse);
    ask("\"camera\": \"main\"");
    for (int i = 0; i < TURNS && r.shade->set != r.shade->first_set; i++)
        rig_turn(&r);
    assert_true(r.shade->set == r.shade->first_set && !r.shade->set->coarse && !r.shade->coarse_view);
    rig_end(&r);
}

static void only_live_images_of_auto_begin_coarse(void **state)
{
    (void)state;
    static const char *const flags[][6] = {
        { "--scene", RING, "--source", "push:", NULL }, { "--scene", RING, "--samples", "8", NULL },
        { "--scene", RING, "--method", "mis", NULL },   { "--scene", RING, "--caustics", "stored", NULL },
        { "--scene", RING, "--edge-rays", "1", NULL },  { "--cache-dir", "off", NULL },
    };
    struct rig r;

    for (size_t k = 0; k < sizeof(flags) / sizeof(flags[0]); k++) {
        rig_begin(&r, flags[k]);
        rig_load(&r);
        assert_false(r.shade->set->coarse || r.shade->coarse_view);
        rig_end(&r);
    }
}

static void nobody_watching_is_no_reason_to_refine(void **state)
{
    (void)state;
    static const char *const flags[] = { "--method", "mis", "--samples", "2", "--converge", "1e-9", NULL };
    static float rgb[3 * WIDTH * HEIGHT];
    struct rig r;

    rig_begin(&r, flags);
    rig_load(&r);
    light(&r, 1, false, rgb);
    fake.demand.viewers = 0;
    for (const double start_s = clock_seconds(); clock_seconds() < start_s + 2.5;) /* longer than any quiet time */
        rig_turn(&r);
    assert_int_equal(fake_figures().all_passes, 0);
    fake.demand.viewers = 1;
    assert_non_null(rig_image(&r, TURNS));
    rig_end(&r);
}

/* Turns until the newest image is by these settings and has all samples of the lamps. */
static void await_lamps(struct rig *r, float *rgb)
{
    for (int i = 0; i < TURNS; i++) {
        struct shaded *p = rig_image(r, TURNS);
        assert_non_null(p);
        assert_true(p->header.flags & PROTOCOL_PICTURE_FINER);
        memcpy(rgb, p->rgb, sizeof(float) * 3 * WIDTH * HEIGHT);
        rig_release(r, p);
        if (fake_figures().lamp_samples == fake_figures().lamp_samples_wanted)
            return;
    }
    fail_msg("the lamps were not completed");
}

/* The sky lights the frame once; the lamps are refined meanwhile, and their factor scales the newest result. */
static void lamps_are_scaled_without_lighting_the_frame_again(void **state)
{
    (void)state;
    static const char *const flags[] = { "--scene",    EVENING,   "--method", "mis",    "--samples",
                                         "2",          "--lamps", "50",       "--tune", "lamp-samples=9",
                                         "--converge", "off",     NULL };
    static float once[3 * WIDTH * HEIGHT], off[3 * WIDTH * HEIGHT], twice[3 * WIDTH * HEIGHT];
    struct rig r;
    double sum = 0.0;

    rig_begin(&r, flags);
    rig_load(&r);
    light(&r, 1, false, once);
    assert_int_equal(fake_figures().lamp_samples_wanted, 9);
    await_lamps(&r, once);
    ask("\"lamps\": 0");
    struct shaded *p = rig_image(&r, TURNS);
    assert_non_null(p);
    memcpy(off, p->rgb, sizeof(off));
    rig_release(&r, p);
    ask("\"lamps\": 100");
    await_lamps(&r, twice);
    for (int i = 0; i < 3 * WIDTH * HEIGHT; i++) {
        assert_float_equal(twice[i] - off[i], 2.0 * (double)(once[i] - off[i]), 1e-5f * twice[i]);
        sum += (double)(once[i] - off[i]);
    }
    assert_true(sum > 0.01 * WIDTH * HEIGHT);
    assert_int_equal(fake_figures().used, 1);
    rig_end(&r);
}

static double mean_of(const float *rgb)
{
    double sum = 0.0;

    for (int i = 0; i < 3 * WIDTH * HEIGHT; i++)
        sum += (double)rgb[i];
    return sum / (3 * WIDTH * HEIGHT);
}

/* The next image that has passes of refinement. */
static double mean_refined(struct rig *r)
{
    for (int i = 0; i < TURNS; i++) {
        struct shaded *p = rig_image(r, TURNS);
        assert_non_null(p);
        const double mean = mean_of(p->rgb);
        rig_release(r, p);
        if (fake_figures().passes > 0)
            return mean;
    }
    fail_msg("no image was refined");
    return 0.0;
}

/* Passes and the first image are of the sky alone: the lamps are neither refined away nor doubled. */
static void refinement_leaves_the_lamps_as_they_are(void **state)
{
    (void)state;
    static const char *const flags[] = { "--scene",    EVENING,   "--method", "mis",    "--samples",
                                         "4",          "--lamps", "8000",     "--tune", "lamp-samples=9",
                                         "--converge", "1e-9",    NULL };
    static const char *const dark[] = { "--scene", EVENING, "--method",   "mis", "--samples", "256",
                                        "--lamps", "0",     "--converge", "off", NULL };
    static float rgb[3 * WIDTH * HEIGHT];
    struct rig r;

    rig_begin(&r, dark);
    rig_load(&r);
    light(&r, 1, false, rgb);
    const double sky = mean_of(rgb);
    rig_end(&r);
    rig_begin(&r, flags);
    rig_load(&r);
    light(&r, 1, false, rgb);
    await_lamps(&r, rgb);
    const double lit = mean_of(rgb);
    assert_true(lit > 1.5 * sky);
    assert_float_equal(mean_refined(&r), lit, 0.03 * lit);
    ask("\"lamps\": 0");
    assert_float_equal(mean_refined(&r), sky, 0.03 * sky);
    rig_end(&r);
}

/* relMSE against another image, of all values. */
static double rel_mse(const float *rgb, const float *truth)
{
    const double mean = mean_of(truth);
    double sum = 0.0;

    for (int i = 0; i < 3 * WIDTH * HEIGHT; i++)
        sum += pow((double)(rgb[i] - truth[i]), 2.0) / (pow((double)truth[i], 2.0) + 1e-2 * mean * mean);
    return sum / (3 * WIDTH * HEIGHT);
}

/* An image of lamps, beside which the sky is dark, once they have so many samples. */
static void light_lamps(const char *samples, bool lockstep, float *rgb)
{
    char tune[40];
    const char *const flags[] = { "--scene", EVENING,  "--method", "mis",        "--samples", "2", "--lamps",
                                  "1000000", "--tune", tune,       "--converge", "off",       NULL };
    struct rig r;

    snprintf(tune, sizeof(tune), "lamp-samples=%s", samples);
    rig_begin(&r, flags);
    rig_load(&r);
    light(&r, 1, lockstep, rgb);
    if (!lockstep)
        await_lamps(&r, rgb);
    rig_end(&r);
}

/* The first image that has light of the lamps is not grainy: filtered, it is nearer to a long run than the unfiltered
 * one of a lockstep sequence, by far. */
static void the_first_light_of_lamps_is_filtered(void **state)
{
    (void)state;
    static float truth[3 * WIDTH * HEIGHT], live[3 * WIDTH * HEIGHT], plain[3 * WIDTH * HEIGHT];

    light_lamps("1024", true, truth);
    light_lamps("2", false, live);
    light_lamps("2", true, plain);
    printf("relMSE of two samples %.5f, filtered %.5f\n", rel_mse(plain, truth), rel_mse(live, truth));
    assert_true(rel_mse(live, truth) < 0.5 * rel_mse(plain, truth));
}

/* Whatever controllers say, and though the lamps' part was not complete when the frame came. */
static void lockstep_images_have_all_of_the_lamps(void **state)
{
    (void)state;
    static const char *const flags[] = { "--scene", EVENING,          "--method",   "mis", "--samples", "2",
                                         "--tune",  "lamp-samples=9", "--converge", "off", NULL };
    static float first[3 * WIDTH * HEIGHT], again[3 * WIDTH * HEIGHT];
    struct rig r;

    rig_begin(&r, flags);
    rig_load(&r);
    ask("\"lamps\": 0");
    light(&r, 3, true, first);
    assert_int_equal(fake_figures().lamp_samples, 9);
    light(&r, 3, true, again);
    assert_memory_equal(first, again, sizeof(first));
    rig_end(&r);
}

/* A setting has cancelled the image after the one on display: a query waits until the image is made again. */
static void a_query_waits_for_an_image_that_is_made_again(void **state)
{
    (void)state;
    static const char *const flags[] = { "--method", "mis", "--samples", "2", "--converge", "off", NULL };
    static float rgb[3 * WIDTH * HEIGHT];
    struct rig r;

    rig_begin(&r, flags);
    rig_load(&r);
    fake.answers = 0;
    fake.inspection = (struct server_inspection){ .x = WIDTH / 2, .y = HEIGHT / 2, .samples = 16 };
    fake.has_inspection = true;
    inspect_result(r.shade);
    assert_true(fake.answers == 1 && !fake.answered); /* there is no image at all */
    light(&r, 1, false, rgb);
    r.shade->last = NULL;
    r.shade->cut_s = clock_seconds();
    fake.has_inspection = true;
    inspect_result(r.shade);
    assert_int_equal(fake.answers, 1);
    for (int i = 0; i < TURNS && fake.answers == 1; i++) {
        struct shaded *p = rig_image(&r, 1);
        if (p)
            rig_release(&r, p);
    }
    assert_true(fake.answers == 2 && fake.answered);
    rig_end(&r);
}

/* As rank 0 of a job asks for it while others light the image before. */
static void a_frame_taken_early_is_lit_before_newer_ones(void **state)
{
    (void)state;
    static const char *const flags[] = { "--method", "mis", "--samples", "2", "--converge", "off", NULL };
    static float rgb[3 * WIDTH * HEIGHT];
    const struct environment *e = NULL;
    const struct relight_desc *request = NULL;
    struct rig r;

    rig_begin(&r, flags);
    rig_load(&r);
    assert_false(shade_thread_next(r.shade, &e, &request)); /* no image yet */
    light(&r, 1, false, rgb);
    fake.demand.recorder = true;                            /* without a pause between images */
    assert_false(shade_thread_next(r.shade, &e, &request)); /* no frame yet */
    rig_hand_in(&r, 2, false);
    assert_true(shade_thread_next(r.shade, &e, &request));
    assert_int_equal(e->number, 2);
    assert_true(request->direct.samples == 2 && request->turn == 1);
    rig_hand_in(&r, 3, false);
    assert_false(shade_thread_next(r.shade, &e, &request)); /* one is enough */
    for (uint64_t number = 2; number <= 3; number++) {
        struct shaded *p = rig_image(&r, TURNS);
        assert_non_null(p);
        assert_int_equal(p->header.frame, number);
        rig_release(&r, p);
    }
    rig_hand_in(&r, 4, false);
    r.shade->begun_s = clock_seconds() + 1000.0;
    assert_false(shade_thread_next(r.shade, &e, &request)); /* its image is not due for a while */
    rig_end(&r);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_frame_that_is_handed_in_becomes_an_image),
    cmocka_unit_test(settings_take_effect_at_the_next_frame),
    cmocka_unit_test(lockstep_renders_with_the_initial_settings),
    cmocka_unit_test(another_camera_lights_the_standing_frame_anew),
    cmocka_unit_test(a_still_image_refines_and_stops),
    cmocka_unit_test(a_still_image_is_lit_again_until_the_cache_is_complete),
    cmocka_unit_test(the_first_image_of_glass_is_coarse_and_the_second_complete),
    cmocka_unit_test(a_coarse_first_view_that_was_left_is_completed_on_return),
    cmocka_unit_test(only_live_images_of_auto_begin_coarse),
    cmocka_unit_test(nobody_watching_is_no_reason_to_refine),
    cmocka_unit_test(lamps_are_scaled_without_lighting_the_frame_again),
    cmocka_unit_test(refinement_leaves_the_lamps_as_they_are),
    cmocka_unit_test(the_first_light_of_lamps_is_filtered),
    cmocka_unit_test(lockstep_images_have_all_of_the_lamps),
    cmocka_unit_test(a_frame_taken_early_is_lit_before_newer_ones),
    cmocka_unit_test(a_query_waits_for_an_image_that_is_made_again),
};

UNIT_MAIN(tests)
