#define _GNU_SOURCE /* close_range */
#include "import/sandbox/confine.h"

#include <errno.h>
#include <seccomp.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

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
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || prctl(PR_SET_DUMPABLE, 0, 0, 0, 0) != 0)
        return errno;
    if (!limit(RLIMIT_AS, address_bytes) || !limit_time(l->seconds) ||
        !limit(RLIMIT_NOFILE, l->descriptors + l->received) || !limit(RLIMIT_FSIZE, l->file_bytes) ||
        !limit(RLIMIT_CORE, 0) || (!l->threads && !limit(RLIMIT_NPROC, 0)) || !limit(RLIMIT_MEMLOCK, 0) ||
        !limit(RLIMIT_MSGQUEUE, 0))
        return errno;
    return 0;
}

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
