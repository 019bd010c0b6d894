/* The relighter's cache for --method cached: made once, told apart, refused where it is too large, and what it leaves
 * is sampled. */

#include "light/frame/stage.h"
#include "scene/geometry/files.h"
#include "support/kept.h"
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

enum { WIDTH = 32, HEIGHT = 18 };

static struct stage court_of(uint32_t width, uint32_t height)
{
    return stage_make(&(struct prepared_scene_desc){ .width = width, .height = height }, sky_with_sun(64, 32, 2e3f));
}

static struct stage court(void)
{
    return court_of(WIDTH, HEIGHT);
}

static void it_is_computed_once_and_told_apart(void **state)
{
    const struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 } };
    struct relight_stats first, second;
    struct stage s = court();
    double ms;
    (void)state;

    assert_int_equal(stage_run(&s, &light, &first), ERR_OK);
    assert_int_equal(stage_run(&s, &light, &second), ERR_OK);
    assert_true(first.cache_ms > 0.0 && second.cache_ms == 0.0);
    assert_true(first.cache.bytes > 0 && first.cache.bytes == second.cache.bytes);
    assert_true(first.cache.packets == s.set->gbuffer->packet_count);
    assert_true(first.cache_frame.sun > 0 && first.direct.rays >= first.cache_frame.rays);
    assert_non_null(first.bias);
    assert_int_equal(relighter_prepare(s.relighter, &light, false, &ms), ERR_OK);
    assert_true(ms == 0.0);
    stage_finish(&s);
}

/* Refused again without being computed again; another limit is another question. */
static void one_that_is_too_large_is_refused(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 }, .cache_bytes = 1000 };
    struct relight_stats stats;
    struct stage s = court();
    struct reason before;
    (void)state;

    assert_int_equal(stage_run(&s, &light, &stats), ERR_RANGE);
    assert_non_null(strstr(s.why.text, "--cache-memory"));
    before = s.why;
    s.why.text[0] = '\0';
    assert_int_equal(stage_run(&s, &light, &stats), ERR_RANGE);
    assert_string_equal(s.why.text, before.text);
    assert_true(stats.cache_ms == 0.0);
    light.cache_bytes = 0;
    assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
    light.cache_bytes = 1000;
    light.direct.method = METHOD_MIS; /* which needs none */
    assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
    assert_true(stats.cache.bytes == 0);
    stage_finish(&s);
}

/* V = 1 everywhere: more light than with shadows, by a tenth at least in this court. */
static void without_visibility_it_is_another(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 } };
    struct relight_stats stats;
    struct stage s = court();
    double sum[2] = { 0.0 };
    (void)state;

    for (int k = 0; k < 2; k++) {
        light.direct.no_visibility = k;
        assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
        assert_true(stats.cache_ms > 0.0);
        for (size_t i = 0; i < (size_t)s.set->gbuffer->packet_count * 3 * PACKET; i++)
            sum[k] += (double)relighter_points(s.relighter)[i];
    }
    assert_true(sum[1] > 1.1 * sum[0]);
    stage_finish(&s);
}

/* ---- Files ---- */

/* A folder of its own as the user's caches; returns its path, static storage. */
static const char *own_caches(void)
{
    static char path[64];

    strcpy(path, "/tmp/relight-caches-XXXXXX");
    assert_non_null(mkdtemp(path));
    assert_int_equal(setenv("XDG_CACHE_HOME", path, 1), 0);
    return path;
}

/* Another relighter, as if in another run, makes the image; true when its cache was loaded. */
static bool run_anew(struct stage *s, const struct relight_desc *light, float **lo)
{
    const size_t floats = (size_t)s->set->gbuffer->packet_count * 3 * PACKET;
    struct relight_stats stats;

    relighter_destroy(s->relighter);
    s->relighter = relighter_create(s->set, best_kernels());
    assert_int_equal(stage_run(s, light, &stats), ERR_OK);
    assert_true(stats.cache_ms > 0.0);
    *lo = mem_alloc(floats, sizeof(float));
    memcpy(*lo, relighter_points(s->relighter), floats * sizeof(float));
    return stats.cache_loaded;
}

/* The file of the built-in scene is made in a folder that was not there, and loaded by the next run; one that is
 * damaged is refused once and replaced, another seed gets a file of its own. All give the same bits. */
static void another_run_loads_what_one_has_computed(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16, .no_visibility = true },
                                  .cache_file = "" };
    struct stage s = court();
    const size_t bytes = (size_t)s.set->gbuffer->packet_count * 3 * PACKET * sizeof(float);
    float *first, *again;
    char name[256], folder[96];
    (void)state;

    const char *caches = own_caches();
    snprintf(folder, sizeof(folder), "%s/relightd", caches);
    assert_false(run_anew(&s, &light, &first));
    assert_int_equal(kept_files(folder, name), 1);
    assert_non_null(strstr(name, "/builtin.main-32x18-"));
    for (int k = 0; k < 6; k++) {
        if (k == 2) { /* in the middle, as a failing disk might */
            FILE *f = fopen(name, "r+b");
            assert_true(f && fseek(f, 50000, SEEK_SET) == 0 && fwrite("?", 1, 1, f) == 1 && fclose(f) == 0);
        }
        light.direct.seed = k == 4;
        log_begin();
        const bool loaded = run_anew(&s, &light, &again);
        assert_int_equal(count_of(log_end(), "a checksum does not match; it is computed again"), k == 2);
        assert_int_equal(loaded, k != 2 && k != 4);
        assert_int_equal(memcmp(first, again, bytes) == 0, k != 4);
        assert_int_equal(kept_files(folder, name), k < 4 ? 1 : 2);
        mem_free(again);
    }
    mem_free(first);
    kept_remove(folder);
    assert_int_equal(rmdir(caches), 0);
    stage_finish(&s);
}

/* A name of one's own; none; and places that cannot be: the image comes all the same. */
static void files_are_where_they_are_asked_for_or_nowhere(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16, .no_visibility = true } };
    struct stage s = court();
    float *lo;
    char name[96], other[96];
    (void)state;

    const char *caches = own_caches();
    snprintf(name, sizeof(name), "%s/mine", caches);
    snprintf(other, sizeof(other), "%s/no/folder", caches);
    const char *const asked[] = { NULL, name, name, other };
    for (int k = 0; k < 4; k++) {
        light.cache_file = asked[k];
        assert_int_equal(run_anew(&s, &light, &lo), k == 2);
        assert_int_equal(access(name, R_OK) == 0, k > 0);
        mem_free(lo);
    }
    assert_int_equal(unlink(name), 0);
    assert_int_equal(rmdir(caches), 0); /* nothing else was made in it */
    setenv("XDG_CACHE_HOME", "/dev/null", 1);
    light.cache_file = "";
    assert_false(run_anew(&s, &light, &lo));
    mem_free(lo);
    stage_finish(&s);
}

/* A folder that is none, or somebody else's, or on no disk: said once, and the image comes. Indirect light, in the
 * first, asks for the file a second time. */
static void a_folder_that_cannot_be_used_is_reported_once(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 4 }, .cache_file = "" };
    struct stage s = court_of(8, 5);
    char file[] = "/tmp/relight-caches-XXXXXX", foreign[] = "/tmp/relight-caches-XXXXXX";
    const char *const why[] = { "is not a folder", "cannot create the folder", "belongs to user" };
    float *lo;
    (void)state;

    assert_true(close(mkstemp(file)) == 0 && mkdtemp(foreign) != NULL);
    const bool root = geteuid() == 0 && chown(foreign, 12345, 12345) == 0;
    const char *const folders[] = { file, "/proc/relight", foreign };
    for (int k = 0; k < (root ? 3 : 2); k++) {
        light.cache_dir = folders[k];
        light.classes = k == 0 ? PATH_ALL : 0;
        log_begin();
        assert_false(run_anew(&s, &light, &lo));
        const char *log = log_end();
        if (count_of(log, "warning") != 1)
            fail_msg("%s: %s", folders[k], log);
        assert_int_equal(count_of(log, why[k]), 1);
        mem_free(lo);
    }
    unlink(file);
    rmdir(foreign);
    stage_finish(&s);
}

/* No space is left where the file goes, here by a limit on files: said once, nothing half written stays, and a later
 * run with room keeps it. */
static void a_full_disk_is_reported_once(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 4 }, .cache_file = "" };
    struct stage s = court_of(16, 9);
    struct rlimit before, small;
    char folder[] = "/tmp/relight-caches-XXXXXX";
    float *lo;
    (void)state;

    assert_non_null(mkdtemp(folder));
    light.cache_dir = folder;
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &before), 0);
    for (int full = 1; full >= 0; full--) {
        small = before;
        small.rlim_cur = full ? 4096 : before.rlim_cur;
        log_begin();
        assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
        assert_false(run_anew(&s, &light, &lo));
        assert_int_equal(setrlimit(RLIMIT_FSIZE, &before), 0);
        const char *log = log_end();
        if (count_of(log, "not kept for the next run") != full || count_of(log, "kept in") != !full)
            fail_msg("%s", log);
        if (full)
            assert_int_equal(rmdir(folder), 0); /* empty */
        mem_free(lo);
    }
    kept_remove(folder);
    stage_finish(&s);
}

/* ---- In the background ---- */

static float *copy_points(const struct stage *s)
{
    const size_t floats = (size_t)s->set->gbuffer->packet_count * 3 * PACKET;
    float *lo = mem_alloc(floats, sizeof(float));

    memcpy(lo, relighter_points(s->relighter), floats * sizeof(float));
    return lo;
}

/* Frames come while it is computed, the last ones are those of a cache that was waited for, and its file is loaded by
 * the next run; a frame that is to be the same whenever it is made waits. */
static void computed_in_the_background_it_ends_as_if_waited_for(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16, .no_visibility = true } };
    struct stage s = court();
    const size_t bytes = (size_t)s.set->gbuffer->packet_count * 3 * PACKET * sizeof(float);
    struct relight_stats stats;
    float *waited, *lo = NULL;
    char name[96];
    double ms;
    (void)state;

    const char *caches = own_caches();
    snprintf(name, sizeof(name), "%s/mine", caches);
    assert_false(run_anew(&s, &light, &waited));
    light.cache_file = name;
    for (int run_number = 0; run_number < 2; run_number++) { /* 0: to the end by frames; 1: a frame waits */
        relighter_destroy(s.relighter);
        s.relighter = relighter_create(s.set, best_kernels());
        light.cache_background = true;
        assert_int_equal(relighter_prepare(s.relighter, &light, false, &ms), ERR_OK);
        assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
        assert_true(!stats.cache_refused && !stats.cache_loaded && stats.cache_ms == 0.0);
        light.cache_background = run_number == 0;
        int same = 0;
        for (int k = 0; k < 100000 && same < 3; k++) {
            assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
            same += stats.cache_share == 1.0 && memcmp(waited, relighter_points(s.relighter), bytes) == 0;
            assert_true(run_number == 0 || same == k + 1);
        }
        assert_int_equal(same, 3);
        relighter_destroy(s.relighter); /* which waits for the file */
        s.relighter = relighter_create(s.set, best_kernels());
        light.cache_background = true;
        assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
        assert_true(stats.cache_loaded && stats.cache_share == 1.0);
        mem_free(lo);
        lo = copy_points(&s);
        assert_memory_equal(waited, lo, bytes);
        assert_int_equal(unlink(name), 0);
    }
    mem_free(lo);
    mem_free(waited);
    assert_int_equal(rmdir(caches), 0);
    stage_finish(&s);
}

/* Images go on by auto; who waits is told. */
static void refused_in_the_background_it_is_auto(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 },
                                  .cache_bytes = 300000,
                                  .cache_background = true };
    struct stage s = court();
    const size_t bytes = (size_t)s.set->gbuffer->packet_count * 3 * PACKET * sizeof(float);
    struct relight_stats stats = { .cache_refused = false };
    (void)state;

    for (int k = 0; k < 100000 && !stats.cache_refused; k++)
        assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
    assert_true(stats.cache_refused && !stats.bias);
    float *lo = copy_points(&s);
    light.direct.method = METHOD_AUTO;
    assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
    assert_memory_equal(lo, relighter_points(s.relighter), bytes);
    light.direct.method = METHOD_CACHED;
    light.cache_background = false;
    assert_int_equal(stage_run(&s, &light, &stats), ERR_RANGE);
    assert_non_null(strstr(s.why.text, "--cache-memory"));
    mem_free(lo);
    stage_finish(&s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(it_is_computed_once_and_told_apart),
    cmocka_unit_test(one_that_is_too_large_is_refused),
    cmocka_unit_test(without_visibility_it_is_another),
    cmocka_unit_test(another_run_loads_what_one_has_computed),
    cmocka_unit_test(files_are_where_they_are_asked_for_or_nowhere),
    cmocka_unit_test(a_folder_that_cannot_be_used_is_reported_once),
    cmocka_unit_test(a_full_disk_is_reported_once),
    cmocka_unit_test(computed_in_the_background_it_ends_as_if_waited_for),
    cmocka_unit_test(refused_in_the_background_it_is_auto),
};
UNIT_MAIN(tests)
