/* server/stream/tls.h */
/* A certificate and its key for the server's own TLS: looked at before libwebsockets gets them, which says no more than
 * that it could not. Any thread. */
#ifndef STREAM_TLS_H
#define STREAM_TLS_H

#include "err.h"

/* PEM files: the certificate with those that vouch for it behind it, and its private key without a password. ERR_USAGE
 * names the file and what is wrong: it cannot be read or is no such thing, they do not belong together, or the
 * certificate's time is over or has not begun. */
MUST_CHECK enum err tls_check(const char *cert, const char *key, struct reason *why);

#endif
