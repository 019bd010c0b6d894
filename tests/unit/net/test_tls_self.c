/* The certificate of the server's own: for whom it is, how long, who may read its key, and when it is made again. */
#include "net/tls_self.h"
#include "support/unit.h"

#include <openssl/pem.h>
#include <openssl/x509v3.h>
#include <stdbool.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

static char folder[64], cert[128], key[128];

static int make_folder(void **state)
{
    (void)state;
    strcpy(folder, "/tmp/relight-tls-XXXXXX");
    if (!mkdtemp(folder))
        return -1;
    strcat(folder, "/own"); /* which it makes */
    return 0;
}

static int remove_folder(void **state)
{
    char command[100];
    (void)state;
    snprintf(command, sizeof(command), "rm -r %.*s", (int)(strlen(folder) - strlen("/own")), folder);
    return system(command);
}

static void make(const char *names)
{
    struct reason why = { "" };

    if (tls_self_signed(folder, names, cert, key, sizeof(cert), &why))
        fail_msg("%s", why.text);
}

static X509 *read_it(void)
{
    FILE *f = fopen(cert, "r");
    X509 *x = f ? PEM_read_X509(f, NULL, NULL, NULL) : NULL;

    assert_non_null(x);
    fclose(f);
    return x;
}

static bool ends_within(X509 *x, double days)
{
    time_t at = time(NULL) + (time_t)(86400.0 * days);
    return X509_cmp_time(X509_get0_notAfter(x), &at) < 0;
}

static void it_is_for_this_machine_and_the_names_asked_for(void **state)
{
    struct stat info;
    char host[256] = "";
    (void)state;

    make("studio.example,192.0.2.7,2001:db8::7,not a name,studio.example");
    X509 *x = read_it();
    assert_int_equal(X509_check_host(x, "localhost", 0, 0, NULL), 1);
    assert_int_equal(X509_check_host(x, "studio.example", 0, 0, NULL), 1);
    assert_int_equal(X509_check_host(x, "other.example", 0, 0, NULL), 0);
    assert_int_equal(X509_check_ip_asc(x, "127.0.0.1", 0), 1);
    assert_int_equal(X509_check_ip_asc(x, "::1", 0), 1);
    assert_int_equal(X509_check_ip_asc(x, "192.0.2.7", 0), 1);
    assert_int_equal(X509_check_ip_asc(x, "2001:db8::7", 0), 1);
    assert_int_equal(X509_check_ip_asc(x, "192.0.2.8", 0), 0);
    assert_int_equal(gethostname(host, sizeof(host) - 1), 0);
    if (!strchr(host, '_')) /* no DNS name, which is left out */
        assert_int_equal(X509_check_host(x, host, 0, 0, NULL), 1);
    GENERAL_NAMES *all = X509_get_ext_d2i(x, NID_subject_alt_name, NULL, NULL);
    assert_non_null(all);
    int studios = 0;
    for (int i = 0; i < sk_GENERAL_NAME_num(all); i++) {
        const GENERAL_NAME *g = sk_GENERAL_NAME_value(all, i);
        studios += g->type == GEN_DNS && strstr((const char *)ASN1_STRING_get0_data(g->d.dNSName), "studio") != NULL;
    }
    GENERAL_NAMES_free(all);
    assert_int_equal(studios, 1); /* each name once, and none with blanks */
    assert_true(ends_within(x, 731.0) && !ends_within(x, 729.0));
    time_t yesterday = time(NULL) - 80000;
    assert_true(X509_cmp_time(X509_get0_notBefore(x), &yesterday) < 0); /* clocks on a LAN differ */
    assert_int_equal(X509_check_ca(x), 0);
    assert_int_equal(X509_get_version(x), 2);
    assert_int_equal(X509_get_extended_key_usage(x), XKU_SSL_SERVER);
    assert_int_equal(X509_get_key_usage(x), KU_DIGITAL_SIGNATURE);
    FILE *f = fopen(key, "r");
    EVP_PKEY *pair = f ? PEM_read_PrivateKey(f, NULL, NULL, NULL) : NULL;
    assert_non_null(pair);
    fclose(f);
    assert_int_equal(X509_check_private_key(x, pair), 1);
    assert_int_equal(X509_verify(x, pair), 1);
    EVP_PKEY_free(pair);
    X509_free(x);
    assert_int_equal(stat(key, &info), 0);
    assert_int_equal(info.st_mode & 0777, 0600);
}

static void it_is_kept_and_made_again_without_its_key(void **state)
{
    struct reason why;
    char long_name[200];
    (void)state;

    make(NULL);
    X509 *first = read_it();
    make("new.example"); /* named in a warning */
    X509 *kept = read_it();
    assert_int_equal(X509_cmp(first, kept), 0);
    assert_int_equal(unlink(key), 0);
    make(NULL);
    X509 *again = read_it();
    assert_int_not_equal(X509_cmp(first, again), 0);
    X509_free(first);
    X509_free(kept);
    X509_free(again);
    FILE *f = fopen(cert, "w");
    assert_non_null(f);
    fputs("damaged", f);
    fclose(f);
    assert_int_equal(tls_self_signed(folder, NULL, cert, key, sizeof(cert), &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "is no PEM certificate"));
    memset(long_name, 'x', sizeof(long_name) - 1);
    long_name[sizeof(long_name) - 1] = '\0';
    assert_int_equal(tls_self_signed(long_name, NULL, cert, key, sizeof(cert), &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "the path is too long"));
    assert_int_equal(tls_self_signed("/dev/null/x", NULL, cert, key, sizeof(cert), &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "/dev/null/x: cannot be made"));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test_setup_teardown(it_is_for_this_machine_and_the_names_asked_for, make_folder, remove_folder),
    cmocka_unit_test_setup_teardown(it_is_kept_and_made_again_without_its_key, make_folder, remove_folder),
};
UNIT_MAIN(tests)
