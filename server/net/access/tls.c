#include "net/access/tls.h"

#include "base/mem.h"

#include <errno.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

struct tls {
    SSL_CTX *files; /* holds certificate, chain and key; never used for a handshake */
    int64_t expires_s;
};

/* Without this, OpenSSL would wait for a password on the terminal. */
static int no_password(char *out, int size, int writing, void *user)
{
    (void)out, (void)size, (void)writing, (void)user;
    return 0;
}

static enum err check_dates(struct tls *t, const char *cert, struct reason *why)
{
    const X509 *x = SSL_CTX_get0_certificate(t->files);
    const time_t now = time(NULL);
    int days, seconds;

    if (X509_cmp_current_time(X509_get0_notAfter(x)) <= 0)
        return err_say(why, ERR_USAGE, "--tls-cert %s: has expired; no browser will accept it", cert);
    if (X509_cmp_current_time(X509_get0_notBefore(x)) >= 0)
        return err_say(why, ERR_USAGE, "--tls-cert %s: is not valid yet; is the clock right?", cert);
    ASN1_TIME *from = ASN1_TIME_set(NULL, now);
    const bool known = from && ASN1_TIME_diff(&days, &seconds, from, X509_get0_notAfter(x)) == 1;
    ASN1_TIME_free(from);
    if (!known)
        return err_say(why, ERR_NOMEM, "out of memory");
    t->expires_s = (int64_t)now + 86400 * (int64_t)days + seconds;
    return ERR_OK;
}

static enum err read_files(struct tls *t, const char *cert, const char *key, struct reason *why)
{
    SSL_CTX_set_default_passwd_cb(t->files, no_password);
    if (access(cert, R_OK) != 0)
        return err_say(why, ERR_USAGE, "--tls-cert %s: cannot be read: %s", cert, strerror(errno));
    if (access(key, R_OK) != 0)
        return err_say(why, ERR_USAGE, "--tls-key %s: cannot be read: %s", key, strerror(errno));
    if (SSL_CTX_use_certificate_chain_file(t->files, cert) != 1)
        return err_say(why, ERR_USAGE, "--tls-cert %s: is not a PEM certificate, or it is too weak", cert);
    if (SSL_CTX_use_PrivateKey_file(t->files, key, SSL_FILETYPE_PEM) != 1) {
        const bool other = ERR_GET_REASON(ERR_peek_last_error()) == X509_R_KEY_VALUES_MISMATCH;
        return err_say(why, ERR_USAGE, "--tls-key %s: is %s", key,
                       other ? "not the key of that certificate" : "no private key in PEM without a password");
    }
    return check_dates(t, cert, why);
}

enum err tls_load(const char *cert, const char *key, struct tls **out, struct reason *why)
{
    struct tls *t = mem_alloc(1, sizeof(*t));
    enum err e = ERR_NOMEM;

    *out = NULL;
    if (t)
        t->files = SSL_CTX_new(TLS_server_method());
    if (t && t->files)
        e = read_files(t, cert, key, why);
    else
        err_say(why, e, "out of memory");
    ERR_clear_error(); /* libwebsockets reads the same error queue */
    if (e) {
        tls_destroy(t);
        return e;
    }
    *out = t;
    return ERR_OK;
}

void tls_destroy(struct tls *t)
{
    if (!t)
        return;
    SSL_CTX_free(t->files);
    mem_free(t);
}

int64_t tls_expires_s(const struct tls *t)
{
    return t->expires_s;
}

/* A context holds one certificate per kind of key. If the new one is of another kind, clients could still get the old
 * one; so clear the connection's certificates first. 0 ends the handshake. */
static int show(SSL *ssl, void *arg)
{
    struct tls *const *shown = arg;
    SSL_CTX *files = (*shown)->files;
    STACK_OF(X509) *chain = NULL;

    SSL_certs_clear(ssl);
    return SSL_CTX_get0_chain_certs(files, &chain) == 1 &&
           SSL_use_cert_and_key(ssl, SSL_CTX_get0_certificate(files), SSL_CTX_get0_privatekey(files), chain, 1) == 1;
}

bool tls_restrict(void *context)
{
    /* Those of TLS 1.3 are all of that kind. A session ticket's key would decrypt every session of TLS 1.2 in which it
     * was used. */
    SSL_CTX_set_options(context, SSL_OP_NO_TICKET | SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_COMPRESSION);
    return SSL_CTX_set_min_proto_version(context, TLS1_2_VERSION) == 1 &&
           SSL_CTX_set_cipher_list(context, "ECDHE+AESGCM:ECDHE+CHACHA20") == 1;
}

void tls_show(void *context, struct tls *const *shown)
{
    SSL_CTX_set_cert_cb(context, show, (void *)shown);
}
