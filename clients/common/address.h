/* The address of a server, as a user writes it. Pure; any thread. */
#pragma once

#include "base/err.h"

#include <stdbool.h>

#define ADDRESS_PORT 8080    /* relightd's own default */
#define ADDRESS_TLS_PORT 443 /* of every server with TLS */

struct address {
    bool tls;
    char host[256];  /* a name, or a numeric address without brackets */
    char named[272]; /* host and port as the Host header has them: brackets around IPv6 */
    char path[256];  /* PROTOCOL_PATH unless the address names another */
    int port;
};

/* "ws://HOST[:PORT][/PATH]", or wss:// for TLS; http:// and https://, which relightd prints and browsers show, mean the
 * same. ERR_USAGE: *why quotes the address and says what is wrong with it. */
MUST_CHECK enum err address_parse(const char *text, struct address *out, struct reason *why);
