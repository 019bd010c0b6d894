/* References and their cache, on the built-in scene at 16 x 9 pixels. */
#include "measure/chart/judge.h"

#include "base/rng.h"
#include "sky/source/source.h"
#include "support/sets.h"
#include "support/unit.h"

#include <math.h>
#include <sys/stat.h>
#include <unistd.h>

enum { WIDTH = 16, HEIGHT = 9, VALUES = 3 * WIDTH * HEIGHT };

struct stage {
    struct prepared_scene *set;
    struct environment *environment;
    struct frame frame;
    char cache[64];
};

static void stage_begin(struct stage *s, const char *sky)
{
    const struct prepared_scene_desc d = { .width = WIDTH, .height = HEIGHT };
    const struct source_desc from = { .spec = sky };
    struct source *source;
    struct reason why;

    memset(s, 0, sizeof(*s));
    strcpy(s->cache, "/tmp/relight-truth-XXXXXX");
    assert_non_null(mkdtemp(s->cache));
    s->set = set_of(&d);
    assert_int_equal(source_open(&from, &source, &why), ERR_OK);
    assert_int_equal(source_next(source, &s->frame, &why), ERR_OK);
    source_close(source);
    s->environment = environment_create(&(struct environment_desc){ .n = 32 });
    assert_int_equal(environment_update(s->environment, &s->frame, &why), ERR_OK);
}

static struct truth_desc desc_of(const struct stage *s, uint32_t samples, bool cached)
{
    return (struct truth_desc){
        .set = s->set,
        .environment = s->environment,
        .frame = &s->frame,
        .classes = PATH_BACKGROUND | PATH_DIRECT,
        .samples = samples,
        .cache = cached ? s->cache : NULL,
    };
}

static void stage_end(struct stage *s)
{
    char command[128];

    snprintf(command, sizeof(command), "rm -r '%s'", s->cache);
    assert_int_equal(system(command), 0);
    environment_destroy(s->environment);
    set_destroy(s->set);
    frame_finish(&s->frame);
}

static struct truth make(const struct truth_desc *d)
{
    struct truth t;
    struct reason why = { "" };

    if (truth_make(d, &t, &why))
        fail_msg("%s", why.text);
    return t;
}

static bool same(const struct truth *a, const struct truth *b)
{
    return memcmp(a->half[0], b->half[0], VALUES * sizeof(float)) == 0 &&
           memcmp(a->half[1], b->half[1], VALUES * sizeof(float)) == 0;
}

/* One part now and two more later, or three at once, or three that stand in the cache: the same bits. */
static void an_interrupted_reference_goes_on_where_it_was(void **state)
{
    struct stage s;
    (void)state;

    stage_begin(&s, "sky:hour=12,size=64x32");
    const struct truth_desc one = desc_of(&s, TRUTH_PART, true), three = desc_of(&s, 3 * TRUTH_PART, true),
                            fresh = desc_of(&s, 3 * TRUTH_PART, false);
    struct truth first = make(&one), later = make(&three), at_once = make(&fresh), again = make(&three);
    assert_true(first.found[0] == 0 && first.samples[0] == TRUTH_PART);
    assert_true(later.found[0] == TRUTH_PART && later.found[1] == TRUTH_PART && later.samples[1] == 3 * TRUTH_PART);
    assert_true(again.found[0] == 3 * TRUTH_PART);
    assert_true(same(&later, &at_once) && same(&later, &again) && !same(&first, &later));
    /* More than was asked for is not thrown away. */
    struct truth less = make(&one);
    assert_true(less.samples[0] == 3 * TRUTH_PART && same(&less, &later));
    truth_finish(&first);
    truth_finish(&later);
    truth_finish(&at_once);
    truth_finish(&again);
    truth_finish(&less);
    stage_end(&s);
}

/* The two differ in every lit pixel, and agree in the mean: their difference in brightness is within 4 of its standard
 * errors, taken from the differences of pixels. */
static void the_two_references_are_independent_and_agree(void **state)
{
    struct stage s;
    double sum = 0.0, square = 0.0, total = 0.0;
    (void)state;

    stage_begin(&s, "sky:hour=12,size=64x32");
    struct truth_desc d = desc_of(&s, TRUTH_PART, false);
    d.classes = PATH_ALL;
    struct truth t = make(&d);
    for (int i = 0; i < VALUES; i += 3) { /* one channel: the others follow it */
        const double e = (double)t.half[0][i] - (double)t.half[1][i];
        sum += e;
        square += e * e;
        total += (double)t.half[0][i];
    }
    print_message("difference %.2e of %.2e, standard error %.2e\n", sum, total, sqrt(square));
    assert_true(square > 0.0 && fabs(sum) < 4.0 * sqrt(square));
    assert_true(sqrt(square) < 0.05 * total);
    truth_finish(&t);
    stage_end(&s);
}

static void spoil(const char *name, long at, int how)
{
    struct stat st;
    FILE *f;

    assert_int_equal(stat(name, &st), 0);
    if (how < 0) { /* cut */
        assert_int_equal(truncate(name, at < 0 ? st.st_size + at : at), 0);
        return;
    }
    f = fopen(name, "r+b");
    assert_non_null(f);
    fseek(f, at < 0 ? st.st_size + at : at, SEEK_SET);
    const int was = fgetc(f);
    fseek(f, -1, SEEK_CUR);
    fputc(was ^ how, f);
    fclose(f);
}

/* Cut at any place, or one bit turned in the head, the sum or the last byte: refused, and made again with the same
 * bits. */
static void a_damaged_reference_is_made_again(void **state)
{
    static const struct {
        long at;
        int how;
    } faults[] = {
        { 0, -1 }, { 20, -1 }, { -1, -1 }, { 0, 1 }, { 16, 2 }, { 30, 1 }, { 40, 128 }, { 300, 4 }, { -1, 1 }
    };
    struct stage s;
    char name[4096];
    (void)state;

    stage_begin(&s, "sky:hour=12,size=64x32");
    const struct truth_desc d = desc_of(&s, TRUTH_PART, true);
    struct truth good = make(&d);
    truth_name(&d, 0, name, sizeof(name));
    for (size_t k = 0; k < sizeof(faults) / sizeof(faults[0]); k++) {
        spoil(name, faults[k].at, faults[k].how);
        struct truth t = make(&d);
        assert_true(t.found[0] == 0 && t.found[1] == TRUTH_PART && same(&t, &good));
        truth_finish(&t);
    }
    truth_finish(&good);
    stage_end(&s);
}

/* Another sky, class of light, size or half has another name; the same sky under another name and number has not. */
static void names_follow_what_a_reference_shows(void **state)
{
    struct stage s, other;
    char name[4096], second[4096];
    (void)state;

    stage_begin(&s, "sky:hour=12,size=64x32");
    stage_begin(&other, "sky:hour=13,size=64x32");
    struct truth_desc d = desc_of(&s, 64, true), e = desc_of(&s, 6400, true);
    truth_name(&d, 0, name, sizeof(name));
    truth_name(&e, 0, second, sizeof(second));
    assert_string_equal(name, second); /* more samples go on with it */
    strcpy(s.frame.name, "another name");
    s.frame.number += 5;
    truth_name(&d, 0, second, sizeof(second));
    assert_string_equal(name, second);
    truth_name(&d, 1, second, sizeof(second));
    assert_string_not_equal(name, second);
    e.classes = PATH_ALL;
    truth_name(&e, 0, second, sizeof(second));
    assert_string_not_equal(name, second);
    e = d;
    e.frame = &other.frame;
    truth_name(&e, 0, second, sizeof(second));
    assert_string_not_equal(name, second);
    s.set->scene->materials[0].diffuse.x *= 1.01f;
    truth_name(&d, 0, second, sizeof(second));
    assert_string_not_equal(name, second);
    stage_end(&s);
    stage_end(&other);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(an_interrupted_reference_goes_on_where_it_was),
    cmocka_unit_test(the_two_references_are_independent_and_agree),
    cmocka_unit_test(a_damaged_reference_is_made_again),
    cmocka_unit_test(names_follow_what_a_reference_shows),
};
UNIT_MAIN(tests)
