/* The certificate of the server's own: for whom it is, how long, who may read its key, and when it is made again. */
#include "net/access/tls.h"
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

    make("studio.example,192.0.2.7,2001:db8::7,not a name,studio.example,last.example,last.example,last.exam");
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
    assert_int_equal(X509_check_host(x, "last.exam", 0, 0, NULL), 1);
    int studios = 0, lasts = 0;
    for (int i = 0; i < sk_GENERAL_NAME_num(all); i++) {
        const GENERAL_NAME *g = sk_GENERAL_NAME_value(all, i);
        studios += g->type == GEN_DNS && strstr((const char *)ASN1_STRING_get0_data(g->d.dNSName), "studio") != NULL;
        lasts +=
            g->type == GEN_DNS && strstr((const char *)ASN1_STRING_get0_data(g->d.dNSName), "last.example") != NULL;
    }
    GENERAL_NAMES_free(all);
    assert_int_equal(studios, 1); /* each name once, and none with blanks */
    assert_int_equal(lasts, 1);
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

static void what_cannot_be_written_is_named(void **state)
{
    char inner[200], want[300];
    struct reason why;
    (void)state;

    assert_int_equal(mkdir(folder, 0700), 0);
    snprintf(inner, sizeof(inner), "%s/key.pem", folder);
    assert_int_equal(mkdir(inner, 0700), 0);
    assert_int_equal(tls_self_signed(folder, NULL, cert, key, sizeof(cert), &why), ERR_USAGE);
    snprintf(want, sizeof(want), "--tls-self-signed: %s: cannot be written: Is a directory", inner);
    assert_string_equal(why.text, want);
    assert_int_equal(rmdir(inner), 0);
    snprintf(inner, sizeof(inner), "%s/key.pem.new", folder);
    assert_int_equal(mkdir(inner, 0700), 0);
    assert_int_equal(tls_self_signed(folder, NULL, cert, key, sizeof(cert), &why), ERR_USAGE);
    snprintf(want, sizeof(want), "--tls-self-signed: %s: cannot be written: File exists", inner);
    assert_string_equal(why.text, want);
}

/* Who may write to the folder would choose the key. */
static void a_folder_that_others_may_write_to_is_refused(void **state)
{
    const mode_t open_to[] = { 0777, 0722, 0770, 01777 };
    struct reason why;
    char link[200];
    (void)state;

    assert_int_equal(mkdir(folder, 0700), 0);
    for (size_t i = 0; i < sizeof(open_to) / sizeof(open_to[0]); i++) {
        assert_int_equal(chmod(folder, open_to[i]), 0);
        assert_int_equal(tls_self_signed(folder, NULL, cert, key, sizeof(cert), &why), ERR_USAGE);
        assert_non_null(strstr(why.text, "other users may write to it"));
    }
    assert_int_equal(chmod(folder, 0755), 0);
    snprintf(link, sizeof(link), "%s-link", folder);
    assert_int_equal(symlink(folder, link), 0);
    assert_int_equal(tls_self_signed(link, NULL, cert, key, sizeof(cert), &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "is not a folder"));
    if (geteuid() == 0) {
        assert_int_equal(chown(folder, 65534, 65534), 0);
        assert_int_equal(tls_self_signed(folder, NULL, cert, key, sizeof(cert), &why), ERR_USAGE);
        assert_int_equal(chown(folder, 0, 0), 0);
    }
    assert_int_equal(access(key, F_OK), -1);
    make(NULL);
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
    assert_non_null(strstr(why.text, "is not a PEM certificate"));
    memset(long_name, 'x', sizeof(long_name) - 1);
    long_name[sizeof(long_name) - 1] = '\0';
    assert_int_equal(tls_self_signed(long_name, NULL, cert, key, sizeof(cert), &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "the path is too long"));
    assert_int_equal(tls_self_signed("/dev/null/x", NULL, cert, key, sizeof(cert), &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "/dev/null/x: cannot be made"));
}

/* What the log says: SHA-256 as 32 bytes with colons between, and each name that a kept certificate lacks. */
static void the_log_has_the_fingerprint_and_the_names_that_are_missing(void **state)
{
    unsigned char digest[32];
    unsigned size = 0;
    char want[3 * 32 + 40] = "SHA-256 fingerprint ", text[4096] = "";
    (void)state;

    make(NULL);
    X509 *x = read_it();
    assert_int_equal(X509_digest(x, EVP_sha256(), digest, &size), 1);
    for (unsigned i = 0; i < size; i++)
        sprintf(want + strlen(want), i + 1 < size ? "%02X:" : "%02X\n", digest[i]);
    X509_free(x);
    FILE *f = tmpfile();
    fflush(stderr);
    const int kept = dup(2);
    assert_true(f && kept >= 0 && dup2(fileno(f), 2) == 2);
    make("localhost,new.example,198.51.100.9");
    fflush(stderr);
    dup2(kept, 2);
    close(kept);
    rewind(f);
    text[fread(text, 1, sizeof(text) - 1, f)] = '\0';
    fclose(f);
    if (!strstr(text, want) || !strstr(text, "using ") ||
        !strstr(text, "does not cover DNS:new.example, IP:198.51.100.9: browsers"))
        fail_msg("not in the log: %s", text);
    assert_null(strstr(text, "localhost"));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test_setup_teardown(the_log_has_the_fingerprint_and_the_names_that_are_missing, make_folder,
                                    remove_folder),
    cmocka_unit_test_setup_teardown(it_is_for_this_machine_and_the_names_asked_for, make_folder, remove_folder),
    cmocka_unit_test_setup_teardown(what_cannot_be_written_is_named, make_folder, remove_folder),
    cmocka_unit_test_setup_teardown(a_folder_that_others_may_write_to_is_refused, make_folder, remove_folder),
    cmocka_unit_test_setup_teardown(it_is_kept_and_made_again_without_its_key, make_folder, remove_folder),
};
UNIT_MAIN(tests)
