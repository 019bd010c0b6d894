/* The server's TLS certificate and key: checked before libwebsockets gets the files, because its errors give no reason,
 * and replaced at run time. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
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

/* ---- Self-signed certificates ---- */

/* A self-signed certificate for a LAN: browsers ask once, other programs get the file with --ca. Thread: any. */

/* Writes the paths of dir/cert.pem and dir/key.pem to cert[size] and key[size]. Makes both, and dir, if they are not
 * there or the certificate ends within a month: for this machine's names and addresses and `names` (separated by
 * commas; NULL: none), for two years; the key has mode 0600. Logs the fingerprint, and names and addresses that a kept
 * certificate lacks. ERR_USAGE: names dir or file and fault. ERR_NOMEM. */
MUST_CHECK enum err tls_self_signed(const char *dir, const char *names, char *cert, char *key, size_t size,
                                    struct reason *why);
