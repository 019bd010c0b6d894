/* server/stream/tls.h */
/* The certificate and key that the server's own TLS shows to whoever comes: read and looked at before libwebsockets
 * gets the files, which says no more than that it could not, and put in the place of those while it runs. */
#ifndef STREAM_TLS_H
#define STREAM_TLS_H

#include "err.h"

#include <stdint.h>

struct tls;

/* From PEM files: the certificate with those that vouch for it behind it, and its private key without a password.
 * ERR_USAGE names the file and what is wrong: it cannot be read or is no such thing, they do not belong together, or
 * the certificate's time is over or has not begun. ERR_NOMEM. On any error *out is NULL. Any thread. */
MUST_CHECK enum err tls_load(const char *cert, const char *key, struct tls **out, struct reason *why);
void tls_destroy(struct tls *t); /* NULL is allowed */

/* When the certificate's time is over, in seconds since 1970, UTC. Any thread. */
int64_t tls_expires_s(const struct tls *t);

/* Whoever shakes hands in that context (OpenSSL's SSL_CTX, of a server) is shown what *shown is by then, and only that,
 * whatever the context itself holds. Who is in keeps what he was shown. *shown outlives the context and is changed by
 * the thread alone that shakes hands. */
void tls_show(void *context, struct tls *const *shown);

#endif
