/* The server's TLS certificate and key: checked before libwebsockets gets the files, because its errors give no reason,
 * and replaced at run time. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stdint.h>

struct tls;

/* Reads PEM files: the certificate followed by its chain, and its private key without a password. ERR_USAGE names the
 * file and the fault: unreadable, not PEM, no pair, expired or not yet valid. ERR_NOMEM. On any error *out is NULL. Any
 * thread. */
MUST_CHECK enum err tls_load(const char *cert, const char *key, struct tls **out, struct reason *why);
void tls_destroy(struct tls *t); /* NULL is allowed */

/* Expiry of the certificate, in seconds since 1970, UTC. Any thread. */
int64_t tls_expires_s(const struct tls *t);

/* Allows handshakes in that context (OpenSSL's SSL_CTX of a server) only TLS 1.3, or 1.2 with forward secrecy and
 * authenticated encryption. False: OpenSSL has no such ciphers. */
bool tls_restrict(void *context);

/* Makes handshakes in that context use *shown as it is at that time, and no certificate of the context. Open
 * connections keep theirs. *shown outlives the context; only the handshaking thread changes it. */
void tls_show(void *context, struct tls *const *shown);
