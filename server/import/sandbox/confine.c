#define _GNU_SOURCE /* close_range, setresuid */
#include "import/sandbox/confine.h"

#include <errno.h>
#include <grp.h>
#include <linux/capability.h>
#include <seccomp.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#define NOBODY 65534 /* user and group that own nothing */

/* ---- User and capabilities ---- */

static int capabilities(long call, struct __user_cap_data_struct sets[2])
{
    struct __user_cap_header_struct header = { .version = _LINUX_CAPABILITY_VERSION_3 };

    return syscall(call, &header, sets) == 0 ? 0 : errno;
}

/* Nothing is asked for where there is nothing to drop: a service manager's filter may refuse the call itself. */
static int drop_capabilities(void)
{
    struct __user_cap_data_struct sets[2] = { { 0 } }, none[2] = { { 0 } };
    const int failed = capabilities(SYS_capget, sets);

    return !failed && memcmp(sets, none, sizeof(none)) == 0 ? 0 : capabilities(SYS_capset, none);
}

/* Whether this root may become another user, and its parent, which has the same capabilities, may still end it. */
static bool may_change_user(void)
{
    const uint32_t needed = 1u << CAP_SETUID | 1u << CAP_SETGID | 1u << CAP_KILL;
    struct __user_cap_data_struct sets[2] = { { 0 } };

    return geteuid() == 0 && capabilities(SYS_capget, sets) == 0 && (sets[0].effective & needed) == needed;
}

int confine_user(void)
{
    for (unsigned long k = 0; prctl(PR_CAPBSET_READ, k, 0, 0, 0) >= 0; k++)
        prctl(PR_CAPBSET_DROP, k, 0, 0, 0); /* fails only without CAP_SETPCAP; nothing can be gained without it */
    /* EINVAL: a user namespace that has no such user, whose root is nobody elsewhere. */
    if (may_change_user() &&
        (setgroups(0, NULL) != 0 || setresgid(NOBODY, NOBODY, NOBODY) != 0 || setresuid(NOBODY, NOBODY, NOBODY) != 0) &&
        errno != EINVAL)
        return errno;
    if (prctl(PR_CAP_AMBIENT, PR_CAP_AMBIENT_CLEAR_ALL, 0, 0, 0) != 0)
        return errno;
    const int failed = drop_capabilities();
    if (failed)
        return failed;
    return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || prctl(PR_SET_DUMPABLE, 0, 0, 0, 0) != 0 ? errno : 0;
}

/* ---- Limits ---- */

static bool limit(int what, rlim_t most)
{
    const struct rlimit r = { most, most };

    return setrlimit((__rlimit_resource_t)what, &r) == 0;
}

/* The kernel sends SIGXCPU at the first limit, SIGKILL at the second. */
static bool limit_time(unsigned seconds)
{
    const struct rlimit r = { seconds, (rlim_t)seconds + 2 };

    return setrlimit(RLIMIT_CPU, &r) == 0;
}

int confine_limits(const struct confine_limits *l)
{
    rlim_t address_bytes = l->address_bytes;

    close_range(l->descriptors, ~0u, 0); /* closes descriptors left open by the caller */
#ifdef __SANITIZE_ADDRESS__
    address_bytes = RLIM_INFINITY; /* AddressSanitizer's shadow memory exceeds any limit */
#endif
    const int failed = confine_user();
    if (failed)
        return failed;
    if (!limit(RLIMIT_AS, address_bytes) || !limit_time(l->seconds) ||
        !limit(RLIMIT_NOFILE, l->descriptors + l->received) || !limit(RLIMIT_FSIZE, l->file_bytes) ||
        !limit(RLIMIT_CORE, 0) || (!l->threads && !limit(RLIMIT_NPROC, 0)) || !limit(RLIMIT_MEMLOCK, 0) ||
        !limit(RLIMIT_MSGQUEUE, 0))
        return errno;
    return 0;
}

/* ---- System calls: seccomp ---- */

/* malloc needs getrandom. The masks ignore the upper halves of the int arguments of mmap and mprotect, as the kernel
 * does. */
static int add_rules(scmp_filter_ctx filter, bool receives)
{
    static const int calls[] = {
#ifdef __SANITIZE_ADDRESS__ /* writes its report */
        SCMP_SYS(getpid),
        SCMP_SYS(gettid),
        SCMP_SYS(sched_yield),
        SCMP_SYS(sigaltstack),
        SCMP_SYS(rt_sigprocmask),
        SCMP_SYS(rt_sigaction),
#endif
        SCMP_SYS(read),
        SCMP_SYS(write),
        SCMP_SYS(futex),
        SCMP_SYS(getrandom),
        SCMP_SYS(brk),
        SCMP_SYS(munmap),
        SCMP_SYS(madvise),
        SCMP_SYS(mremap),
        SCMP_SYS(clock_gettime),
        SCMP_SYS(rt_sigreturn),
        SCMP_SYS(restart_syscall),
        SCMP_SYS(exit),
        SCMP_SYS(exit_group)
    };
    static const int more[] = {
        SCMP_SYS(recvmsg), SCMP_SYS(close),
#ifndef __SANITIZE_ADDRESS__
        SCMP_SYS(getpid),  SCMP_SYS(gettid), SCMP_SYS(rt_sigprocmask), /* abort */
#endif
    };
    const struct scmp_arg_cmp itself = SCMP_A0(SCMP_CMP_EQ, (scmp_datum_t)getpid(), 0);
    const struct scmp_arg_cmp not_executed = SCMP_A2(SCMP_CMP_MASKED_EQ, PROT_EXEC, 0),
                              not_a_file = SCMP_A3(SCMP_CMP_MASKED_EQ, MAP_ANONYMOUS, MAP_ANONYMOUS);
    int fault = 0;

    for (size_t i = 0; i < sizeof(calls) / sizeof(calls[0]) && !fault; i++)
        fault = seccomp_rule_add_exact(filter, SCMP_ACT_ALLOW, calls[i], 0);
    if (!fault)
        fault = seccomp_rule_add_exact(filter, SCMP_ACT_ALLOW, SCMP_SYS(mprotect), 1, not_executed);
    if (!fault)
        fault = seccomp_rule_add_exact(filter, SCMP_ACT_ALLOW, SCMP_SYS(mmap), 2, not_executed, not_a_file);
    for (size_t i = 0; receives && i < sizeof(more) / sizeof(more[0]) && !fault; i++)
        fault = seccomp_rule_add_exact(filter, SCMP_ACT_ALLOW, more[i], 0);
    if (receives && !fault)
        fault = seccomp_rule_add_exact(filter, SCMP_ACT_ALLOW, SCMP_SYS(tgkill), 1, itself);
    return fault;
}

static int install(uint32_t otherwise, bool receives)
{
    const scmp_filter_ctx filter = seccomp_init(otherwise);

    if (!filter) /* the kernel does not support that action, or out of memory */
        return ENOSYS;
    int fault = seccomp_attr_set(filter, SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS); /* i386 and x32 calls */
    if (!fault)
        fault = seccomp_attr_set(filter, SCMP_FLTATR_API_SYSRAWRC, 1); /* seccomp_load returns the kernel's errno */
    if (!fault)
        fault = add_rules(filter, receives);
    if (!fault)
        fault = seccomp_load(filter);
    seccomp_release(filter);
    return -fault;
}

int confine_calls(bool receives)
{
    return install(SCMP_ACT_KILL_PROCESS, receives);
}

int confine_calls_softly(void)
{
    return install(SCMP_ACT_ERRNO(EPERM), false);
}
