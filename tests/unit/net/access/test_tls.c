/* Certificate and key: what is refused with which reason, when the certificate ends, and what a handshake shows. */
#include "support/folder.h"
#include "support/unit.h"

#include "net/access/tls.h"

#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>
#include <time.h>
#include <unistd.h>

static char cert[2][128], key[2][128];

/* Pair k, valid between two times relative to now. */
static void make_pair(int k, long from_s, long to_s)
{
    EVP_PKEY *pair = EVP_EC_gen("P-256");
    X509 *x = X509_new();

    snprintf(cert[k], sizeof(cert[k]), "%s/cert%d.pem", folder, k);
    snprintf(key[k], sizeof(key[k]), "%s/key%d.pem", folder, k);
    ASN1_INTEGER_set(X509_get_serialNumber(x), 100 + k);
    X509_gmtime_adj(X509_getm_notBefore(x), from_s);
    X509_gmtime_adj(X509_getm_notAfter(x), to_s);
    X509_set_pubkey(x, pair);
    assert_true(X509_sign(x, pair, EVP_sha256()) > 0);
    FILE *f = fopen(cert[k], "w");
    assert_int_equal(PEM_write_X509(f, x), 1);
    fclose(f);
    f = fopen(key[k], "w");
    assert_int_equal(PEM_write_PrivateKey(f, pair, NULL, NULL, 0, NULL, NULL), 1);
    fclose(f);
    X509_free(x);
    EVP_PKEY_free(pair);
}

static void must_refuse(const char *c, const char *k, const char *file, const char *about)
{
    struct tls *t = (struct tls *)8;
    struct reason why;

    assert_int_equal(tls_load(c, k, &t, &why), ERR_USAGE);
    assert_null(t);
    if (!strstr(why.text, file) || !strstr(why.text, about))
        fail_msg("\"%s\" does not name %s and \"%s\"", why.text, file, about);
}

static void a_pair_is_taken_and_says_when_it_ends(void **state)
{
    const long seconds[] = { 100, 86400 + 50, 30 * 86400 };
    struct reason why;
    (void)state;

    for (int i = 0; i < 3; i++) {
        struct tls *t;
        make_pair(0, -10, seconds[i]);
        const int64_t want = (int64_t)time(NULL) + seconds[i];
        assert_int_equal(tls_load(cert[0], key[0], &t, &why), ERR_OK);
        assert_true(llabs(tls_expires_s(t) - want) <= 2);
        tls_destroy(t);
    }
    tls_destroy(NULL);
}

static void what_no_browser_would_take_is_refused_with_the_file(void **state)
{
    char none[200];
    (void)state;

    make_pair(0, -10, 1000);
    make_pair(1, -10, 1000);
    snprintf(none, sizeof(none), "%s/none.pem", folder);
    must_refuse(none, key[0], none, "--tls-cert");
    must_refuse(none, key[0], none, "cannot be read: No such file");
    must_refuse(cert[0], none, none, "--tls-key");
    must_refuse(cert[0], none, none, "cannot be read: No such file");
    must_refuse(key[0], key[0], key[0], "is not a PEM certificate");
    must_refuse(cert[0], cert[0], cert[0], "is no private key in PEM");
    must_refuse(cert[0], key[1], key[1], "is not the key of that certificate");
    make_pair(0, -2000, -1000);
    must_refuse(cert[0], key[0], cert[0], "has expired");
    make_pair(0, 1000, 2000);
    must_refuse(cert[0], key[0], cert[0], "is not valid yet");
}

/* Handshakes in memory, until both sides are done. Returns whether the client got the certificate of that pair. */
static bool shows(SSL_CTX *server, int version, int k)
{
    SSL_CTX *context = SSL_CTX_new(TLS_client_method());
    SSL *a = SSL_new(context), *b = SSL_new(server);
    BIO *left, *right;
    bool done = false;

    SSL_set_min_proto_version(a, version);
    SSL_set_max_proto_version(a, version);
    assert_int_equal(BIO_new_bio_pair(&left, 0, &right, 0), 1);
    SSL_set_bio(a, left, left);
    SSL_set_bio(b, right, right);
    for (int i = 0; i < 10 && !done; i++) {
        const int x = SSL_connect(a), y = SSL_accept(b);
        done = x == 1 && y == 1;
    }
    X509 *got = done ? SSL_get1_peer_certificate(a) : NULL;
    const bool same = got && ASN1_INTEGER_get(X509_get_serialNumber(got)) == 100 + k;
    X509_free(got);
    SSL_free(a);
    SSL_free(b);
    SSL_CTX_free(context);
    return same;
}

static void a_handshake_shows_the_present_pair_in_new_versions_only(void **state)
{
    SSL_CTX *server = SSL_CTX_new(TLS_server_method());
    struct tls *t[2], *shown;
    struct reason why;
    (void)state;

    for (int k = 0; k < 2; k++) {
        make_pair(k, -10, 1000);
        assert_int_equal(tls_load(cert[k], key[k], &t[k], &why), ERR_OK);
    }
    assert_true(tls_restrict(server));
    tls_show(server, &shown);
    for (int i = 0; i < 4; i++) {
        shown = t[i % 2];
        assert_true(shows(server, TLS1_3_VERSION, i % 2));
        assert_true(shows(server, TLS1_2_VERSION, i % 2));
        assert_false(shows(server, TLS1_1_VERSION, i % 2));
    }
    assert_int_equal(SSL_CTX_get_min_proto_version(server), TLS1_2_VERSION);
    assert_true(SSL_CTX_get_options(server) & SSL_OP_NO_TICKET);
    SSL_CTX_free(server);
    tls_destroy(t[0]);
    tls_destroy(t[1]);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test_setup_teardown(a_pair_is_taken_and_says_when_it_ends, make_folder, remove_folder),
    cmocka_unit_test_setup_teardown(what_no_browser_would_take_is_refused_with_the_file, make_folder, remove_folder),
    cmocka_unit_test_setup_teardown(a_handshake_shows_the_present_pair_in_new_versions_only, make_folder,
                                    remove_folder),
};
UNIT_MAIN(tests)
