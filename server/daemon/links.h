/* relightd --show-link: the addresses by which people and programs reach the server, with their tokens. */
#ifndef DAEMON_LINKS_H
#define DAEMON_LINKS_H

#include "stream/server.h"

#include <stdio.h>

/* Prints them; codes: with QR codes of the page's. ERR_USAGE: the port is not known beforehand. Main thread. */
MUST_CHECK enum err links_print(const struct server_desc *desc, FILE *out, bool codes, struct reason *why);

#endif
