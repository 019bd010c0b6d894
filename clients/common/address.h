/* clients/common/address.h */
/* Where a server is: ws://HOST:PORT, as a user writes it. Pure; any thread. */
#ifndef CLIENTS_ADDRESS_H
#define CLIENTS_ADDRESS_H

#include "err.h"

#define ADDRESS_PORT 8080 /* relightd's own default */

struct address {
    char host[256];  /* a name, or a numeric address without brackets */
    char named[272]; /* host and port as the Host header has them: brackets around IPv6 */
    char path[256];  /* PROTOCOL_PATH unless the address names another */
    int port;
};

/* "ws://HOST[:PORT][/PATH]"; http:// is taken for ws://, since that is what relightd prints and browsers show.
 * ERR_USAGE names the fault. */
MUST_CHECK enum err address_parse(const char *text, struct address *out, struct reason *why);

#endif
