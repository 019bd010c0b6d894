/* Scenes read in the confined process: the same to the bit, and whatever a file does to that process, it costs a
 * message. MISBEHAVE is the process with faults on demand (misbehave.c), EXAMPLES a folder of scenes. */
#include "scene/geometry/files.h"
#include "scene/geometry/load.h"

#include "base/digest.h"
#include "base/progress.h"
#include "import/reader/files.h"
#include "import/reader/reader.h"
#include "scene/geometry/scene_digest.h"

#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <sys/stat.h>

#define SQUARE "v 0 0 0\nv 1 0 0\nv 1 1 0\nusemtl grey\nf 1 2 3\n"
#define SCENE                                                                                                          \
    "{\"camera\":{\"position\":[0,1,5],\"look_at\":[0,0,0],\"fov_y_degrees\":40},\"models\":[{\"file\":\"a.obj\"},"    \
    "{\"file\":\"a.obj\",\"material\":\"mirror\"}],\"odd\":1,\"materials\":{"                                          \
    "\"grey\":{\"type\":\"lambert\",\"albedo\":[0.5,0.4,0.3]},\"mirror\":{\"type\":\"mirror\"}}}"

static struct digest sum_of(const struct scene *s)
{
    struct digest sum = { { 0 } }, *d = &sum;

    digest_scene(d, s);
    for (size_t i = 0; i < s->camera_count; i++) {
        const struct camera *c = &s->cameras[i];
        digest_bytes(d, c->name, strlen(c->name));
        digest_bytes(d, &c->position, sizeof(c->position));
        digest_bytes(d, &c->look_at, sizeof(c->look_at));
        digest_bytes(d, &c->up, sizeof(c->up));
        digest_bytes(d, &c->fov_y, sizeof(c->fov_y));
    }
    for (size_t i = 0; i < s->material_count; i++)
        digest_bytes(d, s->materials[i].name, strlen(s->materials[i].name));
    digest_bytes(d, &s->low, sizeof(s->low));
    digest_bytes(d, &s->high, sizeof(s->high));
    digest_u64(d, s->triangle_count);
    digest_u64(d, s->unmodelled);
    return sum;
}

static void compare(const char *path)
{
    struct reason why = { "" };
    struct scene *far = NULL, *near = load_or_fail(path);

    if (scene_load(path, NULL, &far, NULL, &why))
        fail_msg("%s", why.text);
    const struct digest a = sum_of(near), b = sum_of(far);
    assert_memory_equal(&a, &b, sizeof(a));
    scene_destroy(near);
    scene_destroy(far);
}

static void scenes_are_the_same_to_the_bit(void **state)
{
    struct folder f;

    (void)state;
    compare(EXAMPLES "/ring.json");
    compare(EXAMPLES "/steps.json");
    folder_make(&f);
    folder_text(&f, "a.obj", SQUARE);
    compare(folder_text(&f, "scene.json", SCENE));
    folder_remove(&f);
}

static void shared_scenes_are_the_same_to_the_bit(void **state)
{
    static const char *const paths[] = { "../scenes/dragon.json", "../scenes/plaza.json",
                                         "models/house.glb",      "models/low-poly-tree.glb",
                                         "models/gltf/Mixer.glb", "models/gltf/FlightHelmet/FlightHelmet.gltf",
                                         "models/glass-table.glb" };

    (void)state;
    for (size_t i = 0; i < sizeof(paths) / sizeof(paths[0]); i++)
        compare(unit_data(paths[i]));
}

static void warnings_and_progress_come_through(void **state)
{
    struct reason why = { "" };
    struct progress line;
    struct scene *s = NULL;
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "a.obj", SQUARE "f 1 1 1\n");
    const char *path = folder_text(&f, "scene.json", SCENE);
    progress_begin(&line, "loading", 0, NULL);
    log_begin();
    const enum err e = scene_load(path, NULL, &s, &line, &why);
    const char *said = log_end();
    if (e)
        fail_msg("%s", why.text);
    assert_int_equal(count_of(said, "unknown key 'odd'"), 1);
    assert_int_equal(count_of(said, "dropped 1 degenerate"), 2);
    assert_int_equal(line.done, 2);
    scene_destroy(s);
    folder_remove(&f);
}

static void a_bad_file_has_the_reason_of_its_reader(void **state)
{
    struct reason far = { "" }, near = { "" };
    struct scene *s = NULL;
    struct folder f;

    (void)state;
    folder_make(&f);
    const char *path = folder_text(&f, "scene.json", SCENE); /* without its model */
    assert_int_equal(load_here(path, &s, &near), ERR_IO);
    assert_int_equal(scene_load(path, NULL, &s, NULL, &far), ERR_IO);
    assert_string_equal(near.text, far.text);
    assert_non_null(strstr(far.text, "a.obj: No such file"));
    assert_null(s);
    folder_remove(&f);
}

/* The triangle stands at 8 after 2 of 4 s, and at rest at 0. */
/* ---- Files that change while they are read ---- */

static void open_and_close(struct scene_files *files, const char *path)
{
    struct reason why;
    size_t size;
    int fd;

    if (scene_files_open(files, path, &fd, &size, &why))
        fail_msg("%s", why.text);
    close(fd);
}

static void expect_change(struct scene_files *files, const char *of)
{
    char expected[512];
    struct reason why;

    snprintf(expected, sizeof(expected), "%s: has changed while the scene was read; load it again", of);
    assert_int_equal(scene_files_check(files, &why), ERR_IO);
    assert_string_equal(why.text, expected);
}

static void changes_of_opened_files_are_seen(void **state)
{
    char scene[256], model[256];
    struct scene_files files;
    struct reason why;
    struct folder f;
    struct stat st;
    (void)state;

    folder_make(&f);
    strcpy(scene, folder_text(&f, "scene.json", SCENE));
    strcpy(model, folder_text(&f, "a.obj", SQUARE));
    for (int k = 0; k < 4; k++) {
        assert_int_equal(scene_files_init(&files, scene, 1 << 20), ERR_OK);
        open_and_close(&files, scene);
        assert_int_equal(scene_files_allow(&files, model, &why), ERR_OK);
        open_and_close(&files, model);
        open_and_close(&files, model);
        assert_int_equal(scene_files_check(&files, &why), ERR_OK);
        assert_int_equal(stat(model, &st), 0);
        if (k == 0) /* longer */
            folder_text(&f, "a.obj", SQUARE "f 1 2 3\n");
        if (k == 1) { /* in place, by one who keeps its length, a second later */
            st.st_mtim.tv_sec++;
            assert_int_equal(utimensat(AT_FDCWD, model, (struct timespec[]){ st.st_mtim, st.st_mtim }, 0), 0);
        }
        if (k == 2) { /* replaced by one of the same length and time */
            char other[256];
            strcpy(other, folder_text(&f, "b.obj", SQUARE "f 1 2 3\n"));
            assert_int_equal(utimensat(AT_FDCWD, other, (struct timespec[]){ st.st_mtim, st.st_mtim }, 0), 0);
            assert_int_equal(rename(other, model), 0);
        }
        if (k == 3) /* gone */
            assert_int_equal(unlink(model), 0);
        expect_change(&files, model);
        scene_files_finish(&files);
    }
    folder_remove(&f);
}

static atomic_bool written_enough;

static void *write_on(void *path)
{
    while (!atomic_load(&written_enough))
        if (utimensat(AT_FDCWD, path, NULL, 0) != 0)
            break;
    return NULL;
}

static void a_model_that_is_written_meanwhile_costs_a_message(void **state)
{
    struct reason why = { "" };
    struct scene *s = NULL;
    char model[256];
    pthread_t writer;
    struct folder f;
    (void)state;

    folder_make(&f);
    strcpy(model, folder_text(&f, "a.obj", SQUARE));
    const char *path = folder_text(&f, "scene.json", SCENE);
    assert_int_equal(pthread_create(&writer, NULL, write_on, model), 0);
    enum err e = ERR_OK;
    for (int k = 0; k < 20 && !e; k++) { /* times have the grain of a clock tick */
        e = scene_load(path, NULL, &s, NULL, &why);
        scene_destroy(s);
    }
    atomic_store(&written_enough, true);
    pthread_join(writer, NULL);
    assert_int_equal(e, ERR_IO);
    assert_null(s);
    assert_non_null(strstr(why.text, "a.obj: has changed while the scene was read"));
    assert_int_equal(scene_load(path, NULL, &s, NULL, &why), ERR_OK); /* and the next time it is well */
    scene_destroy(s);
    folder_remove(&f);
}

static void the_time_of_animations_reaches_the_reader(void **state)
{
    static const float numbers[] = { 0, 0, 0, 1, 0, 0, 0, 1, 0, /* corners */ 0, 4, /* times */ 0, 0, 0, 16, 0, 0 };
    const struct scene_reading reading[] = { { .seconds = 0 }, { .animate = true, .time = 2.0 } };
    struct reason why = { "" };
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_write(&f, "a.bin", numbers, sizeof(numbers));
    const char *path = folder_text(
        &f, "a.gltf",
        "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"uri\":\"a.bin\",\"byteLength\":68}],\"bufferViews\":["
        "{\"buffer\":0,\"byteLength\":36},{\"buffer\":0,\"byteOffset\":36,\"byteLength\":8},{\"buffer\":0,"
        "\"byteOffset\":44,\"byteLength\":24}],\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,"
        "\"type\":\"VEC3\"},{\"bufferView\":1,\"componentType\":5126,\"count\":2,\"type\":\"SCALAR\"},"
        "{\"bufferView\":2,\"componentType\":5126,\"count\":2,\"type\":\"VEC3\"}],\"meshes\":[{\"primitives\":["
        "{\"attributes\":{\"POSITION\":0}}]}],\"nodes\":[{\"mesh\":0}],\"animations\":[{\"channels\":[{\"sampler\":0,"
        "\"target\":{\"node\":0,\"path\":\"translation\"}}],\"samplers\":[{\"input\":1,\"output\":2}]}]}");
    for (int i = 0; i < 2; i++) {
        struct scene *s = NULL;
        if (scene_load(path, &reading[i], &s, NULL, &why))
            fail_msg("%s", why.text);
        assert_float_equal(s->low.x, 8.0f * (float)i, 1e-6f);
        scene_destroy(s);
    }
    folder_remove(&f);
}

/* ---- The process with faults on demand ---- */

static const struct scene_reading bad = { .memory_bytes = UINT64_C(64000000), .seconds = 60, .program = MISBEHAVE };

static void need_confinement(void)
{
#ifdef __SANITIZE_ADDRESS__
    skip(); /* memory has no limit, and faults are reported instead of died of */
#endif
}

/* The file NAME.json does that deed; the next file is read. */
static void deed(const char *name, enum err expected, const char *because)
{
    struct reason why = { "" };
    struct scene *s = NULL;
    struct folder f;
    char file[64];

    folder_make(&f);
    folder_text(&f, "a.obj", SQUARE);
    snprintf(file, sizeof(file), "%s.json", name);
    const char *path = folder_text(&f, file, SCENE);
    struct scene_reading how = bad;
    if (strcmp(name, "hang") == 0)
        how.seconds = 1; /* elsewhere the limit only ends a hang */
    const enum err e = scene_load(path, &how, &s, NULL, &why);
    if (e != expected || s || !strstr(why.text, because) || !strstr(why.text, path))
        fail_msg("%s: not %d, '%s' but %d: %s", name, expected, because, e, why.text);
    for (const char *c = why.text; *c; c++)
        assert_true(*c >= ' ' || strcmp(name, "talk-escape") == 0);
    path = folder_text(&f, "good.json", SCENE);
    if (scene_load(path, &bad, &s, NULL, &why))
        fail_msg("after %s: %s", name, why.text);
    scene_destroy(s);
    folder_remove(&f);
}

static void a_crash_costs_a_message(void **state)
{
    (void)state;
    need_confinement();
    deed("crash", ERR_FORMAT, "relight-reader crashed (signal 11)");
    deed("abort", ERR_FORMAT, "relight-reader crashed (signal 6)");
    deed("exit", ERR_FORMAT, "relight-reader crashed (exit code 3)");
}

static void endless_work_costs_a_message(void **state)
{
    (void)state;
    deed("hang", ERR_RANGE, "took longer than 1 s");
}

static void too_much_memory_costs_a_message(void **state)
{
    (void)state;
    need_confinement();
    deed("eat", ERR_RANGE, "needs more than 0.064 GB");
    deed("fill", ERR_RANGE, "needs more than 0.064 GB");
}

static void a_reader_that_asks_for_more_than_its_due_dies_of_it(void **state)
{
    static const char *const deeds[] = { "ask-open", "ask-socket", "ask-fork",  "ask-exec",
                                         "ask-kill", "ask-code",   "ask-limits" };

    (void)state;
    need_confinement();
    for (size_t i = 0; i < sizeof(deeds) / sizeof(deeds[0]); i++)
        deed(deeds[i], ERR_FORMAT, "made a forbidden system call");
}

static void what_a_reader_says_is_not_believed(void **state)
{
    (void)state;
    deed("talk-magic", ERR_FORMAT, "sent an invalid answer");
    deed("talk-kind", ERR_FORMAT, "sent an invalid answer");
    deed("talk-hello", ERR_FORMAT, "sent an invalid answer");
    deed("talk-result", ERR_FORMAT, "sent an invalid answer");
    deed("talk-empty", ERR_FORMAT, "sent an invalid scene");
}

static void a_reader_sees_no_other_files(void **state)
{
    struct reason why = { "" };
    struct scene *s = NULL;
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "a.obj", SQUARE);
    assert_int_equal(scene_load(folder_text(&f, "outside.json", SCENE), &bad, &s, NULL, &why), ERR_IO);
    assert_non_null(strstr(why.text, "/etc/passwd: is outside of the folders"));
    assert_int_equal(scene_load(folder_text(&f, "late.json", SCENE), &bad, &s, NULL, &why), ERR_FORMAT);
    assert_null(s);
    folder_remove(&f);
}

static void a_reader_that_is_missing_is_said(void **state)
{
    const struct scene_reading none = { .program = "/nowhere/relight-reader" };
    const struct scene_reading other = { .program = "/bin/true" };
    struct reason why = { "" };
    struct scene *s = NULL;

    (void)state;
    assert_int_equal(scene_load(EXAMPLES "/ring.json", &none, &s, NULL, &why), ERR_IO);
    assert_non_null(strstr(why.text, "/nowhere/relight-reader: cannot execute"));
    assert_int_equal(scene_load(EXAMPLES "/ring.json", &other, &s, NULL, &why), ERR_IO);
    assert_non_null(strstr(why.text, "/bin/true: is not the relight-reader of this version"));
    assert_null(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(scenes_are_the_same_to_the_bit),
    cmocka_unit_test(shared_scenes_are_the_same_to_the_bit),
    cmocka_unit_test(warnings_and_progress_come_through),
    cmocka_unit_test(a_bad_file_has_the_reason_of_its_reader),
    cmocka_unit_test(changes_of_opened_files_are_seen),
    cmocka_unit_test(a_model_that_is_written_meanwhile_costs_a_message),
    cmocka_unit_test(the_time_of_animations_reaches_the_reader),
    cmocka_unit_test(a_crash_costs_a_message),
    cmocka_unit_test(endless_work_costs_a_message),
    cmocka_unit_test(too_much_memory_costs_a_message),
    cmocka_unit_test(a_reader_that_asks_for_more_than_its_due_dies_of_it),
    cmocka_unit_test(what_a_reader_says_is_not_believed),
    cmocka_unit_test(a_reader_sees_no_other_files),
    cmocka_unit_test(a_reader_that_is_missing_is_said),
};

UNIT_MAIN(tests)
