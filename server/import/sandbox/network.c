#define _GNU_SOURCE /* CLONE_THREAD, O_PATH */
#include "import/sandbox/confine.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/landlock.h>
#include <linux/netlink.h>
#include <netinet/in.h>
#include <sched.h>
#include <seccomp.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

/* ---- Files: Landlock ---- */

#define READ_RIGHTS (LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR)
#define ALL_RIGHTS ((LANDLOCK_ACCESS_FS_MAKE_SYM << 1) - 1) /* of the first version, up to its last */

static void allow_below(int ruleset, const char *path)
{
    struct landlock_path_beneath_attr rule = { .allowed_access = READ_RIGHTS,
                                               .parent_fd = open(path, O_PATH | O_CLOEXEC) };
    struct stat st;

    if (rule.parent_fd < 0)
        return; /* not on this system */
    if (fstat(rule.parent_fd, &st) == 0 && !S_ISDIR(st.st_mode))
        rule.allowed_access &= ~(uint64_t)LANDLOCK_ACCESS_FS_READ_DIR;
    (void)syscall(SYS_landlock_add_rule, ruleset, LANDLOCK_RULE_PATH_BENEATH, &rule, 0);
    close(rule.parent_fd);
}

/* Needs no_new_privs, which confine_limits sets. */
static void limit_files(const char *file)
{
    static const char *const paths[] = {
        "/etc/hosts",           "/etc/resolv.conf",   "/etc/nsswitch.conf", "/etc/host.conf",
        "/etc/gai.conf",        "/etc/services",      "/etc/ssl",           "/usr/share/ca-certificates",
        "/run/systemd/resolve", "/etc/ld.so.cache",   "/usr/lib",           "/lib",
        "/etc/localtime",       "/usr/share/zoneinfo"
    };
    const struct landlock_ruleset_attr all = { .handled_access_fs = ALL_RIGHTS };
    const long ruleset = syscall(SYS_landlock_create_ruleset, &all, sizeof(all), 0);

    if (ruleset < 0)
        return;
    for (size_t i = 0; i < sizeof(paths) / sizeof(paths[0]); i++)
        allow_below((int)ruleset, paths[i]);
    if (file)
        allow_below((int)ruleset, file);
    (void)syscall(SYS_landlock_restrict_self, (int)ruleset, 0);
    close((int)ruleset);
}

/* ---- System calls: seccomp ---- */

static const int calls[] = {
    /* Memory, time, threads. */
    SCMP_SYS(brk),
    SCMP_SYS(mmap),
    SCMP_SYS(munmap),
    SCMP_SYS(mremap),
    SCMP_SYS(madvise),
    SCMP_SYS(mprotect),
    SCMP_SYS(futex),
    SCMP_SYS(set_robust_list),
    SCMP_SYS(rseq),
    SCMP_SYS(sched_yield),
    SCMP_SYS(sched_getaffinity),
    SCMP_SYS(getrandom),
    SCMP_SYS(clock_gettime),
    SCMP_SYS(clock_getres),
    SCMP_SYS(clock_nanosleep),
    SCMP_SYS(nanosleep),
    SCMP_SYS(gettimeofday),
    SCMP_SYS(time),
    SCMP_SYS(exit),
    SCMP_SYS(exit_group),
    SCMP_SYS(restart_syscall),
    SCMP_SYS(rt_sigreturn),
    SCMP_SYS(rt_sigprocmask),
    SCMP_SYS(rt_sigaction),
    SCMP_SYS(sigaltstack),
    SCMP_SYS(getpid),
    SCMP_SYS(gettid),
    SCMP_SYS(getuid),
    SCMP_SYS(geteuid),
    SCMP_SYS(getgid),
    SCMP_SYS(getegid),
    SCMP_SYS(uname),
    SCMP_SYS(sysinfo),
    SCMP_SYS(getrusage),
    /* Descriptors. */
    SCMP_SYS(read),
    SCMP_SYS(readv),
    SCMP_SYS(pread64),
    SCMP_SYS(write),
    SCMP_SYS(writev),
    SCMP_SYS(close),
    SCMP_SYS(lseek),
    SCMP_SYS(fstat),
    SCMP_SYS(newfstatat),
    SCMP_SYS(stat),
    SCMP_SYS(lstat),
    SCMP_SYS(access),
    SCMP_SYS(poll),
    SCMP_SYS(ppoll),
    SCMP_SYS(select),
    SCMP_SYS(pselect6),
    SCMP_SYS(epoll_create),
    SCMP_SYS(epoll_create1),
    SCMP_SYS(epoll_ctl),
    SCMP_SYS(epoll_wait),
    SCMP_SYS(epoll_pwait),
    SCMP_SYS(eventfd2),
    SCMP_SYS(pipe2),
    SCMP_SYS(readlink),
    /* Sockets. */
    SCMP_SYS(connect),
    SCMP_SYS(bind),
    SCMP_SYS(listen),
    SCMP_SYS(accept),
    SCMP_SYS(accept4),
    SCMP_SYS(getsockname),
    SCMP_SYS(getpeername),
    SCMP_SYS(setsockopt),
    SCMP_SYS(getsockopt),
    SCMP_SYS(sendto),
    SCMP_SYS(recvfrom),
    SCMP_SYS(sendmsg),
    SCMP_SYS(recvmsg),
    SCMP_SYS(sendmmsg),
    SCMP_SYS(recvmmsg),
    SCMP_SYS(shutdown),
};

/* The kernel ignores the upper halves of these arguments, so the filter does. */
#define IS(value) SCMP_CMP_MASKED_EQ, 0xffffffffu, (scmp_datum_t)(value)

/* TCP, UDP, and of netlink what tells which addresses there are. No raw sockets. */
static int add_sockets(scmp_filter_ctx filter)
{
    static const struct {
        int family, type, protocol;
    } allowed[] = {
        { AF_INET, SOCK_STREAM, 0 },
        { AF_INET, SOCK_STREAM, IPPROTO_TCP },
        { AF_INET, SOCK_DGRAM, 0 },
        { AF_INET, SOCK_DGRAM, IPPROTO_UDP },
        { AF_INET6, SOCK_STREAM, 0 },
        { AF_INET6, SOCK_STREAM, IPPROTO_TCP },
        { AF_INET6, SOCK_DGRAM, 0 },
        { AF_INET6, SOCK_DGRAM, IPPROTO_UDP },
        { AF_NETLINK, SOCK_RAW, NETLINK_ROUTE },
    };
    const scmp_datum_t type = ~(scmp_datum_t)(SOCK_CLOEXEC | SOCK_NONBLOCK) & 0xffffffffu;
    int fault = 0;

    for (size_t i = 0; i < sizeof(allowed) / sizeof(allowed[0]) && !fault; i++)
        fault = seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(socket), 3, SCMP_A0(IS(allowed[i].family)),
                                 SCMP_A1(SCMP_CMP_MASKED_EQ, type, (scmp_datum_t)allowed[i].type),
                                 SCMP_A2(IS(allowed[i].protocol)));
    return fault;
}

/* Not F_SETOWN, F_SETSIG and O_ASYNC, with which a descriptor sends any signal to any process of this user; of ioctl,
 * whose numbers are many, only what asks about waiting bytes and makes a socket non-blocking. */
static int add_descriptors(scmp_filter_ctx filter)
{
    static const int commands[] = { F_GETFD, F_SETFD, F_GETFL, F_DUPFD, F_DUPFD_CLOEXEC };
    static const unsigned long requests[] = { FIONBIO, FIONREAD };
    int fault = seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(fcntl), 2, SCMP_A1(IS(F_SETFL)),
                                 SCMP_A2(SCMP_CMP_MASKED_EQ, O_ASYNC, 0));

    for (size_t i = 0; i < sizeof(commands) / sizeof(commands[0]) && !fault; i++)
        fault = seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(fcntl), 1, SCMP_A1(IS(commands[i])));
    for (size_t i = 0; i < sizeof(requests) / sizeof(requests[0]) && !fault; i++)
        fault = seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(ioctl), 1, SCMP_A1(IS(requests[i])));
    return fault;
}

static int add_rules(scmp_filter_ctx filter)
{
    const struct scmp_arg_cmp reads = SCMP_A2(SCMP_CMP_MASKED_EQ, O_ACCMODE | O_CREAT | O_TRUNC, O_RDONLY),
                              thread = SCMP_A0(SCMP_CMP_MASKED_EQ, CLONE_THREAD, CLONE_THREAD),
                              itself = SCMP_A0(SCMP_CMP_EQ, (scmp_datum_t)getpid(), 0);
    int fault = 0;

    for (size_t i = 0; i < sizeof(calls) / sizeof(calls[0]) && !fault; i++)
        fault = seccomp_rule_add(filter, SCMP_ACT_ALLOW, calls[i], 0);
    if (!fault)
        fault = add_sockets(filter);
    if (!fault)
        fault = add_descriptors(filter);
    if (!fault)
        fault = seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(openat), 1, reads);
    if (!fault)
        fault = seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(clone), 1, thread);
    if (!fault) /* its flags are in memory, where a filter cannot read them: the C library takes clone instead */
        fault = seccomp_rule_add(filter, SCMP_ACT_ERRNO(ENOSYS), SCMP_SYS(clone3), 0);
    if (!fault)
        fault = seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(tgkill), 1, itself);
    if (!fault)
        fault = seccomp_rule_add(filter, SCMP_ACT_KILL_PROCESS, SCMP_SYS(execve), 0);
    if (!fault)
        fault = seccomp_rule_add(filter, SCMP_ACT_KILL_PROCESS, SCMP_SYS(execveat), 0);
    return fault;
}

int confine_network(const char *file)
{
    limit_files(file);
    const scmp_filter_ctx filter = seccomp_init(SCMP_ACT_ERRNO(EPERM));

    if (!filter)
        return ENOSYS;
    int fault = seccomp_attr_set(filter, SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS);
    if (!fault)
        fault = seccomp_attr_set(filter, SCMP_FLTATR_API_SYSRAWRC, 1);
    if (!fault)
        fault = add_rules(filter);
    if (!fault)
        fault = seccomp_load(filter);
    seccomp_release(filter);
    return -fault;
}
