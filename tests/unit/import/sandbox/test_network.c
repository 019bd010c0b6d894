/* The sandbox of a process that reads from the network: what it may still do, and what it may not. */
#define _GNU_SOURCE /* syscall */
#include "support/unit.h"

#include "import/sandbox/confine.h"

#include <errno.h>
#include <fcntl.h>
#include <ifaddrs.h>
#include <linux/capability.h>
#include <linux/landlock.h>
#include <net/if.h>
#include <netdb.h>
#include <pthread.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
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

/* Sends this signal through a descriptor to the process that started this one. */
static int signal_through_descriptor(void)
{
    int ends[2];

    if (pipe2(ends, O_CLOEXEC) != 0)
        return ALLOWED;
    const bool owned = fcntl(ends[0], F_SETOWN, getppid()) == 0, chosen = fcntl(ends[0], F_SETSIG, SIGKILL) == 0;
    const bool sends = fcntl(ends[0], F_SETFL, O_ASYNC | O_NONBLOCK) == 0;
    return owned || chosen || sends ? ALLOWED : DENIED;
}

static int signal_through_ioctl(void)
{
    const int s = socket(AF_INET, SOCK_DGRAM, 0), on = 1, pid = getppid();
    const bool owned = ioctl(s, FIOSETOWN, &pid) == 0 || ioctl(s, SIOCSPGRP, &pid) == 0;

    return s < 0 || owned || ioctl(s, FIOASYNC, &on) == 0 ? ALLOWED : DENIED;
}

static int use_raw_sockets(void)
{
    return socket(AF_INET, SOCK_RAW, IPPROTO_ICMP) >= 0 || socket(AF_INET6, SOCK_RAW, IPPROTO_RAW) >= 0 ||
                   socket(AF_INET, SOCK_DGRAM, IPPROTO_ICMP) >= 0 || errno != EPERM
               ? ALLOWED
               : DENIED;
}

static int use_netlink_of_others(void)
{
    for (int protocol = 1; protocol < 32; protocol++)
        if (socket(AF_NETLINK, SOCK_RAW, protocol) >= 0 || errno != EPERM)
            return ALLOWED;
    return DENIED;
}

static int change_device(void)
{
    struct ifreq lo = { .ifr_name = "lo", .ifr_mtu = 1400 };

    return ioctl(socket(AF_INET, SOCK_DGRAM, 0), SIOCSIFMTU, &lo) == 0 || errno != EPERM ? ALLOWED : DENIED;
}

static int make_socket_quick(void)
{
    const int s = socket(AF_INET6, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, IPPROTO_TCP), on = 1;
    const int flags = fcntl(s, F_GETFL);

    return flags >= 0 && fcntl(s, F_SETFL, flags | O_NONBLOCK) == 0 && fcntl(s, F_SETFD, FD_CLOEXEC) == 0 &&
                   ioctl(s, FIONBIO, &on) == 0
               ? ALLOWED
               : DENIED;
}

static int list_addresses(void)
{
    struct ifaddrs *all = NULL;

    return getifaddrs(&all) == 0 && all ? ALLOWED : DENIED;
}

static bool was_root;

/* Whether a process of root is root no longer, and no process has a capability or can gain one. */
static int keep_privileges(void)
{
    struct __user_cap_header_struct header = { .version = _LINUX_CAPABILITY_VERSION_3 };
    struct __user_cap_data_struct sets[2] = { { 0 } };
    bool any = geteuid() == 0 || getuid() == 0 || (was_root && getgroups(0, NULL) != 0);

    any = any || syscall(SYS_capget, &header, sets) != 0 || prctl(PR_GET_NO_NEW_PRIVS, 0, 0, 0, 0) != 1;
    for (int k = 0; k < 2; k++)
        any = any || sets[k].effective || sets[k].permitted || sets[k].inheritable;
    return any ? ALLOWED : DENIED;
}

static void signals_go_through_no_descriptor(void **state)
{
    (void)state;
    assert_int_equal(confined(signal_through_descriptor), DENIED);
    assert_int_equal(confined(signal_through_ioctl), DENIED);
}

static void only_tcp_udp_and_the_list_of_addresses_are_reached(void **state)
{
    (void)state;
    assert_int_equal(confined(use_raw_sockets), DENIED);
    assert_int_equal(confined(use_netlink_of_others), DENIED);
    assert_int_equal(confined(change_device), DENIED);
    assert_int_equal(confined(make_socket_quick), ALLOWED);
    assert_int_equal(confined(list_addresses), ALLOWED);
}

/* Of every helper, with or without the network: before the system calls are limited, so that it can be asked. */
static void no_helper_keeps_privileges(void **state)
{
    was_root = geteuid() == 0;
    const pid_t pid = fork();
    int status = 0;

    (void)state;
    assert_true(pid >= 0);
    if (pid == 0) {
        const struct confine_limits limits = { .address_bytes = (size_t)4 << 30, .seconds = 60, .descriptors = 3 };
        _exit(confine_limits(&limits) ? NO_SANDBOX : keep_privileges());
    }
    assert_int_equal(waitpid(pid, &status, 0), pid);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), DENIED);
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
    cmocka_unit_test(signals_go_through_no_descriptor),
    cmocka_unit_test(only_tcp_udp_and_the_list_of_addresses_are_reached),
    cmocka_unit_test(no_helper_keeps_privileges),
    cmocka_unit_test(network_process_cannot_read_files_where_landlock_is),
};

UNIT_MAIN(tests)
