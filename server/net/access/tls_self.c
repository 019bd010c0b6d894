#include "net/access/tls.h"

#include "base/file_store.h"
#include "base/log.h"
#include "net/access/site.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <openssl/x509v3.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define VALID_S (730L * 86400) /* some systems accept at most 825 days */
#define RENEW_S (30L * 86400)

/* "DNS:localhost,IP:192.168.1.20,...": each name once. */
struct alternatives {
    char text[4096];
    size_t size;
};

/* What is neither a DNS name nor a numeric address is left out. */
static void add(struct alternatives *a, const char *name, size_t length)
{
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-";
    struct in6_addr ip;
    char plain[256], entry[300];

    if (length == 0 || length >= sizeof(plain))
        return;
    memcpy(plain, name, length);
    plain[length] = '\0';
    const bool number = inet_pton(AF_INET, plain, &ip) == 1 || inet_pton(AF_INET6, plain, &ip) == 1;
    const int n = snprintf(entry, sizeof(entry), ",%s:%s", number ? "IP" : "DNS", plain);
    if ((!number && strspn(plain, letters) < length) || n < 0 || a->size + (size_t)n >= sizeof(a->text))
        return;
    const char *at = strstr(a->text, entry);
    if (at && (at[n] == ',' || at[n] == '\0'))
        return;
    memcpy(a->text + a->size, entry, (size_t)n + 1);
    a->size += (size_t)n;
}

static void collect(struct alternatives *a, const char *names)
{
    char host[256] = "", found[ADDRESSES_MAX][ADDRESS_TEXT];

    *a = (struct alternatives){ .size = 0 };
    add(a, "localhost", 9);
    add(a, "127.0.0.1", 9);
    add(a, "::1", 3);
    if (gethostname(host, sizeof(host) - 1) == 0 && host[0]) {
        add(a, host, strlen(host));
        const size_t length = strlen(host);
        if (!strchr(host, '.') && length + 7 < sizeof(host)) { /* by multicast DNS */
            memcpy(host + length, ".local", 7);
            add(a, host, strlen(host));
        }
    }
    const size_t count = addresses_of_machine(found);
    for (size_t i = 0; i < count; i++)
        add(a, found[i], strlen(found[i]));
    for (const char *at = names ? names : ""; *at; at += strcspn(at, ",") + (at[strcspn(at, ",")] == ','))
        add(a, at, strcspn(at, ","));
}

static bool extend(X509 *x, int nid, const char *value)
{
    X509V3_CTX context;

    X509V3_set_ctx_nodb(&context);
    X509V3_set_ctx(&context, x, x, NULL, NULL, 0);
    X509_EXTENSION *extension = X509V3_EXT_conf_nid(NULL, &context, nid, value);
    const bool ok = extension && X509_add_ext(x, extension, -1) == 1;
    X509_EXTENSION_free(extension);
    return ok;
}

/* Signed by its own key; NULL: OpenSSL failed. */
static X509 *make_certificate(EVP_PKEY *key, const struct alternatives *a)
{
    unsigned char serial[16];
    X509 *x = X509_new();
    BIGNUM *number = NULL;

    if (!x || RAND_bytes(serial, sizeof(serial)) != 1)
        goto failed;
    serial[0] &= 0x7f; /* positive */
    number = BN_bin2bn(serial, sizeof(serial), NULL);
    X509_NAME *name = X509_get_subject_name(x);
    if (!number || !BN_to_ASN1_INTEGER(number, X509_get_serialNumber(x)) || X509_set_version(x, 2) != 1 ||
        !X509_gmtime_adj(X509_getm_notBefore(x), -86400) || /* clocks on a LAN differ */
        !X509_gmtime_adj(X509_getm_notAfter(x), VALID_S) || X509_set_pubkey(x, key) != 1 ||
        X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_ASC, (const unsigned char *)"relightd", -1, -1, 0) != 1 ||
        X509_set_issuer_name(x, name) != 1)
        goto failed;
    /* No authority: whoever trusts it trusts this server only. */
    if (!extend(x, NID_basic_constraints, "critical,CA:FALSE") || !extend(x, NID_ext_key_usage, "serverAuth") ||
        !extend(x, NID_key_usage, "critical,digitalSignature") || !extend(x, NID_subject_alt_name, a->text + 1) ||
        X509_sign(x, key, EVP_sha256()) == 0)
        goto failed;
    BN_free(number);
    return x;
failed:
    BN_free(number);
    X509_free(x);
    return NULL;
}

/* Writes through a temporary file, so that nobody reads half of one. key NULL: the certificate. */
static enum err store(const char *path, mode_t mode, const X509 *cert, EVP_PKEY *key, struct reason *why)
{
    char temporary[4200];

    snprintf(temporary, sizeof(temporary), "%s.new", path);
    unlink(temporary);
    const int fd = open(temporary, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
    FILE *f = fd >= 0 ? fdopen(fd, "w") : NULL;
    if (!f) {
        const int error = errno;
        if (fd >= 0)
            close(fd);
        return err_say(why, ERR_USAGE, "--tls-self-signed: %s: cannot be written: %s", temporary, strerror(error));
    }
    bool ok = key ? PEM_write_PrivateKey(f, key, NULL, NULL, 0, NULL, NULL) == 1 : PEM_write_X509(f, cert) == 1;
    ok = fflush(f) == 0 && ok;
    ok = fclose(f) == 0 && ok;
    if (ok && rename(temporary, path) == 0)
        return ERR_OK;
    const int error = errno;
    unlink(temporary);
    return err_say(why, ERR_USAGE, "--tls-self-signed: %s: cannot be written: %s", path, strerror(error));
}

static enum err make(const char *cert, const char *key, const struct alternatives *a, struct reason *why)
{
    EVP_PKEY *pair = EVP_EC_gen("P-256");
    X509 *x = pair ? make_certificate(pair, a) : NULL;
    enum err e = x ? ERR_OK : err_say(why, ERR_NOMEM, "--tls-self-signed: OpenSSL could not make a certificate");

    /* The key first: a certificate without its key would be kept. */
    if (!e)
        e = store(key, 0600, NULL, pair, why);
    if (!e)
        e = store(cert, 0644, x, NULL, why);
    X509_free(x);
    EVP_PKEY_free(pair);
    return e;
}

static X509 *read_certificate(const char *path)
{
    FILE *f = fopen(path, "r");
    X509 *x = f ? PEM_read_X509(f, NULL, NULL, NULL) : NULL;

    if (f)
        fclose(f);
    return x;
}

static bool covers(X509 *x, const char *entry, size_t length)
{
    char name[300];
    const bool number = strncmp(entry, "IP:", 3) == 0;
    const size_t skip = number ? 3 : 4;

    snprintf(name, sizeof(name), "%.*s", (int)(length - skip), entry + skip);
    return number ? X509_check_ip_asc(x, name, 0) == 1 : X509_check_host(x, name, 0, 0, NULL) == 1;
}

static void report(X509 *x, const char *cert, const struct alternatives *a, bool made)
{
    unsigned char digest[EVP_MAX_MD_SIZE];
    char text[3 * EVP_MAX_MD_SIZE + 1] = "", lacks[512] = "";
    unsigned size = 0;

    if (X509_digest(x, EVP_sha256(), digest, &size) == 1)
        for (unsigned i = 0; i < size; i++)
            snprintf(text + 3 * i, 4, "%02X%s", digest[i], i + 1 < size ? ":" : "");
    log_info("--tls-self-signed: %s %s; SHA-256 fingerprint %s", made ? "made" : "using", cert, text);
    for (const char *at = a->text; *at == ','; at += 1 + strcspn(at + 1, ",")) {
        const size_t length = strcspn(at + 1, ","), used = strlen(lacks);
        if (!covers(x, at + 1, length))
            snprintf(lacks + used, sizeof(lacks) - used, "%s%.*s", used ? ", " : "", (int)length, at + 1);
    }
    if (lacks[0])
        log_warning("%s does not cover %s: browsers will warn; delete it to get a new one", cert, lacks);
}

enum err tls_self_signed(const char *dir, const char *names, char *cert, char *key, size_t size, struct reason *why)
{
    struct alternatives a;
    enum err e;

    if ((size_t)snprintf(cert, size, "%s/cert.pem", dir) >= size ||
        (size_t)snprintf(key, size, "%s/key.pem", dir) >= size)
        return err_say(why, ERR_USAGE, "--tls-self-signed %.200s...: the path is too long", dir);
    e = folder_make_own("--tls-self-signed", dir, why);
    if (e)
        return e;
    collect(&a, names);
    const bool there = access(cert, F_OK) == 0;
    X509 *x = there ? read_certificate(cert) : NULL;
    if (there && !x)
        return err_say(why, ERR_USAGE, "--tls-self-signed: %s is not a PEM certificate; delete it to get a new one",
                       cert);
    time_t soon = time(NULL) + RENEW_S;
    const bool keeps = x && access(key, F_OK) == 0 && X509_cmp_time(X509_get0_notAfter(x), &soon) > 0;
    if (!keeps) {
        X509_free(x);
        e = make(cert, key, &a, why);
        x = e ? NULL : read_certificate(cert);
    }
    if (x)
        report(x, cert, &a, !keeps);
    X509_free(x);
    ERR_clear_error(); /* libwebsockets reads the same error queue */
    return e;
}
