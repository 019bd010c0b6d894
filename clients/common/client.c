#include "clients/common/client.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/setting_table.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EXIT_REFUSED 3  /* 1 and 2 are err_exit_code's */
#define GOODBYE_MS 2000 /* time limit for ending in good order */
#define TOKEN_MAX 255

#define CONNECTION .section = "Connection"
#define AT(field) SETTING_AT(connection_desc, field)

const struct setting client_rows[] = {
    { "ca", "FILE", "PEM file of the certificate authorities to trust; default: the system's (wss:// only)", NULL,
      CONNECTION, TEXT, AT(ca_file) },
    { "token", "T", "access token; default: the variable RELIGHT_TOKEN", NULL, CONNECTION, TEXT, AT(token) },
    { "retry", "N", "consecutive attempts to reconnect; default: unlimited", NULL, CONNECTION, WHOLE(0, 1000000),
      AT(tries) },
    { "give-up-after", "SECONDS", "give up after this long without a connection; 0: never", "0", CONNECTION,
      REAL(0.0, 1e6), AT(give_up_s) },
    { "quiet", NULL, "print only errors, no progress", NULL, .section = "Messages", SWITCH, AT(quiet) },
    { .name = NULL },
};

static volatile sig_atomic_t stops; /* requests to stop */
static double start_s;

static void on_stop(int signal_number)
{
    (void)signal_number;
    stops++;
}

enum err client_start(struct command *c, int argc, char **argv, bool *done, struct reason *why)
{
    struct connection_desc *d = c->lists[1].values;

    start_s = clock_seconds();
    log_init(c->name, LOG_INFO);
    sigaction(SIGINT, &(struct sigaction){ .sa_handler = on_stop }, NULL);
    sigaction(SIGTERM, &(struct sigaction){ .sa_handler = on_stop }, NULL);
    sigaction(SIGPIPE, &(struct sigaction){ .sa_handler = SIG_IGN }, NULL);
    /* exceeding a limit on file sizes is then an ordinary error */
    sigaction(SIGXFSZ, &(struct sigaction){ .sa_handler = SIG_IGN }, NULL);
    command_begin(c);
    d->tries = -1;
    enum err e = command_parse(c, argc, argv, done, why);
    if (!e && !*done)
        e = command_read(c, why);
    d->token = d->token ? d->token : getenv("RELIGHT_TOKEN");
    if (!e && d->token && strlen(d->token) > TOKEN_MAX)
        e = err_say(why, ERR_USAGE, "--token: longer than %d bytes", TOKEN_MAX);
    if (!e && d->quiet)
        log_init(c->name, LOG_ERROR);
    return e;
}

bool client_interrupted(void)
{
    return stops > 0;
}

bool client_is_stopping(struct connection *c)
{
    static int64_t since_ms;
    const int64_t now = clock_ms();

    if (!stops)
        return false;
    since_ms = since_ms ? since_ms : now;
    if (stops == 1 && now - since_ms <= GOODBYE_MS && connection_is_open(c))
        return true;
    connection_stop(c);
    return false;
}

json_t *client_number(bool known, uint64_t number)
{
    return known ? json_integer((json_int_t)number) : json_null();
}

void client_print(json_t *summary, const struct connection *c)
{
    int64_t ahead_us = 0, uncertain_us = 0;
    const bool clock = connection_clock(c, &ahead_us, &uncertain_us);
    json_t *more = json_pack("{s:i, s:f, s:o}", "connections", (int)connection_count(c), "seconds",
                             clock_seconds() - start_s, "clock",
                             clock ? json_pack("{s:I, s:I}", "server_ahead_us", (json_int_t)ahead_us, "uncertain_us",
                                               (json_int_t)uncertain_us)
                                   : json_null());

    if (summary && more && json_object_update(summary, more) == 0) {
        json_dumpf(summary, stdout, JSON_REAL_PRECISION(6));
        putchar('\n');
    }
    json_decref(more);
    json_decref(summary);
}

int client_exit_code(enum connection_end end, bool complete)
{
    if (end == CONNECTION_REFUSED)
        return EXIT_REFUSED;
    return end == CONNECTION_DONE && complete ? 0 : 1;
}
