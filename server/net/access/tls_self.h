/* A self-signed certificate for a LAN: browsers ask once, other programs get the file with --ca. Thread: any. */
#pragma once

#include "base/err.h"

#include <stddef.h>

/* Writes the paths of dir/cert.pem and dir/key.pem to cert[size] and key[size]. Makes both, and dir, if they are not
 * there or the certificate ends within a month: for this machine's names and addresses and `names` (separated by
 * commas; NULL: none), for two years; the key has mode 0600. Logs the fingerprint, and names and addresses that a kept
 * certificate lacks. ERR_USAGE: names dir or file and fault. ERR_NOMEM. */
MUST_CHECK enum err tls_self_signed(const char *dir, const char *names, char *cert, char *key, size_t size,
                                    struct reason *why);
