/* The sandbox of a process that reads from the network: what it may still do, and what it may not. */
#define _GNU_SOURCE /* syscall */
#include "support/unit.h"

#include "import/sandbox/confine.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/landlock.h>
#include <netdb.h>
#include <pthread.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

enum { ALLOWED = 0, DENIED = 1, NO_SANDBOX = 2 };

/* Runs `deed` in a process that was confined, and returns its exit code, or 128 plus the signal that ended it. */
static int confined(int (*deed)(void))
{
    const pid_t pid = fork();
    int status = 0;

    assert_true(pid >= 0);
    if (pid == 0) {
        const struct confine_limits limits = {
            .address_bytes = (size_t)4 << 30, .seconds = 60, .descriptors = 3, .received = 64, .threads = true
        };
        _exit(confine_limits(&limits) || confine_network(NULL) ? NO_SANDBOX : deed());
    }
    assert_int_equal(waitpid(pid, &status, 0), pid);
    if (WIFEXITED(status) && WEXITSTATUS(status) == NO_SANDBOX) {
        printf("skipped: no seccomp here\n");
        exit(UNIT_SKIPPED);
    }
    return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
}

static int open_for_reading(const char *path)
{
    const int fd = open(path, O_RDONLY);

    if (fd >= 0)
        close(fd);
    return fd >= 0 ? ALLOWED : DENIED;
}

static int read_passwords(void)
{
    return open_for_reading("/etc/passwd");
}

static int read_itself(void)
{
    return open_for_reading("/proc/self/environ");
}

static int read_names(void)
{
    return open_for_reading("/etc/hosts");
}

static int write_file(void)
{
    const int fd = open("/tmp/relight-confine-test", O_WRONLY | O_CREAT, 0600);

    unlink("/tmp/relight-confine-test");
    return fd >= 0 ? ALLOWED : DENIED;
}

static int remove_file(void)
{
    errno = 0;
    return unlink("/tmp/relight-confine-nothing") != 0 && errno == EPERM ? DENIED : ALLOWED;
}

static int use_internet(void)
{
    return socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0) >= 0 ? ALLOWED : DENIED;
}

static int use_local_sockets(void)
{
    return socket(AF_UNIX, SOCK_STREAM, 0) >= 0 ? ALLOWED : DENIED;
}

static void *idle(void *arg)
{
    return arg;
}

static int start_thread(void)
{
    pthread_t thread;

    return pthread_create(&thread, NULL, idle, NULL) == 0 && pthread_join(thread, NULL) == 0 ? ALLOWED : DENIED;
}

static int start_process(void)
{
    const pid_t pid = fork();

    if (pid == 0)
        _exit(0);
    return pid > 0 ? ALLOWED : DENIED;
}

static int start_program(void)
{
    char *const arguments[] = { (char[]){ "true" }, NULL };

    execv("/bin/true", arguments);
    return DENIED;
}

static int signal_parent(void)
{
    return kill(getppid(), 0) == 0 ? ALLOWED : DENIED;
}

static int find_name(void)
{
    struct addrinfo *found = NULL;

    const int failed = getaddrinfo("localhost", "80", NULL, &found);
    if (!failed)
        freeaddrinfo(found);
    return failed ? DENIED : ALLOWED;
}

static void network_process_keeps_sockets_threads_and_names(void **state)
{
    (void)state;
    assert_int_equal(confined(use_internet), ALLOWED);
    assert_int_equal(confined(start_thread), ALLOWED);
    assert_int_equal(confined(read_names), ALLOWED);
    assert_int_equal(confined(find_name), ALLOWED);
}

static void network_process_cannot_write_signal_or_start_anything(void **state)
{
    (void)state;
    assert_int_equal(confined(write_file), DENIED);
    assert_int_equal(confined(remove_file), DENIED);
    assert_int_equal(confined(use_local_sockets), DENIED);
    assert_int_equal(confined(start_process), DENIED);
    assert_int_equal(confined(signal_parent), DENIED);
    assert_int_equal(confined(start_program), 128 + SIGSYS);
}

static void network_process_cannot_read_files_where_landlock_is(void **state)
{
    (void)state;
    if (syscall(SYS_landlock_create_ruleset, NULL, 0, LANDLOCK_CREATE_RULESET_VERSION) < 1) {
        printf("skipped: no Landlock here\n");
        exit(UNIT_SKIPPED);
    }
    assert_int_equal(confined(read_passwords), DENIED);
    assert_int_equal(confined(read_itself), DENIED);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(network_process_keeps_sockets_threads_and_names),
    cmocka_unit_test(network_process_cannot_write_signal_or_start_anything),
    cmocka_unit_test(network_process_cannot_read_files_where_landlock_is),
};

UNIT_MAIN(tests)
