/* The table of what the server reports: each name once, of the right form and at the field that it is about; and the
 * two small texts beside it, a QR code and this machine's addresses. */
#include "support/unit.h"

#include "net/access/figures.h"
#include "net/access/qr.h"
#include "net/access/site.h"

#include <arpa/inet.h>
#include <ctype.h>

static bool is_name(const char *text)
{
    if (!islower((unsigned char)*text))
        return false;
    for (; *text; text++)
        if (!islower((unsigned char)*text) && !isdigit((unsigned char)*text) && *text != '_' && *text != '.')
            return false;
    return true;
}

/* name, or name{label="value"}; *length: of the name. */
static bool is_metric(const char *text, size_t *length)
{
    *length = strcspn(text, "{");
    return strncmp(text, "relightd_", 9) == 0 && (!text[*length] || text[strlen(text) - 1] == '}');
}

static void each_row_has_a_name_and_each_metric_its_help_once(void **state)
{
    const struct figure *before = NULL;
    size_t rows = 0, metrics = 0;
    (void)state;

    for (const struct figure *f = server_figure_table; f->json || f->metric; before = f++, rows++) {
        size_t length, last;
        if (f->json && !is_name(f->json))
            fail_msg("%s is no place in the status", f->json);
        assert_true(f->offset < sizeof(struct server_figures));
        assert_int_equal(f->help != NULL && !f->metric, 0);
        for (const struct figure *k = server_figure_table; k < f; k++) {
            assert_true(k->offset != f->offset);
            assert_true(!f->json || !k->json || strcmp(f->json, k->json) != 0);
            assert_true(!f->metric || !k->metric || strcmp(f->metric, k->metric) != 0);
        }
        if (!f->metric)
            continue;
        metrics++;
        if (!is_metric(f->metric, &length))
            fail_msg("%s is no metric", f->metric);
        const bool again = before && before->metric && is_metric(before->metric, &last) && last == length &&
                           memcmp(f->metric, before->metric, length) == 0;
        if ((f->help == NULL) != again)
            fail_msg("%s: help belongs to the first row of a name alone", f->metric);
        if (f->help && (!isupper((unsigned char)f->help[0]) && !isdigit((unsigned char)f->help[0])))
            fail_msg("%s: its help is no sentence", f->metric);
        if (f->help && f->help[strlen(f->help) - 1] != '.')
            fail_msg("%s: its help is no sentence", f->metric);
        const bool counter = length > 6 && memcmp(f->metric + length - 6, "_total", 6) == 0;
        const bool seconds = strstr(f->metric, "_seconds_total") != NULL; /* of processor time: fractions */
        assert_true(!counter || f->type == (seconds ? FIGURE_DOUBLE : FIGURE_U64));
    }
    assert_true(rows >= 60 && metrics >= 25);
}

/* Where the type of a field is known from its values: the table reads them back. */
static void rows_read_the_fields_that_they_name(void **state)
{
    static const struct {
        const char *json;
        size_t offset;
        enum figure_type type;
    } rows[] = {
        { "samples", offsetof(struct server_figures, samples), FIGURE_U32 },
        { "source.hour", offsetof(struct server_figures, hour), FIGURE_DOUBLE },
        { "source.day", offsetof(struct server_figures, day), FIGURE_U32 },
        { "place.north", offsetof(struct server_figures, north), FIGURE_DOUBLE },
        { "frames.received", offsetof(struct server_figures, received), FIGURE_U64 },
        { "frames.repaired", offsetof(struct server_figures, repaired), FIGURE_U64 },
        { "late.seconds", offsetof(struct server_figures, late_s), FIGURE_KNOWN },
        { "light.error", offsetof(struct server_figures, error), FIGURE_KNOWN },
        { "light.converged", offsetof(struct server_figures, converged), FIGURE_BOOL },
        { "camera", offsetof(struct server_figures, camera), FIGURE_TEXT },
        { "offers.cameras", offsetof(struct server_figures, cameras), FIGURE_LIST },
    };
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        const struct figure *f = server_figure_table;
        while ((f->json || f->metric) && (!f->json || strcmp(f->json, rows[i].json) != 0))
            f++;
        if (!f->json || f->offset != rows[i].offset || f->type != rows[i].type)
            fail_msg("%s is missing, or of another field", rows[i].json);
    }
    assert_string_equal(server_publish_state_name(SERVER_PUBLISH_WAITING), "waiting");
    assert_string_equal(server_publish_state_name(SERVER_PUBLISH_RETRYING), "retrying");
}

/* Half lines of blocks to modules: [row][column], 1 for dark. Returns the side with its margin. */
static int read_code(FILE *f, unsigned char out[64][64])
{
    static const char *const blocks[4] = { " ", "\xe2\x96\x84", "\xe2\x96\x80", "\xe2\x96\x88" };
    char line[600];
    int y = 0, x = 0;

    while (fgets(line, sizeof(line), f)) {
        const char *at = line + strlen("\033[30;107m");
        assert_memory_equal(line, "\033[30;107m", strlen("\033[30;107m"));
        for (x = 0; *at != '\033'; x++) {
            int b = 3;
            while (b > 0 && strncmp(at, blocks[b], 3) != 0)
                b--;
            assert_true(b > 0 || *at == ' ');
            out[y][x] = (unsigned char)(b >> 1);
            out[y + 1][x] = (unsigned char)(b & 1);
            at += b ? 3 : 1;
        }
        assert_string_equal(at, "\033[0m\n");
        y += 2;
    }
    assert_true(y >= x && y <= x + 1);
    return x;
}

/* A finder of 7 x 7 at three corners and none at the fourth, four light modules around, and alternating timing. */
static void a_printed_code_has_finders_timing_and_margin(void **state)
{
    static const char *const finder[7] = {
        "1111111", "1000001", "1011101", "1011101", "1011101", "1000001", "1111111"
    };
    unsigned char m[64][64] = { { 0 } };
    FILE *f = tmpfile();
    (void)state;

    if (!qr_available())
        exit(UNIT_SKIPPED);
    assert_true(qr_print(f, "http://192.0.2.1:8080/?token=0123456789abcdef"));
    rewind(f);
    const int side = read_code(f, m), n = side - 8;
    fclose(f);
    assert_int_equal((n - 17) % 4, 0);
    assert_true(n >= 21);
    for (int i = 0; i < side; i++)
        for (int k = 0; k < 4; k++)
            assert_true(!m[k][i] && !m[i][k] && !m[side - 1 - k][i] && !m[i][side - 1 - k]);
    for (int y = 0; y < 7; y++)
        for (int x = 0; x < 7; x++) {
            assert_int_equal(m[4 + y][4 + x], finder[y][x] == '1');
            assert_int_equal(m[4 + y][side - 11 + x], finder[y][x] == '1');
            assert_int_equal(m[side - 11 + y][4 + x], finder[y][x] == '1');
        }
    for (int i = 8; i < n - 8; i++) {
        assert_int_equal(m[4 + 6][4 + i], i % 2 == 0);
        assert_int_equal(m[4 + i][4 + 6], i % 2 == 0);
    }
}

static void addresses_are_those_that_others_can_reach(void **state)
{
    char out[ADDRESSES_MAX][ADDRESS_TEXT];
    const size_t count = addresses_of_machine(out);
    struct in6_addr ip;
    (void)state;

    assert_true(count <= ADDRESSES_MAX);
    for (size_t i = 0; i < count; i++) {
        assert_true(inet_pton(AF_INET, out[i], &ip) == 1 || inet_pton(AF_INET6, out[i], &ip) == 1);
        assert_true(strncmp(out[i], "127.", 4) != 0 && strcmp(out[i], "::1") != 0);
        assert_true(strncmp(out[i], "169.254.", 8) != 0 && strncmp(out[i], "fe80:", 5) != 0);
        assert_true(i == 0 || strchr(out[i], ':') || !strchr(out[i - 1], ':')); /* IPv4 first */
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(each_row_has_a_name_and_each_metric_its_help_once),
    cmocka_unit_test(rows_read_the_fields_that_they_name),
    cmocka_unit_test(a_printed_code_has_finders_timing_and_margin),
    cmocka_unit_test(addresses_are_those_that_others_can_reach),
};
UNIT_MAIN(tests)
