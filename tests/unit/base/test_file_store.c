#include "support/unit.h"

#include "base/file_store.h"

#include <dirent.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

struct folder {
    char path[64], file[128], part[160];
};

static void enter(struct folder *f)
{
    snprintf(f->path, sizeof(f->path), "/tmp/relight-store-XXXXXX");
    assert_non_null(mkdtemp(f->path));
    snprintf(f->file, sizeof(f->file), "%s/a.bin", f->path);
    snprintf(f->part, sizeof(f->part), "%s.part", f->file);
}

/* How many names there are; removes them and the folder. */
static int leave(struct folder *f)
{
    DIR *d = opendir(f->path);
    int count = 0;

    assert_non_null(d);
    for (struct dirent *e; (e = readdir(d)) != NULL;) {
        char path[512];
        if (e->d_name[0] == '.')
            continue;
        snprintf(path, sizeof(path), "%s/%s", f->path, e->d_name);
        unlink(path);
        count++;
    }
    closedir(d);
    rmdir(f->path);
    return count;
}

static size_t content(const char *path, char *out, size_t room)
{
    FILE *f = fopen(path, "rb");
    const size_t n = f ? fread(out, 1, room, f) : 0;

    if (f)
        fclose(f);
    return n;
}

static void a_file_is_replaced_whole_and_alone(void **state)
{
    struct reason why = { "" };
    struct folder f;
    char got[16];

    (void)state;
    enter(&f);
    assert_int_equal(file_store(f.file, "long content", 12, &why), ERR_OK);
    assert_int_equal(file_store(f.file, "short", 5, &why), ERR_OK);
    assert_int_equal(content(f.file, got, sizeof(got)), 5);
    assert_memory_equal(got, "short", 5);
    assert_int_equal(leave(&f), 1);
}

/* A relative name without a slash has a folder too. */
static void a_name_in_the_working_folder_is_stored(void **state)
{
    struct reason why = { "" };
    struct folder f;
    char old[4096], got[4];

    (void)state;
    enter(&f);
    assert_non_null(getcwd(old, sizeof(old)));
    assert_int_equal(chdir(f.path), 0);
    const enum err e = file_store("a.bin", "x", 1, &why);
    assert_int_equal(content("a.bin", got, sizeof(got)), 1);
    assert_int_equal(chdir(old), 0);
    assert_int_equal(e, ERR_OK);
    assert_int_equal(leave(&f), 1);
}

static void what_a_killed_writer_left_is_taken_over(void **state)
{
    struct reason why = { "" };
    struct folder f;
    char got[64];

    (void)state;
    enter(&f);
    FILE *part = fopen(f.part, "wb");
    assert_non_null(part);
    fputs("half of a much longer file", part);
    fclose(part);
    assert_int_equal(file_store(f.file, "whole", 5, &why), ERR_OK);
    assert_int_equal(content(f.file, got, sizeof(got)), 5);
    assert_int_equal(leave(&f), 1);
}

/* Another process that is writing keeps its own temporary file. */
static void two_writers_do_not_share_a_temporary_file(void **state)
{
    struct flock lock = { .l_type = F_WRLCK, .l_whence = SEEK_SET };
    struct reason why = { "" };
    struct folder f;
    char got[64], byte;
    int ready[2];

    (void)state;
    enter(&f);
    assert_int_equal(pipe(ready), 0);
    const pid_t other = fork();
    if (other == 0) {
        const int fd = open(f.part, O_WRONLY | O_CREAT, 0666);
        if (fcntl(fd, F_SETLK, &lock) != 0 || write(fd, "theirs", 6) != 6 || write(ready[1], "x", 1) != 1)
            _exit(1);
        pause();
        _exit(0);
    }
    assert_int_equal(read(ready[0], &byte, 1), 1);
    const enum err e = file_store(f.file, "ours", 4, &why);
    const size_t n = content(f.part, got, sizeof(got));
    kill(other, SIGKILL);
    waitpid(other, NULL, 0);
    assert_int_equal(e, ERR_OK);
    assert_int_equal(n, 6);
    assert_memory_equal(got, "theirs", 6);
    assert_int_equal(content(f.file, got, sizeof(got)), 4);
    close(ready[0]);
    close(ready[1]);
    assert_int_equal(leave(&f), 2);
}

/* Nobody makes us write through a link of theirs in a folder that all may write to. */
static void a_link_under_the_temporary_name_is_not_followed(void **state)
{
    struct reason why = { "" };
    struct folder f;
    char victim[160], got[16];

    (void)state;
    enter(&f);
    snprintf(victim, sizeof(victim), "%s/victim", f.path);
    assert_int_equal(file_store(victim, "keep", 4, &why), ERR_OK);
    assert_int_equal(symlink("victim", f.part), 0);
    assert_int_equal(file_store(f.file, "new", 3, &why), ERR_OK);
    assert_int_equal(content(victim, got, sizeof(got)), 4);
    assert_int_equal(content(f.file, got, sizeof(got)), 3);
    assert_int_equal(leave(&f), 3);
}

#define STRANGER 65534 /* a user that owns nothing else here */

/* Whether this user may act as another one. */
static bool may_act(void)
{
    return geteuid() == 0;
}

/* In a folder of another user: what that user put under the name is replaced, and under the temporary name left
 * alone. */
static void what_others_put_there_is_not_written_through(void **state)
{
    struct reason why = { "" };
    struct stat st;
    struct folder f;
    char victim[160], got[16];

    (void)state;
    enter(&f);
    snprintf(victim, sizeof(victim), "%s/victim", f.path);
    assert_int_equal(file_store(victim, "keep", 4, &why), ERR_OK);
    for (int kind = 0; may_act() && kind < 4; kind++) {
        const char *name = kind < 2 ? f.file : f.part;
        unlink(f.file);
        unlink(f.part);
        if (kind % 2 == 0)
            assert_int_equal(symlink("victim", name), 0);
        else
            assert_int_equal(mkfifo(name, 0666), 0);
        assert_int_equal(lchown(name, STRANGER, STRANGER), 0);
        alarm(20); /* a pipe without a reader would block */
        assert_int_equal(file_store(f.file, "new", 3, &why), ERR_OK);
        alarm(0);
        assert_int_equal(content(victim, got, sizeof(got)), 4);
        assert_int_equal(lstat(f.file, &st), 0);
        assert_true(S_ISREG(st.st_mode) && st.st_uid == geteuid());
        assert_int_equal(content(f.file, got, sizeof(got)), 3);
    }
    leave(&f);
}

/* Else the finished file would belong to them. */
static void a_file_of_others_under_the_temporary_name_is_left_alone(void **state)
{
    struct reason why = { "" };
    struct stat st;
    struct folder f;
    char got[16];

    (void)state;
    enter(&f);
    FILE *part = fopen(f.part, "wb");
    assert_non_null(part);
    fputs("theirs", part);
    fclose(part);
    if (!may_act() || chown(f.part, STRANGER, STRANGER) != 0) {
        leave(&f);
        return;
    }
    assert_int_equal(file_store(f.file, "new", 3, &why), ERR_OK);
    assert_int_equal(stat(f.file, &st), 0);
    assert_int_equal(st.st_uid, geteuid());
    assert_int_equal(content(f.file, got, sizeof(got)), 3);
    assert_int_equal(content(f.part, got, sizeof(got)), 6);
    assert_int_equal(leave(&f), 2);
}

/* A second name of a file of ours would let others have it emptied. */
static void a_second_name_of_a_file_is_not_a_leftover(void **state)
{
    struct reason why = { "" };
    struct folder f;
    char victim[160], got[16];

    (void)state;
    enter(&f);
    snprintf(victim, sizeof(victim), "%s/victim", f.path);
    assert_int_equal(file_store(victim, "keep", 4, &why), ERR_OK);
    assert_int_equal(link(victim, f.part), 0);
    assert_int_equal(file_store(f.file, "new", 3, &why), ERR_OK);
    assert_int_equal(content(victim, got, sizeof(got)), 4);
    assert_int_equal(file_open(victim, O_WRONLY), -1);
    assert_int_equal(leave(&f), 3);
}

static void own_links_and_pipes_are_written_in_place(void **state)
{
    struct reason why = { "" };
    struct folder f;
    char target[160], got[16];
    int ends;

    (void)state;
    enter(&f);
    snprintf(target, sizeof(target), "%s/target", f.path);
    assert_int_equal(symlink("target", f.file), 0);
    assert_int_equal(file_store(f.file, "first", 5, &why), ERR_OK);
    assert_int_equal(file_store(f.file, "new", 3, &why), ERR_OK);
    assert_int_equal(content(target, got, sizeof(got)), 3);
    assert_int_equal(unlink(f.file), 0);
    assert_int_equal(mkfifo(f.file, 0600), 0);
    ends = open(f.file, O_RDWR);
    assert_int_equal(file_store(f.file, "piped", 5, &why), ERR_OK);
    assert_int_equal(read(ends, got, sizeof(got)), 5);
    close(ends);
    assert_int_equal(leave(&f), 2);
}

/* As a library does it: by name, also after another user has put a link in the file's place. */
static void a_draft_is_the_open_file_whatever_its_name_becomes(void **state)
{
    struct reason why = { "" };
    struct file_draft d;
    struct folder f;
    char victim[160], got[16];

    (void)state;
    enter(&f);
    snprintf(victim, sizeof(victim), "%s/victim", f.path);
    assert_int_equal(file_store(victim, "keep", 4, &why), ERR_OK);
    assert_int_equal(file_draft_begin(&d, f.file, &why), ERR_OK);
    assert_int_equal(unlink(f.part), 0);
    assert_int_equal(symlink("victim", f.part), 0);
    FILE *library = fopen(d.name, "wb");
    assert_non_null(library);
    fputs("new", library);
    fclose(library);
    assert_int_equal(content(victim, got, sizeof(got)), 4);
    file_draft_discard(&d);
    leave(&f);
}

/* A limit on file size stands for a disk that fills up half-way. */
static void a_full_disk_leaves_the_old_file_alone(void **state)
{
    static char large[5000];
    struct rlimit old, limit;
    struct reason why = { "" };
    struct folder f;
    char got[16];

    (void)state;
    enter(&f);
    assert_int_equal(file_store(f.file, "old", 3, &why), ERR_OK);
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &old), 0);
    limit = old;
    limit.rlim_cur = 1000;
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
    const enum err e = file_store(f.file, large, sizeof(large), &why);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &old), 0);
    assert_int_equal(e, ERR_IO);
    assert_non_null(strstr(why.text, "a.bin: cannot write the file: File too large"));
    assert_int_equal(content(f.file, got, sizeof(got)), 3);
    assert_int_equal(leave(&f), 1);
}

static void patterns_name_files_by_number(void **state)
{
    static const struct {
        const char *text;
        uint64_t number;
        const char *name;
    } good[] = {
        { "a.%04d.exr", 7, "a.0007.exr" }, { "a.%d.exr", 12345, "a.12345.exr" },
        { "%04d", 123456, "123456" },      { "d/%20d", UINT64_MAX, "d/18446744073709551615" },
        { "plain.exr", 5, "plain.exr" },
    };
    static const char *const bad[] = { "%s", "%", "a%", "%d%d", "%%d", "%021d", "%4", "%-4d", "%4294967297d", "a%x%d" };
    struct file_pattern p;
    struct reason why;
    char name[64];

    (void)state;
    for (size_t i = 0; i < sizeof(good) / sizeof(good[0]); i++) {
        assert_int_equal(file_pattern_parse(good[i].text, "--out", &p, &why), ERR_OK);
        assert_int_equal(file_pattern_name(&p, good[i].number, name, sizeof(name), &why), ERR_OK);
        assert_string_equal(name, good[i].name);
    }
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++)
        if (file_pattern_parse(bad[i], "--out", &p, &why) != ERR_USAGE || !strstr(why.text, "--out"))
            fail_msg("taken: %s", bad[i]);
    assert_int_equal(file_pattern_parse("%020d", "--out", &p, &why), ERR_OK);
    assert_int_equal(file_pattern_name(&p, 1, name, 20, &why), ERR_USAGE);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_file_is_replaced_whole_and_alone),
    cmocka_unit_test(a_name_in_the_working_folder_is_stored),
    cmocka_unit_test(what_a_killed_writer_left_is_taken_over),
    cmocka_unit_test(two_writers_do_not_share_a_temporary_file),
    cmocka_unit_test(a_link_under_the_temporary_name_is_not_followed),
    cmocka_unit_test(what_others_put_there_is_not_written_through),
    cmocka_unit_test(a_file_of_others_under_the_temporary_name_is_left_alone),
    cmocka_unit_test(a_second_name_of_a_file_is_not_a_leftover),
    cmocka_unit_test(own_links_and_pipes_are_written_in_place),
    cmocka_unit_test(a_draft_is_the_open_file_whatever_its_name_becomes),
    cmocka_unit_test(a_full_disk_leaves_the_old_file_alone),
    cmocka_unit_test(patterns_name_files_by_number),
};

UNIT_MAIN(tests)
