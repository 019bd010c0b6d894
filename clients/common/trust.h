/* The servers that a TLS client trusts, and the reason if it does not trust one. Any thread. */
#pragma once

#include "clients/common/address.h"

#include <openssl/ssl.h>

/* For TLS 1.2 and later. Trusts the certificate authorities in the PEM file, or the system's when it is NULL; the
 * certificate must name the address's host, also when that is numeric. ERR_IO, ERR_FORMAT: the file; ERR_NOMEM. The
 * caller frees *out with SSL_CTX_free. */
MUST_CHECK enum err trust_create(const char *ca_file, const struct address *server, SSL_CTX **out, struct reason *why);

/* After a handshake that failed: true when the certificate is at fault; *why then says how, and what to do. */
bool trust_explain(const SSL *failed, const char *ca_file, struct reason *why);
