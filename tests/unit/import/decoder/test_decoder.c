/* Files of strangers: decoded as if nothing were between, and whatever they do to the process that decodes them, no
 * more than their own frame is lost. MISBEHAVE is that process with faults on demand (misbehave.c). */
#define _GNU_SOURCE
#include "support/unit.h"

#include "import/decoder/decoder.h"

#include <ctype.h>
#include <dirent.h>
#include <signal.h>
#include <time.h>
#include <unistd.h>

static struct decoder *begin(const struct decoder_desc *given)
{
    const struct decoder_desc none = { 0 };
    struct decoder *d = NULL;
    struct reason why = { "" };

    if (decoder_create(given ? given : &none, &d, &why) != ERR_OK)
        fail_msg("%s", why.text);
    return d;
}

static struct decoder *begin_bad(void)
{
    return begin(
        &(struct decoder_desc){ .program = MISBEHAVE, .timeout_ms = 600000, .memory_bytes = (size_t)64 << 20 });
}

/* Skips where memory has no limit and faults are reported instead of died of, and where the kernel has no seccomp. */
static void need_confinement(struct decoder *d)
{
#ifdef __SANITIZE_ADDRESS__
    const bool sanitized = true;
#else
    const bool sanitized = false;
#endif
    if (sanitized || !decoder_is_confined(d)) {
        decoder_destroy(d);
        skip();
    }
}

static enum err decode(struct decoder *d, const void *bytes, size_t size, struct image *im, struct reason *why)
{
    return decoder_decode(d, bytes, size, "frame 7", im, why);
}

/* A file that says `text` to misbehave.c is refused, and that says why. */
static void refused(struct decoder *d, const char *text, const char *because)
{
    struct image im = { 0 };
    struct reason why = { "" };
    const enum err e = decode(d, text, strlen(text), &im, &why);

    if (e == ERR_OK)
        fail_msg("'%s' was taken", text);
    if (!strstr(why.text, "frame 7") || !strstr(why.text, because))
        fail_msg("'%s': not '%s' but: %s", text, because, why.text);
    image_finish(&im);
}

static const char good[] = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nCAPDATE= 1970:01:01 00:00:09\n\n-Y 1 +X 2\n"
                           "\x80\x80\x80\x81\x40\x40\x40\x81";

static void taken(struct decoder *d)
{
    struct image im = { 0 };
    struct reason why = { "" };

    if (decode(d, good, sizeof(good) - 1, &im, &why))
        fail_msg("%s", why.text);
    assert_int_equal(im.width, 2);
    assert_int_equal(im.height, 1);
    assert_true(im.rgb[0] == 1.0f && im.rgb[3] == 0.5f);
    assert_int_equal(im.taken_us, 9000000);
    image_finish(&im);
}

static void sleep_ms(long ms)
{
    nanosleep(&(struct timespec){ ms / 1000, ms % 1000 * 1000000 }, NULL);
}

/* Taken as soon as no pause after deaths in a row is left. */
static void taken_at_last(struct decoder *d)
{
    struct image im = { 0 };
    struct reason why = { "" };

    while (decode(d, good, sizeof(good) - 1, &im, &why)) {
        if (!strstr(why.text, "in a row"))
            fail_msg("%s", why.text);
        sleep_ms(20);
    }
    image_finish(&im);
    taken(d);
}

/* The only process that this one has started. */
static pid_t child(void)
{
    char text[64] = "";
    FILE *f = fopen("/proc/thread-self/children", "r");

    if (!f)
        skip();
    if (!fgets(text, sizeof(text), f))
        text[0] = '\0';
    fclose(f);
    return (pid_t)strtol(text, NULL, 10);
}

static void a_decoder_killed_while_idle_costs_no_frame(void **state)
{
    struct decoder_counts counts;
    struct decoder *d = begin(NULL);

    (void)state;
    for (int i = 0; i < 5; i++) {
        taken(d);
        assert_int_equal(kill(child(), SIGKILL), 0);
        taken(d); /* at once, while the process may still be dying */
        assert_int_equal(kill(child(), SIGSEGV), 0);
        sleep_ms(100);
        taken(d); /* dead for a while */
    }
    decoder_counts(d, &counts);
    assert_int_equal(counts.starts, 11);
    assert_int_equal(counts.crashed, 10);
    decoder_destroy(d);
}

static uint8_t *read_file(const char *path, size_t *size)
{
    uint8_t *bytes = malloc((size_t)1 << 20);
    FILE *f = fopen(path, "rb");

    assert_non_null(bytes);
    assert_non_null(f);
    *size = fread(bytes, 1, (size_t)1 << 20, f);
    fclose(f);
    return bytes;
}

/* Both ways of decoding must agree in everything, texels, counts, layout and reasons. */
static void compare(struct decoder *d, const uint8_t *bytes, size_t size, struct image *near, struct image *far)
{
    struct reason here = { "" }, there = { "" };
    const enum err a = decode_image(bytes, size, "frame 7", near, &here);
    const enum err b = decode(d, bytes, size, far, &there);

    if (a != b)
        fail_msg("%d, not %d: '%s', '%s'", b, a, there.text, here.text);
    if (a) {
        assert_string_equal(here.text, there.text);
        return;
    }
    assert_int_equal(near->width, far->width);
    assert_int_equal(near->height, far->height);
    assert_int_equal(near->layout, far->layout);
    assert_memory_equal(&near->faults, &far->faults, sizeof(near->faults));
    assert_memory_equal(near->rgb, far->rgb, 3 * sizeof(float) * near->width * near->height);
}

static void files_are_decoded_to_the_same_bits(void **state)
{
    (void)state;
    static const char *const folders[] = { CORPUS "/exr", CORPUS "/hdr" };
    struct decoder *d = begin(NULL);
    struct decoder_counts counts;
    struct image near = { 0 }, far = { 0 };
    unsigned files = 0;

    for (size_t k = 0; k < 2; k++) {
        DIR *dir = opendir(folders[k]);
        assert_non_null(dir);
        for (struct dirent *e; (e = readdir(dir));) {
            char path[1200];
            size_t size;
            if (e->d_name[0] == '.')
                continue;
            snprintf(path, sizeof(path), "%s/%s", folders[k], e->d_name);
            uint8_t *bytes = read_file(path, &size);
            compare(d, bytes, size, &near, &far);
            free(bytes);
            files++;
        }
        closedir(dir);
    }
    assert_true(files > 40);
    decoder_counts(d, &counts);
    assert_int_equal(counts.files, files);
    assert_int_equal(counts.starts, 1); /* damaged files are refused by the decoder itself: none cost the process */
    image_finish(&near);
    image_finish(&far);
    decoder_destroy(d);
}

/* The image is 2x1 texels. */
static void an_image_above_its_limit_is_refused_by_the_process_too(void **state)
{
    (void)state;
    struct decoder *d = begin(NULL);
    struct image near = { .max_side = 1 }, far = { .max_side = 1 };
    struct reason why = { "" };

    assert_int_equal(decode(d, good, sizeof(good) - 1, &far, &why), ERR_RANGE);
    assert_non_null(strstr(why.text, "an image of 2x1 texels is too large; the limit is 1 per side"));
    compare(d, (const uint8_t *)good, sizeof(good) - 1, &near, &far);
    near.max_side = far.max_side = 2;
    assert_int_equal(decode(d, good, sizeof(good) - 1, &far, &why), ERR_OK);
    compare(d, (const uint8_t *)good, sizeof(good) - 1, &near, &far);
    image_finish(&near);
    image_finish(&far);
    decoder_destroy(d);
}

/* Bytes that the memory named so takes in this process; 0: there is none of that name. */
static size_t held_of(const char *name)
{
    FILE *f = fopen("/proc/self/smaps", "r");
    char line[512];
    bool its = false;
    size_t kib = 0, sum = 0;

    assert_non_null(f);
    while (fgets(line, sizeof(line), f)) {
        if (!isupper((unsigned char)line[0])) /* the next mapping's own line */
            its = strstr(line, name) != NULL;
        else if (its && sscanf(line, "Rss: %zu kB", &kib) == 1)
            sum += kib << 10;
    }
    fclose(f);
    return sum;
}

static void memory_of_a_huge_file_goes_back_with_the_next(void **state)
{
    (void)state;
    const size_t size = (size_t)257 << 20, kept = (size_t)65 << 20;
    struct decoder *d = begin(&(struct decoder_desc){ .file_bytes = size });
    struct image im = { 0 };
    struct reason why = { "" };
    uint8_t *bytes = malloc(size);

    assert_non_null(bytes);
    memset(bytes, 'x', size);
    assert_int_equal(decode(d, bytes, size, &im, &why), ERR_FORMAT);
    assert_true(held_of("memfd:relight-file") >= size);
    taken(d);
    const size_t held = held_of("memfd:relight-file");
    assert_true(held > 0 && held <= kept);
    free(bytes);
    image_finish(&im);
    decoder_destroy(d);
}

static void a_decoder_that_dies_costs_its_frame_only(void **state)
{
    (void)state;
    struct decoder *d = begin_bad();
    struct decoder_counts counts;

    need_confinement(d);
    refused(d, "crash", "signal 11");
    taken(d);
    refused(d, "abort", "forbidden system call"); /* raise() could signal others: not allowed either */
    taken(d);
    refused(d, "exit", "exit code 3");
    taken(d);
    decoder_counts(d, &counts);
    assert_int_equal(counts.crashed, 3);
    assert_int_equal(counts.starts, 4);
    assert_int_equal(counts.files, 6);
    decoder_destroy(d);
}

static void a_decoder_that_hangs_is_ended(void **state)
{
    (void)state;
    struct decoder *d = begin(&(struct decoder_desc){ .program = MISBEHAVE, .timeout_ms = 5000 });
    struct decoder_counts counts;

    refused(d, "hang", "timed out after 5 s");
    taken(d);
    decoder_counts(d, &counts);
    assert_int_equal(counts.timed_out, 1);
    assert_int_equal(counts.crashed, 0);
    decoder_destroy(d);
}

static void a_decoder_cannot_eat_the_memory(void **state)
{
    (void)state;
    struct decoder *d =
        begin(&(struct decoder_desc){ .program = MISBEHAVE, .timeout_ms = 600000, .memory_bytes = (size_t)64 << 20 });
    struct decoder_counts counts;

    need_confinement(d);
    refused(d, "eat", "frame 7");
    taken(d);
    decoder_counts(d, &counts);
    assert_int_equal(counts.crashed, 1); /* it asked for a GiB where 64 MiB beside the program are its due */
    decoder_destroy(d);
}

static void a_decoder_that_asks_for_more_than_its_due_dies_of_it(void **state)
{
    (void)state;
    static const char *const asks[] = { "ask open",     "ask socket", "ask fork",       "ask exec",
                                        "ask kill",     "ask ptrace", "ask code",       "ask write-code",
                                        "ask map-file", "ask limits", "ask other-table" };
    struct decoder *d = begin_bad();
    struct decoder_counts counts;

    need_confinement(d);
    for (size_t i = 0; i < sizeof(asks) / sizeof(asks[0]); i++) {
        refused(d, asks[i], "forbidden system call");
        taken(d);
    }
    decoder_counts(d, &counts);
    assert_int_equal(counts.crashed, sizeof(asks) / sizeof(asks[0]));
    decoder_destroy(d);
}

static void what_a_decoder_says_is_not_believed(void **state)
{
    (void)state;
    static const char *const lies[] = { "answer wide", "answer layout", "answer result", "answer magic",
                                        "answer short" };
    struct decoder *d = begin_bad();
    struct decoder_counts counts;
    struct image im = { 0 };
    struct reason why = { "" };

    for (size_t i = 0; i < sizeof(lies) / sizeof(lies[0]); i++) {
        refused(d, lies[i], "invalid answer");
        taken(d); /* by another process: that one is gone */
    }
    assert_int_equal(decode(d, "answer escape", 13, &im, &why), ERR_FORMAT);
    for (const char *p = why.text; *p; p++)
        assert_true(*p >= ' ' && *p < 127);
    assert_true(strlen(why.text) > 100);
    decoder_counts(d, &counts);
    assert_int_equal(counts.invalid, 5);
    decoder_destroy(d);
    image_finish(&im);
}

static void texels_are_put_right_on_this_side(void **state)
{
    (void)state;
    struct decoder *d = begin_bad();
    struct image im = { 0 };
    struct reason why = { "" };

    assert_int_equal(decode(d, "nan", 3, &im, &why), ERR_OK);
    for (int i = 0; i < 24; i++)
        assert_true(im.rgb[i] >= 0.0f && im.rgb[i] <= IMAGE_MAX);
    image_finish(&im);
    decoder_destroy(d);
}

static void deaths_in_a_row_make_it_wait_and_a_good_file_ends_that(void **state)
{
    (void)state;
    struct decoder *d = begin_bad();
    struct decoder_counts counts;

    for (int i = 0; i < 3; i++)
        refused(d, "exit", "exit code 3");
    for (int i = 0; i < 50; i++) /* nobody starts fifty processes for fifty bad files */
        refused(d, "exit", "frame 7");
    decoder_counts(d, &counts);
    assert_int_equal(counts.starts + counts.refused, 53);
    assert_true(counts.starts < 10); /* three, unless the fifty last longer than the pauses, which double */
    taken_at_last(d);
    refused(d, "exit", "exit code 3"); /* the row has begun anew */
    taken(d);
    decoder_destroy(d);
}

static void the_process_ends_with_its_decoder(void **state)
{
    (void)state;
    char before[64], path[64];
    int count[2] = { 0, 0 };

    snprintf(path, sizeof(path), "/proc/%d/task/%d/children", (int)getpid(), (int)getpid());
    for (int k = 0; k < 2; k++) {
        if (k == 1) {
            struct decoder *d = begin(NULL);
            taken(d);
            decoder_destroy(d);
            decoder_destroy(NULL);
        }
        FILE *f = fopen(path, "r");
        if (!f)
            skip(); /* a kernel without that list */
        while (fscanf(f, "%63s", before) == 1)
            count[k]++;
        fclose(f);
    }
    assert_int_equal(count[0], count[1]);
}

static void what_cannot_be_started_is_said_at_once(void **state)
{
    (void)state;
    struct decoder *d = NULL;
    struct reason why = { "" };

    assert_int_equal(decoder_create(&(struct decoder_desc){ .program = "/nonexistent/decoder" }, &d, &why), ERR_IO);
    assert_non_null(strstr(why.text, "/nonexistent/decoder"));
    assert_null(d);
    assert_int_equal(decoder_create(&(struct decoder_desc){ .program = "/bin/true", .timeout_ms = 2000 }, &d, &why),
                     ERR_IO);
    assert_non_null(strstr(why.text, "/bin/true"));
    assert_null(d);
}

static void whoever_waits_for_a_file_can_be_called_away(void **state)
{
    (void)state;
    static atomic_bool stop;
    struct decoder *d = begin(&(struct decoder_desc){ .program = MISBEHAVE, .timeout_ms = 60000, .stop = &stop });
    struct image im = { 0 };
    struct reason why = { "" };

    atomic_store(&stop, true);
    assert_int_equal(decode(d, "hang", 4, &im, &why), ERR_END);
    decoder_destroy(d);
}

static void a_file_above_its_limit_is_not_handed_on(void **state)
{
    (void)state;
    struct decoder *d = begin(&(struct decoder_desc){ .file_bytes = 4096 });
    struct image im = { 0 };
    struct reason why = { "" };
    uint8_t bytes[4097] = { 0 };

    assert_int_equal(decode(d, bytes, sizeof(bytes), &im, &why), ERR_RANGE);
    assert_int_equal(decode(d, bytes, 4096, &im, &why), ERR_FORMAT);
    taken(d);
    decoder_destroy(d);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(files_are_decoded_to_the_same_bits),
    cmocka_unit_test(a_decoder_that_dies_costs_its_frame_only),
    cmocka_unit_test(a_decoder_killed_while_idle_costs_no_frame),
    cmocka_unit_test(a_decoder_that_hangs_is_ended),
    cmocka_unit_test(a_decoder_cannot_eat_the_memory),
    cmocka_unit_test(a_decoder_that_asks_for_more_than_its_due_dies_of_it),
    cmocka_unit_test(what_a_decoder_says_is_not_believed),
    cmocka_unit_test(texels_are_put_right_on_this_side),
    cmocka_unit_test(deaths_in_a_row_make_it_wait_and_a_good_file_ends_that),
    cmocka_unit_test(the_process_ends_with_its_decoder),
    cmocka_unit_test(what_cannot_be_started_is_said_at_once),
    cmocka_unit_test(whoever_waits_for_a_file_can_be_called_away),
    cmocka_unit_test(a_file_above_its_limit_is_not_handed_on),
    cmocka_unit_test(an_image_above_its_limit_is_refused_by_the_process_too),
    cmocka_unit_test(memory_of_a_huge_file_goes_back_with_the_next),
};
UNIT_MAIN(tests)
