/* What relight-feed and relight-record have in common: flags, signals, the summary. Main thread. */
#pragma once

#include "base/command.h"
#include "clients/common/connection.h"

/* Flags of struct connection_desc; the address is a flag of the program. */
extern const struct setting client_rows[];

/* Starts log and signal handling, and reads the command line, of which client_rows are list 1, into the lists' structs.
 * *done: something was printed, and the program should exit with 0. ERR_USAGE names the flag. */
MUST_CHECK enum err client_start(struct command *c, int argc, char **argv, bool *done, struct reason *why);

bool client_interrupted(void); /* SIGINT or SIGTERM has arrived */

/* For each tick: true after a signal, when the caller should end the connection in good order. At a second signal or
 * after two seconds the connection is stopped. */
bool client_is_stopping(struct connection *c);

/* ---- --json ---- */

json_t *client_number(bool known, uint64_t number); /* null where it is not known */

/* Adds connections, seconds since client_start and the server's clock to the summary, which it takes over, and prints
 * it. */
void client_print(json_t *summary, const struct connection *c);

/* Exit code: 3 where the server refused, else 0 or 1. */
int client_exit_code(enum connection_end end, bool complete);
