#include "tls.h"

#include <errno.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>
#include <stdbool.h>
#include <string.h>
#include <unistd.h>

/* A password that is asked for would be waited for. */
static int no_password(char *out, int size, int writing, void *user)
{
    (void)out, (void)size, (void)writing, (void)user;
    return 0;
}

static enum err check_dates(const SSL_CTX *ctx, const char *cert, struct reason *why)
{
    const X509 *x = SSL_CTX_get0_certificate(ctx);

    if (X509_cmp_current_time(X509_get0_notAfter(x)) <= 0)
        return err_say(why, ERR_USAGE, "--tls-cert %s: has expired; no browser would take it", cert);
    if (X509_cmp_current_time(X509_get0_notBefore(x)) >= 0)
        return err_say(why, ERR_USAGE, "--tls-cert %s: is not valid yet; is the clock right?", cert);
    return ERR_OK;
}

static enum err check_files(SSL_CTX *ctx, const char *cert, const char *key, struct reason *why)
{
    SSL_CTX_set_default_passwd_cb(ctx, no_password);
    if (access(cert, R_OK) != 0)
        return err_say(why, ERR_USAGE, "--tls-cert %s: cannot be read: %s", cert, strerror(errno));
    if (access(key, R_OK) != 0)
        return err_say(why, ERR_USAGE, "--tls-key %s: cannot be read: %s", key, strerror(errno));
    if (SSL_CTX_use_certificate_chain_file(ctx, cert) != 1)
        return err_say(why, ERR_USAGE, "--tls-cert %s: is no certificate in PEM, or too weak a one", cert);
    if (SSL_CTX_use_PrivateKey_file(ctx, key, SSL_FILETYPE_PEM) != 1) {
        const bool other = ERR_GET_REASON(ERR_peek_last_error()) == X509_R_KEY_VALUES_MISMATCH;
        return err_say(why, ERR_USAGE, "--tls-key %s: is %s", key,
                       other ? "not the key of that certificate" : "no private key in PEM without a password");
    }
    return check_dates(ctx, cert, why);
}

enum err tls_check(const char *cert, const char *key, struct reason *why)
{
    SSL_CTX *ctx = SSL_CTX_new(TLS_server_method());

    if (!ctx)
        return err_say(why, ERR_NOMEM, "out of memory");
    const enum err e = check_files(ctx, cert, key, why);
    SSL_CTX_free(ctx);
    ERR_clear_error(); /* libwebsockets looks at the same list */
    return e;
}
