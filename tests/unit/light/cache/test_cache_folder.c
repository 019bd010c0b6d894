/* The folder of kept files: where it is, whose it is, and what goes first when it is full. */
#include "light/cache/cache_file.h"
#include "support/kept.h"

#include <fcntl.h>
#include <stdbool.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <time.h>

static char folder[32];

static int set_up(void **state)
{
    (void)state;
    strcpy(folder, "/tmp/relight-folder-XXXXXX");
    return mkdtemp(folder) == NULL;
}

static int tear_down(void **state)
{
    (void)state;
    kept_remove(folder);
    return 0;
}

/* A file of 100 bytes, last used so many seconds ago. */
static void put(const char *name, time_t ago)
{
    char path[128];

    snprintf(path, sizeof(path), "%s/%s", folder, name);
    FILE *f = fopen(path, "wb");
    assert_true(f && fseek(f, 99, SEEK_SET) == 0 && fputc(0, f) == 0 && fclose(f) == 0);
    const struct timespec t[2] = { { .tv_sec = time(NULL) - ago }, { .tv_sec = time(NULL) - ago } };
    assert_int_equal(utimensat(AT_FDCWD, path, t, 0), 0);
}

static bool is_there(const char *name)
{
    char path[128];

    snprintf(path, sizeof(path), "%s/%s", folder, name);
    return access(path, F_OK) == 0;
}

static void touch(const char *name)
{
    char path[128];

    snprintf(path, sizeof(path), "%s/%s", folder, name);
    cache_folder_touch(path);
}

static enum err trim(const char *keep, uint64_t more, uint64_t limit)
{
    struct reason why;

    return cache_folder_trim(folder, keep, more, limit, &why);
}

static void the_least_recently_used_goes_first(void **state)
{
    (void)state;
    put("a.transport", 3000);
    put("b.transport", 2000);
    put("c.transport", 1000);
    put("notes.txt", 9000); /* somebody's own */
    assert_int_equal(trim(NULL, 100, 400), ERR_OK);
    assert_true(is_there("a.transport") && is_there("b.transport") && is_there("c.transport"));
    touch("a.transport");
    assert_int_equal(trim(NULL, 100, 300), ERR_OK);
    assert_true(is_there("a.transport") && !is_there("b.transport") && is_there("c.transport"));
    assert_int_equal(trim("x/c.transport", 250, 300), ERR_OK); /* c is about to be replaced */
    assert_true(!is_there("a.transport") && is_there("c.transport"));
    assert_int_equal(trim(NULL, 301, 300), ERR_RANGE);
    assert_true(is_there("c.transport") && is_there("notes.txt"));
}

/* What a writer leaves that was killed goes after a while; one that still writes is left alone. */
static void what_was_left_behind_goes(void **state)
{
    (void)state;
    put("a.transport.part", 10000);
    put("a.transport.7.part", 10000);
    put("b.transport.part", 10);
    put("mine.part", 10000);
    assert_int_equal(trim(NULL, 0, 1000), ERR_OK);
    assert_true(!is_there("a.transport.part") && !is_there("a.transport.7.part"));
    assert_true(is_there("b.transport.part") && is_there("mine.part"));
}

static void variables_say_where_it_is(void **state)
{
    struct reason why;
    char path[64], small[8];
    (void)state;

    setenv("XDG_CACHE_HOME", "/x", 1);
    assert_int_equal(cache_folder_find(NULL, path, sizeof(path), &why), ERR_OK);
    assert_string_equal(path, "/x/relightd");
    setenv("CACHE_DIRECTORY", "/one:/two", 1);
    assert_int_equal(cache_folder_find(NULL, path, sizeof(path), &why), ERR_OK);
    assert_string_equal(path, "/one");
    assert_int_equal(cache_folder_find("mine", path, sizeof(path), &why), ERR_OK);
    assert_string_equal(path, "mine");
    assert_int_equal(cache_folder_find("/far/too/long", small, sizeof(small), &why), ERR_IO);
    unsetenv("CACHE_DIRECTORY");
    unsetenv("XDG_CACHE_HOME");
    unsetenv("HOME");
    assert_int_equal(cache_folder_find(NULL, path, sizeof(path), &why), ERR_USAGE);
}

static void a_folder_is_made_or_refused(void **state)
{
    struct reason why;
    char path[64];
    struct stat st;
    (void)state;

    snprintf(path, sizeof(path), "%s/new", folder);
    assert_int_equal(cache_folder_check(path, &why), ERR_OK);
    assert_int_equal(stat(path, &st), -1);
    assert_int_equal(cache_folder_prepare(path, &why), ERR_OK);
    assert_int_equal(rmdir(path), 0);
    put("new", 0);
    assert_int_equal(cache_folder_prepare(path, &why), ERR_IO);
    assert_non_null(strstr(why.text, "is not a folder"));
    assert_non_null(strstr(why.text, path));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test_setup_teardown(the_least_recently_used_goes_first, set_up, tear_down),
    cmocka_unit_test_setup_teardown(what_was_left_behind_goes, set_up, tear_down),
    cmocka_unit_test(variables_say_where_it_is),
    cmocka_unit_test_setup_teardown(a_folder_is_made_or_refused, set_up, tear_down),
};
UNIT_MAIN(tests)
