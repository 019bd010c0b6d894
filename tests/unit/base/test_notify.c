#include "support/unit.h"

#include "base/process.h"

#include <stddef.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

/* A service manager's socket of that name; '@' in front as in NOTIFY_SOCKET. */
static int manager(const char *name)
{
    struct sockaddr_un address = { .sun_family = AF_UNIX };
    const size_t length = strlen(name);
    const int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);

    memcpy(address.sun_path, name, length);
    if (name[0] == '@')
        address.sun_path[0] = '\0';
    assert_int_equal(
        bind(fd, (struct sockaddr *)&address, (socklen_t)(offsetof(struct sockaddr_un, sun_path) + length)), 0);
    setenv("NOTIFY_SOCKET", name, 1);
    return fd;
}

static void assert_heard(int fd, const char *text)
{
    char got[256];
    const ssize_t n = recv(fd, got, sizeof(got) - 1, 0);

    assert_true(n >= 0);
    got[n] = '\0';
    assert_string_equal(got, text);
    assert_true(recv(fd, got, sizeof(got), 0) < 0); /* and nothing more */
}

static void words_arrive_by_path_and_by_name_without_file(void **state)
{
    char folder[] = "/tmp/relight_notify_XXXXXX", path[64], name[64];

    (void)state;
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof(path), "%s/socket", folder);
    snprintf(name, sizeof(name), "@relight-notify-%ld", (long)getpid());
    for (int k = 0; k < 2; k++) {
        const int fd = manager(k ? name : path);
        assert_true(notify_enabled());
        assert_true(notify_send("READY=1\nSTATUS=%s %d.", "frame", 7));
        assert_heard(fd, "READY=1\nSTATUS=frame 7.");
        close(fd);
    }
    unlink(path);
    rmdir(folder);
}

static void without_a_manager_nothing_is_said(void **state)
{
    static const char *const bad[] = { "", "/", "@", "relative", "vsock:2:1", "/nowhere/there/is/no/socket" };
    char long_name[200];

    (void)state;
    unsetenv("NOTIFY_SOCKET");
    assert_false(notify_enabled());
    assert_false(notify_send("READY=1"));
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        setenv("NOTIFY_SOCKET", bad[i], 1);
        assert_int_equal(notify_enabled(), bad[i][0] == '/' && bad[i][1]);
        assert_false(notify_send("READY=1"));
    }
    memset(long_name, 'x', sizeof(long_name));
    long_name[0] = '/';
    long_name[sizeof(long_name) - 1] = '\0';
    setenv("NOTIFY_SOCKET", long_name, 1);
    assert_false(notify_enabled());
}

/* A manager that does not read must not hold up the server. */
static void a_full_socket_is_not_waited_for(void **state)
{
    char name[64];
    int said = 0;

    (void)state;
    snprintf(name, sizeof(name), "@relight-notify-full-%ld", (long)getpid());
    const int fd = manager(name);
    while (said < 100000 && notify_send("STATUS=%d", said))
        said++;
    assert_true(said > 0 && said < 100000);
    close(fd);
}

static void a_watchdog_of_another_process_is_not_ours(void **state)
{
    char own[32];

    (void)state;
    setenv("NOTIFY_SOCKET", "/run/systemd/notify", 1);
    unsetenv("WATCHDOG_PID");
    unsetenv("WATCHDOG_USEC");
    assert_int_equal(notify_watchdog_us(), 0);
    setenv("WATCHDOG_USEC", "30000000", 1);
    assert_int_equal(notify_watchdog_us(), 30000000);
    snprintf(own, sizeof(own), "%ld", (long)getpid());
    setenv("WATCHDOG_PID", own, 1);
    assert_int_equal(notify_watchdog_us(), 30000000);
    setenv("WATCHDOG_PID", "1", 1);
    assert_int_equal(notify_watchdog_us(), 0);
    setenv("WATCHDOG_PID", own, 1);
    static const char *const bad[] = { "", "x", "-5", "5x", "99999999999999999999999" };
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        setenv("WATCHDOG_USEC", bad[i], 1);
        assert_int_equal(notify_watchdog_us(), 0);
    }
    setenv("WATCHDOG_USEC", "30000000", 1);
    unsetenv("NOTIFY_SOCKET");
    assert_int_equal(notify_watchdog_us(), 0);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(words_arrive_by_path_and_by_name_without_file),
    cmocka_unit_test(without_a_manager_nothing_is_said),
    cmocka_unit_test(a_full_socket_is_not_waited_for),
    cmocka_unit_test(a_watchdog_of_another_process_is_not_ours),
};

UNIT_MAIN(tests)
