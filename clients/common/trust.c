#include "clients/common/connection.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* libwebsockets asks for names and IPv4 addresses to match, but cuts IPv6 addresses at their first colon, so it is told
 * not to look at these (connection.c). A zone, as in fe80::1%eth0, is of this machine and in no certificate. */
static enum err expect_address(SSL_CTX *c, const char *host, struct reason *why)
{
    char address[sizeof(((struct address *)0)->host)];

    snprintf(address, sizeof(address), "%.*s", (int)strcspn(host, "%"), host);
    if (X509_VERIFY_PARAM_set1_ip_asc(SSL_CTX_get0_param(c), address) == 1)
        return ERR_OK;
    return err_say(why, ERR_USAGE, "[%s]: is not an IPv6 address, so no certificate can be checked against it", host);
}

enum err trust_create(const char *ca_file, const struct address *server, SSL_CTX **out, struct reason *why)
{
    SSL_CTX *c = SSL_CTX_new(TLS_client_method());
    enum err e = ERR_OK;

    *out = NULL;
    if (!c || !SSL_CTX_set_min_proto_version(c, TLS1_2_VERSION) || (!ca_file && !SSL_CTX_set_default_verify_paths(c)))
        e = err_say(why, ERR_NOMEM, "OpenSSL could not be started");
    else if (ca_file && access(ca_file, R_OK) != 0)
        e = err_say(why, ERR_IO, "--ca %s: cannot be read: %s", ca_file, strerror(errno));
    else if (ca_file && !SSL_CTX_load_verify_file(c, ca_file))
        e = err_say(why, ERR_FORMAT, "--ca %s: has no certificate in PEM form", ca_file);
    else if (strchr(server->host, ':'))
        e = expect_address(c, server->host, why);
    if (e) {
        SSL_CTX_free(c);
        return e;
    }
    *out = c;
    return ERR_OK;
}

bool trust_explain(const SSL *failed, const char *ca_file, struct reason *why)
{
    const long fault = SSL_get_verify_result(failed);
    const char *advice =
        ca_file ? "no authority in --ca signed it" : "use --ca FILE to name the authority that signed it (PEM)";

    if (fault == X509_V_ERR_HOSTNAME_MISMATCH || fault == X509_V_ERR_IP_ADDRESS_MISMATCH)
        advice = "connect with a name that it covers";
    if (fault == X509_V_ERR_CERT_HAS_EXPIRED || fault == X509_V_ERR_CERT_NOT_YET_VALID)
        advice = "renew it there, or set the clock here";
    (void)err_say(why, ERR_OK, "its certificate is not trusted (%s): %s", X509_verify_cert_error_string(fault), advice);
    return fault != X509_V_OK;
}
