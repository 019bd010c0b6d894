/* Limits on what the ranks of a team keep. */
#include "support/unit.h"

#include "base/rng.h"
#include "job/team/team_internal.h"

#define PACKETS 500
#define RANKS 7

static double before[PACKETS + 1];

static void weigh(uint64_t seed)
{
    for (uint32_t p = 0; p < PACKETS; p++)
        before[p + 1] = before[p] + 1.0 + (double)(rng_mix(seed, p) % 9);
}

static void shares_within_their_limits_stay(void **state)
{
    const double most[4] = { 400.0, 400.0, 400.0, 400.0 };
    uint32_t cuts[5] = { 0, 100, 250, 400, PACKETS };

    (void)state;
    for (uint32_t p = 0; p < PACKETS; p++)
        before[p + 1] = before[p] + 2.0;
    team_limit_shares(before, PACKETS, most, 4, cuts);
    assert_true(cuts[1] == 100 && cuts[2] == 250 && cuts[3] == 400 && cuts[4] == PACKETS);
    cuts[1] = 40; /* the second rank then has 420 of its 400 */
    team_limit_shares(before, PACKETS, most, 4, cuts);
    assert_true(cuts[1] == 40 && cuts[2] == 240 && cuts[3] == 400);
    cuts[1] = cuts[2] = cuts[3] = 0; /* the last rank has everything */
    team_limit_shares(before, PACKETS, most, 4, cuts);
    assert_true(cuts[1] == 0 && cuts[2] == 100 && cuts[3] == 300);
}

static void no_rank_exceeds_its_limit_from_any_cuts(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 300; seed++) {
        const uint32_t count = 2 + (uint32_t)(seed % (RANKS - 1));
        uint32_t cuts[RANKS + 1] = { 0 };
        double most[RANKS], whole = 0.0;

        weigh(seed);
        for (uint32_t k = 0; k < count; k++)
            whole += most[k] = 1.0 + (double)(rng_mix(seed, 1000 + k) % 4);
        for (uint32_t k = 0; k < count; k++)
            most[k] *= 1.05 * before[PACKETS] / whole;
        for (uint32_t k = 1; k < count; k++) {
            const uint32_t place = (uint32_t)(rng_mix(seed, 2000 + k) % PACKETS);
            cuts[k] = place > cuts[k - 1] ? place : cuts[k - 1];
        }
        cuts[count] = PACKETS;
        team_limit_shares(before, PACKETS, most, count, cuts);
        for (uint32_t k = 0; k < count; k++) {
            assert_true(cuts[k] <= cuts[k + 1]);
            assert_true(before[cuts[k + 1]] - before[cuts[k]] <= most[k] + 9.0); /* and a packet */
        }
    }
}

/* A slow link: 100 packets take 5 ms of light and arrive 40 ms after the image before. */
static void a_slow_link_is_remembered_while_nobody_waits_for_it(void **state)
{
    double speed[2] = { 2000.0, 0.0 }, way_s[2] = { 0.0 }, waited[2] = { 0.0, 0.01 };
    struct team t = { .count = 2, .settled = true, .speed = speed, .way_s = way_s, .waited = waited };

    (void)state;
    for (int k = 0; k < 3; k++)
        team_learn_answer(&t, 1, 100, 0.005, 0.040);
    assert_float_equal(speed[1], 100.0 / 0.040, 1e-9);
    waited[1] = 0.0; /* just in time: by the light alone, the rank would be eight times as fast */
    team_learn_answer(&t, 1, 100, 0.005, 0.040);
    assert_true(speed[1] > 2500.0 && speed[1] < 1.02 * 2500.0);
    for (int k = 0; k < 200; k++) /* the link has become fast, which shows in time */
        team_learn_answer(&t, 1, 100, 0.005, 0.040);
    assert_float_equal(speed[1], 100.0 / 0.005, 100.0);
    waited[1] = 0.01; /* and slow again, at once */
    for (int k = 0; k < 60; k++)
        team_learn_answer(&t, 1, 100, 0.005, 0.040);
    assert_float_equal(speed[1], 100.0 / 0.040, 50.0);
}

/* Rank 0 ends its image 6 ms after the one before: an answer that is there took no longer. */
static void an_answer_took_no_longer_than_the_image(void **state)
{
    double speed[2] = { 2000.0, 0.0 }, way_s[2] = { 0.0, 1.0 }, waited[2] = { 0.0 };
    struct team t = { .count = 2, .speed = speed, .way_s = way_s, .waited = waited };

    (void)state;
    team_learn_answer(&t, 1, 100, 0.005, 0.006);
    assert_float_equal(speed[1], 100.0 / 0.006, 1e-6);
    team_learn_answer(&t, 1, 0, 0.005, 0.006); /* no part, nothing learned */
    assert_float_equal(speed[1], 100.0 / 0.006, 1e-6);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(shares_within_their_limits_stay),
    cmocka_unit_test(no_rank_exceeds_its_limit_from_any_cuts),
    cmocka_unit_test(a_slow_link_is_remembered_while_nobody_waits_for_it),
    cmocka_unit_test(an_answer_took_no_longer_than_the_image),
};

UNIT_MAIN(tests)
