/* The address of a server, as a user writes it. Pure; any thread. */
#pragma once

#include "base/err.h"

#include <openssl/ssl.h>
#include <stdbool.h>

#define ADDRESS_PORT 8080    /* relightd's own default */
#define ADDRESS_TLS_PORT 443 /* of every server with TLS */

struct address {
    bool tls;
    char host[256];  /* a name, or a numeric address without brackets */
    char named[272]; /* host and port as the Host header has them: brackets around IPv6, no zone */
    char path[256];  /* PROTOCOL_PATH unless the address names another */
    int port;
};

/* "ws://HOST[:PORT][/PATH]", or wss:// for TLS; http:// and https://, which relightd prints and browsers show, mean the
 * same. ERR_USAGE: *why quotes the address and says what is wrong with it. */
MUST_CHECK enum err address_parse(const char *text, struct address *out, struct reason *why);

/* ---- Trust ---- */

/* The servers that a TLS client trusts, and the reason if it does not trust one. Any thread. */

/* For TLS 1.2 and later. Trusts the certificate authorities in the PEM file, or the system's when it is NULL; the
 * certificate must name the address's host, also when that is numeric. ERR_USAGE: no certificate can; ERR_IO,
 * ERR_FORMAT: the file; ERR_NOMEM. The caller frees *out with SSL_CTX_free. */
MUST_CHECK enum err trust_create(const char *ca_file, const struct address *server, SSL_CTX **out, struct reason *why);

/* After a handshake that failed: true when the certificate is at fault; *why then says how, and what to do. */
bool trust_explain(const SSL *failed, const char *ca_file, struct reason *why);
