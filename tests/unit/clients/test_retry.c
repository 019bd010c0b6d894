#include "support/unit.h"

#include "clients/common/connection.h"

/* PROTOCOL.md section 8, code for code. */
static void close_codes_are_answered_as_the_protocol_says(void **state)
{
    static const struct {
        int code;
        enum retry_when when;
        bool refused;
    } want[] = {
        { 1000, RETRY_AGAIN, false }, { 1001, RETRY_AGAIN, false }, { 1002, RETRY_NEVER, false },
        { 1006, RETRY_AGAIN, false }, { 1007, RETRY_NEVER, false }, { 1009, RETRY_NEVER, false },
        { 4001, RETRY_NEVER, false }, { 4002, RETRY_NEVER, false }, { 4003, RETRY_NEVER, false },
        { 4004, RETRY_NEVER, true },  { 4005, RETRY_NEVER, true },  { 4006, RETRY_NEVER, true },
        { 4007, RETRY_LATER, true },  { 4008, RETRY_AGAIN, false }, { 4009, RETRY_AGAIN, false },
        { 4010, RETRY_LATER, false }, { 4011, RETRY_NEVER, true },  { 4012, RETRY_LATER, true },
        { 4013, RETRY_AGAIN, false }, { 4014, RETRY_NEVER, false }, { 4999, RETRY_LATER, false },
    };

    (void)state;
    for (size_t i = 0; i < sizeof(want) / sizeof(want[0]); i++) {
        const struct retry_rule rule = retry_after_close(want[i].code);
        if (rule.when != want[i].when || rule.refused != want[i].refused || !rule.name[0])
            fail_msg("close code %d", want[i].code);
    }
}

static void a_server_that_is_away_is_told_from_another_page(void **state)
{
    (void)state;
    assert_int_equal(retry_after_status(0).when, RETRY_AGAIN);
    assert_int_equal(retry_after_status(503).when, RETRY_AGAIN);
    assert_int_equal(retry_after_status(429).when, RETRY_AGAIN);
    assert_int_equal(retry_after_status(404).when, RETRY_NEVER);
    assert_int_equal(retry_after_status(403).when, RETRY_NEVER);
    assert_int_equal(retry_after_status(200).when, RETRY_NEVER);
    assert_true(retry_after_status(403).refused);
    assert_false(retry_after_status(503).refused);
}

static void waits_double_up_to_ten_seconds_with_jitter(void **state)
{
    struct rng rng = { 1 };

    (void)state;
    for (unsigned tries = 0; tries < 40; tries++) {
        const double plain = tries < 5 ? 500.0 * (1 << tries) : 10000.0;
        double least = 1e9, most = 0.0;
        for (int i = 0; i < 200; i++) {
            const int ms = retry_wait_ms(tries, RETRY_AGAIN, &rng);
            least = ms < least ? ms : least;
            most = ms > most ? ms : most;
        }
        assert_true(least >= 0.8 * plain - 1.0 && least <= 0.9 * plain);
        assert_true(most <= 10000.0 && most <= 1.2 * plain && (most >= 1.1 * plain || most >= 9900.0));
    }
}

static void later_is_never_before_ten_seconds(void **state)
{
    struct rng rng = { 2 };

    (void)state;
    for (unsigned tries = 0; tries < 100; tries++) {
        const int ms = retry_wait_ms(tries, RETRY_LATER, &rng);
        assert_in_range(ms, 10000, 12000);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(close_codes_are_answered_as_the_protocol_says),
    cmocka_unit_test(a_server_that_is_away_is_told_from_another_page),
    cmocka_unit_test(waits_double_up_to_ten_seconds_with_jitter),
    cmocka_unit_test(later_is_never_before_ten_seconds),
};

UNIT_MAIN(tests)
