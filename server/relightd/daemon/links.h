/* relightd --show-link: the server's URLs for people and programs, with their tokens. */
#pragma once

#include "net/stream/server.h"

#include <stdio.h>

/* Prints the URLs; codes: with QR codes for the page's. ERR_USAGE: the port is not known in advance. Main thread. */
MUST_CHECK enum err links_print(const struct server_desc *desc, FILE *out, bool codes, struct reason *why);
