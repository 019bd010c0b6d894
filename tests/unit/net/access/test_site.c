/* The page's files: which are served, under which address, and what is refused. */
#include "net/access/site.h"
#include "support/folder.h"
#include "support/unit.h"

#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static void put(const char *name, const char *text)
{
    char path[200];

    snprintf(path, sizeof(path), "%s/%s", folder, name);
    FILE *f = fopen(path, "w");
    assert_non_null(f);
    fputs(text, f);
    fclose(f);
}

static void assert_file(const struct site *s, const char *path, const char *type, const char *text)
{
    const struct site_file *f = site_find(s, path);

    if (!f)
        fail_msg("%s is not served", path);
    assert_string_equal(f->type, type);
    assert_int_equal(f->size, strlen(text));
    assert_memory_equal(f->bytes, text, f->size);
}

/* Pages lose their extension, files of a folder keep its name; hidden ones, unknown kinds and folders of folders are
 * not there. The tag is that of the bytes. */
static void files_have_their_address_kind_and_tag(void **state)
{
    struct site s, again;
    struct reason why;
    char inner[100];
    (void)state;

    snprintf(inner, sizeof(inner), "%s/js", folder);
    assert_int_equal(mkdir(inner, 0700), 0);
    snprintf(inner, sizeof(inner), "%s/js/deep", folder);
    assert_int_equal(mkdir(inner, 0700), 0);
    put("index.html", "<p>start");
    put("embed.html", "<p>embed");
    put("app.js", "1;");
    put("js/inner.js", "2;");
    put("js/deep/not.js", "3;");
    put(".hidden.js", "4;");
    put("notes.txt", "5");
    assert_int_equal(site_load(&s, folder, &why), ERR_OK);
    assert_int_equal(s.count, 4);
    assert_file(&s, "/", "text/html; charset=utf-8", "<p>start");
    assert_file(&s, "/index.html", "text/html; charset=utf-8", "<p>start");
    assert_file(&s, "/embed", "text/html; charset=utf-8", "<p>embed");
    assert_file(&s, "/app.js", "text/javascript; charset=utf-8", "1;");
    assert_file(&s, "/js/inner.js", "text/javascript; charset=utf-8", "2;");
    assert_null(site_find(&s, "/embed.htm"));
    assert_null(site_find(&s, "/js/deep/not.js"));
    put("app.js", "9;"); /* of the same length */
    assert_int_equal(site_load(&again, folder, &why), ERR_OK);
    assert_string_equal(site_find(&again, "/")->etag, site_find(&s, "/")->etag);
    assert_string_not_equal(site_find(&again, "/app.js")->etag, site_find(&s, "/app.js")->etag);
    assert_true(site_find(&s, "/app.js")->etag[0] == '"' && strlen(site_find(&s, "/app.js")->etag) == 18);
    site_finish(&s);
    site_finish(&again);
}

static void what_is_no_page_is_refused_with_its_name(void **state)
{
    struct site s;
    struct reason why;
    char path[40], program[4096];
    (void)state;

    assert_int_equal(site_load(&s, "/nowhere", &why), ERR_IO);
    assert_non_null(strstr(why.text, "/nowhere: the folder of the page cannot be read: No such file"));
    put("app.js", "1;");
    assert_int_equal(site_load(&s, folder, &why), ERR_IO);
    assert_non_null(strstr(why.text, "has no index.html"));
    assert_int_equal(site_folder("/asked", path, sizeof(path), &why), ERR_OK);
    assert_string_equal(path, "/asked");
    assert_int_equal(site_folder("/a/folder/whose/path/is/longer/than/forty/letters", path, sizeof(path), &why),
                     ERR_RANGE);
    assert_int_equal(site_folder(NULL, program, sizeof(program), &why), ERR_OK); /* beside this program's folder */
    assert_non_null(strstr(program, "/bin/../share/relightd/web"));
}

static void a_page_has_limits_that_are_told(void **state)
{
    char name[32], dir[4096];
    struct site s;
    struct reason why;
    (void)state;

    put("index.html", "<p>start");
    for (int i = 1; i < SITE_FILES_MAX; i++) {
        snprintf(name, sizeof(name), "f%d.js", i);
        put(name, "1;");
    }
    assert_int_equal(site_load(&s, folder, &why), ERR_OK);
    assert_int_equal(s.count, SITE_FILES_MAX);
    site_finish(&s);
    put("more.js", "1;");
    assert_int_equal(site_load(&s, folder, &why), ERR_RANGE);
    snprintf(dir, sizeof(dir), "%s: more than %d files for the page", folder, SITE_FILES_MAX);
    assert_string_equal(why.text, dir);
}

/* The folder's path as long as it may be with "/index.html" behind, and one letter longer. */
static void a_path_may_be_as_long_as_the_system_allows(void **state)
{
    char dir[4096];
    struct site s;
    struct reason why;
    (void)state;

    put("index.html", "<p>start");
    for (size_t length = 4095 - 11; length <= 4096 - 11; length++) {
        size_t n = (size_t)snprintf(dir, sizeof(dir), "%s", folder);
        while (n < length)
            dir[n++] = '/';
        dir[n] = '\0';
        assert_int_equal(site_load(&s, dir, &why), length == 4095 - 11 ? ERR_OK : ERR_RANGE);
        if (length == 4095 - 11)
            site_finish(&s);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test_setup_teardown(a_page_has_limits_that_are_told, make_folder, remove_folder),
    cmocka_unit_test_setup_teardown(a_path_may_be_as_long_as_the_system_allows, make_folder, remove_folder),
    cmocka_unit_test_setup_teardown(files_have_their_address_kind_and_tag, make_folder, remove_folder),
    cmocka_unit_test_setup_teardown(what_is_no_page_is_refused_with_its_name, make_folder, remove_folder),
};
UNIT_MAIN(tests)
