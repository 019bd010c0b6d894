/* The ingest and encode threads and the status board, each by itself. */
#include "relightd/daemon/fake_server.h"

#include "base/clock.h"

#include <math.h>
#include <unistd.h>

enum { AWAITED = 120000 }; /* turns of 5 ms until a wait counts as a hang */

static void even_image(struct shaded *p, uint64_t frame, float radiance, bool new_view)
{
    for (size_t i = 0; i < (size_t)3 * WIDTH * HEIGHT; i++)
        p->rgb[i] = radiance;
    p->header = (struct protocol_picture){ .frame = frame, .width = WIDTH, .height = HEIGHT };
    p->ticket = (struct server_ticket){ 0 };
    p->new_view = new_view;
}

/* Exposure adapts from frame to frame of one camera, and starts afresh with another. */
static void exposure_does_not_carry_over_to_another_camera(void **state)
{
    (void)state;
    static const char *const flags[] = { NULL };
    struct encode_thread *t;
    struct reason why;
    struct rig r;

    rig_begin(&r, flags);
    assert_int_equal(encode_thread_create(&r.shared, &t, &why), ERR_OK);
    struct shaded *p = &r.shared.images.slot[0];
    even_image(p, 1, 1.0f, false);
    encode_image(t, p);
    const float bright = p->header.gain;
    even_image(p, 2, 0.25f, false);
    encode_image(t, p);
    const float adapting = p->header.gain;
    even_image(p, 3, 0.25f, true);
    encode_image(t, p);
    const float fresh = p->header.gain;
    assert_true(adapting > 1.01f * bright && adapting < 3.9f * bright);
    assert_true(fabsf(fresh / bright - 4.0f) < 0.01f);
    assert_int_equal(fake.published.frame, 3);
    assert_int_equal(fake.images, 3); /* JPEG each */
    encode_thread_destroy(t);
    rig_end(&r);
}

/* A refined image of a frame keeps its exposure. */
static void refinement_does_not_step_exposure(void **state)
{
    (void)state;
    static const char *const flags[] = { NULL };
    struct encode_thread *t;
    struct reason why;
    struct rig r;

    rig_begin(&r, flags);
    assert_int_equal(encode_thread_create(&r.shared, &t, &why), ERR_OK);
    struct shaded *p = &r.shared.images.slot[0];
    even_image(p, 1, 1.0f, false);
    encode_image(t, p);
    const float first = p->header.gain;
    even_image(p, 1, 0.5f, false);
    p->header.flags |= PROTOCOL_PICTURE_FINER;
    encode_image(t, p);
    assert_true(p->header.gain == first);
    encode_thread_destroy(t);
    rig_end(&r);
}

/* EXPOSURE_AUTO measures the first image of a camera, and the one at hand when it is turned on. */
static void auto_exposure_keeps_its_first_value(void **state)
{
    (void)state;
    static const char *const flags[] = { "--exposure=auto", NULL };
    struct encode_thread *t;
    struct reason why;
    struct rig r;

    rig_begin(&r, flags);
    assert_int_equal(encode_thread_create(&r.shared, &t, &why), ERR_OK);
    struct shaded *p = &r.shared.images.slot[0];
    const struct {
        float radiance, gain;
        bool new_view;
        double stops;
    } steps[] = {
        { 1.0f, 0.18f, false, EXPOSURE_AUTO },
        { 0.25f, 0.18f, false, EXPOSURE_AUTO },
        { 0.25f, 0.72f, true, EXPOSURE_AUTO },
        { 1.0f, 0.72f, false, EXPOSURE_AUTO },
        { 1.0f, 2.0f, false, 1.0 },
        { 1.0f, 0.18f, false, EXPOSURE_AUTO },
        { 0.25f, 0.18f, false, EXPOSURE_AUTO },
    };
    for (size_t k = 0; k < sizeof(steps) / sizeof(steps[0]); k++) {
        r.shared.settings.now.exposure_stops = steps[k].stops;
        even_image(p, k + 1, steps[k].radiance, steps[k].new_view);
        encode_image(t, p);
        assert_true(fabsf(p->header.gain / steps[k].gain - 1.0f) < 1e-4f);
    }
    encode_thread_destroy(t);
    rig_end(&r);
}

/* Renditions are made once per image, at their width; a linear one after the image has gone asks for it again. */
static void renditions_are_made_as_asked(void **state)
{
    (void)state;
    static const char *const flags[] = { NULL };
    struct encode_thread *t;
    struct reason why;
    struct rig r;

    rig_begin(&r, flags);
    assert_int_equal(encode_thread_create(&r.shared, &t, &why), ERR_OK);
    struct shaded *p = &r.shared.images.slot[0];
    fake.renditions = 0;
    even_image(p, 1, 1.0f, false);
    encode_image(t, p);
    assert_int_equal(fake.renditions, 0);
    fake.demand.renditions[2] = (struct server_rendition){ SERVER_JPEG, 1, 20, 1 };
    encode_image(t, p);
    assert_int_equal(fake.renditions, 1);
    assert_int_equal(fake.rendition.width, 20);
    assert_int_equal(fake.rendition.height, 11);
    fake.demand.renditions[2].serial = 2; /* another use of the slot: without a new image, from what is kept */
    fake.demand.renditions[2].width = WIDTH + 1;
    fake.demand.renditions[3] = (struct server_rendition){ SERVER_EXR, 1, 20, 3 };
    atomic_store(&r.shared.repeat_requested, false);
    assert_int_equal(encode_thread_start(t, &why), ERR_OK);
    for (int i = 0; i < AWAITED && (fake.renditions < 2 || !atomic_load(&r.shared.repeat_requested)); i++)
        nanosleep(&(struct timespec){ .tv_nsec = 5000000 }, NULL);
    assert_int_equal(fake.renditions, 2);
    assert_int_equal(fake.rendition.width, WIDTH);
    assert_true(atomic_load(&r.shared.repeat_requested));
    const int slot = handoff_begin(&r.shared.images.handoff);
    even_image(&r.shared.images.slot[slot], 1, 1.0f, false);
    fake.demand.renditions[2].image = SERVER_NO_IMAGE;
    handoff_publish(&r.shared.images.handoff, slot);
    for (int i = 0; i < AWAITED && fake.renditions < 3; i++)
        nanosleep(&(struct timespec){ .tv_nsec = 5000000 }, NULL);
    assert_int_equal(fake.renditions, 3);
    assert_int_equal(fake.rendition.width, 20);
    shared_close(&r.shared);
    encode_thread_destroy(t);
    rig_end(&r);
}

/* Waits until n frames were refused. */
static void await_refusals(uint64_t n)
{
    for (int i = 0; i < AWAITED && fake_figures().refused < n; i++)
        nanosleep(&(struct timespec){ .tv_nsec = 5000000 }, NULL);
    assert_true(fake_figures().refused >= n);
}

static void await_frames(uint64_t n)
{
    for (int i = 0; i < AWAITED && fake_figures().received < n; i++)
        nanosleep(&(struct timespec){ .tv_nsec = 5000000 }, NULL);
    assert_true(fake_figures().received >= n);
}

/* While the scene loads, a source's first frame is read, but no other, and nothing is said about it. */
static void the_first_frame_is_read_before_the_scene(void **state)
{
    (void)state;
    static const char *const flags[] = { "--source", "sky:size=64x32,speed=1", "--rate", "200", NULL };
    struct ingest_thread *t;
    struct reason why;
    struct rig r;

    rig_begin(&r, flags);
    assert_int_equal(ingest_thread_create(&r.shared, &t, &why), ERR_OK);
    assert_int_equal(ingest_thread_start(t, &why), ERR_OK);
    await_frames(1);
    nanosleep(&(struct timespec){ .tv_nsec = 100000000 }, NULL); /* for twenty frames, were they read */
    assert_int_equal(fake_figures().received, 1);
    assert_int_not_equal(fake_figures().source, SERVER_LIVE);
    ingest_thread_go_on(t);
    await_frames(2);
    assert_int_equal(fake_figures().source, SERVER_LIVE);
    shared_close(&r.shared);
    ingest_thread_destroy(t);
    rig_end(&r);
}

/* A source of one bad file is read again and again, but the log has one line about it. */
static void an_ingest_error_is_reported_once(void **state)
{
    (void)state;
    char path[] = "/tmp/relightd_bad_XXXXXX";
    const int fd = mkstemp(path);
    const char *const flags[] = { "--source", path, "--rate", "200", "--log-level", "error", NULL };
    struct ingest_thread *t;
    struct log_counts before, after;
    struct reason why;
    struct rig r;

    assert_true(fd >= 0);
    assert_int_equal(write(fd, "no picture", 10), 10);
    close(fd);
    log_init("test", LOG_WARNING);
    rig_begin(&r, flags);
    log_counts(&before);
    assert_int_equal(ingest_thread_create(&r.shared, &t, &why), ERR_OK);
    assert_int_equal(ingest_thread_start(t, &why), ERR_OK);
    ingest_thread_go_on(t);
    await_refusals(4);
    const struct server_figures f = fake_figures();
    shared_close(&r.shared);
    ingest_thread_destroy(t);
    log_counts(&after);
    assert_int_equal(after.lines[LOG_WARNING] - before.lines[LOG_WARNING], 1);
    assert_int_equal(f.source, SERVER_FAILED);
    assert_non_null(strstr(f.detail, path));
    assert_int_equal(f.received, f.refused);
    assert_int_equal(f.unreadable, f.refused);
    unlink(path);
    rig_end(&r);
}

/* received = used + dropped + refused, give or take those under way (PROTOCOL.md 4.8.3). */
static void status_figures_add_up(void **state)
{
    (void)state;
    static const char *const flags[] = { "--method", "mis", "--samples", "2", "--converge", "off", NULL };
    static const struct image_faults faults = { .nan = 1, .infinite = 2, .negative = 4 };
    struct rig r;
    char text[128];

    rig_begin(&r, flags);
    rig_load(&r);
    struct status_board *b = &r.shared.status;
    for (uint64_t frame = 0; frame < 6; frame++) {
        rig_hand_in(&r, frame, false);
        if (frame % 2 == 0) /* the next one replaces it */
            continue;
        struct shaded *p = rig_image(&r, 1000);
        assert_non_null(p);
        rig_release(&r, p);
    }
    status_frame_unreadable(b, "a torn file", false);
    status_frame_received(b, &faults, false);
    assert_false(status_all_frames_done(b));
    status_frame_unusable(b, "a ball");
    const struct server_figures f = fake_figures();
    assert_int_equal(f.received, 8);
    assert_int_equal(f.used, 3);
    assert_int_equal(f.dropped, 3);
    assert_int_equal(f.refused, 2);
    assert_int_equal(f.unreadable + f.unusable, f.refused);
    assert_int_equal(f.repaired, 7);
    assert_int_equal(f.frame, 5);
    assert_true(f.direct_rays > 0 && f.effective > 0 && f.effective <= f.chosen);
    assert_string_equal(f.last_refusal, "a ball");
    assert_true(status_all_frames_done(b));
    status_sentence(b, 2, text, sizeof(text));
    assert_string_equal(text, "Showing an older frame to 2 viewers: a ball.");
    status_line(b, 1, text, sizeof(text));
    assert_non_null(strstr(text, " images/s, 1 viewer, "));
    assert_non_null(strstr(text, ", the last frame was refused")); /* behind the image's error, if it states one */
    rig_end(&r);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(exposure_does_not_carry_over_to_another_camera),
    cmocka_unit_test(refinement_does_not_step_exposure),
    cmocka_unit_test(renditions_are_made_as_asked),
    cmocka_unit_test(auto_exposure_keeps_its_first_value),
    cmocka_unit_test(the_first_frame_is_read_before_the_scene),
    cmocka_unit_test(an_ingest_error_is_reported_once),
    cmocka_unit_test(status_figures_add_up),
};

UNIT_MAIN(tests)
